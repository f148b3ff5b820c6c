"""Words that come down a pipe, one a line, taken in by a process that has other things to look at meanwhile."""

from __future__ import annotations

import queue
import threading
from typing import BinaryIO


class Ear:
    """Hears any number of pipes, each in a thread of its own; whoever asks never waits for one of them."""

    def __init__(self) -> None:
        self._words: queue.SimpleQueue[tuple[str, str | None]] = queue.SimpleQueue()

    def listen(self, pipe: BinaryIO, whose: str) -> None:
        """Hear a pipe from now on, until its end."""
        threading.Thread(target=self._listen, args=(pipe, whose), daemon=True).start()

    def heard(self, wait_s: float) -> list[tuple[str, str | None]]:
        """All that has come, waiting so long for the first: whose word it is, and the word; None at a pipe's end."""
        heard: list[tuple[str, str | None]] = []
        try:
            heard.append(self._words.get(timeout=wait_s))
            while True:
                heard.append(self._words.get_nowait())
        except queue.Empty:
            return heard

    def _listen(self, pipe: BinaryIO, whose: str) -> None:
        for line in pipe:
            self._words.put((whose, line.decode(errors="replace").strip()))
        self._words.put((whose, None))
