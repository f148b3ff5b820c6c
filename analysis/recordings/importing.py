"""Import of other programs' recordings: all of a batch, or none of it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft, trial_of
from analysis.recordings.layout import FORMAT
from analysis.recordings.trial import Kind, Trial
from analysis.recordings.writing import check_trial, write_trial


def import_files(files: Sequence[Path], out: Path, kind: Kind | None) -> list[Path]:
    """Turn `.ddf`, `.csv` and AFM files into trial files in the folder `out`; return their paths.

    Without `kind` a recording is taken for a ``ramp_hold_retract``. Every file is read and checked before
    the first is written: a bad one raises BadInputError and leaves nothing behind.
    """
    if not files:
        raise BadInputError("nothing to import: name .ddf, .csv or AFM files")
    trials: dict[Path, Trial] = {}
    for file in map(Path, files):
        for draft in read_drafts(file, kind or "ramp_hold_retract"):
            target = Path(out) / f"{draft.name or file.stem}.h5"
            if target in trials:
                raise BadInputError(f"{file}: {target.name} comes from two files of this import: rename one")
            if target.exists():
                raise BadInputError(f"{file}: {target} exists already: choose another --out, or remove it")
            trials[target] = trial_of(draft, file, kind or "ramp_hold_retract")
            check_trial(file, trials[target])
    _write_all(trials, Path(out))
    return list(trials)


def read_drafts(file: Path, kind: Kind) -> list[Draft]:
    """Read one file by the importer that its ending names; more than one recording only from AFM maps."""
    _check_file(file)
    ending = file.suffix.lower()
    if ending == ".ddf":
        from analysis.recordings.importers.ddf import read_ddf

        return [read_ddf(file, kind)]
    if ending == ".csv":
        from analysis.recordings.importers.csv_text import read_csv

        return [read_csv(file, kind)]
    if ending == ".dpf":
        raise BadInputError(
            f"{file}: is a DMC protocol, it holds no samples: import the .ddf that it recorded"
        )
    if ending == ".h5" and FORMAT.encode() in file.read_bytes():
        raise BadInputError(f"{file}: is a trial file already: use it as it is")
    from analysis.recordings.importers.afm import read_afm

    return read_afm(file, kind)


def _check_file(file: Path) -> None:
    if file.is_dir():
        raise BadInputError(f"{file}: is a folder: name the files to import, as in {file}/*.ddf")
    try:
        with file.open("rb") as stream:
            empty = not stream.read(1)
    except FileNotFoundError as error:
        raise BadInputError(f"{file}: no such file: check the name") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise BadInputError(f"{file}: can't be opened ({reason}): check its permissions") from error
    if empty:
        raise BadInputError(f"{file}: is empty (0 bytes): copy it again from where it was recorded")


def _write_all(trials: dict[Path, Trial], out: Path) -> None:
    """Write into a folder of its own beside the targets, then move: a full disk leaves nothing behind."""
    made = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".import-", dir=out) as folder:
            for target, trial in trials.items():
                write_trial(Path(folder) / target.name, trial)
            for target in trials:
                (Path(folder) / target.name).replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadInputError(f"{out}: can't be written to ({reason}): choose another --out") from error
    finally:
        if made and out.is_dir() and not any(out.iterdir()):
            out.rmdir()
