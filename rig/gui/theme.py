"""Light and dark: Qt's Fusion style with palettes of its own, and colours that every eye tells apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from PySide6.QtGui import QColor, QFont, QPalette
from PySide6.QtWidgets import QApplication

from analysis.figures import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, YELLOW

_FONT_PT = 10.0


@dataclass(frozen=True, slots=True)
class Theme:
    """The colours of one look, as #rrggbb.

    ``curves`` are told apart on this ground (3:1 against it at least); ``bad``, ``good`` and ``note`` colour
    text that says the same in words. ``phases`` are the faint grounds behind a trial's phases, by name.
    """

    name: str
    window: str
    ground: str
    raised: str
    text: str
    faint: str
    line: str
    accent: str
    on_accent: str
    bad: str
    good: str
    note: str
    curves: tuple[str, ...]
    phases: tuple[tuple[str, str], ...]

    def phase(self, name: str) -> str:
        """Return the ground of a phase; the plot's own where it has none."""
        return dict(self.phases).get(name, self.ground)


LIGHT = Theme(
    name="light",
    window="#f3f4f6",
    ground="#ffffff",
    raised="#e6e8ec",
    text="#16181c",
    faint="#5a6068",
    line="#b9bec6",
    accent=BLUE,
    on_accent="#ffffff",
    bad="#a83200",
    good="#00664a",
    note="#7a5200",
    curves=(BLUE, VERMILLION, GREEN, PURPLE, "#16181c", "#8a5f00"),
    phases=(
        ("approach", "#f0f3f8"),
        ("ramp", "#dcebf6"),
        ("hold", "#eef6ee"),
        ("retract", "#f8ece4"),
    ),
)
DARK = Theme(
    name="dark",
    window="#26282c",
    ground="#1e1e1e",
    raised="#35383e",
    text="#eceef1",
    faint="#a7adb6",
    line="#575c65",
    accent=SKY,
    on_accent="#101214",
    bad="#ff9a66",
    good="#4fd0a6",
    note="#f0c060",
    curves=(SKY, ORANGE, "#2cc79b", PURPLE, YELLOW, "#eceef1"),
    phases=(
        ("approach", "#24272d"),
        ("ramp", "#1d3040"),
        ("hold", "#22301f"),
        ("retract", "#382820"),
    ),
)
THEMES = {theme.name: theme for theme in (LIGHT, DARK)}


def apply_theme(app: QApplication, theme: Theme) -> None:
    """Give the whole program a look; pages restyle their plots themselves (`restyle_plot`)."""
    # each of these polishes every widget there is: no more of them than needed
    if app.style().objectName() != "fusion" and not app.styleSheet():
        app.setStyle("Fusion")
    if app.font().pointSizeF() != _FONT_PT:
        font = QFont(app.font())
        font.setPointSizeF(_FONT_PT)
        app.setFont(font)
    app.setPalette(palette_of(theme))
    app.setStyleSheet(_style_sheet(theme))


def palette_of(theme: Theme) -> QPalette:
    """Return Qt's palette of a theme."""
    role = QPalette.ColorRole
    palette = QPalette()
    for names, colour in (
        ((role.Window,), theme.window),
        ((role.Base,), theme.ground),
        ((role.AlternateBase, role.Button, role.ToolTipBase, role.Midlight, role.Light), theme.raised),
        (
            (role.WindowText, role.Text, role.ButtonText, role.ToolTipText, role.BrightText),
            theme.text,
        ),
        ((role.PlaceholderText,), theme.faint),
        ((role.Highlight, role.Link), theme.accent),
        ((role.HighlightedText,), theme.on_accent),
        ((role.Mid, role.Dark), theme.line),
    ):
        for name in names:
            palette.setColor(name, QColor(colour))
    for name in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, name, QColor(theme.faint))
    return palette


def restyle_plot(plot: Any, theme: Theme) -> None:
    """Give a pyqtgraph PlotWidget or PlotItem the theme's ground, axes and title; curves keep their pens."""
    if hasattr(plot, "setBackground"):
        plot.setBackground(theme.ground)
    item = plot.getPlotItem() if hasattr(plot, "getPlotItem") else plot
    item.setContentsMargins(0, 8, 8, 0)  # else the uppermost number is cut off
    for side in ("left", "bottom", "right", "top"):
        axis = item.getAxis(side)
        axis.setPen(theme.line)
        axis.setTextPen(theme.text)
        axis.enableAutoSIPrefix(False)  # the label names its unit: "(x0.001)" behind it misleads
    item.titleLabel.setAttr("color", theme.text)
    if item.legend is not None:
        item.legend.setLabelTextColor(theme.text)
        for _, label in item.legend.items:
            label.setText(label.text, color=theme.text)


def legend_below(plot: Any) -> None:
    """Give a plot of force over time a legend at the middle of its lower edge, which no held force reaches."""
    plot.getPlotItem().addLegend().anchor((0.5, 1.0), (0.5, 1.0), offset=(0, -8))


def _style_sheet(theme: Theme) -> str:
    """Return what a palette can't say: where the keyboard's focus is, and the words' roles."""
    focusable = "QPushButton, QToolButton, QLineEdit, QComboBox, QCheckBox, QAbstractItemView, QPlainTextEdit"
    focused = ", ".join(f"{name}:focus" for name in focusable.split(", "))
    return f"""
        {focused} {{ outline: none; border: 2px solid {theme.accent}; border-radius: 3px; }}
        QLineEdit, QPlainTextEdit {{ border: 1px solid {theme.line}; border-radius: 3px; padding: 2px 4px;
            background: {theme.ground}; }}
        QLineEdit[faulty="true"] {{ border: 2px solid {theme.bad}; }}
        QPushButton {{ border: 1px solid {theme.line}; border-radius: 3px; padding: 4px 12px;
            background: {theme.raised}; }}
        QCheckBox::indicator:unchecked {{ width: 12px; height: 12px; border: 1px solid {theme.faint};
            background: {theme.ground}; }}
        QPushButton:hover {{ border-color: {theme.accent}; }}
        QPushButton:pressed {{ background: {theme.line}; }}
        QPushButton:disabled {{ color: {theme.faint}; }}
        QPushButton[main="true"] {{ background: {theme.accent}; color: {theme.on_accent}; font-weight: bold; }}
        QPushButton[main="true"]:disabled {{ background: {theme.raised}; color: {theme.faint}; }}
        QLabel[role="bad"] {{ color: {theme.bad}; }}
        QLabel[role="good"] {{ color: {theme.good}; }}
        QLabel[role="note"] {{ color: {theme.note}; }}
        QLabel[role="faint"] {{ color: {theme.faint}; }}
        QLabel[role="heading"] {{ font-size: 13pt; font-weight: bold; }}
        QLabel[role="strong"] {{ font-weight: bold; }}
        QToolTip {{ color: {theme.text}; background: {theme.raised}; border: 1px solid {theme.line}; }}
        QHeaderView::section {{ background: {theme.raised}; color: {theme.text}; padding: 3px 6px; border: 0;
            border-right: 1px solid {theme.line}; }}
    """
