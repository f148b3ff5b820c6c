"""The worker process's own side: takes one job after the other from a pipe and answers each."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import Any, NoReturn

Job = tuple[int, Callable[..., Any], tuple[Any, ...]]
"""Number, a function that can be imported, its arguments."""

Answer = tuple[int, str, Any]
"""Number, how it ended (``done``, ``refused`` for a bad input, ``broken`` for a fault), result or words."""


def serve(connection: Connection[Answer, Job], niceness: int) -> None:
    """Do jobs until the other end closes; a fault in one is its answer and does not end the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is the window's to answer
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_end_with_the_window, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(niceness)
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    while True:
        try:
            number, function, arguments = connection.recv()
        except (EOFError, OSError):
            return
        connection.send((number, *_done(function, arguments)))


def _done(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[str, Any]:
    from analysis.errors import BadInputError

    try:
        return "done", function(*arguments)
    except BadInputError as error:
        return "refused", str(error)
    except Exception as error:  # noqa: BLE001 - whatever a job does, the next one is to be answered too
        traceback.print_exc()
        return "broken", f"{type(error).__name__}: {error}"


def _leave(*_: object) -> NoReturn:
    """End by an exception, so that what a job keeps in a folder of its own meanwhile is removed."""
    sys.exit(0)


def _end_with_the_window() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
