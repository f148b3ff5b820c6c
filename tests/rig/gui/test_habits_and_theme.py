from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from rig.gui.habits import Habits
from rig.gui.theme import THEMES, Theme, apply_theme


def test_habits_last(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "window.json"
    habits = Habits(path)
    habits.theme = "dark"
    habits.rig = tmp_path / "rig.toml"
    habits.used_folder("trials", tmp_path)
    habits.keep_layout("main", b"\x00\xff state")
    habits.keep_choice("axes", "force over position")
    for name in ("a", "b", "a"):
        habits.used_protocol(tmp_path / f"{name}.toml")
    again = Habits(path)
    assert (again.theme, again.rig, again.folder("trials")) == ("dark", tmp_path / "rig.toml", tmp_path)
    assert again.layout("main") == b"\x00\xff state"
    assert again.choice("axes", "") == "force over position"
    assert [p.name for p in again.recent_protocols] == ["a.toml", "b.toml"]
    again.forget_layouts()
    assert Habits(path).layout("main") is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"folders": 3, "layouts": {"main": "?"}, "theme": null}'])
def test_habits_that_make_no_sense_are_begun_anew(tmp_path: Path, text: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(text)
    habits = Habits(path)
    assert (habits.theme, habits.rig, habits.folder("trials")) == ("light", None, None)
    assert (habits.layout("main"), habits.recent_protocols) == (None, ())
    habits.used_folder("trials", tmp_path)
    assert Habits(path).folder("trials") == tmp_path


def test_habits_that_cant_be_kept_are_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    habits = Habits(tmp_path / "file" / "window.json")
    habits.theme = "dark"
    assert "can't be written" in habits.fault
    assert habits.theme == "dark"


def _luminance(colour: str) -> float:
    parts = QColor(colour).getRgbF()[:3]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(one: str, other: str) -> float:
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", THEMES.values(), ids=list(THEMES))
def test_contrasts_are_those_of_wcag(theme: Theme) -> None:
    """Text 4.5:1 on every ground it stands on, curves 3:1 on the plot."""
    for ground in (theme.window, theme.ground, theme.raised):
        for text in (theme.text, theme.bad, theme.good, theme.note, theme.faint):
            assert _contrast(text, ground) >= 4.5, (text, ground)
    assert _contrast(theme.on_accent, theme.accent) >= 4.5
    for curve in theme.curves:
        assert _contrast(curve, theme.ground) >= 3.0, curve
    for _, ground in theme.phases:
        assert _contrast(theme.curves[0], ground) >= 3.0


def test_a_theme_reaches_the_application(qapp: QApplication) -> None:
    for theme in THEMES.values():
        apply_theme(qapp, theme)
        assert qapp.palette().color(QPalette.ColorRole.Base) == QColor(theme.ground)
        assert qapp.font().pointSizeF() == pytest.approx(10.0)
