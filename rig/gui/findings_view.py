"""A diagnosis in words: the verdict, the physics that was left out by size, before and after, what next."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QScrollArea, QVBoxLayout, QWidget

from rig.gui.controls import button, words
from rig.gui.jobs.report_file import DiagnosisFolder, Mechanism, Quantity, Report, Window
from rig.gui.numbers import counted, with_error

_VERDICTS = {
    "no_mismatch": ("The simulation explains the recordings", "good"),
    "named": ("The missing physics is named", "good"),
    "one_of": ("The missing physics is one of several", "note"),
    "unknown": ("Something is left that no known physics explains", "bad"),
}
_MEANINGS = {
    "no_mismatch": "✓ nothing is left but the recordings' own noise",
    "named": "✓ each part of what differs has one explanation",
    "one_of": "these recordings can't tell between them: see the next experiment",
    "unknown": "⚠ look at the bench where the windows below say",
}
_TISSUE = (
    ("k0_mn_per_mm", "k0, mN/mm"),
    ("k1_mn_per_mm", "k1, mN/mm"),
    ("tau1_s", "τ1, s"),
    ("k2_mn_per_mm", "k2, mN/mm"),
    ("tau2_s", "τ2, s"),
)
_EMPTY = (
    "Compare recordings with the simulation: choose a folder of trials and press Diagnose. It says what the "
    "simulation leaves out, where that shows, and what to measure next. It takes from half a minute to some "
    "minutes; everything else goes on meanwhile."
)


class FindingsView(QScrollArea):
    """Shows one diagnosis. `window_asked` gives the window that is to be looked at."""

    window_asked = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setAccessibleName("what the diagnosis found")
        self.show_nothing()

    def minimumSizeHint(self) -> QSize:  # noqa: N802
        """Room for the widest line that can't be broken: there is no way to scroll across."""
        inside: QWidget | None = self.widget()
        needed = 0 if inside is None else inside.minimumSizeHint().width()
        beside = self.verticalScrollBar().sizeHint().width() + 2 * self.frameWidth()
        return super().minimumSizeHint().expandedTo(QSize(needed + beside, 0))

    def show_nothing(self, text: str = _EMPTY, role: str = "faint") -> None:
        """Say what to do, or what went wrong."""
        self._column = self._fresh()
        self._column.addWidget(words(text, role))
        self._column.addStretch(1)

    def show_diagnosis(
        self, found: DiagnosisFolder, run_next: Callable[[], object], use_twin: Callable[[], object]
    ) -> None:
        """Show a diagnosis; the two functions are what its buttons do."""
        report = found.report
        self._column = self._fresh()
        title, role = _VERDICTS[report.verdict]
        self._column.addWidget(words(title, "heading"))
        self._column.addWidget(words(_MEANINGS[report.verdict], role))
        self._column.addWidget(words(report.summary))
        self._next(found, run_next, use_twin)
        self._mechanisms(report)
        self._windows(report)
        self._before_and_after(report)
        self._hidden(report)
        self._said_besides(report)
        self._column.addStretch(1)

    def _fresh(self) -> QVBoxLayout:
        inside = QWidget()
        column = QVBoxLayout(inside)
        column.setContentsMargins(6, 4, 10, 4)
        column.setSpacing(6)
        self.setWidget(inside)
        return column

    def _next(
        self, found: DiagnosisFolder, run_next: Callable[[], object], use_twin: Callable[[], object]
    ) -> None:
        following = found.report.next_experiment
        if following is not None and found.next_protocol is not None:
            self._column.addWidget(words(following.reason, "faint"))
            self._column.addWidget(
                button(
                    "Run the &next experiment",
                    run_next,
                    tip="load next.toml, the protocol that separates what is still open",
                    main=True,
                )
            )
        if found.twin is not None:
            self._column.addWidget(
                button(
                    "Use as simulated rig",
                    use_twin,
                    tip="load twin.toml: a simulated bench that behaves as these recordings do",
                )
            )

    def _mechanisms(self, report: Report) -> None:
        if not report.mechanisms:
            return
        self._heading("What was left out, the largest first")
        for number, mechanism in enumerate(report.mechanisms, start=1):
            card = QFrame()
            card.setFrameShape(QFrame.Shape.StyledPanel)
            inside = QVBoxLayout(card)
            inside.setContentsMargins(8, 6, 8, 6)
            inside.setSpacing(2)
            inside.addWidget(_bold(f"{number}. {_spoken(mechanism.name)}{_how_sure(mechanism)}"))
            for name, quantity in mechanism.parameters.items():
                inside.addWidget(words(f"{parameter_words(name, quantity)}"))
            if mechanism.explanation:
                inside.addWidget(words(mechanism.explanation))
            if mechanism.alternatives:
                others = ", ".join(_alternative(mechanism, name) for name in mechanism.alternatives)
                inside.addWidget(words(f"Could as well be: {others}.", "note"))
            self._column.addWidget(card)

    def _windows(self, report: Report) -> None:
        if not report.mismatch:
            return
        self._heading("Where it differs")
        for number, window in enumerate(report.mismatch, start=1):
            line = button(
                f"{number}. {window_words(window)}",
                partial(self.window_asked.emit, window),
                tip=f"look at it in the trial; {window.conditions}" if window.conditions else "look at it",
            )
            line.setStyleSheet("text-align: left")
            self._column.addWidget(line)

    def _before_and_after(self, report: Report) -> None:
        self._heading("Before and after")
        table = QWidget()
        grid = QGridLayout(table)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setColumnStretch(3, 1)
        rows = [("", "before", "after")]
        for name, label in _TISSUE:
            before, after = report.baseline_parameters.get(name), report.improved_parameters.get(name)
            if before is not None and after is not None:
                rows.append((label, _with_error(before), _with_error(after)))
        held = report.heldout
        for label, one, other in (
            ("missed, mN rms", held.baseline_rms_mn, held.improved_rms_mn),
            ("χ² a sample", held.baseline_chi2, held.improved_chi2),
        ):
            if one is not None and other is not None:
                rows.append((label, f"{one:.3f}", f"{other:.3f}"))
        for i, row in enumerate(rows):
            for j, text in enumerate(row):
                grid.addWidget(_bold(text) if i == 0 else QLabel(text), i, j)
        self._column.addWidget(table)
        if held.noise_floor_mn is not None:
            text = f"predicting {counted(held.n_trials, 'trial')} that took no part in the fit; "
            self._column.addWidget(words(f"{text}noise {held.noise_floor_mn:.3f} mN rms", "faint"))

    def _hidden(self, report: Report) -> None:
        if not report.not_identifiable:
            return
        self._heading("What can't be seen in these recordings")
        for one in report.not_identifiable:
            way = f" To see it: {one.separated_by.replace('_', ' ')}." if one.separated_by else ""
            self._column.addWidget(words(f"{_spoken(one.name)}: {one.reason}.{way}", "faint"))

    def _said_besides(self, report: Report) -> None:
        for title, lines in (("Trials left out", report.left_out), ("To be kept in mind", report.notes)):
            if lines:
                self._heading(title)
            for line in lines:
                self._column.addWidget(words(line, "note"))

    def _heading(self, text: str) -> None:
        self._column.addSpacing(4)
        self._column.addWidget(_bold(text))


def _bold(text: str) -> QLabel:
    return words(text, "strong")


def _spoken(name: str) -> str:
    text = name.replace("_", " ")
    return text[:1].upper() + text[1:]


def _how_sure(mechanism: Mechanism) -> str:
    parts = []
    if mechanism.share_of_mismatch is not None:
        parts.append(f"{100 * mechanism.share_of_mismatch:.0f} % of the mismatch")
    if mechanism.probability is not None:
        parts.append(f"{100 * mechanism.probability:.0f} % sure")
    return f"   ({', '.join(parts)})" if parts else ""


def _alternative(mechanism: Mechanism, name: str) -> str:
    probability = mechanism.alternative_probabilities.get(name)
    sure = "" if probability is None else f" ({100 * probability:.0f} %)"
    return f"{name.replace('_', ' ')}{sure}"


def parameter_words(name: str, quantity: Quantity) -> str:
    """Return a parameter as it is said: name without its unit, value, error, unit."""
    ending = quantity.unit.lower().replace("/", "_per_")
    for unit in (ending, quantity.unit.lower().replace("/", "_")):
        name = name.removesuffix(f"_{unit}") if unit else name
    return f"{name.replace('_', ' ')}: {_with_error(quantity)} {quantity.unit}".rstrip()


def _with_error(quantity: Quantity) -> str:
    return with_error(quantity.value, quantity.se)


def window_words(window: Window) -> str:
    """Return where a window lies and what is left there."""
    size = "" if window.mean_residual_mn is None else f", {window.mean_residual_mn:+.2f} mN"
    share = f", {100 * window.share_of_mismatch:.0f} % of the mismatch" if window.share_of_mismatch else ""
    return f"{window.signal}, {window.phase}, {window.start_s:.2f} to {window.stop_s:.2f} s{size}{share}"
