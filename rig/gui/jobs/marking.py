"""Which trials count: discarded ones keep their file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings.live.locking import is_locked
from analysis.recordings.writing import mark_discarded, take_back_discard
from rig.gui.jobs.headers import Header, read_headers


def discard(paths: Sequence[str], reason: str) -> tuple[Header, ...]:
    """Mark trials as discarded, for a reason; return their new headers."""
    for path in _finished(paths):
        mark_discarded(path, reason)
    return read_headers(paths)


def take_back(paths: Sequence[str]) -> tuple[Header, ...]:
    """Count discarded trials again; return their new headers."""
    for path in _finished(paths):
        take_back_discard(path)
    return read_headers(paths)


def _finished(paths: Sequence[str]) -> list[Path]:
    files = [Path(path) for path in paths]
    for file in files:
        if is_locked(file):
            raise BadInputError(f"{file}: is being written: mark it when the trial has ended")
    return files
