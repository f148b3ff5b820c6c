"""Pictures of the pages that need no bench: `python -m rig.gui.page_screenshots DIR --trials FOLDER`.

The trials page overlaying and fitting the folder's trials, the protocol page with and without faults, the
mismatch page with ``--diagnosis FOLDER``; each in both themes. For a 4K screen set QT_SCALE_FACTOR=2 and
--size 1830x990. Words that do not fit are told on stderr, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication, QWidget

    from rig.gui.habits import Habits
    from rig.gui.worker import Worker

_PATIENCE_S = 120.0
_SIZE = "1276x690"
"""What a window of 1366 x 768 leaves to a page."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Take the pictures; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m rig.gui.page_screenshots", description="Pictures of the pages that need no bench."
    )
    parser.add_argument("out", type=Path, metavar="DIR")
    parser.add_argument("--trials", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--diagnosis", type=Path, metavar="FOLDER")
    parser.add_argument("--size", default=_SIZE, metavar="WxH")
    given = parser.parse_args(arguments)
    out: Path = given.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    for name in ("CONFIG", "CACHE"):
        os.environ[f"XDG_{name}_HOME"] = str(out / ".home" / name.lower())

    from PySide6.QtWidgets import QApplication

    from rig.gui.cut_off import cut_off
    from rig.gui.habits import Habits
    from rig.gui.theme import THEMES, apply_theme
    from rig.gui.worker import Worker

    app = QApplication([])
    worker = Worker()
    width, height = (int(part) for part in given.size.split("x"))
    until = _Patience(app)
    faults: list[str] = []
    for theme in THEMES.values():
        apply_theme(app, theme)
        habits = Habits(out / ".home" / f"window-{theme.name}-{os.getpid()}.json")
        for name, page in _views(worker, habits, given.trials, given.diagnosis, until):
            if not page.isVisible():
                page.resize(width, height)
                page.restyle(theme)  # type: ignore[attr-defined]
                page.show()
                continue
            path = out / f"{name}-{theme.name}.png"
            until.passed(0.3)
            page.grab().save(str(path))
            if (page.width(), page.height()) != (width, height):
                faults.append(f"{path.stem}: the page has grown to {page.width()} x {page.height()}")
            faults += [f"{path.stem}: {fault}" for fault in cut_off(page)]
            print(path, flush=True)
    worker.close()
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


def _views(
    worker: Worker, habits: Habits, trials: Path, diagnosis: Path | None, until: _Patience
) -> Iterator[tuple[str, QWidget]]:
    """Yield each page once to be shown, then whenever there is something to be photographed."""
    from rig.commands.run import load_rig_or_simulated
    from rig.gui.pages.mismatch import MismatchPage
    from rig.gui.pages.protocol import ProtocolPage
    from rig.gui.pages.trials import TrialsPage

    page = TrialsPage(worker, habits)
    yield "", page
    yield "trials-empty", page
    page.open_folder(trials)
    until(lambda: bool(page.table.rows) and all(row.header is not None for row in page.table.rows))
    page.commands.fit_again()
    until(lambda: all(row.fit is not None for row in page.table.rows))
    page.view.selectAll()
    until(lambda: len(page.overlay.plot.shown) > 0 and not worker.busy)
    yield "trials-overlay", page
    page.show_fit()
    page.view.selectRow(1)
    until.passed(0.2)
    until(lambda: not worker.busy)
    page.commands.ask_reason()
    yield "trials-fit-discard", page
    page.hide()

    form = ProtocolPage(worker, habits)
    form.set_rig(load_rig_or_simulated(None))
    yield "", form
    until(lambda: not worker.busy)
    yield "protocol", form
    for key, text in (("study.depths_mm", "0.2, -1"), ("study.repeats", "two")):
        form.form.lines[key].type_in(text)
    form.check()
    form.new_protocol("air_sweep")
    yield "protocol-faults", form
    form.hide()

    mismatch = MismatchPage(worker, habits)
    yield "", mismatch
    yield "mismatch-empty", mismatch
    if diagnosis is not None:
        mismatch.open_diagnosis(diagnosis, trials)
        until(lambda: mismatch.comparison.shown is not None)
        yield "mismatch", mismatch
        mismatch.show_figures()
        yield "mismatch-figures", mismatch
    mismatch.hide()


class _Patience:
    """Lets the program go on until something is so."""

    def __init__(self, app: QApplication) -> None:
        self._app = app

    def __call__(self, so: Callable[[], bool]) -> None:
        deadline = time.monotonic() + _PATIENCE_S
        while not so():
            if time.monotonic() > deadline:
                raise TimeoutError("the page did not come to what was to be photographed")
            self._app.processEvents()
            time.sleep(0.002)

    def passed(self, seconds: float) -> None:
        """Let some time pass."""
        until = time.monotonic() + seconds
        self(lambda: time.monotonic() >= until)


if __name__ == "__main__":
    sys.exit(main())
