"""Whether constants can be those of this lever: a sign or a factor that is wrong drives the arm into the finger."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.recordings.trial import Calibration
    from rig.settings.rig_file import LeverSettings

TOLERANCE = 0.20
"""Levers of one make, and calibrations of one lever, differ by a few percent."""

ZERO_TOLERANCE_V = 1.0
"""Half a millimetre of the lever, or 67 mN: no zero of a whole rig is measured so far from where it was set."""


def constants_problem(calibration: Calibration, lever: LeverSettings) -> str | None:
    """Say which constant is not within 20 % of what the lever's maker states, sign included; None if all are."""
    nominal = {
        "volts_per_mm": lever.nominal_volts_per_mm,
        "command_volts_per_mm": lever.nominal_volts_per_mm,
        "volts_per_mn": lever.nominal_volts_per_mn,
    }
    for name, expected in nominal.items():
        value = getattr(calibration, name)
        if not abs(value - expected) <= TOLERANCE * abs(expected):
            key = "nominal_volts_per_mn" if name == "volts_per_mn" else "nominal_volts_per_mm"
            return (
                f"{name} = {value:g} is not within {TOLERANCE:.0%} of the lever's {expected:g} "
                f"(lever.{key}), sign included"
            )
    return None


def difference_problem(calibration: Calibration, rig: Calibration) -> str | None:
    """Say which constant of a calibration is too far from this rig's own; None if all are near."""
    for name in ("volts_per_mm", "command_volts_per_mm", "volts_per_mn"):
        value, expected = getattr(calibration, name), getattr(rig, name)
        if not abs(value - expected) <= TOLERANCE * abs(expected):
            return f"{name} = {value:g} is not within {TOLERANCE:.0%} of the rig file's {expected:g}"
    for name in ("position_zero_v", "command_zero_v", "force_zero_v"):
        value, expected = getattr(calibration, name), getattr(rig, name)
        if not abs(value - expected) <= ZERO_TOLERANCE_V:
            return f"{name} = {value:g} is not within {ZERO_TOLERANCE_V:g} V of the rig file's {expected:g}"
    return None
