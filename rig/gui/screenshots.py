"""Pictures of every page, without a screen: `python -m rig.gui.screenshots DIR [--theme dark] [--size 1366x768]`.

The window is the real one on the simulated rig: it connects, runs a small study, aborts, and is
photographed on the way. For a 4K screen set QT_SCALE_FACTOR=2 and --size 1920x1080. Words that do not fit are
told on stderr, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

    from rig.gui.window import Window

STUDY = """kind = "study"

[study]
subject = "s01"
fingers = ["index", "middle"]
depths_mm = [0.2, 0.4]
repeats = 2
rest_s = 15.0

[surface]
start_mm = 2.5

[indentation]
dwell_s = 0.5
hold_s = 4.0
"""

_PATIENCE_S = 120.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Take the pictures; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m rig.gui.screenshots", description="Pictures of every page."
    )
    parser.add_argument("out", type=Path, metavar="DIR")
    parser.add_argument("--theme", choices=("light", "dark"), default="light")
    parser.add_argument("--size", default="1366x768", metavar="WxH")
    given = parser.parse_args(arguments)
    out = given.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    for name in ("CONFIG", "CACHE", "STATE", "DATA"):
        os.environ[f"XDG_{name}_HOME"] = str(out / ".home" / name.lower())

    from PySide6.QtWidgets import QApplication

    from rig.gui.habits import Habits
    from rig.gui.window import Window

    app = QApplication([])
    habits = Habits()
    habits.theme = given.theme
    window = Window(habits, out / ".home" / "logs")
    width, height = (int(part) for part in given.size.split("x"))
    window.resize(width, height)
    window.show()
    photographer = _Photographer(app, window, out)
    photographer.tour(out / ".home" / f"trials-{os.getpid()}")
    window.close()
    for fault in photographer.faults:
        print(fault, file=sys.stderr)
    return 1 if photographer.faults else 0


class _Photographer:
    """Drives a window through a session; `faults` holds what could not be read in its pictures."""

    def __init__(self, app: QApplication, window: Window, out: Path) -> None:
        self._app, self._window, self._out = app, window, out
        self._size = window.size()
        self.faults: list[str] = []

    def tour(self, folder: Path) -> None:
        """Go through a session at the bench."""
        window = self._window
        window.connect_rig(None)
        self._until(lambda: window.link.state.link == "open" and window.link.bins is not None)
        self._let_pass(3.0)
        self._photograph("1-live-idle")
        protocol = self._out / ".home" / "study.toml"
        protocol.write_text(STUDY, encoding="utf-8")
        window.study.load(protocol, folder)
        window.shell.show_page("Study")
        window.commands.start()
        self._until(lambda: window.shell.banner.stands)
        self._photograph("2-study-prompt")
        window.study.by_bench.setChecked(True)
        window.shell.banner.answer()
        window.shell.show_page("Live")
        self._until(lambda: self._state == "holding")
        self._let_pass(2.5)
        self._photograph("3-live-hold")
        self._until(lambda: window.shell.banner.stands)
        window.shell.show_page("Study")
        window.shell.banner.answer()
        self._until(lambda: self._state == "resting" and bool(window.study.table.rows[0].a0_mn))
        self._let_pass(1.0)
        self._photograph("4-study-fit-rest")
        window.actions_by_name["Skip rest"].trigger()
        self._until(lambda: self._state == "holding")
        self._let_pass(0.5)
        window.link.abort()
        self._until(lambda: not window.link.state.running)
        self._let_pass(0.3)
        window.study.discard()
        self._photograph("5-study-aborted-discard")
        window.shell.show_page("Log")
        self._photograph("6-log")
        window.shell.clear()  # what the abort did has been seen
        self._calibrate()
        for i, name in enumerate(("Trials", "Protocol", "Mismatch"), start=11):
            if name in window.shell.pages:
                window.shell.show_page(name)
                if name == "Trials":
                    window.trials.open_folder(folder)
                self._let_pass(3.0)
                self._photograph(f"{i}-{name.lower()}")

    def _calibrate(self) -> None:
        window = self._window
        window.shell.show_page("Calibrate")
        self._photograph("7-calibrate")
        window.calibration.choose("force")
        self._photograph("8-calibrate-prepare")
        window.calibration.start_asked.emit("force", "bench")
        self._until(lambda: window.link.state.snapshot.trial_number >= 6)
        self._photograph("9-calibrate-points")
        self._until(lambda: "waiting" in repr(window.link.state.snapshot.calibration))
        self._photograph("10-calibrate-result")

    @property
    def _state(self) -> str:
        return str(self._window.link.state.snapshot.state)

    def _photograph(self, name: str) -> None:
        from rig.gui.cut_off import cut_off

        self._let_pass(0.2)
        path = self._out / f"{name}.png"
        self._window.grab().save(str(path))
        if self._window.size() != self._size:
            self.faults.append(f"{name}: the window has grown to {self._window.width()} px")
        self.faults += [f"{name}: {fault}" for fault in cut_off(self._window)]
        print(path, flush=True)

    def _let_pass(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        self._until(lambda: time.monotonic() >= until)

    def _until(self, when: Callable[[], bool]) -> None:
        deadline = time.monotonic() + _PATIENCE_S
        while not when():
            if time.monotonic() > deadline:
                raise TimeoutError(f"the window did not come to it; it says: {self._window.link.state.words}")
            self._app.processEvents()
            time.sleep(0.002)


if __name__ == "__main__":
    sys.exit(main())
