"""Which estimates a recording tells, and which are only where a search happened to stop.

A time that ends at a bound of the search, or whose logarithm is known to no better than a half, is not
measured: neither it nor its amplitude is printed, tabled or averaged. The row says instead why.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.result import Estimate, TrialFit
from analysis.relaxation.windows import CannotFitError, FitWindow

_LEAST_KNOWN = 0.5  # standard error of a time's logarithm, or of A0 over A0, beyond which it is not known
_LEAST_ELASTIC = 1e-3  # of the instantaneous stiffness


def without_untold(
    row: TrialFit, times_s: FloatArray, log_errors: FloatArray, at_bound: Sequence[bool]
) -> TrialFit:
    """Return the row with what is told alone among its estimates; CannotFitError where that is nothing.

    ``times_s``, ``log_errors`` and ``at_bound`` (n_arms,), longest time first, as the estimates have them.
    """
    untold: dict[str, str] = {}
    for i, (tau_s, error, stopped) in enumerate(
        zip(times_s.tolist(), log_errors.tolist(), at_bound, strict=True)
    ):
        if stopped:
            reason = f"the search for t{i + 1} ended at its bound, {tau_s:.3g} s"
        elif not error < _LEAST_KNOWN:
            reason = _unknown_time(i + 1, times_s)
        else:
            continue
        untold[f"t{i + 1}_s"] = untold[f"A{i + 1}_over_A0"] = reason
    a0 = row.estimates["A0_mn"]
    if not abs(a0.se) < _LEAST_KNOWN * abs(a0.value):
        reason = "the elastic part is known to no better than half of itself"
        untold |= {name: reason for name in row.estimates if not name.endswith("_s") and name not in untold}
    told = {name: estimate for name, estimate in row.estimates.items() if name not in untold}
    if not told:
        reasons = "; ".join(dict.fromkeys(untold.values()))
        raise CannotFitError(
            f"the recording tells none of the solid's constants ({reasons}): a longer hold, faster sampling "
            "or a deeper press tells more"
        )
    exponent = row.exponent if row.exponent is not None and row.exponent.se < _LEAST_KNOWN else None
    stiffness = row.stiffness_mn_per_um if "A0_mn" in told else None
    return replace(row, estimates=told, untold=untold, exponent=exponent, stiffness_mn_per_um=stiffness)


def _unknown_time(number: int, times_s: FloatArray) -> str:
    longest, shortest = float(times_s.max()), float(times_s.min())
    if len(times_s) > 1 and longest < 1.5 * shortest:
        return "one time says the hold as well as two: they can't be told apart"
    return f"t{number} is known to no better than a factor of {np.exp(2.0 * _LEAST_KNOWN):.2g}"


def check_elastic(share: float, window: FitWindow, of_hold: Estimate | None) -> None:
    """Raise CannotFitError with what the recording shows where A0 is next to nothing of the whole.

    ``share`` is that of A0 in the force of an ideal step; ``of_hold`` is A0 as the hold alone has it, mN,
    None where the hold has none either (or it was the hold alone that was fitted).
    """
    if share > _LEAST_ELASTIC:
        return
    if of_hold is not None:
        raise CannotFitError(
            "the way in and the hold are not those of one solid of two relaxation times: the hold alone "
            f"levels off (at {of_hold.value:.3g} mN), the two together would not: see what --model step says, "
            "and whether position and force are of the same instant"
        )
    falling, seconds = still_falling(window)
    raise CannotFitError(
        f"no elastic part can be told: the force still falls at the end of the hold of {window.hold_s:.3g} s "
        f"(by {100 * falling:.2g} % of what it fell in the hold, in the last {seconds:.3g} s): hold longer"
        if falling > 0
        else "no elastic part can be told: the force does not level off as springs and dashpots would, "
        "nor does it still fall: look for drift of the sensor, or a change of control in the hold"
    )


def still_falling(window: FitWindow) -> tuple[float, float]:
    """Return what share of the hold's fall lies in its last quarter, 0 where noise hides it, and how long that is."""
    force_mn = window.force_mn[window.hold_start :]
    n = len(force_mn)
    third, last = force_mn[n // 2 : 3 * n // 4], force_mn[3 * n // 4 :]
    fell_mn = float(np.mean(third) - np.mean(last))
    rough = float(np.std(np.diff(force_mn))) / np.sqrt(2.0)
    noise_mn = rough * float(np.sqrt(1.0 / len(third) + 1.0 / len(last)))
    whole_mn = float(np.max(force_mn[: max(1, n // 50)]) - np.mean(last))
    seconds = window.hold_s / 4.0
    return (fell_mn / whole_mn, seconds) if fell_mn > 3.0 * noise_mn and whole_mn > 0 else (0.0, seconds)
