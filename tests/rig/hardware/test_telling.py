"""Lines to the person: taken or not, whoever writes them goes on."""

from __future__ import annotations

import os
import time

from rig.hardware.telling import tell_person


def test_a_line_is_written_whole() -> None:
    reads, writes = os.pipe()
    tell_person(writes, "lift it by hand")
    assert os.read(reads, 100) == b"\nindenter: lift it by hand\n"
    os.close(reads)
    tell_person(writes, "nobody hears this")
    os.close(writes)


def test_a_terminal_that_takes_nothing_holds_nobody_up(full_pipe: tuple[int, int]) -> None:
    reads, writes = full_pipe
    began_s = time.monotonic()
    tell_person(writes, "lift it by hand")
    assert time.monotonic() - began_s < 5.0
    said = b""
    while b"lift it by hand" not in said:
        said = said[-100:] + os.read(reads, 4096)  # it comes when there is room again
