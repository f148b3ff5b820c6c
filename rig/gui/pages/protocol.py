"""The protocol page: a form, what it would do, and the file that the headless runner takes as well."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QFontDatabase, QHideEvent
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QMenu,
    QPlainTextEdit,
    QPushButton,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from analysis.errors import BadInputError
from rig.gui.asking import ask_file, ask_new_file
from rig.gui.banner import Banner
from rig.gui.controls import button, say, words
from rig.gui.form_fields import kinds
from rig.gui.habits import Habits
from rig.gui.jobs.planning import Preview, preview_protocol, usual_surface_mm
from rig.gui.motion_preview import MotionPreview
from rig.gui.protocol_draft import ProtocolDraft
from rig.gui.protocol_form import ProtocolForm
from rig.gui.theme import Theme
from rig.gui.worker import Worker
from rig.settings.rig_file import RigFile

_SETTLE_MS = 120
_TOML = "Protocols (*.toml)"


class ProtocolPage(QWidget):
    """Edits one protocol file. `run_asked` gives the saved file that is to be run."""

    said = Signal(str)
    run_asked = Signal(Path)

    def __init__(self, worker: Worker, habits: Habits) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self._rig = RigFile()
        self._rig_known = False
        self._surface_mm = usual_surface_mm(self._rig)
        self.draft = ProtocolDraft.example("study")
        self.faults: dict[str, str] = {}
        self.form = ProtocolForm()
        self.preview = MotionPreview()
        self.banner = Banner()
        self._settle = QTimer(self)
        self._settle.setSingleShot(True)
        self._settle.setInterval(_SETTLE_MS)
        self._settle.timeout.connect(self.check)
        self._build()
        self.form.changed.connect(self._settle.start)
        self.preview.surface_moved.connect(self._move_surface)
        self._edit(self.draft)

    def set_rig(self, rig: RigFile) -> None:
        """Take the limits of the rig that the protocol would run on."""
        self._rig, self._rig_known = rig, True
        self._surface_mm = usual_surface_mm(rig)
        self.check()

    def open_protocol(self, path: Path) -> None:
        """Show a protocol file; changes that are not saved are asked about first."""
        self._unless_changed(partial(self._load, path))

    def new_protocol(self, kind: str) -> None:
        """Begin with the example of a kind; changes that are not saved are asked about first."""
        self._unless_changed(lambda: self._edit(ProtocolDraft.example(kind)))

    def save(self, then: Callable[[], object] = lambda: None) -> None:
        """Save the file, under a new name where it has none; then go on."""
        if self.draft.path is None:
            self.save_as(then)
        else:
            self._save_to(then, self.draft.path)

    def save_as(self, then: Callable[[], object] = lambda: None) -> None:
        """Ask for a name and save the file there."""
        folder = self._habits.folder("protocols") or Path.home()
        name = self.draft.path.name if self.draft.path else f"{self.draft.kind}.toml"
        ask_new_file(self, "Save the protocol as", folder / name, _TOML, partial(self._save_to, then))

    def run_protocol(self) -> None:
        """Ask for the protocol to be run; what runs is always a file as it is saved."""
        self.check()
        if self.faults:
            self._show_first_fault()
        elif self.draft.path is None:
            self.banner.ask(
                "This protocol has no file yet: what is run is kept with its trials, and can be run again.",
                [("Save and run", lambda: self.save(self._run)), ("Cancel", lambda: None)],
            )
        elif self.draft.changed:
            self.banner.ask(
                f"{self.draft.path.name} has changes that are not saved.",
                [("Save and run", lambda: self.save(self._run)), ("Cancel", lambda: None)],
            )
        else:
            self._run()

    def check(self) -> None:
        """Say what is wrong with each value; where nothing is, have the motion worked out."""
        self.faults = self.draft.faults(self._rig if self._rig_known else None)
        others = self.form.show_faults(self.faults)
        self._run_button.setEnabled(not self.faults)
        if self.faults:
            n = len(self.faults)
            text = "; ".join(others) or f"{n} value{'s' if n > 1 else ''} to mend, marked in the form"
            say(self._state, text, "bad")
        elif not self._rig_known:
            say(
                self._state,
                "Every value is valid. No rig is chosen: the limits shown are the usual ones.",
                "note",
            )
        else:
            whose = f"the rig “{self._rig.name}”" if self._rig.name else "this rig"
            say(self._state, f"Every value is valid, and within the limits of {whose}.", "good")
        mark = " — not saved" if self.draft.changed or self.draft.path is None else ""
        self._title.setText(f"{self.draft.path or self.draft.kind.replace('_', ' ')}{mark}")
        self._title.setToolTip(str(self.draft.path or ""))
        if self._text.toPlainText() != self.draft.text:
            self._text.setPlainText(self.draft.text)
        self._ask_preview()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.preview.restyle(theme)

    def hideEvent(self, event: QHideEvent) -> None:  # noqa: N802
        """Remember the layout."""
        super().hideEvent(event)
        self._habits.keep_layout("protocol.split", bytes(self._split.saveState().data()))

    def _build(self) -> None:
        self._title = QLabel()
        self._title.setProperty("role", "heading")
        self._title.setSizePolicy(
            self._title.sizePolicy().Policy.Ignored, self._title.sizePolicy().Policy.Fixed
        )
        self._state = words()
        self._run_button = button(
            "&Run this protocol", self.run_protocol, tip="run it on the rig that is chosen", main=True
        )
        bar = QHBoxLayout()
        bar.addWidget(self._menu_button("&New", "begin with the example of a kind", self._fill_new))
        bar.addWidget(button("&Open …", self._ask_file, tip="open a protocol file", key="Ctrl+O"))
        bar.addWidget(self._menu_button("Re&cent", "protocols used lately", self._fill_recent))
        bar.addWidget(button("&Save", self.save, tip="save the file", key="Ctrl+S"))
        bar.addWidget(button("Save &as …", self.save_as, tip="save under another name"))
        bar.addStretch(1)
        bar.addWidget(self._run_button)
        self._text = QPlainTextEdit()
        self._text.setReadOnly(True)
        self._text.setAccessibleName("the file as it is saved")
        self._text.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self._text.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        tabs = QTabWidget()
        tabs.addTab(self.preview, "&Motion")
        tabs.addTab(self._text, "Fi&le")
        self._split = QSplitter(Qt.Orientation.Horizontal)
        self._split.addWidget(self.form)
        self._split.addWidget(tabs)
        self._split.setChildrenCollapsible(False)
        self._split.setSizes([560, 700])
        state = self._habits.layout("protocol.split")
        if state is not None:
            self._split.restoreState(state)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addLayout(bar)
        layout.addWidget(self._title)
        layout.addWidget(self.banner)
        layout.addWidget(self._state)
        layout.addWidget(self._split, 1)

    def _menu_button(self, text: str, tip: str, fill: Callable[[QMenu], None]) -> QPushButton:
        made = QPushButton(text)
        made.setAccessibleName(text.replace("&", ""))
        made.setToolTip(tip)
        menu = QMenu(made)
        menu.aboutToShow.connect(lambda: fill(menu))
        made.setMenu(menu)
        return made

    def _fill_new(self, menu: QMenu) -> None:
        menu.clear()
        for kind in kinds():
            menu.addAction(kind.replace("_", " "), partial(self.new_protocol, kind))

    def _fill_recent(self, menu: QMenu) -> None:
        menu.clear()
        recent = self._habits.recent_protocols
        for path in recent:
            menu.addAction(f"{path.name}   {path.parent}", partial(self.open_protocol, path))
        if not recent:
            menu.addAction("none yet: open or save one").setEnabled(False)

    def _ask_file(self) -> None:
        ask_file(self, "Open a protocol", self._habits.folder("protocols"), _TOML, self.open_protocol)

    def _unless_changed(self, then: Callable[[], object]) -> None:
        if not self.draft.changed:
            then()
            return
        name = self.draft.path.name if self.draft.path else "This protocol"
        self.banner.ask(
            f"{name} has changes that are not saved.",
            [("Save", lambda: self.save(then)), ("Drop the changes", then), ("Cancel", lambda: None)],
        )

    def _load(self, path: Path) -> None:
        try:
            draft = ProtocolDraft.load(path)
        except BadInputError as error:
            self._failed(str(error))
            return
        self._used(path)
        self._edit(draft)

    def _save_to(self, then: Callable[[], object], path: Path) -> None:
        try:
            self.draft.save(path)
        except BadInputError as error:
            self._failed(str(error))
            return
        self._used(path)
        self.said.emit(f"{path}: saved")
        self.check()
        then()

    def _used(self, path: Path) -> None:
        self._habits.used_protocol(path)
        self._habits.used_folder("protocols", path.parent)

    def _edit(self, draft: ProtocolDraft) -> None:
        self.banner.drop()
        self.draft = draft
        self.form.edit(draft)
        self.check()

    def _failed(self, problem: str) -> None:
        self.banner.ask(problem, [("Dismiss", lambda: None)], "bad")
        self.said.emit(problem)

    def _run(self) -> None:
        if not self.faults and self.draft.path is not None:
            self.said.emit(f"{self.draft.path}: to be run")
            self.run_asked.emit(self.draft.path)

    def _show_first_fault(self) -> None:
        for line in self.form.lines.values():
            if line.fault.text():
                self.form.ensureWidgetVisible(line.editor)
                line.editor.setFocus()
                return

    def _move_surface(self, surface_mm: float) -> None:
        lever = self._rig.lever
        self._surface_mm = min(max(surface_mm, lever.travel_min_mm), lever.travel_max_mm)
        self._ask_preview()

    def _ask_preview(self) -> None:
        if self.faults:
            self._worker.forget("preview")
            self.preview.show_preview(None, self._rig)
            return
        rig = self._rig

        def got(preview: Preview) -> None:
            self.preview.show_preview(preview, rig)

        self._worker.ask(
            "the preview of the motion",
            preview_protocol,
            self.draft.text,
            rig,
            self._surface_mm,
            then=got,
            failed=self._failed,
            key="preview",
            urgent=True,
        )
