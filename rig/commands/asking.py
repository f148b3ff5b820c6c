"""A person at this terminal, who answers what a run asks; another process may answer first."""

from __future__ import annotations

import os
import sys
import threading
from queue import Empty, SimpleQueue

from rich.console import Console

from rig.engine.progress import Snapshot
from rig.engine.prompts import Desk, Prompt
from rig.hardware.lever import Chunk

_NOBODY = (
    "nobody is at the console to answer; run in a terminal, or name a service under [operator] in rig.toml"
)


class ConsoleAnswers:
    """An observer that writes the question that stands, and answers it with what is typed here."""

    def __init__(self, desk: Desk, console: Console) -> None:
        self._desk = desk
        self._console = console
        self._asked = ""
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._reader: threading.Thread | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Write a question that has come up, and have its answer awaited."""
        prompt = snapshot.prompt
        if prompt is None or prompt.id == self._asked:
            return
        self._asked = prompt.id
        if self._reader is None:
            self._reader = threading.Thread(target=self._read, name="console", daemon=True)
            self._reader.start()
        number = f"; Enter alone for {prompt.suggested:g} {prompt.unit}" if prompt.wants == "number" else ""
        self._console.print(
            f"{prompt.words} [dim](Enter when done, s to stop{number})[/dim]", highlight=False, soft_wrap=True
        )
        threading.Thread(target=self._await, args=(prompt,), name="answer", daemon=True).start()

    def follow(self, chunk: Chunk) -> None:
        """See samples; no question depends on them."""

    def mark(self, name: str, sample: int, now: int) -> None:
        """Hear of a phase; no question depends on it."""

    def _await(self, prompt: Prompt) -> None:
        """Wait for a line as long as the question stands."""
        while self._desk.standing is prompt:
            try:
                line = self._lines.get(timeout=0.1)
            except Empty:
                continue
            if line is None:
                self._lines.put(None)  # for the next question too
                self._desk.cancel(prompt.id, _NOBODY)
            elif line.strip().lower() in {"s", "stop"}:
                self._desk.cancel(prompt.id, "the operator stopped the run")
            else:
                self._answer(prompt, line.strip())

    def _answer(self, prompt: Prompt, line: str) -> None:
        value = None
        if prompt.wants == "number" and line:
            try:
                value = float(line.replace(",", "."))
            except ValueError:
                self._console.print(f"{line} is no number: give it in {prompt.unit}", highlight=False)
                return
        why = self._desk.answer(prompt.id, value)
        if why:
            self._console.print(why, highlight=False)

    def _read(self) -> None:
        """Read lines for as long as the program lives, past Python's buffers, which its end would wait for."""
        rest = b""
        while True:
            try:
                came = os.read(sys.stdin.fileno(), 4096)
            except (OSError, ValueError):
                came = b""
            *lines, rest = (rest + came).split(b"\n")
            for line in lines:
                self._lines.put(line.decode("utf-8", "replace"))
            if not came:
                self._lines.put(None)
                return
