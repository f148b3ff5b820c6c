"""Words down a pipe: heard in order and whole, and no hindrance to the end of who listens."""

from __future__ import annotations

import os
import subprocess
import sys

from rig.hardware.hearing import Ear, first_line

LISTENING = """
import sys
from rig.hardware.hearing import Ear
ear = Ear()
ear.listen(0, "program")
assert ear.heard(30.0) == [("program", "end")]
"""


def test_words_are_heard_in_order_after_the_first_line() -> None:
    hears, says = os.pipe()
    os.write(says, b'{"orders": 1}\naway 1.0 2.0\nbe')
    assert first_line(hears) == b'{"orders": 1}\n'
    ear = Ear()
    ear.listen(hears, "program")
    os.write(says, b"at engine\nsafe\n")
    os.close(says)
    heard: list[tuple[str, str | None]] = []
    while ("program", None) not in heard:
        came = ear.heard(5.0)
        assert came, heard
        heard += came
    assert [word for _, word in heard] == ["away 1.0 2.0", "beat engine", "safe", None]
    os.close(hears)


def test_a_process_that_listens_ends_at_once_and_whole() -> None:
    """The pipe still open: a thread that waits in it must not make the end a crash, a second later."""
    process = subprocess.Popen(
        [sys.executable, "-c", LISTENING], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdin is not None
    process.stdin.write(b"end\n")
    process.stdin.flush()
    code = process.wait(30.0)
    assert code == 0, process.communicate()[1].decode()
    process.stdin.close()
    assert process.stderr is not None
    process.stderr.close()
