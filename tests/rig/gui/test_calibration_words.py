"""What is said of a calibration: its age, its end, how far it has changed."""

from __future__ import annotations

from datetime import datetime, timedelta

from rig.engine.progress import CalibrationInUse, MeasuredConstant
from rig.gui.calibration_words import difference_words, expired, in_use_words, relative_change, reminder

NOW = datetime.now().astimezone()
NEVER = CalibrationInUse("position")


def measured(days_ago: float, valid_days: float) -> CalibrationInUse:
    then = NOW - timedelta(days=days_ago)
    return CalibrationInUse("force", then.isoformat(), (then + timedelta(days=valid_days)).isoformat())


def test_age_and_end() -> None:
    assert "12 days ago, valid until" in in_use_words(measured(12.5, 30))
    assert "EXPIRED" in in_use_words(measured(31, 30))
    assert "never measured" in in_use_words(NEVER)
    assert [expired(item) for item in (NEVER, measured(1, 30), measured(31, 30))] == [False, False, True]


def test_what_is_said_before_a_study() -> None:
    assert reminder((measured(1, 30),), simulated=False) == ""
    assert "EXPIRED" in reminder((measured(31, 30),), simulated=True)
    assert "never measured" in reminder((NEVER,), simulated=False)
    assert reminder((NEVER,), simulated=True) == "", "the simulated rig's nominal constants are its own"


def test_how_far_it_has_changed() -> None:
    gain = MeasuredConstant("volts_per_mn", 0.0153, 1e-5, 0.015)
    zero = MeasuredConstant("force_zero_v", 0.012, 1e-4, 0.0)
    assert abs((relative_change(gain) or 0) - 0.02) < 1e-9
    assert difference_words(gain) == "+2.000 %"
    assert relative_change(zero) is None
    assert difference_words(zero) == "+12.00 mV"
