"""A bench kept open in a process of its own: `python -m rig.engine.serving RIG.toml`; a window drives it.

It shows live samples while nothing runs, and runs protocols and calibrations when a message asks for them.
Its standard input is its lifeline: when that closes, whoever started it has died, and it stops what runs,
takes the arm clear, and ends.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue

from analysis.errors import BadInputError
from rig.calibration.kept import FOLDER, CalibrationFile, calibration_folder, newest_calibration
from rig.calibration.mixing import check_same_rig, keep_rig
from rig.engine.bench import Bench
from rig.engine.control import Control
from rig.engine.feed import IDLE, Feed
from rig.engine.idling import LiveView
from rig.engine.interrupts import Interrupts
from rig.engine.loading import load_run
from rig.engine.progress import BenchFacts, CalibrationInUse, CalibrationShown, Doubt, Snapshot
from rig.engine.prompts import Desk
from rig.engine.requests import Accept, Calibrate, Close, Request, Run, Verdict
from rig.engine.resuming import keep_protocol
from rig.engine.routines import CalibrationResult, CalibrationRun, calibrate_with, routine
from rig.engine.runner import Runner
from rig.engine.session import open_bench
from rig.engine.states import State
from rig.engine.tasks import Recorded, Task
from rig.errors import RigError
from rig.hardware.processes import ask_for_priority
from rig.protocols.steps import Plan
from rig.settings.reading import check_protocol_on_rig, load_rig
from rig.settings.rig_file import RigFile

_log = logging.getLogger(__name__)

_LOOK_S = 0.02
"""Between two looks at the resting arm and at what is asked for."""


class Session:
    """An open bench that does what it is asked, one thing at a time, until it is closed."""

    def __init__(self, bench: Bench, rig: RigFile, rig_path: Path, used: dict[str, CalibrationFile]) -> None:
        self._bench = bench
        self._rig = rig
        self._folder = calibration_folder(rig, rig_path) or rig_path.parent / FOLDER
        self._orders: SimpleQueue[Run | Calibrate | Accept] = SimpleQueue()
        self._control: Control | None = None
        self._busy = False
        self._closing = threading.Event()
        self._result: CalibrationResult | None = None
        self._facts = facts_of(bench, rig, used)
        self._snapshot = Snapshot(title="", state=State.IDLE, bench=self._facts)
        lever = bench.lever
        # the first thing that is heard of a bench says which bench it is: a window decides by that whose hands act
        self._feed = Feed(
            rig.name or "bench",
            rig_path,
            lever.sample_rate_hz,
            lever.calibration,
            self.hear,
            first=self._snapshot,
        )
        self._live = LiveView(lever, lambda: self._feed.mark(IDLE, 0, 0), self._feed.follow)

    def serve(self) -> None:
        """Do what is asked for until `close`, or a Close request. Raises RigError where the arm is lost."""
        with self._feed:
            # a program before this one may have left the arm anywhere
            self._bench.lever.retreat()
            self._show(self._snapshot)
            while not self._closing.is_set():
                try:
                    order = self._orders.get(timeout=_LOOK_S)
                except Empty:
                    self._live.look()
                    if self._live.trouble != self._snapshot.trouble:
                        self._show(replace(self._snapshot, trouble=self._live.trouble))
                    continue
                self._live.end()
                self._do(order)
                self._busy = False
            self._live.end()

    def close(self) -> None:
        """Stop what runs, and end; from any thread."""
        self._closing.set()
        control = self._control
        if control is not None:
            control.interrupts.request()

    def hear(self, request: Request) -> Verdict:
        """Take a request on, or refuse it; from the feed's thread."""
        control = self._control
        if control is not None:
            return control.hear(request)
        why = ""
        match request:
            case Close():
                self._closing.set()
            case Run() | Calibrate() if not self._busy:
                self._busy = True
                self._orders.put(request)
            case Accept() if self._result is not None and not self._busy:
                self._orders.put(request)
            case Accept():
                why = "no calibration waits to be accepted"
            case Run() | Calibrate():
                why = "a run is about to begin"
            case _:
                why = "no run is in progress"
        return Verdict(request.id, accepted=not why, why=why)

    def _do(self, order: Run | Calibrate | Accept) -> None:
        """Do what was asked for; what goes wrong is shown, and the bench stays open where the arm is clear."""
        self._snapshot = replace(self._snapshot, error="", doubt=None, message="", ended=(), title="")
        try:
            match order:
                case Run():
                    self._run_protocol(order)
                case Calibrate():
                    self._calibrate(order)
                case Accept():
                    self._decide(order)
        except (RigError, BadInputError, OSError) as error:
            said = " ".join(str(error).split())
            _log.error("%s", said)
            self._snapshot = replace(self._snapshot, error=said)
        except KeyboardInterrupt as stopped:
            self._snapshot = replace(self._snapshot, message=str(stopped), error="")
        self._show(
            replace(self._snapshot, state=State.IDLE, prompt=None, pausing=False, file="", rest_left_s=0.0)
        )

    def _run_protocol(self, order: Run) -> None:
        out = Path(order.out)
        loaded = load_run(Path(order.protocol), self._rig, out)
        if not loaded.left.tasks:
            message = f"{out}: all {loaded.left.n_done} trials are done, nothing is left to run"
            self._snapshot = replace(self._snapshot, message=message, out=str(out))
            return
        calibration = self._bench.lever.calibration
        doubts: list[str] = []

        def accepted(words: str) -> bool:
            doubts.append(words)
            return order.accept

        try:
            check_same_rig(self._rig, calibration, out, accepted)
        except BadInputError:
            if not doubts:
                raise
            # whoever asked for the run answers by asking again: nothing waits here for a window that may die
            self._snapshot = replace(self._snapshot, doubt=Doubt(order.id, doubts[0]), out=str(out))
            return
        keep_protocol(loaded.toml, out)
        keep_rig(self._rig, calibration, out)
        self._record(loaded.plan, loaded.left.tasks, out, order.hands, lambda _: None)

    def _calibrate(self, order: Calibrate) -> None:
        protocol = routine(order.which)
        check_protocol_on_rig(protocol, self._rig, f"calibrate {order.which}")
        calibration = CalibrationRun(protocol, self._folder)
        self._result = None
        x_name = calibration.x_name
        self._snapshot = replace(self._snapshot, calibration=CalibrationShown(order.which, x_name))

        def run(plan: Plan, tasks: Sequence[Task], out: Path) -> Sequence[Recorded]:
            return self._record(plan, tasks, out, order.hands, calibration.recorded)

        self._result = calibrate_with(run, calibration)
        self._snapshot = replace(
            self._snapshot, calibration=self._result.shown(self._bench.lever.calibration)
        )

    def _decide(self, order: Accept) -> None:
        result, shown = self._result, self._snapshot.calibration
        if result is None or shown is None:
            return
        self._result = None
        if order.keep:
            path = result.save(self._folder, self._rig.name)
            shown = replace(shown, decision="kept", file=str(path))
        else:
            shown = replace(shown, decision="left")
        self._snapshot = replace(self._snapshot, calibration=shown)

    def _record(
        self,
        plan: Plan,
        tasks: Sequence[Task],
        out: Path,
        hands: str,
        recorded: Callable[[Recorded], CalibrationShown | None],
    ) -> list[Recorded]:
        desk = Desk(asks_first=hands == "person")
        with Interrupts() as interrupts:
            control = Control(interrupts, desk)
            runner = Runner(
                self._bench,
                interrupts,
                [self._feed],
                control=control,
                idle=self._live,
                recorded=recorded,
                snapshot=self._snapshot,
            )
            self._control = control
            if self._closing.is_set():
                interrupts.request()
            try:
                return runner.run(plan, tasks, out)
            finally:
                self._control = None
                self._snapshot = runner.snapshot

    def _show(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot
        self._feed.show(snapshot)


def facts_of(bench: Bench, rig: RigFile, used: dict[str, CalibrationFile]) -> BenchFacts:
    """Return what does not change while this bench is open."""
    in_use = []
    for kind in ("position", "force"):
        found = used.get(kind)
        said = (
            (found.calibrated, found.valid_until) if found is not None else (rig.calibration.calibrated, "")
        )
        in_use.append(CalibrationInUse("position" if kind == "position" else "force", *said))
    limits = rig.lever
    return BenchFacts(
        rig=rig.name,
        simulated=bench.source == "simulated",
        travel_min_mm=limits.travel_min_mm,
        travel_max_mm=limits.travel_max_mm,
        safe_position_mm=limits.safe_position_mm,
        force_max_mn=limits.force_max_mn,
        sample_rate_hz=bench.lever.sample_rate_hz,
        guards=bench.guards,
        calibrations=tuple(in_use),
    )


def _hold_the_lifeline(ended: Callable[[], None]) -> None:
    """Call `ended` once nobody holds the other end of stdin any more."""
    while os.read(0, 4096):
        time.sleep(0.01)
    _log.warning("whoever started this bench is gone: the arm is taken clear")
    ended()


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve a bench; return the process's exit code, after one line on stderr where it is not 0."""
    parser = argparse.ArgumentParser(prog="python -m rig.engine.serving", description="A bench kept open.")
    parser.add_argument("rig", type=Path, metavar="RIG.toml")
    rig_path = parser.parse_args(arguments).rig
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    # Ctrl-C at a terminal is the window's business, and that ends here by the lifeline
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ask_for_priority()
    try:
        rig = load_rig(rig_path)
        folder = calibration_folder(rig, rig_path)
        calibration, used = newest_calibration(rig, folder if folder and folder.exists() else None)
        with open_bench(rig, calibration) as bench:
            session = Session(bench, rig, rig_path, dict(used))
            signal.signal(signal.SIGTERM, lambda *_: session.close())
            threading.Thread(
                target=_hold_the_lifeline, args=(session.close,), name="lifeline", daemon=True
            ).start()
            session.serve()
    except (RigError, BadInputError) as error:
        print("indenter:", " ".join(str(error).split()), file=sys.stderr, flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
