"""Import of other programs' recordings: files, folders, wide tables; what was found is said of each."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft, trial_of
from analysis.recordings.importers.findings import Findings, look_at
from analysis.recordings.importers.instructions import NOTHING_SAID, Instructions
from analysis.recordings.importers.rows import SPREADSHEETS, TEXTS
from analysis.recordings.layout import FORMAT
from analysis.recordings.trial import Kind, Trial
from analysis.recordings.writing import check_trial, write_trial

_OURS = (".ddf", *TEXTS, *SPREADSHEETS)
_BESIDE = {".dpf", ".toml", ".md", ".png", ".pdf", ".html", ".json", ".h5", ".py"}  # no recordings of others


@dataclass(frozen=True, slots=True)
class Imported:
    """A trial that was made of ``source``: its file, itself, and what was found."""

    source: Path
    path: Path
    trial: Trial
    findings: Findings


@dataclass(frozen=True, slots=True)
class Refused:
    """A file that was not imported, and why, in one line."""

    source: Path
    reason: str


def import_recordings(
    paths: Sequence[Path], out: Path, kind: Kind | None = None, said: Instructions = NOTHING_SAID
) -> tuple[list[Imported], list[Refused]]:
    """Turn files, and all recordings in folders, into trial files in `out`; a bad one stops no other.

    Returns what was made and what was refused. Raises BadInputError where nothing is named, or `out` can't
    be written.
    """
    made: dict[Path, Imported] = {}
    refused: list[Refused] = []
    files = recordings_of(paths)
    if not files:
        named = ", ".join(str(path) for path in paths) or "nothing"
        raise BadInputError(
            f"{named}: holds nothing to import: recordings end in {', '.join(_OURS)}, or are AFM files"
        )
    for file in files:
        try:
            ones = _read(file, Path(out), kind, said.on(file))
            for one in ones:
                _claim(made, one)
        except BadInputError as error:
            refused.append(Refused(file, str(error)))
    _write_all(made, Path(out))
    return list(made.values()), refused


def recordings_of(paths: Sequence[Path]) -> list[Path]:
    """Return the files named and, of folders, every file that may be a recording, sorted."""
    files: list[Path] = []
    for path in map(Path, paths):
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(p for p in path.rglob("*") if p.is_file() and not p.name.startswith("."))
        files += [p for p in inside if p.suffix and p.suffix.lower() not in _BESIDE]
    return list(dict.fromkeys(files))


def _read(file: Path, out: Path, kind: Kind | None, said: Instructions) -> list[Imported]:
    """Read and check the trials of one file; nothing is written."""
    made = []
    for draft, own in _drafts(file, kind or "ramp_hold_retract", said):
        path = out / f"{draft.name or file.stem}.h5"
        if path.exists():
            raise BadInputError(f"{file}: {path} exists already: choose another --out, or remove it")
        trial = trial_of(draft, file, kind or "ramp_hold_retract")
        trial = replace(
            trial,
            specimen=replace(trial.specimen, **own.specimen),
            protocol=replace(trial.protocol, **own.protocol),
            path=str(path),
        )
        findings = look_at(trial, of_cells=file.suffix.lower() not in _OURS)
        trial = replace(trial, log=(*trial.log, *findings.lines()))
        check_trial(file, trial)
        made.append(Imported(file, path, trial, findings))
    return made


def _claim(made: dict[Path, Imported], one: Imported) -> None:
    if one.path in made:
        raise BadInputError(f"{one.source}: {one.path.name} comes from two files of this import: rename one")
    made[one.path] = one


def _drafts(file: Path, kind: Kind, said: Instructions) -> list[tuple[Draft, Instructions]]:
    drafts = read_drafts(file, kind, said)
    if len(drafts) != len(said.trials):
        return [(draft, said) for draft in drafts]
    own = [
        Instructions(specimen=trial.get("specimen", {}), protocol=trial.get("protocol", {}))
        for trial in said.trials
    ]
    return [(draft, said.over(one)) for draft, one in zip(drafts, own, strict=True)]


def read_drafts(file: Path, kind: Kind, said: Instructions = NOTHING_SAID) -> list[Draft]:
    """Read one file by the importer that its ending names; more than one recording from maps and wide tables."""
    _check_file(file)
    ending = file.suffix.lower()
    if ending == ".ddf":
        from analysis.recordings.importers.ddf import read_ddf

        return [read_ddf(file, kind)]
    if ending in (*TEXTS, *SPREADSHEETS):
        return _of_table(file, kind, said)
    if ending == ".dpf":
        raise BadInputError(
            f"{file}: is a DMC protocol, it holds no samples: import the .ddf that it recorded"
        )
    if ending == ".h5" and FORMAT.encode() in file.read_bytes():
        raise BadInputError(f"{file}: is a trial file already: use it as it is")
    from analysis.recordings.importers.afm import read_afm

    return read_afm(file, kind)


def _of_table(file: Path, kind: Kind, said: Instructions) -> list[Draft]:
    from analysis.recordings.importers.csv_text import names_columns_so, read_csv
    from analysis.recordings.importers.table import read_table, states_its_columns

    ours = file.suffix.lower() == ".csv" and not said.of_columns
    if ours and (names_columns_so(file) or not states_its_columns(file)):
        return [read_csv(file, kind)]
    return read_table(file, kind, said)


def _check_file(file: Path) -> None:
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


def _write_all(made: dict[Path, Imported], out: Path) -> None:
    """Write into a folder of its own beside the targets, then move: a full disk leaves nothing behind."""
    if not made:
        return
    new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".import-", dir=out) as folder:
            for target, one in made.items():
                write_trial(Path(folder) / target.name, one.trial)
            for target in made:
                (Path(folder) / target.name).replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadInputError(f"{out}: can't be written to ({reason}): choose another --out") from error
    finally:
        if new and out.is_dir() and not any(out.iterdir()):
            out.rmdir()
