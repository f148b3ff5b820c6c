"""What is said of a calibration: where it comes from, how old it is, how far it has changed."""

from __future__ import annotations

from datetime import datetime

from rig.engine.progress import CalibrationInUse, MeasuredConstant

LARGE = 0.02
"""Two calibrations of one rig agree to some parts in a thousand; a change of 2 % has a cause."""


def relative_change(constant: MeasuredConstant) -> float | None:
    """Return how far a gain has changed, as a share; None for a zero, which may lie anywhere."""
    if constant.name.endswith("_zero_v") or constant.in_use == 0:
        return None
    return constant.value / constant.in_use - 1


def difference_words(constant: MeasuredConstant) -> str:
    """Return how a constant differs from the one in use, in words."""
    share = relative_change(constant)
    if share is None:
        return f"{1e3 * (constant.value - constant.in_use):+.2f} mV"
    return f"{100 * share:+.3f} %"


def in_use_words(item: CalibrationInUse) -> str:
    """Return where the constants in use come from, and how old they are."""
    if not item.calibrated:
        return f"{item.kind}: nominal constants, never measured on this rig"
    days = (datetime.now().astimezone() - datetime.fromisoformat(item.calibrated)).days
    state = ""
    if item.valid_until:
        over = expired(item)
        state = f", EXPIRED on {item.valid_until[:10]}" if over else f", valid until {item.valid_until[:10]}"
    return f"{item.kind}: measured {item.calibrated[:16].replace('T', ' ')}, {days} days ago{state}"


def expired(item: CalibrationInUse) -> bool:
    """Whether a calibration has been valid no longer."""
    return bool(item.valid_until) and datetime.fromisoformat(item.valid_until) < datetime.now().astimezone()


def reminder(calibrations: tuple[CalibrationInUse, ...], *, simulated: bool) -> str:
    """Return what is to be said before a study on these: those that are old or, on a real rig, missing."""
    told = [
        in_use_words(item) for item in calibrations if expired(item) or not (item.calibrated or simulated)
    ]
    return "\n".join(told)
