"""Words that come down a pipe, one a line, taken in by a process that has other things to look at meanwhile."""

from __future__ import annotations

import os
import queue
import threading

_AT_ONCE = 4096


class Ear:
    """Hears any number of pipes, each in a thread of its own; whoever asks never waits for one of them.

    They are read past Python's buffers: a thread that waits in one of those when the process ends holds that end
    up for a second, and then makes it a crash.
    """

    def __init__(self) -> None:
        self._words: queue.SimpleQueue[tuple[str, str | None]] = queue.SimpleQueue()

    def listen(self, fd: int, whose: str) -> None:
        """Hear the pipe of a descriptor from now on, until its end."""
        threading.Thread(target=self._listen, args=(fd, whose), daemon=True).start()

    def heard(self, wait_s: float) -> list[tuple[str, str | None]]:
        """All that has come, waiting so long for the first: whose word it is, and the word; None at a pipe's end."""
        heard: list[tuple[str, str | None]] = []
        try:
            heard.append(self._words.get(timeout=wait_s))
            while True:
                heard.append(self._words.get_nowait())
        except queue.Empty:
            return heard

    def _listen(self, fd: int, whose: str) -> None:
        rest = b""
        while came := os.read(fd, _AT_ONCE):
            *lines, rest = (rest + came).split(b"\n")
            for line in lines:
                self._words.put((whose, line.decode(errors="replace").strip()))
        self._words.put((whose, None))


def first_line(fd: int) -> bytes:
    """The first line that comes down a pipe, and nothing of what follows it."""
    with open(fd, "rb", buffering=0, closefd=False) as pipe:
        return pipe.readline()
