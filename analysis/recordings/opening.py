"""Opening a trial file, and every way in which that fails, in one line each."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from analysis.errors import BadInputError

HDF5_ERRORS = (OSError, KeyError, RuntimeError, ValueError, TypeError, OverflowError, MemoryError)
"""What h5py raises on a damaged file; UnicodeDecodeError is a ValueError."""


@contextmanager
def open_file(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for reading; BadInputError says what is wrong with one that can't be."""
    try:
        file = h5py.File(path, "r", locking="best-effort")
    except HDF5_ERRORS as error:
        raise BadInputError(_why_not_opened(path, error)) from error
    with file:
        yield file


def check_is_file(path: Path) -> None:
    """Raise BadInputError unless the path is a file that can be read and is not empty."""
    if path.is_dir():
        raise BadInputError(
            f"{path}: is a folder, not a trial file: give a file, or a folder that holds *.h5"
        )
    try:
        with path.open("rb") as file:
            start = file.read(8)
    except FileNotFoundError as error:
        raise BadInputError(f"{path}: no such file: check the name") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise BadInputError(f"{path}: can't be opened ({reason}): check its permissions") from error
    if not start:
        raise BadInputError(f"{path}: is empty (0 bytes): copy it again from where it was recorded")


def _why_not_opened(path: Path, error: BaseException) -> str:
    text = _one_line(error)
    if "truncated file" in text:
        sizes = re.search(r"eof = (\d+).*stored_eof = (\d+)", text)
        size = f" after {sizes[1]} of {sizes[2]} bytes" if sizes else ""
        return f"{path}: is cut short{size}: copy it again, or bring back what is there by `indenter rescue`"
    if "signature not found" in text:
        return f"{path}: is not an HDF5 file: text and .ddf recordings are brought in by `indenter import`"
    return f"{path}: can't be opened as HDF5 ({text}): the file is damaged, copy it again"


def reason_of(error: BaseException) -> str:
    """What went wrong, in the system's own words where it has any: h5py buries them in a page of its own."""
    number = error.errno if isinstance(error, OSError) else None
    return os.strerror(number) if number else _one_line(error)


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return (text or type(error).__name__)[:200]


@contextmanager
def access(path: Path, where: str) -> Iterator[None]:
    """Translate what h5py raises on damaged contents into one line that names the place."""
    try:
        yield
    except BadInputError:
        raise
    except HDF5_ERRORS as error:
        raise BadInputError(
            f"{path}: {where} can't be read ({_one_line(error)}): the file is damaged, copy it again"
        ) from error


def bad_input(path: Path, where: str, what: str, todo: str) -> BadInputError:
    """Return the error in its one form: which file, where in it, what is wrong, what to do."""
    return BadInputError(f"{path}: {where} {what}: {todo}")
