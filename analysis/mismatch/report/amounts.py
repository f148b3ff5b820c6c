"""How a report gives its numbers: unit, digits and error as a person reads them."""

from __future__ import annotations

import numpy as np

from analysis.mismatch.model.words import spoken
from analysis.mismatch.name.own_sizes import Quantity
from analysis.mismatch.report.contents import Comparison

MANYFOLD = 9.0


def symbol(name: str) -> str:
    """Return a parameter's name without its unit, as it is spoken."""
    for ending in (
        "_mn_per_mm", "_mn_s_per_mm", "_um_per_mn", "_mn_per_s", "_per_mm", "_to_k0", "_rad_s",
        "_mn", "_um", "_mm", "_ms", "_hz", "_s", "_g",
    ):  # fmt: skip
        if name.endswith(ending):
            return spoken(name.removesuffix(ending))
    return spoken(name)


def scaled(value: float, unit: str) -> tuple[float, str]:
    """Return a factor and the unit in which a value (mN or g) is read best; other units stay as they are.

    Forces of other instruments are newtons of a drive or nanonewtons on a cell.
    """
    size = abs(value)
    if unit == "mN" and size >= 1e3:
        return 1e-3, "N"
    if unit == "mN" and 0 < size < 1e-3:
        return 1e6, "nN"
    if unit == "g" and size >= 1e4:
        return 1e-3, "kg"
    return 1.0, unit


def force(value_mn: float, digits: int = 2, *, signed: bool = False) -> str:
    """Return a force with the unit in which it is read best."""
    factor, unit = scaled(value_mn, "mN")
    rounded = float(f"{value_mn * factor:.{digits}g}")
    return f"{rounded:+g} {unit}" if signed else f"{rounded:g} {unit}"


def errors(heldout: Comparison) -> list[str]:
    """Return the error before and after, and its noise, with the digits that tell the first two apart, at least three.

    More than six no sample of single precision has.
    """
    values_mn = heldout.baseline_rms_mn, heldout.improved_rms_mn, heldout.noise_floor_mn
    told = [[force(v, digits) for v in values_mn] for digits in (3, 4, 5, 6)]
    return next((t for t in told if t[0] != t[1]), told[0])


def with_error(q: Quantity) -> str:
    """Return value, error and unit, the value rounded to its error's second digit."""
    factor, scaled_unit = scaled(q.value, q.unit)
    q = Quantity(factor * q.value, factor * q.se, scaled_unit)
    unit = "" if q.unit == "1" else f" {q.unit}"
    if not np.isfinite(q.se) or q.se <= 0:
        return f"{q.value:.4g}{unit}"
    if q.se >= abs(q.value):
        return f"not settled (error {float(f'{q.se:.2g}'):g}{unit})"
    decimals = int(1 - np.floor(np.log10(q.se)))
    if decimals > 5 or decimals < -3 or abs(q.value) >= 1e5:
        return f"{q.value:.5g} ± {q.se:.2g}{unit}"
    return f"{q.value:.{max(decimals, 0)}f} ± {q.se:.{max(decimals, 0)}f}{unit}"


def chance(p_value: float) -> str:
    """Return a p-value as it is read: no more digits than it deserves."""
    return "< 0.0001" if p_value < 1e-4 else f"{p_value:.1g}"


def change_in_percent(change: float) -> str:
    """Return a relative change in per cent, two digits, as it is read; as a factor where per cent say nothing."""
    if change > MANYFOLD:
        return f"a factor of {float(f'{1.0 + change:.2g}'):g}"
    return f"{float(f'{100 * change:.2g}'):+g} %"


def percent(share: float) -> str:
    """Return a share in per cent, with the digits that tell it from all and from nothing."""
    if share >= 1.0 or share <= 0.0:
        return f"{100 * share:.0f} %"
    if share > 0.9995:
        return "> 99.9 %"
    return f"{100 * share:.1f} %" if share > 0.99 else f"{float(f'{100 * share:.2g}'):g} %"
