"""Runs a protocol or a study without a window: `indenter run`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from rich.console import Console

from analysis.errors import BadInputError
from rig.calibration.kept import calibration_for
from rig.calibration.mixing import check_same_rig, keep_rig
from rig.commands.asking import ConsoleAnswers
from rig.commands.showing import TerminalProgress
from rig.engine.audience import Observer
from rig.engine.bench import Bench
from rig.engine.control import Control
from rig.engine.feed import Feed
from rig.engine.interrupts import Interrupts
from rig.engine.loading import load_run
from rig.engine.prompts import Desk
from rig.engine.resuming import keep_protocol
from rig.engine.runner import Runner
from rig.engine.session import open_bench
from rig.engine.tasks import Recorded, Task
from rig.protocols.steps import Plan
from rig.settings.reading import load_rig
from rig.settings.rig_file import RigFile

_EXAMPLES = files("rig.examples")
SIMULATED_RIG = "simulated_rig.toml"


def run_protocol_file(protocol: Path, *, rig: Path | None, out: Path, accept: bool = False) -> Path:
    """Run a protocol, or go on with it where `out` holds its beginning; return the folder of its trials.

    A calibration whose time is over, or another than the trials of `out` were recorded with, is asked for at
    the terminal; `accept` says yes beforehand.

    Raises BadInputError, before anything is written, where a file is wrong; Interrupted after a clean
    stop; RigError where the run failed.
    """
    settings = load_rig_or_simulated(rig)
    loaded = load_run(protocol, settings, out)
    plan, left = loaded.plan, loaded.left
    console = Console(stderr=True)
    if left.n_done:
        on = "going on" if left.tasks else "nothing is left to run"
        console.print(f"{out}: {left.n_done} of {len(plan.trials)} trials are done, {on}", highlight=False)
    if left.tasks:

        def ask(question: str) -> bool:
            return accept or _confirmed(question)

        calibration = calibration_for(settings, rig, console, ask)
        check_same_rig(settings, calibration, out, ask)
        keep_protocol(loaded.toml, out)
        keep_rig(settings, calibration, out)
        with open_bench(settings, calibration) as bench:
            run_on_bench(bench, plan, left.tasks, out, console=console)
    return out


def run_on_bench(
    bench: Bench, plan: Plan, tasks: Sequence[Task], out: Path, *, console: Console
) -> list[Recorded]:
    """Run tasks on an open bench, shown on the console and open to be followed by other processes."""
    desk = Desk() if bench.operator is None else None
    with Interrupts() as interrupts, TerminalProgress(console) as progress:
        control = Control(interrupts, desk)
        observers: list[Observer] = [progress]
        if desk is not None:
            observers.append(ConsoleAnswers(desk, console))
        lever = bench.lever
        with Feed(plan.title, out, lever.sample_rate_hz, lever.calibration, control.hear) as feed:
            return Runner(bench, interrupts, [*observers, feed], control=control).run(plan, tasks, out)


def _confirmed(question: str) -> bool:
    """Ask at the terminal; without one the answer is no."""
    from rich.prompt import Confirm

    return sys.stdin.isatty() and Confirm.ask(question, default=False)


def load_rig_or_simulated(rig: Path | None) -> RigFile:
    """Read a rig file; without one, that of the simulated rig which ships with the program."""
    return load_rig(Path(str(_EXAMPLES / SIMULATED_RIG)) if rig is None else rig)


def write_examples(directory: Path) -> None:
    """Write the rig and protocol files with every key explained; existing files are left as they are."""
    texts = {item.name: item for item in _EXAMPLES.iterdir() if item.name.endswith(".toml")}
    taken = sorted(name for name in texts if (directory / name).exists())
    if taken:
        raise BadInputError(f"{directory / taken[0]}: exists already: give another folder to --example")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, item in texts.items():
            (directory / name).write_text(item.read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise BadInputError(
            f"{directory}: can't be written ({error.strerror}): give another folder"
        ) from error
