"""The bar above every page: what rig this is, what it does, and the button that takes the arm off the skin."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDoubleSpinBox, QFrame, QHBoxLayout, QLabel, QPushButton

from rig.gui.bench_state import BenchState
from rig.gui.shortened import ShortenedLabel
from rig.gui.theme import LIGHT, Theme

_DISK_EVERY_S = 5.0
_LITTLE_GB = 2.0
_RIG_PX = 220
"""What the name of a rig may take: it is as long as whoever wrote its file liked."""


class DiskSpace:
    """Asks, in a thread of its own, how much room the disk has: a network drive may take long to say."""

    def __init__(self) -> None:
        self.folder: Path | None = None
        self.free_gb: float | None = None
        self._end = threading.Event()
        threading.Thread(target=self._look, name="disk", daemon=True).start()

    def close(self) -> None:
        """Ask no more."""
        self._end.set()

    def _look(self) -> None:
        while True:
            folder = self.folder or Path.cwd()
            try:
                while not folder.exists() and folder != folder.parent:
                    folder = folder.parent
                self.free_gb = shutil.disk_usage(folder).free / 1e9
            except OSError:
                self.free_gb = None
            if self._end.wait(_DISK_EVERY_S):
                return


class Header(QFrame):
    """Banner, state, file, samples lost, disk, and Abort, which is never disabled and never moves."""

    abort = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self._theme = LIGHT
        self._state = BenchState()
        self.disk = DiskSpace()
        self._rig = QLabel("NO RIG")
        self._rig.setAccessibleName("which rig this is")
        self._doing = QLabel()
        self._doing.setAccessibleName("what the rig does")
        self._file = ShortenedLabel("the file being written; its folder")
        self._lost = QLabel()
        self._disk = QLabel()
        self._lost.setToolTip("samples of this run that never came from the card")
        self._disk.setToolTip("room on the disk that the trials go to")
        self.abort_button = QPushButton("ABORT   Esc")
        self.abort_button.setAccessibleName("abort: take the arm off the skin now")
        self.abort_button.setToolTip("Take the arm off the skin now and end the run (Esc). Asks nothing.")
        self.abort_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.abort_button.setFixedSize(180, 48)
        self.abort_button.pressed.connect(self.abort)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(6, 4, 6, 4)
        layout.setSpacing(14)
        for widget in (self._rig, self._doing):
            layout.addWidget(widget)
        layout.addWidget(self._file, 1)
        for widget in (self._lost, self._disk):
            layout.addWidget(widget)
        layout.addWidget(self.abort_button)
        self.restyle(LIGHT)

    def show_state(self, state: BenchState) -> None:
        """Render the state."""
        self._state = state
        s = state.snapshot
        if s.out:
            self.disk.folder = Path(s.out)
        if state.link in {"closed", "died"}:
            rig = "NO RIG"
        elif state.simulated:
            rig = "SIMULATED RIG"
        else:
            rig = (s.bench.rig if s.bench else "") or state.rig or "rig"
        self._rig.setText(self.fontMetrics().elidedText(rig, Qt.TextElideMode.ElideMiddle, _RIG_PX))
        self._rig.setToolTip(rig)
        self._doing.setText(state.words)
        place = Path(s.out).name if s.out else ""
        written = s.file and state.link in {"open", "silent"}
        self._file.setText(f"writing {place}/{s.file}" if written else "no file is being written")
        self._lost.setText(f"lost {s.n_lost}" if state.link in {"open", "silent"} else "")
        self._colour()

    def refresh(self) -> None:
        """Say how much room there is."""
        free = self.disk.free_gb
        little = free is not None and free < _LITTLE_GB
        self._disk.setText("" if free is None else f"disk {free:.0f} GB" + (" !" if little else ""))
        self._disk.setStyleSheet(f"color: {self._theme.bad}; font-weight: bold;" if little else "")

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        self.abort_button.setStyleSheet(
            f"QPushButton {{ background: {theme.bad}; color: {theme.ground}; font-size: 15pt; font-weight: bold;"
            f" border: 2px solid {theme.text}; border-radius: 4px; padding: 0; }}"
            f"QPushButton:pressed {{ background: {theme.text}; }}"
        )
        self._colour()

    def _colour(self) -> None:
        t = self._theme
        simulated = self._state.simulated
        ground, text = (t.note, t.ground) if simulated else (t.raised, t.text)
        self._rig.setStyleSheet(
            f"background: {ground}; color: {text}; font-weight: bold; padding: 8px 10px; border-radius: 3px;"
        )
        wrong = self._state.link in {"silent", "died"} or bool(self._state.snapshot.trouble)
        self._doing.setStyleSheet(f"font-size: 14pt; font-weight: bold; color: {t.bad if wrong else t.text};")
        lost = self._state.snapshot.n_lost > 0
        self._lost.setStyleSheet(f"color: {t.bad}; font-weight: bold;" if lost else "")


class Banner(QFrame):
    """A question of the bench's, below the header of every page: done, can't be done, or a number."""

    answered = Signal(str, str, object)

    def __init__(self) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self._prompt = ""
        self._words = QLabel()
        self._words.setWordWrap(True)
        self._words.setAccessibleName("what the bench asks for")
        self._number = QDoubleSpinBox()
        self._number.setRange(0.0, 1000.0)
        self._number.setDecimals(4)
        self._number.setAccessibleName("number read off")
        self._done = QPushButton("Done   Enter")
        self._done.setProperty("main", True)
        self._done.setToolTip("It is done; the run goes on (Enter)")
        self._cancel = QPushButton("Can't be done")
        self._cancel.setToolTip("It can't be done: the run ends, the arm stays clear")
        self._done.clicked.connect(self.answer)
        self._cancel.clicked.connect(lambda: self.answered.emit(self._prompt, "cancel", None))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(10, 6, 10, 6)
        layout.addWidget(self._words, 1)
        for widget in (self._number, self._done, self._cancel):
            layout.addWidget(widget)
        self.hide()

    @property
    def stands(self) -> bool:
        """Whether a question waits for its answer."""
        return bool(self._prompt)

    def show_state(self, state: BenchState) -> bool:
        """Show the question that stands; return True where it is a new one."""
        prompt = state.snapshot.prompt if state.link == "open" else None
        if prompt is None:
            self._prompt = ""
            self.hide()
            return False
        new = prompt.id != self._prompt
        self._prompt = prompt.id
        if new:
            self._words.setText(prompt.words)
            wants = prompt.wants == "number"
            self._number.setVisible(wants)
            if wants:
                self._number.setSuffix(f" {prompt.unit}")
                self._number.setValue(prompt.suggested or 0.0)
            self.show()
        asked = "answer" in state.asked
        self._done.setEnabled(not asked)
        self._cancel.setEnabled(not asked)
        return new

    def answer(self) -> None:
        """Say that it is done, with the number where one is wanted."""
        if self._prompt and self._done.isEnabled():
            value = self._number.value() if not self._number.isHidden() else None
            self.answered.emit(self._prompt, "done", value)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.setStyleSheet(f"Banner {{ background: {theme.raised}; border: 2px solid {theme.accent}; }}")
        self._words.setStyleSheet("font-size: 14pt; font-weight: bold;")
