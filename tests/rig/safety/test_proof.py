"""Whatever is wrong with wires or constants before the arm moves: it is refused, and nothing is on the finger."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from analysis.errors import BadInputError
from analysis.recordings.trial import Calibration
from rig.hardware.errors import ArmNotProvenError
from rig.settings.rig_file import CalibrationSettings

NOMINAL = CalibrationSettings().nominal()
ONE = 'kind = "surface_detection"\n[surface]\nstart_mm = 2.5\n'


def refused(bench: Any, words: str, *, calibration: Calibration = NOMINAL, within_mm: float = 0.0) -> None:
    bench.call("request", "place_finger", {"finger": "index", "site": "1", "repeat": 1})
    before = bench.call("arm")
    with pytest.raises(ArmNotProvenError, match=words) as caught:
        bench.run(ONE, calibration=calibration)
    assert "\n" not in str(caught.value)
    assert bench.call("arm")["position_mm"] == pytest.approx(before["position_mm"], abs=within_mm + 1e-3)
    assert bench.largest_force_mn() == 0.0


@pytest.mark.parametrize(
    ("line", "gain", "offset_v", "words"),
    [
        ("position", 0.0, 0.0, "the position signal says 4.90 mm, the loop-back of the command"),
        ("position", 0.0, 10.0, "the position signal says 9.79 mm, the loop-back of the command"),
        ("position", -1.0, 0.0, "the position signal says 9.5"),
        ("loopback", 0.0, 0.0, "the loop-back of the command 4.90 mm"),
        ("force", 0.0, 0.0, "its line is dead"),
        ("force", 0.0, 4.0, "its line is dead"),
        ("force", 0.1, 0.0, "its line is dead, or its gain wrong"),
        ("force", 30.0, 0.0, "its line is open, or its gain wrong"),
    ],
)
def test_a_line_that_is_wrong_is_refused_before_anything_moves(
    bench: Any, line: str, gain: float, offset_v: float, words: str
) -> None:
    bench.fault("wire", line=line, gain=gain, offset_v=offset_v)
    refused(bench, words)


@pytest.mark.parametrize(
    "wrong",
    [
        {"volts_per_mm": -2.042},
        {"volts_per_mm": -2.042, "position_zero_v": -9.0},
        {"command_volts_per_mm": -2.042},
        {
            "volts_per_mm": -2.042,
            "position_zero_v": 10.0,
            "command_volts_per_mm": -2.042,
            "command_zero_v": 10.0,
        },
        {"volts_per_mn": 0.15},
        {"volts_per_mn": 0.45},
        {"volts_per_mn": -0.015},
        {"volts_per_mm": 20.42},
    ],
)
def test_constants_that_are_wrong_are_refused_before_anything_moves(
    bench: Any, wrong: dict[str, float]
) -> None:
    refused(bench, "the constants are not those of this lever", calibration=replace(NOMINAL, **wrong))


@pytest.mark.parametrize(
    "wrong", ["volts_per_mm = -2.042", "command_volts_per_mm = -2.042", "volts_per_mn = 0.15"]
)
def test_a_rig_file_with_such_constants_is_refused(bench: Any, wrong: str) -> None:
    with pytest.raises(BadInputError, match="is not within 20%"):
        bench.run(ONE, rig=bench.rig_toml(f"[calibration]\n{wrong}\n"))


def test_a_position_that_runs_backwards_is_seen_by_the_probe(bench: Any) -> None:
    """At rest it agrees: only a motion tells the sign."""
    bench.run(ONE)
    bench.largest_force_mn()
    bench.fault("wire", line="position", gain=-1.0, offset_v=2 * (0.5 * 2.042 - 10.0))
    refused(bench, r"sent by -0.050 mm the arm moved by \+0.0", within_mm=0.05)


def test_a_position_that_does_not_move_is_seen_by_the_probe(bench: Any) -> None:
    bench.run(ONE)
    bench.largest_force_mn()
    bench.fault("wire", line="position", gain=0.0, offset_v=0.5 * 2.042 - 10.0)
    refused(bench, r"sent by -0.050 mm the arm moved by [+-]0.0000 mm", within_mm=0.05)


def test_a_force_that_is_none_of_a_free_arm_is_refused(bench: Any) -> None:
    bench.fault("wire", line="force", offset_v=1.0)
    refused(bench, "the force at the safe position is 6. mN", within_mm=0.3)


def test_without_a_loopback_an_arm_elsewhere_is_not_moved(bench: Any) -> None:
    bench.fault("wire", line="position", gain=0.0)
    with pytest.raises(ArmNotProvenError, match="no loop-back says what the arm is commanded to"):
        bench.run(ONE, rig=bench.rig_toml(wired=False))
    assert bench.largest_force_mn() == 0.0


@pytest.mark.parametrize(
    ("protocol", "words"),
    [
        (ONE + "approach_speed_mm_s = 100.0\n", "faster than"),
        (
            'kind = "ramp_hold_retract"\n[indentation]\ndepth_mm = 5.0\n',
            "deeper than this rig's lever.depth_max_mm",
        ),
    ],
)
def test_a_protocol_that_asks_for_too_much_is_refused(bench: Any, protocol: str, words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        bench.run(protocol)
