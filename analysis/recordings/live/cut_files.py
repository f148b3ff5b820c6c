"""Trial files that lost their end, to a full disk or a broken copy: what they still hold.

HDF5 refuses a file that is shorter than its superblock says. The samples stand at the end of a trial file,
so that all else is usually there: the file is filled up with bytes that read as NaN, and read up to those.
"""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path

from analysis.recordings.probing import probe
from analysis.recordings.reading import read_unchecked
from analysis.recordings.trial import Trial

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_END_OF_FILE = slice(40, 48)  # address in a superblock of version 0 with 8-byte addresses
_MOST_MISSING = 2**33


def bytes_missing(path: Path) -> int:
    """Return how many bytes the file is shorter than its superblock says, 0 where it does not say."""
    with path.open("rb") as file:
        start = file.read(48)
    if len(start) < 48 or not start.startswith(_SIGNATURE) or start[8] != 0 or start[13] != 8:
        return 0
    missing = struct.unpack("<Q", start[_END_OF_FILE])[0] - path.stat().st_size
    return missing if 0 < missing < _MOST_MISSING else 0


def read_cut_file(path: Path) -> Trial:
    """Return the trial up to the last sample that every channel has. Raises BadInputError."""
    with tempfile.TemporaryDirectory() as folder:
        filled = Path(folder) / path.name
        filled.write_bytes(path.read_bytes() + b"\xff" * bytes_missing(path))
        probe(filled, cut=True)
        return read_unchecked(filled, cut=True)
