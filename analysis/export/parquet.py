"""A study as two tidy Parquet tables: one row a trial with its fit, one row a sample.

Written by arro3 (12 MB of wheels; pyarrow has 55, fastparquet needs pandas), which pandas, polars, R and
DuckDB read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.export.csv_text import phase_names
from analysis.export.exporting import free
from analysis.recordings.trial import Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.result import NAMES, TrialFit


def write_parquet_files(trials: Mapping[str, Trial], out: Path) -> list[Path]:
    """Write trials.parquet (one row a trial: labels, protocol, fit) and samples.parquet (one row a sample)."""
    try:
        from arro3.io import write_parquet
    except ImportError as error:
        raise BadInputError(
            "--to parquet needs the optional extra: install it with `pip install indenter[parquet]`"
        ) from error
    paths = [free(out / "trials.parquet"), free(out / "samples.parquet")]
    fits = {name: fit_trial(trial) for name, trial in trials.items()}
    write_parquet(_trials(trials, fits), paths[0])
    write_parquet(_samples(trials), paths[1], compression="zstd(3)")
    return paths


def _trials(trials: Mapping[str, Trial], fits: Mapping[str, TrialFit]) -> Any:
    columns: dict[str, list[Any]] = {}
    for name, trial in trials.items():
        fit = fits[name]
        row: dict[str, Any] = {
            "trial": name,
            "trial_id": trial.trial_id,
            "started": trial.started,
            "kind": trial.kind,
            "source": trial.source,
            "status": trial.status,
            "discarded": trial.discarded,
            "sample_rate_hz": trial.sample_rate_hz,
            **{
                f: getattr(trial.specimen, f)
                for f in ("subject", "finger", "site", "repeat", "punch_diameter_mm")
            },
            **{f: getattr(trial.protocol, f) for f in ("depth_mm", "ramp_speed_mm_s", "hold_s", "dwell_s")},
        }
        for estimate in NAMES:
            told = fit.estimates.get(estimate)
            row[estimate], row[f"{estimate}_se"] = (None, None) if told is None else (told.value, told.se)
        row["exponent"] = fit.exponent.value if fit.exponent else None
        row["exponent_se"] = fit.exponent.se if fit.exponent else None
        row |= {
            "stiffness_mn_per_um": fit.stiffness_mn_per_um,
            "rms_mn": fit.rms_mn,
            "r2": fit.r2,
            "flags": fit.flags,
        }
        for column, value in row.items():
            columns.setdefault(column, []).append(value)
    return _table(columns)


def _samples(trials: Mapping[str, Trial]) -> Any:
    columns: dict[str, list[Any]] = {
        "trial": [],
        "time_s": [],
        "phase": [],
        "position_mm": [],
        "force_mn": [],
    }
    for name, trial in trials.items():
        native = trial.native
        time_s = trial.time_s if native is None else native.time_s
        columns["trial"] += [name] * len(time_s)
        columns["time_s"].append(time_s)
        columns["phase"] += phase_names(trial, time_s)
        columns["position_mm"].append(trial.position_mm if native is None else native.position_mm)
        columns["force_mn"].append(trial.force_mn if native is None else native.force_mn)
    return _table({n: v if n in {"trial", "phase"} else np.concatenate(v) for n, v in columns.items()})


def _table(columns: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]]) -> Any:
    from arro3.core import Array, DataType, Table

    def array(values: Sequence[Any] | np.ndarray[Any, Any]) -> Any:
        if isinstance(values, np.ndarray):
            return Array(np.ascontiguousarray(values))
        known = [value for value in values if value is not None]
        if any(isinstance(value, str) for value in known):
            return Array(list(values), DataType.string())
        return Array([None if value is None else float(value) for value in values], DataType.float64())

    return Table.from_pydict({name: array(values) for name, values in columns.items()})
