"""Protocols run on the simulated bench through the driver's own client, and leave what they should."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.recordings import mark_discarded, read_trial
from rig.engine.errors import SurfaceNotFoundError
from rig.engine.interrupts import Interrupted, Interrupts
from rig.engine.progress import Snapshot
from rig.engine.states import State
from rig.hardware.errors import LimitHit, RetreatFailedError

QUICK = "[surface]\nstart_mm = 2.5\n[indentation]\ndwell_s = 0.2\nhold_s = 0.5\n"
ONE = 'kind = "ramp_hold_retract"\n' + QUICK + "depth_mm = 0.4\n"
STUDY = (
    'kind = "study"\n[study]\nfingers = ["index", "ring"]\ndepths_mm = [0.2, 0.6]\nrepeats = 1\n'
    "rest_s = 150.0\n" + QUICK
)


def test_an_indentation(bench: Any, witness: Any, tmp_path: Path) -> None:
    seen = witness()
    bench.run(ONE, tmp_path, witness=seen)
    trial = read_trial(tmp_path / "index_0.40mm.h5")
    assert trial.status == "complete"
    assert trial.kind == "ramp_hold_retract"
    assert trial.source == "simulated"
    assert [p.name for p in trial.phases] == ["approach", "dwell", "ramp", "hold", "retract", "clear"]
    for before, after in pairwise(trial.phases):
        assert before.stop == after.start
    assert trial.phases[-1].stop == trial.n_samples == seen.samples
    rate = trial.sample_rate_hz
    durations = {p.name: (p.stop - p.start) / rate for p in trial.phases}
    assert durations["dwell"] == pytest.approx(0.2, abs=0.05)
    assert durations["hold"] == pytest.approx(0.5, abs=0.05)
    assert durations["ramp"] == pytest.approx(0.4 / 5.0, abs=0.003)
    assert trial.protocol.toml == ONE
    assert {e.kind for e in trial.events} == {"threshold", "contact"}, (
        "the loop-back is wired: nothing is unsure"
    )
    assert seen.states == [
        State.PREPARING,
        State.POSITIONING,
        State.APPROACHING,
        State.DWELLING,
        State.RAMPING,
        State.HOLDING,
        State.RETRACTING,
        State.CLEARING,
        State.LEAVING,
        State.SAVED,
        State.FINISHED,
    ]
    assert bench.safe


def test_what_the_trial_says_is_what_the_arm_did(bench: Any, tmp_path: Path) -> None:
    bench.run(ONE, tmp_path)
    trial = read_trial(tmp_path / "index_0.40mm.h5")
    position, force = trial.position_mm, trial.force_mn
    surface = trial.surface
    assert surface is not None
    ramp, hold, clear = trial.phase("ramp"), trial.phase("hold"), trial.phase("clear")
    assert ramp is not None
    assert hold is not None
    assert clear is not None
    held = np.mean(position[hold.start + 80 : hold.stop - 80])
    # the true slope of this bench differs from the nominal by a few percent, nothing else may
    assert held - surface.position_mm == pytest.approx(0.4, rel=0.05)
    at_rest = np.mean(position[ramp.start - 160 : ramp.start])
    assert 1e3 * (at_rest - surface.position_mm) == pytest.approx(surface.overshoot_um, abs=0.3)
    assert 0 < surface.overshoot_um < 15
    # the position begins to move where the ramp phase says, within the servo's lag
    moved = np.flatnonzero(position[ramp.start - 40 : ramp.stop] > at_rest + 0.003)[0] - 40
    assert 0 <= moved <= 16
    assert np.abs(np.mean(force[clear.samples])) < 3.0
    assert np.max(force) > 20.0


def test_a_study_with_rests_in_no_time(bench: Any, witness: Any, tmp_path: Path) -> None:
    seen = witness()
    done = bench.run(STUDY, tmp_path, witness=seen)
    trials = [read_trial(recorded.task.path) for recorded in done]
    assert len(trials) == 4
    assert trials[0].specimen.rest_s is None
    for trial in trials[1:]:
        assert trial.specimen.rest_s is not None
        assert 150.0 <= trial.specimen.rest_s < 160.0
    assert [t.specimen.finger for t in trials] == ["index", "index", "ring", "ring"]
    assert [t.specimen.site for t in trials] == ["1", "2", "1", "2"]
    assert [t.protocol.depth_mm for t in trials] == [0.2, 0.6, 0.2, 0.6]
    left = [s.left_s for s in seen.snapshots]
    assert left[0] > 3 * 150
    assert left[-1] < 1
    assert State.RESTING in seen.states


@pytest.mark.parametrize("state", [State.APPROACHING, State.HOLDING])
def test_a_stop_in_the_midst_of_a_motion_is_no_fault(
    bench: Any, witness: Any, tmp_path: Path, state: State
) -> None:
    interrupts = Interrupts()
    seen = witness()
    follow = seen.follow
    left = [1200]  # samples into the state: the arm moves by then

    def stop_in_the_midst(chunk: Any) -> None:
        follow(chunk)
        if seen.states and seen.states[-1] is state and left[0] > 0:
            left[0] -= chunk.n
            if left[0] <= 0:
                interrupts.request()

    seen.follow = stop_in_the_midst
    with pytest.raises(Interrupted):
        bench.run(STUDY, tmp_path, witness=seen, interrupts=interrupts)
    assert seen.states[-2:] == [State.LEAVING, State.STOPPED]
    assert bench.safe
    cut_off = read_trial(next(tmp_path.glob("*.h5")))
    assert cut_off.status == "aborted"
    assert "stopped by the operator" in cut_off.status_reason


def test_stop_and_go_on(bench: Any, witness: Any, tmp_path: Path) -> None:
    interrupts = Interrupts()

    def stop_in_the_second_dwell(snapshot: Snapshot) -> None:
        if snapshot.trial_number == 2 and snapshot.state is State.DWELLING:
            interrupts.request()

    seen = witness(at=stop_in_the_second_dwell)
    with pytest.raises(Interrupted):
        bench.run(STUDY, tmp_path, witness=seen, interrupts=interrupts)
    assert seen.states[-2:] == [State.LEAVING, State.STOPPED]
    assert bench.safe
    names = sorted(p.name for p in tmp_path.glob("*.h5"))
    assert names == ["001_index_0.20mm_r1.h5", "002_index_0.60mm_r1.h5"]
    cut_off = read_trial(tmp_path / names[1])
    assert cut_off.status == "aborted"
    assert "stopped by the operator" in cut_off.status_reason
    assert [p.name for p in cut_off.phases] == ["approach", "dwell"]
    assert cut_off.n_samples - cut_off.phases[-1].stop <= 0.1 * cut_off.sample_rate_hz

    mark_discarded(tmp_path / names[0], "the finger moved")
    seen = witness()
    bench.run(STUDY, tmp_path, witness=seen)
    made = {s.trial for s in seen.snapshots if s.state is State.SAVED}
    assert made == {
        "001_index_0.20mm_r1",
        "002_index_0.60mm_r1",
        "003_ring_0.20mm_r1",
        "004_ring_0.60mm_r1",
    }
    again = read_trial(tmp_path / "002_index_0.60mm_r1_again2.h5")
    assert again.status == "complete"
    assert again.specimen.site == "2-2", "never the same place twice"
    assert read_trial(tmp_path / names[0]).discarded == "the finger moved"
    assert read_trial(tmp_path / "001_index_0.20mm_r1_again2.h5").status == "complete"
    assert bench.run(STUDY, tmp_path) == [], "nothing is left to do"


def test_a_limit_hit_retracts_and_is_told_in_the_file(bench_of: Callable[[str], Any], tmp_path: Path) -> None:
    stiff = "[companion.settings.tissue]\nk0_mn_per_mm = 2000.0\n"
    with bench_of(stiff) as running:
        with pytest.raises(LimitHit, match="force limit hit"):
            running.run(ONE, tmp_path)
        assert running.safe
        trial = read_trial(tmp_path / "index_0.40mm.h5")
        assert trial.status == "aborted"
        assert "limit" in trial.status_reason
        limits = [e for e in trial.events if e.kind == "limit"]
        assert len(limits) == 1
        assert limits[0].sample < trial.n_samples - 1000, "what followed is recorded too"
        assert trial.phases[-1].stop <= limits[0].sample, "the way out belongs to no phase"
        assert np.mean(trial.force_mn[-400:]) < 10.0
        # and the bench is good for another run
        running.run(ONE.replace("depth_mm = 0.4", "depth_mm = 0.05"), tmp_path / "more")


def test_the_arm_is_out_of_the_way_before_hands_are_asked_for(
    bench: Any, witness: Any, tmp_path: Path
) -> None:
    lever = bench.bench.lever
    bench.bench.operator.request("clear_air", {})
    lever.start_recording()
    playback = lever.play(np.linspace(lever.commanded_mm, 5.0, 2400))
    while not playback.done:
        lever.read(80)
    lever.stop_recording()
    assert not bench.safe
    safe: list[bool] = []
    seen = witness(at=lambda snapshot: safe.append(bench.safe) if snapshot.state is State.PREPARING else None)
    bench.run(ONE, tmp_path, witness=seen)
    assert safe
    assert all(safe)


def test_an_unplugged_card_is_told_with_how_it_began(
    bench_of: Callable[[str], Any], witness: Any, tmp_path: Path
) -> None:
    told = "lift it by hand.*it began with.*-201003.*the card is gone"
    with pytest.raises(RetreatFailedError, match=told), bench_of("") as running:

        def unplug(snapshot: Snapshot) -> None:
            if snapshot.state is State.HOLDING:
                running.control.call("fault", "unplug", {})

        running.run(ONE, tmp_path, witness=witness(at=unplug))
    trial = read_trial(tmp_path / "index_0.40mm.h5")
    assert trial.status == "aborted"
    assert "-201003" in trial.status_reason


def test_no_skin_is_an_error_that_leaves_the_arm_safe(bench: Any, tmp_path: Path) -> None:
    toml = 'kind = "surface_detection"\n[surface]\nstart_mm = 8.0\napproach_speed_mm_s = 5.0\n'
    bench.bench.operator.request("clear_air", {})

    class NoHands:
        def request(self, kind: str, details: object) -> str:
            return "nothing done"

    from dataclasses import replace

    blind = type(bench)(replace(bench.bench, operator=NoHands()), bench.control)
    with pytest.raises(SurfaceNotFoundError, match="no contact"):
        blind.run(toml, tmp_path)
    assert bench.safe
    assert read_trial(tmp_path / "surface.h5").status == "aborted"


def test_air_sweep_has_one_phase_there_and_back(bench: Any, tmp_path: Path) -> None:
    bench.run('kind = "air_sweep"\nsweep_speeds_mm_s = [20.0, 40.0]\nstart_mm = 2.0\nstop_mm = 6.0', tmp_path)
    trials = [read_trial(p) for p in sorted(tmp_path.glob("*.h5"))]
    assert len(trials) == 2
    for trial, speed in zip(trials, (20.0, 40.0), strict=True):
        assert [p.name for p in trial.phases] == ["sweep"]
        sweep = trial.phases[0]
        assert (sweep.stop - sweep.start) / trial.sample_rate_hz == pytest.approx(8.0 / speed, rel=0.01)
        assert np.max(trial.position_mm) - np.min(trial.position_mm) == pytest.approx(4.0, rel=0.05)
        assert trial.protocol.ramp_speed_mm_s == speed
    assert bench.safe


def test_rigid_target(bench: Any, tmp_path: Path) -> None:
    bench.run(
        'kind = "rigid_target"\n[surface]\nstart_mm = 4.4\napproach_speed_mm_s = 0.2\n[indentation]\n'
        "depth_mm = 0.005\nramp_speed_mm_s = 0.5\ndwell_s = 0.1\nhold_s = 0.2\n",
        tmp_path,
    )
    trial = read_trial(tmp_path / "block.h5")
    assert trial.kind == "rigid_target"
    assert 80 < float(np.max(trial.force_mn)) < 400
    assert trial.surface is not None
    assert trial.surface.overshoot_um < 4


def test_a_file_that_stands_there_is_never_overwritten(bench: Any, tmp_path: Path) -> None:
    bench.run(ONE, tmp_path)
    before = (tmp_path / "index_0.40mm.h5").read_bytes()
    assert bench.run(ONE, tmp_path) == []
    assert (tmp_path / "index_0.40mm.h5").read_bytes() == before


def test_an_observer_that_breaks_or_hangs_is_left_behind(bench: Any, witness: Any, tmp_path: Path) -> None:
    def fail(snapshot: Snapshot) -> None:
        if snapshot.state is State.DWELLING:
            raise OSError("the screen is gone")
        if snapshot.state is State.HOLDING:
            hung.set()
            threading.Event().wait(30)

    hung = threading.Event()
    began = time.monotonic()
    bench.run(ONE, tmp_path, witness=witness(at=fail), patience_s=0.05)
    assert hung.is_set()
    assert time.monotonic() - began < 25
    assert bench.safe
    assert read_trial(tmp_path / "index_0.40mm.h5").status == "complete"
