"""Faults while the arm moves: how much the finger feels of them, judged by the bench itself."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

from analysis.recordings import read_trial
from rig.engine.errors import ContactLostError, ContactTooEarlyError, OvershotError
from rig.engine.interrupts import Interrupts
from rig.engine.runner import Runner, Task
from rig.engine.session import open_bench
from rig.errors import RigError
from rig.hardware.errors import LimitHit, LimitRefusedError, RetreatFailedError
from rig.hardware.lever import Lever
from rig.hardware.retreat import straight_mm
from rig.protocols.planning import plan_of
from rig.settings.reading import parse_protocol, parse_rig

BEFORE_CONTACT_MN = 25.0
SURFACE = 'kind = "surface_detection"\n[surface]\nstart_mm = 2.5\n'
ONE = (
    'kind = "ramp_hold_retract"\n[surface]\nstart_mm = 2.5\n'
    "[indentation]\ndepth_mm = 0.8\ndwell_s = 0.3\nhold_s = 1.0\n"
)
FORCE_DEAD = {"line": "force", "gain": 0.0}


@pytest.fixture(scope="module")
def asked_mn(good_run_mn: Callable[[str], float]) -> float:
    """The most that the finger feels of a run without a fault, mN."""
    return good_run_mn(ONE)


def test_a_good_run_is_within_what_the_protocol_asks_for(bench: Any) -> None:
    trial = read_trial(bench.run(ONE))
    assert trial.status == "complete"
    assert bench.largest_force_mn() == pytest.approx(trial.force_mn.max(), rel=0.05)
    assert bench.clear


@pytest.mark.parametrize("state", ["approaching", "dwelling", "ramping", "holding"])
def test_a_force_line_that_goes_dead_reverses_the_arm(
    bench: Any, witness: Any, state: str, asked_mn: float
) -> None:
    seen = witness(state, lambda: bench.fault("wire", **FORCE_DEAD))
    with pytest.raises(LimitHit, match="the force signal went dead"):
        bench.run(ONE, witness=seen)
    allowed_mn = BEFORE_CONTACT_MN if state == "approaching" else asked_mn + 15.0
    assert bench.largest_force_mn() < allowed_mn
    assert bench.clear
    assert read_trial(next((bench.folder / "out").glob("*.h5"))).status == "aborted"


@pytest.mark.parametrize("state", ["approaching", "holding"])
def test_a_force_line_that_loses_most_of_its_gain_reverses_the_arm(
    bench: Any, witness: Any, state: str, asked_mn: float
) -> None:
    """It is alive, and still not the line that was proven: the skin would be found far too deep."""
    seen = witness(state, lambda: bench.fault("wire", line="force", gain=0.3))
    with pytest.raises(LimitHit, match="the force signal went dead"):
        bench.run(ONE, witness=seen)
    assert bench.largest_force_mn() < (BEFORE_CONTACT_MN if state == "approaching" else asked_mn + 15.0)
    assert bench.clear


def test_what_a_force_line_may_lose_of_its_gain_does_not_press_the_finger(
    bench: Any, witness: Any, asked_mn: float
) -> None:
    seen = witness("approaching", lambda: bench.fault("wire", line="force", gain=0.6))
    bench.run(SURFACE, witness=seen)
    assert 10.0 < bench.largest_force_mn() < BEFORE_CONTACT_MN
    bench.fault("mend")
    seen = witness("approaching", lambda: bench.fault("wire", line="force", gain=0.6))
    bench.run(ONE, witness=seen, name="pressed")
    assert bench.largest_force_mn() < asked_mn + 15.0


@pytest.mark.parametrize("line", ["position", "loopback"])
@pytest.mark.parametrize("state", ["approaching", "holding", "retracting"])
def test_a_line_that_goes_dead_does_not_press_the_finger(
    bench: Any, witness: Any, asked_mn: float, state: str, line: str
) -> None:
    seen = witness(state, lambda: bench.fault("wire", line=line, gain=0.0))
    with pytest.raises(RigError, match=r"lift it by hand|limit hit|loopback_channel"):
        bench.run(ONE, witness=seen)
    allowed_mn = BEFORE_CONTACT_MN if state == "approaching" else asked_mn + 15.0
    assert bench.largest_force_mn() < allowed_mn
    assert bench.clear


def test_a_force_that_is_cut_off_is_no_force(bench: Any, asked_mn: float) -> None:
    bench.fault("wire", line="force", high_v=0.9)
    with pytest.raises(LimitHit, match="went dead"):
        bench.run(ONE)
    assert bench.largest_force_mn() < asked_mn + 15.0
    assert bench.clear


def test_what_is_met_on_the_way_to_the_start_stops_the_arm(bench: Any) -> None:
    # the skin of this bench lies between 3 and 6 mm
    with pytest.raises(ContactTooEarlyError, match="the arm met something"):
        bench.run(SURFACE.replace("2.5", "8.0"))
    assert 10.0 < bench.largest_force_mn() < BEFORE_CONTACT_MN
    assert bench.clear


def test_a_surface_that_is_overshot_by_too_much_is_no_trial(bench: Any) -> None:
    with pytest.raises(OvershotError, match="overshot by"):
        bench.run(ONE, rig=bench.rig_toml("[lever]\novershoot_max_um = 0.5\n"))
    assert read_trial(next((bench.folder / "out").glob("*.h5"))).status == "aborted"
    assert bench.clear


def test_a_ramp_does_not_run_backwards(bench: Any) -> None:
    with pytest.raises(OvershotError, match="deeper than the depth"):
        bench.run(ONE.replace("0.8", "0.0005"))
    assert bench.clear


def test_the_surface_that_was_found_says_how_deep_the_arm_may_go(bench: Any) -> None:
    """A protocol that was not checked against the rig is held to its depth all the same."""
    plan = plan_of(parse_protocol(ONE, "test"), 0.5, ONE)
    settings = parse_rig(bench.rig_toml("[lever]\ndepth_max_mm = 0.3\n"), "rig.toml")
    tasks = [Task(plan.trials[0], bench.folder / "one.h5")]
    with (
        pytest.raises(LimitRefusedError, match=r"lever\.depth_max_mm allows below the surface found"),
        open_bench(settings, settings.calibration.nominal()) as opened,
    ):
        Runner(opened, Interrupts()).run(plan, tasks, bench.folder)
    assert bench.clear


def test_a_finger_that_leaves_in_the_hold_is_seen(bench: Any, witness: Any) -> None:
    seen = witness("holding", lambda: bench.call("request", "remove_finger", {}))
    with pytest.raises(ContactLostError, match="left the punch in the hold"):
        bench.run(ONE, witness=seen)
    assert read_trial(next((bench.folder / "out").glob("*.h5"))).status == "aborted"


@pytest.mark.parametrize("stall_s", [0.05, 0.3, 1.5])
def test_a_card_server_that_stands_still_in_the_approach(
    real_bench: Any, witness: Any, stall_s: float
) -> None:
    def stall() -> None:
        threading.Timer(0.6, lambda: real_bench.fault("stall", duration_s=stall_s)).start()

    path = real_bench.run(SURFACE, witness=witness("approaching", stall))
    trial = read_trial(path)
    assert trial.status == "complete"
    assert trial.surface is not None
    assert trial.surface.overshoot_um < 60.0
    assert real_bench.largest_force_mn() < BEFORE_CONTACT_MN
    assert real_bench.clear


def test_a_long_hold_is_not_rewritten_with_the_punch_in_the_skin(bench: Any, witness: Any) -> None:
    files: dict[str, int] = {}
    path = bench.folder / "out" / "index_0.80mm.h5"

    def note(name: str) -> None:
        files[name] = path.stat().st_ino

    seen = witness("approaching", lambda: note("approaching"))
    later = witness("retracting", lambda: note("retracting"))
    show = seen.show
    seen.show = lambda snapshot: (show(snapshot), later.show(snapshot))  # type: ignore[assignment]
    trial = read_trial(bench.run(ONE.replace("hold_s = 1.0", "hold_s = 60.0"), witness=seen))
    assert files["approaching"] == files["retracting"]
    dwell = trial.phase("dwell")
    assert dwell is not None
    assert (dwell.stop - dwell.start) / 8000.0 == pytest.approx(0.3, abs=0.06)


def test_the_overshoot_is_taken_off_the_depth(bench: Any) -> None:
    trial = read_trial(bench.run(ONE))
    dwell, hold, command_mm = trial.phase("dwell"), trial.phase("hold"), trial.command_mm
    assert dwell is not None
    assert hold is not None
    assert command_mm is not None
    assert trial.surface is not None
    pressed_mm = command_mm[hold.samples].mean() - command_mm[dwell.start + 200 : dwell.stop - 8].mean()
    # how far it went on is a matter of when the samples were read: 4 um as a rule, below 1 um at times
    assert 1e3 * (0.8 - pressed_mm) == pytest.approx(trial.surface.overshoot_um, abs=0.3)


def test_an_arm_that_does_not_come_to_safety_is_told(bench: Any) -> None:
    settings = parse_rig(bench.rig_toml(), "rig.toml")
    with Lever(settings, settings.card.address, settings.calibration.nominal()) as lever:
        lever.retreat()
        lever.start_recording()
        playback = lever.play(straight_mm(lever.commanded_mm, 2.0, speed_mm_s=20.0, rate_hz=8000.0))
        while not playback.done:
            lever.read(80)
        bench.fault("wire", line="position", gain=0.0, offset_v=2.0 * 2.042 - 10.0)
        assert lever._recorder is not None
        with pytest.raises(RetreatFailedError, match=r"instead of 0\.5 mm"):
            lever._brake.retreat(lever._recorder)
        bench.fault("mend")
    assert bench.clear
