"""Questions to the person at the window, never in the event loop's way: the answer comes by a call."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtWidgets import QMessageBox, QWidget

Choices = Mapping[str, Callable[[], object]]

Ask = Callable[[QWidget, str, str, Choices], None]
"""Parent, title, words, and the choices with what each does; the first one is what Esc chooses."""


def ask(parent: QWidget, title: str, text: str, choices: Choices) -> None:
    """Show a box with one button a choice, and do what belongs to the one that is pressed."""
    box = QMessageBox(parent)
    box.setWindowTitle(title)
    box.setText(text)
    box.setIcon(QMessageBox.Icon.Question)
    does = {}
    for i, (name, action) in enumerate(choices.items()):
        button = box.addButton(name, QMessageBox.ButtonRole.ActionRole)
        does[button] = action
        if i == 0:
            box.setDefaultButton(button)
            box.setEscapeButton(button)

    def chosen() -> None:
        action = does.get(box.clickedButton())  # type: ignore[call-overload]
        box.deleteLater()
        if action is not None:
            action()

    box.finished.connect(chosen)
    box.open()
