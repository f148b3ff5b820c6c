"""A first look at an unsealed file, in a process of its own: the HDF5 library may crash on a damaged one.

A path a line comes in, what is wrong with the file goes out (nothing, if it is good). The process is started
when the first unsealed file is read and lives as long as its parent.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path

import psutil

from analysis.errors import BadInputError

_START_S = 60.0
_READ_S = 1.0
_READ_S_PER_BYTE = 1e-7
"""What reading may take of a processor, s: on a damaged file the library may go round for ever."""

_WAITED = 10.0
"""So many times as long is waited for: on a busy computer, or for a slow disk."""

_LOOK_S = 0.05

# finds this package where its parent found it, installed or not
_CHILD = "import sys; sys.path.append(sys.argv[1]); from analysis.recordings.probing import serve; serve()"


class Probe:
    """A child process that reads a file as its parent would, and may die of it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._child: subprocess.Popen[str] | None = None

    def check(self, path: Path, *, cut: bool = False) -> None:
        """Raise BadInputError where the file can't be read, whatever that does to the reading process."""
        with self._lock:
            child = self._child or self._start()
            self._child = None  # kept only if it lives through this file
            work_s = _READ_S + _READ_S_PER_BYTE * path.stat().st_size
            there = str(path.absolute())  # the child stays in the folder it was started in
            answer = _asked(child, json.dumps([there, cut]), work_s, _WAITED * work_s)
            if answer is None:
                raise BadInputError(
                    f"{path}: the HDF5 library crashes or hangs on it: the file is damaged, copy it again"
                )
            self._child = child
        problem = json.loads(answer)
        if problem:
            raise BadInputError(problem.replace(there, str(path)))

    def _start(self) -> subprocess.Popen[str]:
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD, str(Path(__file__).parents[2])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
        )
        atexit.register(_end, child, os.getpid())
        if _asked(child, "null", _START_S, _START_S) is None:
            raise BadInputError("the process that checks trial files does not start: check the installation")
        return child


@cache
def _probe_of(process_id: int) -> Probe:
    """One probe a process; a forked child must not talk through its parent's pipes."""
    return Probe()


def probe(path: Path, *, cut: bool = False) -> None:
    """Raise BadInputError where an unsealed file can't be read, even where reading it would crash."""
    _probe_of(os.getpid()).check(path, cut=cut)


def _asked(child: subprocess.Popen[str], question: str, work_s: float, wait_s: float) -> str | None:
    """Return the child's answer, or None if it died of the question or took too long and was ended.

    It may use a processor for ``work_s``, and is waited for ``wait_s``.
    """
    assert child.stdin is not None
    assert child.stdout is not None
    answered = threading.Event()
    watch = threading.Thread(target=_watch, args=(child, answered, work_s, wait_s), daemon=True)
    watch.start()
    try:
        child.stdin.write(f"{question}\n")
        child.stdin.flush()
        answer = child.stdout.readline()
    except BrokenPipeError:
        answer = ""
    finally:
        answered.set()
        watch.join()
    if answer.endswith("\n"):
        return answer
    _end(child, os.getpid())
    return None


def _watch(child: subprocess.Popen[str], answered: threading.Event, work_s: float, wait_s: float) -> None:
    """End a child that takes too long over its answer."""
    end_s = time.monotonic() + wait_s
    with contextlib.suppress(psutil.Error):  # it is gone already
        process = psutil.Process(child.pid)
        worked_s = _worked_s(process)
        while time.monotonic() < end_s and _worked_s(process) - worked_s < work_s:
            if answered.wait(_LOOK_S):
                return
        child.kill()


def _worked_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _end(child: subprocess.Popen[str], parent_id: int) -> None:
    """End the child and close its pipes; in a fork of its parent there is nothing to end."""
    if parent_id != os.getpid():
        return
    child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()


def serve() -> None:
    """Be the child: answer until the parent closes the pipe."""
    from analysis.recordings.reading import read_unchecked

    for line in sys.stdin:
        question = json.loads(line)
        problem = ""
        if question is not None:
            path, cut = question
            try:
                read_unchecked(Path(path), cut=cut)
            except BadInputError as error:
                problem = str(error)
        sys.stdout.write(json.dumps(problem) + "\n")
        sys.stdout.flush()
