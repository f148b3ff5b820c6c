"""The column beside the plots: position and force in large figures, the rest, the progress, and what can be asked."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from rig.engine.progress import clock_words
from rig.engine.states import State
from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.controls import say, words

WIDTH = 280
_AVERAGED_S = 0.02
_REQUEST_OF = {
    "Start": "run",
    "Stop": "stop",
    "Pause": "pause",
    "Go on": "go_on",
    "Skip rest": "skip",
    "Retreat": "retreat",
    "Repeat": "repeat",
    "Discard": "discard",
}


class Readouts(QWidget):
    """Shows the state of the bench and offers actions; one that waits for its answer says so."""

    volts_wanted = Signal(bool)

    def __init__(self, link: BenchLink) -> None:
        super().__init__()
        self._link = link
        self._state = link.state
        self.setFixedWidth(WIDTH)
        self._position, self._force = _figure("position of the arm"), _figure("force on the punch")
        self._depth = words("", "faint")
        self._volts = QCheckBox("volts")
        self._volts.setToolTip("show the signals as sampled, in volts")
        self._volts.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self._volts.toggled.connect(self.volts_wanted)
        self._next = words("", "heading")
        self._what = words("", "")
        self._rest = QLabel()
        self._rest.setAccessibleName("rest that is left")
        self._rest.setStyleSheet("font-size: 22pt; font-weight: bold;")
        self._bar = QProgressBar()
        self._bar.setAccessibleName("progress of the run")
        self._bar.setTextVisible(False)
        self._bar.setFixedHeight(10)
        self._progress = words("", "faint")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 4, 8, 4)
        layout.setSpacing(3)
        layout.addWidget(self._position)
        layout.addWidget(self._force)
        row = QHBoxLayout()
        row.addWidget(self._depth, 1)
        row.addWidget(self._volts)
        layout.addLayout(row)
        layout.addWidget(_rule())
        layout.addWidget(self._next)
        layout.addWidget(self._what)
        layout.addWidget(self._rest)
        layout.addStretch(1)
        layout.addWidget(self._progress)
        layout.addWidget(self._bar)
        self._grid = QGridLayout()
        self._grid.setSpacing(4)
        layout.addLayout(self._grid)

    def offer(self, actions: list[QAction]) -> None:
        """Put a button for each action below the figures, two in a row."""
        for i, action in enumerate(actions):
            button = QToolButton()
            button.setDefaultAction(action)
            button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
            button.setMinimumSize(128, 30)
            button.setAccessibleName(action.text())
            self._grid.addWidget(button, i // 2, i % 2)

    def show_state(self, state: BenchState) -> None:
        """Render the state."""
        self._state = state
        s = state.snapshot
        resting = s.state is State.RESTING and s.rest_left_s > 0
        self._rest.setText(f"rest {_minutes(s.rest_left_s)}" if resting else "")
        self._rest.setVisible(resting)
        title = state.words[:1].upper() + state.words[1:]
        say(self._next, title, "heading")
        what = s.prompt.words if s.prompt is not None else s.message
        if state.trouble:
            say(self._what, state.trouble, "bad")
        elif s.trouble and not state.running:
            say(self._what, s.trouble, "bad")
        elif s.error and not state.running:
            say(self._what, s.error, "bad")
        else:
            say(self._what, what)
        total = s.done_s + s.left_s
        self._bar.setVisible(state.running and total > 0)
        self._bar.setRange(0, 1000)
        self._bar.setValue(round(1000 * s.done_s / total) if total > 0 else 0)
        if state.running:
            ends = datetime.now() + timedelta(seconds=s.left_s)
            say(
                self._progress,
                f"{s.trial_number} of {s.n_trials}: {s.trial}\n{clock_words(s.left_s)} left, ends {ends:%H:%M}",
                "faint",
            )
        else:
            say(self._progress, "", "faint")
        for button in self.findChildren(QToolButton):
            action = button.defaultAction()
            if action is not None:
                waits = _REQUEST_OF.get(action.iconText(), "") in state.asked
                button.setText(f"{action.iconText()} ..." if waits else action.iconText())

    def refresh(self) -> None:
        """Write the figures anew; ten times a second."""
        bins, process = self._link.bins, self._link.process
        if bins is None or process is None or process.follower is None:
            self._position.setText("-- mm")
            self._force.setText("-- mN")
            self._depth.setText("")
            return
        ring = process.follower.ring
        came = self._link.volts(max(0, bins.next_sample - round(_AVERAGED_S * ring.sample_rate_hz)))
        if came is None or not came[1].shape[1]:
            return
        position_v, force_v = (float(np.mean(came[1][i])) for i in (0, 1))
        c = ring.calibration
        position_mm = (position_v - c.position_zero_v) / c.volts_per_mm
        force_mn = (force_v - c.force_zero_v) / c.volts_per_mn
        if self._volts.isChecked():
            self._position.setText(f"{position_v:8.4f} V")
            self._force.setText(f"{force_v:8.4f} V")
        else:
            self._position.setText(f"{position_mm:7.3f} mm")
            self._force.setText(f"{force_mn:7.1f} mN")
        surface_mm = self._state.snapshot.surface_mm
        below = "" if surface_mm is None else f"{position_mm - surface_mm:+.3f} mm from the surface"
        overshoot = self._state.snapshot.overshoot_um
        if overshoot is not None:
            below += f"\novershoot {overshoot:.1f} um"
        self._depth.setText(below)


def _figure(name: str) -> QLabel:
    label = QLabel("--")
    label.setAccessibleName(name)
    label.setAlignment(Qt.AlignmentFlag.AlignRight)
    label.setStyleSheet("font-size: 26pt; font-weight: bold; font-family: monospace;")
    return label


def _rule() -> QFrame:
    line = QFrame()
    line.setFrameShape(QFrame.Shape.HLine)
    return line


def _minutes(seconds: float) -> str:
    whole = max(0, round(seconds))
    return f"{whole // 60}:{whole % 60:02d}"
