"""Many trials: from files to fits.csv, on this computer's cores or on any executor."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path
from typing import Any

from analysis.errors import BadInputError
from analysis.recordings.folders import find_trials
from analysis.relaxation.cross_prediction import cross_predict, flag_failures
from analysis.relaxation.findings import Findings
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.joint import fit_fingers
from analysis.relaxation.profile import profile_intervals
from analysis.relaxation.result import Model, TrialFit
from analysis.relaxation.study import summarise
from analysis.relaxation.tables import write_csv, write_json

MODELS = ("ramp", "step")
_CHUNK = 4  # files a task
_FEW = 4  # files that are not worth a second process
_LOADED_ONCE = ["analysis.relaxation.batch", "analysis.recordings.reading", "scipy.fft", "scipy.linalg"]


def fit_paths(
    paths: Sequence[Path],
    *,
    model: Model = "ramp",
    out: Path,
    jobs: int | None = None,
    dask: str | None = None,
    intervals: bool = False,
    joint: bool = False,
    exponent: float | None = None,
    show: Callable[[Findings], None] | None = None,
) -> Path:
    """Fit every trial of the files and folders; write fits.csv, fits.json, figures and a page to ``out``.

    ``jobs`` processes are used (all cores without it), or the Dask cluster at ``dask``, which must see
    the same files. ``intervals`` adds profile intervals of every trial, ``joint`` one solid for all
    trials of a finger; both need the ramp model. ``exponent`` is that of `fit_trial`. ``show`` is given what
    was found before the page is written. Returns the page's path. Raises BadInputError where
    there is nothing to fit or not one file can be read.
    """
    if model not in MODELS:
        raise BadInputError(f"model {model!r} is not known: use one of {', '.join(MODELS)}")
    if jobs is not None and jobs < 1:
        raise BadInputError(f"--jobs {jobs}: at least one process is needed")
    if model != "ramp" and (intervals or joint):
        raise BadInputError(f"--intervals and --joint need --model ramp: the {model} model has neither")
    files = find_trials(paths)
    found = fit_to_tables(
        files,
        model=model,
        out=out,
        jobs=jobs,
        dask=dask,
        intervals=intervals,
        joint=joint,
        exponent=exponent,
    )
    if show is not None:
        show(found)
    from analysis.relaxation.page import write_page

    with _writing_to(out):
        return write_page(out, files, found)


def fit_to_tables(
    files: Sequence[Path],
    *,
    model: Model,
    out: Path,
    jobs: int | None = None,
    dask: str | None = None,
    intervals: bool = False,
    joint: bool = False,
    exponent: float | None = None,
) -> Findings:
    """Fit the files and write fits.csv and fits.json; return what they hold, one row a file."""
    with _writing_to(out):
        out.mkdir(parents=True, exist_ok=True)
    with _executor(len(files), jobs, dask) as executor, _progress(len(files)) as advance:
        rows = fit_files(files, model, executor, advance, intervals=intervals, exponent=exponent)
    unread = [row for row in rows if row.failure.startswith(_UNREAD)]
    if len(unread) == len(rows):
        more = f" (and {len(rows) - 1} more files that can't be read)" if len(rows) > 1 else ""
        raise BadInputError(unread[0].failure.removeprefix(_UNREAD) + more)
    rows = _distinct_names(files, rows)
    predictions = cross_predict(files, rows)
    rows = flag_failures(rows, predictions)
    solids = fit_fingers(files, rows) if joint else []
    found = Findings(tuple(rows), summarise(rows), tuple(predictions), tuple(solids))
    with _writing_to(out):
        write_csv(out / "fits.csv", rows)
        write_json(out / "fits.json", found)
    return found


@contextmanager
def _writing_to(out: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BadInputError(
            f"{error.filename or out}: can't be written ({error.strerror}): choose another --out"
        ) from error


def fit_files(
    files: Sequence[Path],
    model: Model,
    executor: Executor | None = None,
    advance: Callable[[int], None] = lambda _: None,
    *,
    intervals: bool = False,
    exponent: float | None = None,
) -> list[TrialFit]:
    """Return one row a file, in order; ``executor`` is anything with the interface of concurrent.futures.

    A file that can't be read gives a row that says so. ``advance`` is told how many files were done.
    """
    chunks = [[str(path) for path in files[i : i + _CHUNK]] for i in range(0, len(files), _CHUNK)]
    if executor is None:
        rows = []
        for file in files:
            rows.append(_fit_file(str(file), model, intervals, exponent))
            advance(1)
        return rows
    tasks = {
        executor.submit(_fit_chunk, chunk, model, intervals, exponent): i for i, chunk in enumerate(chunks)
    }
    done: dict[int, list[TrialFit]] = {}
    for task in as_completed(tasks):
        chunk = chunks[tasks[task]]
        try:
            done[tasks[task]] = task.result()
        except BrokenExecutor as error:
            raise BadInputError(
                f"{chunk[0]}: a fitting process died near this file: use --jobs 1 to see which it is"
            ) from error
        advance(len(chunk))
    return [row for i in range(len(chunks)) for row in done[i]]


_UNREAD = "can't be read: "


def _fit_chunk(files: list[str], model: Model, intervals: bool, exponent: float | None) -> list[TrialFit]:
    return [_fit_file(file, model, intervals, exponent) for file in files]


def _fit_file(file: str, model: Model, intervals: bool, exponent: float | None) -> TrialFit:
    from analysis.recordings.reading import read_trial

    try:
        trial = read_trial(Path(file))
    except BadInputError as error:
        return TrialFit(file=Path(file).name, trial_id="", model=model, failure=f"{_UNREAD}{error}")
    row = fit_trial(trial, model, exponent)
    if not (intervals and row.fitted):
        return row
    try:
        return replace(row, intervals=profile_intervals(trial, exponent=exponent))
    except (ArithmeticError, ValueError):
        return row  # as of a fit, the arithmetic of a hopeless recording must not end the study


@contextmanager
def _executor(n_files: int, jobs: int | None, dask: str | None) -> Iterator[Executor | None]:
    """Yield the executor: a Dask cluster's, a pool of processes, or None for this process alone."""
    if dask is not None:
        with _dask_executor(dask) as executor:
            yield executor
        return
    workers = min(jobs or _cores(), max(1, n_files // 2))
    if workers == 1 or (jobs is None and n_files <= _FEW):
        yield None
        return
    # the processes are the parallelism: threads of linear algebra beside them only get in each other's way
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # a fresh server process, loaded once, is forked from: quick, and safe whatever threads run here
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    context = get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload(_LOADED_ONCE)
    with ProcessPoolExecutor(workers, mp_context=context) as executor:
        try:
            yield executor
        except BaseException:  # interrupted: what waits in the queue is not to run first
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _cores() -> int:
    """Return the cores that this process may use, as far as the system says."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _dask_executor(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise BadInputError(
            "--dask needs the optional extra: install it with `pip install indenter[dask]`"
        ) from error
    try:
        client: Any = Client(address, timeout="10s")  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise BadInputError(f"--dask {address}: no scheduler answers ({error}): check the address") from error
    with client:
        yield client.get_executor()


@contextmanager
def _progress(n_files: int) -> Iterator[Callable[[int], None]]:
    """Yield what is called with the number of files just done; draws a bar where a person watches."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("fitting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("fitting", total=n_files)
        yield lambda n: bar.advance(task, n)


def _distinct_names(files: Sequence[Path], rows: list[TrialFit]) -> list[TrialFit]:
    """Name files by their name; where two share one, by their way from the folder that holds all."""
    counts = Counter(row.file for row in rows)
    if max(counts.values()) == 1:
        return rows
    common = Path(os.path.commonpath([file.resolve().parent for file in files]))
    return [
        replace(row, file=file.resolve().relative_to(common).as_posix())
        for file, row in zip(files, rows, strict=True)
    ]
