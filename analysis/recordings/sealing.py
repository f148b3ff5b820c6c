"""The seal at the end of a finished trial file: a checksum that tells a damaged file from a good one.

The HDF5 library can crash, or never return, on a damaged file, and a flipped bit in a sample is not seen at
all. The seal is a line of text behind the end of the HDF5 data, where the library does not look; it removes
the line itself when a program changes the file, so that a seal never speaks of other contents.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Literal

_LABEL = b"\nindenter-crc32 "
_SEAL_BYTES = len(_LABEL) + 8 + 1


def seal(path: Path) -> None:
    """Append the checksum of all that the file holds."""
    with path.open("rb+") as file:
        file.write(_line(file.read()))


def is_sealed(path: Path) -> bool:
    """Return whether the file carries a seal, without asking whether its contents agree with it."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _SEAL_BYTES))
        return file.read(len(_LABEL)) == _LABEL


def seal_state(path: Path) -> Literal["intact", "broken", "absent"]:
    """Return whether the file carries a seal, and whether its contents still agree with it."""
    contents = path.read_bytes()
    if contents[-_SEAL_BYTES:-9] != _LABEL:
        return "absent"
    body = memoryview(contents)[:-_SEAL_BYTES]
    return "intact" if contents[-_SEAL_BYTES:] == _line(body) else "broken"


def _line(contents: bytes | memoryview) -> bytes:
    return _LABEL + b"%08x\n" % zlib.crc32(contents)
