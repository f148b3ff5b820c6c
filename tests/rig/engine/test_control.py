"""What is asked of a run from outside: prompts, pause, skip, repeat, discard, retreat, stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from analysis.recordings import read_trial
from rig.engine.control import Control
from rig.engine.interrupts import Interrupted, Interrupts
from rig.engine.progress import Snapshot
from rig.engine.prompts import Desk, Prompt
from rig.engine.requests import make_request
from rig.engine.states import State
from rig.hardware.clock import SystemClock
from rig.hardware.errors import OperatorError

QUICK = "[surface]\nstart_mm = 2.5\n[indentation]\ndwell_s = 0.2\nhold_s = 0.5\n"
STUDY = (
    'kind = "study"\n[study]\nfingers = ["index"]\ndepths_mm = [0.2, 0.4]\nrepeats = 1\nrest_s = 150.0\n'
    + QUICK
)
FIRST, SECOND = "001_index_0.20mm_r1", "002_index_0.40mm_r1"


class Asked:
    """A control, and what it said to requests made at moments of the run."""

    def __init__(self, desk: Desk | None = None) -> None:
        self.control = Control(Interrupts(), desk)
        self.refused: list[str] = []

    def ask(self, do: str, **more: Any) -> None:
        verdict = self.control.hear(make_request(do, **more))
        if not verdict.accepted:
            self.refused.append(verdict.why)


def once(state: State, then: Callable[[Snapshot], None], trial: str = "") -> Callable[[Snapshot], None]:
    """Do something the first time the run is in a state (of a trial)."""
    done: list[bool] = []

    def look(snapshot: Snapshot) -> None:
        if snapshot.state is state and snapshot.trial.startswith(trial) and not done:
            done.append(True)
            then(snapshot)

    return look


def both(*looks: Callable[[Snapshot], None]) -> Callable[[Snapshot], None]:
    return lambda snapshot: [look(snapshot) for look in looks] and None


@contextmanager
def person(desk: Desk, does: Callable[[Desk, Prompt], object]) -> Iterator[list[Prompt]]:
    """Someone who answers what stands, from another thread."""
    seen: list[Prompt] = []
    end = threading.Event()

    def answer() -> None:
        while not end.wait(0.005):
            prompt = desk.standing
            if prompt is not None and prompt not in seen:
                seen.append(prompt)
                does(desk, prompt)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield seen
    finally:
        end.set()
        thread.join()


def test_prompts_are_answered_by_id(bench: Any, witness: Any, tmp_path: Path) -> None:
    desk = Desk()
    asked = Asked(desk)
    seen = witness()
    with person(desk, lambda _, prompt: asked.ask("answer", prompt=prompt.id, answer="done")) as prompts:
        bench.run(STUDY, tmp_path, witness=seen, control=asked.control)
    assert [prompt.kind for prompt in prompts] == ["place_finger"] * 2
    assert "index finger on the block, site 2" in prompts[1].words
    shown = [snapshot.prompt for snapshot in seen.snapshots]
    assert all(prompt in shown for prompt in prompts)
    assert shown[-1] is None
    asked.ask("answer", prompt=prompts[0].id, answer="done")
    assert len(asked.refused) == 1, "an answer given twice does nothing"
    assert (tmp_path / f"{SECOND}.h5").exists(), (
        "the bench's own hands placed the finger after the person had"
    )


def test_a_cancelled_prompt_ends_the_run(bench: Any, tmp_path: Path) -> None:
    desk = Desk()
    asked = Asked(desk)
    cancel = person(desk, lambda _, prompt: asked.ask("answer", prompt=prompt.id, answer="cancel"))
    with cancel, pytest.raises(OperatorError, match="cancelled"):
        bench.run(STUDY, tmp_path, control=asked.control)
    assert bench.safe


def test_a_number_is_read_off() -> None:
    desk = Desk()
    said: list[str] = []

    def read_off(desk: Desk, prompt: Prompt) -> None:
        said.append(desk.answer(prompt.id, -1.0))
        said.append(desk.answer(prompt.id, 5.02))

    with person(desk, read_off):
        value = desk.ask(
            "weigh", "Weigh it", check=lambda: None, show=lambda _: None, suggested=5.0, unit="g"
        )
    assert value == 5.02
    assert "0 or more" in said[0]
    assert said[1] == ""


def test_a_stop_ends_a_prompt_and_a_rest_at_once(bench: Any, witness: Any, tmp_path: Path) -> None:
    # the wall's clock: a rest of 150 s is one
    slow = type(bench)(replace(bench.bench, clock=SystemClock()), bench.control)
    took: dict[str, float] = {}
    for name, state, desk in (("rest", State.RESTING, None), ("prompt", State.PREPARING, Desk())):
        asked = Asked(desk)
        moment: list[float] = []

        def stop(_: Snapshot, asked: Asked = asked, moment: list[float] = moment) -> None:
            def later() -> None:
                moment.append(time.monotonic())
                asked.ask("stop")

            threading.Timer(0.3, later).start()

        seen = witness(at=once(state, stop))
        with pytest.raises(Interrupted):
            slow.run(STUDY, tmp_path / name, witness=seen, control=asked.control)
        took[name] = time.monotonic() - moment[0]
        assert seen.states[-2:] == [State.LEAVING, State.STOPPED]
    # the way to safety is in it, and this computer is shared
    assert max(took.values()) < 3.0, took


def test_pause_then_go_on(bench: Any, witness: Any, tmp_path: Path) -> None:
    asked = Asked()
    pause = once(State.HOLDING, lambda _: asked.ask("pause"))
    go_on = once(State.PAUSED, lambda _: asked.ask("go_on"))
    seen = witness(at=both(pause, go_on))
    bench.run(STUDY, tmp_path, witness=seen, control=asked.control)
    at = seen.states.index(State.PAUSED)
    assert seen.states[at - 2 : at + 2] == [State.SAVED, State.PREPARING, State.PAUSED, State.PREPARING]
    assert any(snapshot.pausing and snapshot.state is State.HOLDING for snapshot in seen.snapshots)
    assert read_trial(tmp_path / f"{FIRST}.h5").status == "complete"
    assert seen.states[-1] is State.FINISHED
    assert asked.refused == []


def test_skip_a_rest_and_a_trial(bench: Any, witness: Any, tmp_path: Path) -> None:
    asked = Asked()
    rest = once(State.RESTING, lambda _: asked.ask("skip", what="rest"))
    bench.run(STUDY, tmp_path / "rest", witness=witness(at=rest), control=asked.control)
    trial = read_trial(tmp_path / "rest" / f"{SECOND}.h5")
    assert trial.specimen.rest_s is not None
    assert trial.specimen.rest_s < 150, (
        "the file says how long the finger rested, not how long it should have"
    )

    skip = once(State.RESTING, lambda _: asked.ask("skip", what="trial"))
    early = once(State.HOLDING, lambda _: asked.ask("skip", what="trial"))
    asked = Asked()
    seen = witness(at=both(early, skip))
    bench.run(STUDY, tmp_path / "trial", witness=seen, control=asked.control)
    assert len(asked.refused) == 1
    assert "retreat" in asked.refused[0]
    assert not (tmp_path / "trial" / f"{SECOND}.h5").exists()
    assert [(e.trial, e.outcome) for e in seen.snapshots[-1].ended] == [
        (FIRST, "complete"),
        (SECOND, "skipped"),
    ]
    # what was left out is still to do
    bench.run(STUDY, tmp_path / "trial")
    assert read_trial(tmp_path / "trial" / f"{SECOND}.h5").status == "complete"


def test_retreat_ends_the_trial_and_pauses(bench: Any, witness: Any, tmp_path: Path) -> None:
    asked = Asked()
    safe: list[bool] = []

    def retreated(_: Snapshot) -> None:
        safe.append(bench.safe)
        asked.ask("retreat")  # the arm is clear: refused
        asked.ask("repeat", trial=FIRST)
        asked.ask("go_on")

    retreat = once(State.HOLDING, lambda _: asked.ask("retreat"))
    seen = witness(at=both(retreat, once(State.PAUSED, retreated)))
    bench.run(STUDY, tmp_path, witness=seen, control=asked.control)
    assert safe == [True]
    assert len(asked.refused) == 1
    cut = read_trial(tmp_path / f"{FIRST}.h5")
    assert cut.status == "aborted"
    assert cut.status_reason.endswith("ended by the operator: retreat")
    again = read_trial(tmp_path / f"{FIRST}_again2.h5")
    assert (again.status, again.specimen.site) == ("complete", "1-2")
    assert [(e.file, e.outcome) for e in seen.snapshots[-1].ended] == [
        (f"{FIRST}.h5", "cut short"),
        (f"{FIRST}_again2.h5", "complete"),
        (f"{SECOND}.h5", "complete"),
    ]


def test_discard_restore_and_repeat(bench: Any, witness: Any, tmp_path: Path) -> None:
    asked = Asked()

    def in_the_second(_: Snapshot) -> None:
        asked.ask("discard", file=f"{FIRST}.h5", reason="the finger moved")
        asked.ask("discard", file="../protocol.toml", reason="no")
        asked.ask("repeat", trial=FIRST)
        asked.ask("repeat", trial="no such trial")

    at = once(State.HOLDING, in_the_second, SECOND)
    bench.run(STUDY, tmp_path, witness=witness(at=at), control=asked.control)
    assert len(asked.refused) == 2
    assert read_trial(tmp_path / f"{FIRST}.h5").discarded == "the finger moved"
    assert read_trial(tmp_path / f"{FIRST}_again2.h5").status == "complete"

    asked = Asked()
    (tmp_path / f"{FIRST}_again2.h5").unlink()
    restore = once(State.HOLDING, lambda _: asked.ask("restore", file=f"{FIRST}.h5"))
    bench.run(STUDY, tmp_path, witness=witness(at=restore), control=asked.control)
    assert read_trial(tmp_path / f"{FIRST}.h5").discarded == ""


def test_what_a_snapshot_tells(bench: Any, witness: Any, tmp_path: Path) -> None:
    seen = witness()
    bench.run(STUDY, tmp_path, witness=seen)
    holding = next(s for s in seen.snapshots if s.state is State.HOLDING)
    assert holding.file == f"{FIRST}.h5"
    assert holding.surface_mm == read_trial(tmp_path / f"{FIRST}.h5").surface.position_mm  # type: ignore[union-attr]
    assert holding.overshoot_um is not None
    assert 0 < holding.overshoot_um < 15
    assert max(s.n_lost for s in seen.snapshots) == 0
    assert any(0 < s.rest_left_s <= 150 for s in seen.snapshots if s.state is State.RESTING)
    assert Snapshot.from_message(holding.as_message()) == holding
    assert [name for name, _ in seen.marks][:8] == [
        "trial",
        "approach",
        "dwell",
        "ramp",
        "hold",
        "retract",
        "clear",
        "end",
    ]


def test_nothing_is_taken_on_where_nothing_runs() -> None:
    asked = Asked()
    asked.ask("stop")
    asked.ask("discard", file="001.h5", reason="x")
    assert asked.refused == ["no run is in progress"] * 2
