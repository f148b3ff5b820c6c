"""`indenter export`: trial files and their fits, in the formats of other programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings.folders import find_trials
from analysis.recordings.reading import read_trial
from analysis.recordings.trial import Trial

FORMATS = ("csv", "nwb", "parquet")


@dataclass(frozen=True, slots=True)
class Exported:
    """The files written, and (trial file, reason) of those left out."""

    written: tuple[Path, ...]
    left_out: tuple[tuple[Path, str], ...]


def export_trials(paths: Sequence[Path], to: str, out: Path) -> Exported:
    """Write the trials of files and folders, and their fits, as ``to`` (csv, nwb, parquet) into ``out``.

    A file that can't be read is left out with its reason. Raises BadInputError where nothing can be read, where
    ``out`` holds a file of that name already, or where the format's package is missing.
    """
    if to not in FORMATS:
        raise BadInputError(f"--to {to}: is not known: use one of {', '.join(FORMATS)}")
    named, left_out = _named(find_trials(paths))
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        if to == "csv":
            from analysis.export.csv_text import write_csv_files

            written = write_csv_files(named, out)
        elif to == "nwb":
            from analysis.export.nwb import write_nwb_files

            written = write_nwb_files(named, out)
        else:
            from analysis.export.parquet import write_parquet_files

            written = write_parquet_files(named, out)
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadInputError(
            f"{error.filename or out}: can't be written ({reason}): choose another --out"
        ) from error
    return Exported(tuple(written), tuple(left_out))


def _named(files: Sequence[Path]) -> tuple[dict[str, Trial], list[tuple[Path, str]]]:
    """Return the trials by names of their own, and what can't be read."""
    stems = Counter(file.stem for file in files)
    trials: dict[str, Trial] = {}
    left_out: list[tuple[Path, str]] = []
    for file in files:
        try:
            trial = read_trial(file)
        except BadInputError as error:
            left_out.append((file, str(error)))
            continue
        name = file.stem if stems[file.stem] == 1 else f"{file.parent.name}_{file.stem}"
        if name in trials:
            raise BadInputError(f"{file}: two trials are named {name}: rename one")
        trials[name] = trial
    if not trials:
        more = f" (and {len(left_out) - 1} more files that can't be read)" if len(left_out) > 1 else ""
        raise BadInputError(left_out[0][1] + more)
    return trials, left_out


def free(path: Path) -> Path:
    """Return a path that is free; BadInputError where a file stands there."""
    if path.exists():
        raise BadInputError(f"{path}: exists already: choose another --out, or remove it")
    return path
