"""The live page: the plots and the handful of keys that change what they show."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QToolButton, QVBoxLayout, QWidget

from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.controls import words
from rig.gui.live_plot import SPANS_S, LivePlot
from rig.gui.theme import Theme


class LivePage(QWidget):
    """Position and force as they come, with spans from a second to the whole trial."""

    def __init__(self, link: BenchLink) -> None:
        super().__init__()
        self.plot = LivePlot(link)
        self._spans = QComboBox()
        self._spans.setAccessibleName("span of time that is shown")
        self._spans.setToolTip("how much time the plots show (+ and -, or the wheel)")
        for span_s in SPANS_S:
            self._spans.addItem(_span_words(span_s), span_s)
        self._spans.addItem("whole trial", 0.0)
        self._spans.setCurrentText(_span_words(self.plot.span_s))
        self._spans.activated.connect(lambda: self.plot.show_span(self._spans.currentData()))
        self._hint = words("", "faint")
        self.actions_here = [
            self._action(
                "Freeze", "F", "hold the view still; drag and wheel then pan and zoom", self.plot.freeze
            ),
            self._action("Autoscale", "A", "fit both axes to what is shown", self.plot.autoscale),
            self._action("Longer", "-", "show a longer span", lambda: self.plot.step_span(1)),
            self._action("Shorter", "+", "show a shorter span", lambda: self.plot.step_span(-1)),
        ]
        self.actions_here[3].setShortcuts([QKeySequence("+"), QKeySequence("=")])
        self.actions_here[0].setCheckable(True)
        row = QHBoxLayout()
        row.setContentsMargins(6, 2, 6, 0)
        row.addWidget(self._spans)
        for action in self.actions_here:
            button = QToolButton()
            button.setDefaultAction(action)
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            row.addWidget(button)
        row.addWidget(self._hint, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 2, 4, 2)
        layout.setSpacing(2)
        layout.addLayout(row)
        layout.addWidget(self.plot, 1)
        self.plot.view_changed.connect(self._show_view)

    def show_state(self, state: BenchState) -> None:
        """Render the state."""
        self.plot.show_state(state)

    def refresh(self) -> None:
        """Draw what has come; at every frame while the page is seen."""
        self.plot.redraw()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.plot.restyle(theme)

    def _action(self, name: str, key: str, tip: str, does: object) -> QAction:
        action = QAction(name, self)
        action.setShortcut(QKeySequence(key))
        action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
        action.setToolTip(f"{tip} ({key})")
        action.triggered.connect(lambda *_: does())  # type: ignore[operator]
        self.addAction(action)
        return action

    def _show_view(self) -> None:
        self.actions_here[0].setChecked(self.plot.frozen)
        self._spans.setCurrentText("whole trial" if self.plot.whole_trial else _span_words(self.plot.span_s))
        held = "held still: drag to pan, wheel to zoom; F lets it roll again"
        self._hint.setText(held if self.plot.frozen else "")


def _span_words(span_s: float) -> str:
    return f"{span_s:g} s" if span_s < 120 else f"{span_s / 60:g} min"
