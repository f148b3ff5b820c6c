"""Trials as NWB files (Neurodata Without Borders), a file each, beside what was recorded from the nerve.

Position and force are time series in SI units (metres, newtons: stored as mm and mN with their conversion), phases
are epochs, events an annotation series; the log stands in the notes.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.export.exporting import free
from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.result import NAMES

_PER_MILLI = 1e-3


def write_nwb_files(trials: Mapping[str, Trial], out: Path) -> list[Path]:
    """Write NAME.nwb a trial; return their paths. Raises BadInputError where pynwb is missing."""
    try:
        from pynwb import NWBHDF5IO
    except ImportError as error:
        raise BadInputError(
            "--to nwb needs the optional extra: install it with `pip install indenter[nwb]`"
        ) from error
    paths = [free(out / f"{name}.nwb") for name in trials]
    for path, trial in zip(paths, trials.values(), strict=True):
        with NWBHDF5IO(path, "w") as file:
            file.write(_file_of(trial))
    return paths


def _file_of(trial: Trial) -> Any:
    from pynwb import NWBFile
    from pynwb.file import Subject

    started = datetime.fromisoformat(trial.started)
    specimen = trial.specimen
    file = NWBFile(
        session_description=f"{trial.kind.replace('_', ' ')} by a punch, {trial.status}",
        identifier=trial.trial_id,
        session_start_time=started if started.tzinfo else started.astimezone(),
        experiment_description=_experiment(trial),
        keywords=["indentation", "viscoelastic relaxation"],
        notes="\n".join(trial.log) or None,
        source_script=f"{trial.software} {trial.software_version}".strip() or "indenter",
        source_script_file_name="indenter",
    )
    if specimen.subject or specimen.finger:
        file.subject = Subject(
            subject_id=(specimen.subject or "not named").replace("/", "-"),
            species="Homo sapiens" if specimen.finger else None,
            sex="U",
            description=", ".join(filter(None, (specimen.finger, specimen.site))) or None,
        )
    position_mm, force_mn, rate = _signals(trial)
    file.add_acquisition(
        _series("indentation_position", position_mm, "meters", "position, positive into the skin", rate)
    )
    file.add_acquisition(
        _series("indentation_force", force_mn, "newtons", "force, positive in compression", rate)
    )
    if trial.command_mm is not None and trial.native is None:
        text = "commanded position, positive into the skin"
        file.add_stimulus(_series("commanded_position", trial.command_mm, "meters", text, rate))
    for phase in trial.phases:
        start_s, stop_s = phase.start / trial.sample_rate_hz, phase.stop / trial.sample_rate_hz
        file.add_epoch(start_time=start_s, stop_time=stop_s, tags=[phase.name])
    _add_events(file, trial)
    _add_fit(file, trial)
    return file


def _experiment(trial: Trial) -> str:
    said = {
        "depth": (trial.protocol.depth_mm, "mm"),
        "ramp": (trial.protocol.ramp_speed_mm_s, "mm/s"),
        "hold": (trial.protocol.hold_s, "s"),
        "punch diameter": (trial.specimen.punch_diameter_mm, "mm"),
    }
    return (
        "; ".join(f"{name} {value:g} {unit}" for name, (value, unit) in said.items() if value) or "not stated"
    )


def _signals(trial: Trial) -> tuple[FloatArray, FloatArray, dict[str, Any]]:
    native = trial.native
    if native is not None:
        return native.position_mm, native.force_mn, {"timestamps": native.time_s}
    rate = {"rate": trial.sample_rate_hz, "starting_time": 0.0}
    return trial.position_mm, trial.force_mn, rate


def _series(name: str, values: FloatArray, unit: str, description: str, rate: Mapping[str, Any]) -> Any:
    from pynwb import H5DataIO, TimeSeries

    return TimeSeries(
        name=name,
        data=H5DataIO(values, compression="gzip"),
        unit=unit,
        conversion=_PER_MILLI,
        description=description,
        **rate,
    )


def _add_events(file: Any, trial: Trial) -> None:
    from pynwb.misc import AnnotationSeries

    if not trial.events:
        return
    words = [f"{event.kind}: {event.message}" for event in trial.events]
    instants_s = np.array([event.sample for event in trial.events]) / trial.sample_rate_hz
    file.add_acquisition(
        AnnotationSeries(name="events", data=words, timestamps=instants_s, description="what happened when")
    )


def _add_fit(file: Any, trial: Trial) -> None:
    """Add the relaxation fit as a table of one row an estimate, where there is one."""
    from hdmf.common import DynamicTable

    fit = fit_trial(trial)
    if not fit.fitted:
        return
    table = DynamicTable(
        name="relaxation_fit", description="Maxwell-Weichert solid driven by the recorded motion"
    )
    for column, text in (
        ("quantity", "what"),
        ("value", "estimate"),
        ("standard_error", "its standard error"),
    ):
        table.add_column(name=column, description=text)
    told = {name: fit.estimates[name] for name in NAMES if name in fit.estimates}
    if fit.exponent is not None:
        told["exponent"] = fit.exponent
    for name, estimate in told.items():
        table.add_row(quantity=name, value=estimate.value, standard_error=estimate.se)
    module = file.create_processing_module(
        name="misc", description=f"relaxation fit; flags: {fit.flags or 'none'}"
    )
    module.add(table)
