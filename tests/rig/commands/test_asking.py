"""A person at the terminal is asked in plain words, and answers by a line; or another process does."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from rig.commands.asking import ConsoleAnswers
from rig.engine.progress import Snapshot
from rig.engine.prompts import Desk, Prompt
from rig.engine.states import State
from rig.hardware.errors import OperatorError

Ask = Callable[..., Any]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, Desk, Ask, io.StringIO]]:
    """What is typed (a file to write to), a desk, a question to ask, and what was printed."""
    read_end, write_end = os.pipe()
    typed = os.fdopen(write_end, "w")
    shown = io.StringIO()
    with os.fdopen(read_end) as keyboard:
        monkeypatch.setattr("sys.stdin", keyboard)
        desk = Desk()
        answers = ConsoleAnswers(desk, Console(file=shown, width=200))

        def show(prompt: Prompt | None) -> None:
            answers.show(Snapshot("run", State.PREPARING, prompt=prompt))

        def ask(words: str, **more: Any) -> Any:
            return desk.ask("place_finger", words, check=lambda: None, show=show, **more)

        yield typed, desk, ask, shown
        typed.close()
        if answers._reader is not None:
            answers._reader.join(5)


def test_enter_means_done(terminal: Any) -> None:
    typed, _, ask, shown = terminal
    print(file=typed, flush=True)
    assert ask("Place the index finger") is None
    assert "Place the index finger (Enter when done, s to stop)" in shown.getvalue()


def test_s_stops_and_so_does_a_closed_terminal(terminal: Any) -> None:
    typed, _, ask, _ = terminal
    print("s", file=typed, flush=True)
    with pytest.raises(OperatorError, match="the operator stopped the run"):
        ask("Place the index finger")
    typed.close()
    for _ in range(2):
        with pytest.raises(OperatorError, match="nobody is at the console"):
            ask("Place the index finger")


def test_a_number_is_typed(terminal: Any) -> None:
    typed, _, ask, shown = terminal
    print("five\n5,02", file=typed, flush=True)
    assert ask("Weigh it", suggested=5.0, unit="g") == 5.02
    assert "five is no number" in shown.getvalue()


def test_another_process_may_answer_first(terminal: Any, tmp_path: Path) -> None:
    _, desk, ask, _ = terminal

    def answer() -> None:
        while desk.standing is None:
            pass
        desk.answer(desk.standing.id)

    thread = threading.Thread(target=answer)
    thread.start()
    assert ask("Place the index finger") is None
    thread.join()
