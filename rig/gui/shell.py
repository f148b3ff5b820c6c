"""The window's frame: rail, header, banner, pages and status line, and where they remember to be."""

from __future__ import annotations

from PySide6.QtCore import QByteArray, QSize, QTimer
from PySide6.QtWidgets import (
    QButtonGroup,
    QHBoxLayout,
    QSplitter,
    QStackedWidget,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from rig.gui.header import Banner, Header
from rig.gui.shortened import ShortenedLabel
from rig.gui.theme import LIGHT, Theme

RAIL_WIDTH = 90
_SUCCESS_MS = 5000
_STAY = frozenset({"bad", "done"})


class _Pages(QStackedWidget):
    """Pages that need the room of the one that is seen: Qt asks for that of the widest, seen or not."""

    def __init__(self) -> None:
        super().__init__()
        self.currentChanged.connect(lambda _: self.updateGeometry())

    def minimumSizeHint(self) -> QSize:  # noqa: N802
        """What the page in front needs."""
        page = self.currentWidget()
        return super().minimumSizeHint() if page is None else page.minimumSizeHint()


class Shell(QWidget):
    """Puts header, banner, rail, pages and the column beside them together."""

    def __init__(self, column: QWidget) -> None:
        super().__init__()
        self._theme = LIGHT
        self._column = column
        self.header, self.banner = Header(), Banner()
        self.pages: dict[str, QWidget] = {}
        self._beside: set[str] = set()
        self._stack = _Pages()
        self._buttons = QButtonGroup(self)
        self._buttons.setExclusive(True)
        self._rail = QVBoxLayout()
        self._rail.setContentsMargins(4, 6, 4, 6)
        self._rail.setSpacing(4)
        self._rail.addStretch(1)
        rail = self._rail_widget = QWidget()
        rail.setFixedWidth(RAIL_WIDTH)
        rail.setLayout(self._rail)
        self._status = ShortenedLabel()
        self._status.setAccessibleName("last message")
        self._dismiss = QToolButton()
        self._dismiss.setText("✕")
        self._dismiss.setToolTip("put this message away; the log keeps it")
        self._dismiss.setAccessibleName("put this message away")
        self._dismiss.clicked.connect(self.clear)
        self._fading = QTimer(self)
        self._fading.setSingleShot(True)
        self._fading.timeout.connect(self._fade)
        self._stays: tuple[str, str] | None = None
        middle = QHBoxLayout()
        middle.setSpacing(0)
        middle.addWidget(rail)
        middle.addWidget(self._stack, 1)
        middle.addWidget(column)
        status = QHBoxLayout()
        status.setContentsMargins(8, 2, 8, 3)
        status.addWidget(self._status, 1)
        status.addWidget(self._dismiss)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.header)
        layout.addWidget(self.banner)
        layout.addLayout(middle, 1)
        layout.addLayout(status)
        self.clear()

    def add(self, name: str, page: QWidget, tip: str, *, beside: bool = False) -> None:
        """Add a page to the rail; ``beside``: the column of figures stands beside it."""
        self.pages[name] = page
        if beside:
            self._beside.add(name)
        button = QToolButton()
        button.setText(name)
        button.setCheckable(True)
        button.setToolTip(tip)
        button.setAccessibleName(f"page {name}")
        button.setMinimumSize(QSize(RAIL_WIDTH - 8, 44))
        button.clicked.connect(lambda: self.show_page(name))
        self._buttons.addButton(button)
        button.setProperty("page", name)
        self._rail.insertWidget(self._rail.count() - 1, button)
        self._stack.addWidget(page)

    @property
    def page(self) -> str:
        """The page that is seen."""
        return next((name for name, page in self.pages.items() if page is self._stack.currentWidget()), "")

    def show_page(self, name: str) -> None:
        """Bring a page to the front."""
        # never a wide page and the column at once: a window that has grown does not shrink again
        if name not in self._beside:
            self._column.hide()
        self._stack.setCurrentWidget(self.pages[name])
        if name in self._beside:
            self._column.show()
        for button in self._buttons.buttons():
            button.setChecked(button.property("page") == name)
        self.pages[name].setFocus()

    def tell(self, line: str, kind: str) -> None:
        """Show a message: failures (bad) and what an abort did (done) stay until they are put away.

        A note is shown over them for as long as any message, what just happened besides (good, "") is not.
        """
        if kind in _STAY:
            self._stays = (line, kind)
        elif self._stays is not None and kind != "note":
            return
        self._write(line, kind)
        if kind in _STAY:
            self._fading.stop()
        else:
            self._fading.start(_SUCCESS_MS)

    def _write(self, line: str, kind: str) -> None:
        self._status.setText(line)
        t = self._theme
        colour = {"good": t.good, "done": t.good, "note": t.note, "bad": t.bad}.get(kind, t.text)
        weight = "bold" if kind in _STAY else "normal"
        self._status.setStyleSheet(f"color: {colour}; font-weight: {weight};")
        self._dismiss.setVisible(kind in _STAY)

    def clear(self) -> None:
        """Put the message away, whatever it is."""
        self._stays = None
        self._write("", "")

    def _fade(self) -> None:
        """A message has been seen long enough; one that stays comes back."""
        self._write(*(self._stays or ("", "")))

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        self._rail_widget.setStyleSheet(
            f"QToolButton {{ background: transparent; border: 1px solid transparent; border-radius: 4px; }}"
            f"QToolButton:hover {{ border-color: {theme.line}; }}"
            f"QToolButton:focus {{ border: 2px solid {theme.accent}; }}"
            f"QToolButton:checked {{ background: {theme.raised}; border-left: 4px solid {theme.accent};"
            " font-weight: bold; }"
        )
        self.header.restyle(theme)
        self.banner.restyle(theme)

    def splitters(self) -> dict[str, QSplitter]:
        """Return the splitters of the pages, by a name that stays."""
        found = {}
        for name, page in self.pages.items():
            for i, splitter in enumerate(page.findChildren(QSplitter)):
                found[f"{name} {i}"] = splitter
        return found


def restored(splitter: QSplitter, state: bytes | None) -> None:
    """Put a splitter where it was; one of another make is left as it is."""
    if state is not None:
        splitter.restoreState(QByteArray(state))
