"""One trial's fit as a panel shows it, and rows of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.live.locking import is_locked
from analysis.recordings.reading import read_trial
from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.batch import fit_files
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.prediction import fitted_curve
from analysis.relaxation.result import Model, TrialFit
from rig.gui.jobs.decimation import extremes

_MEANS = 300


@dataclass(frozen=True, slots=True)
class FitPicture:
    """A trial's fit, thinned for the screen; time counts from the end of the ramp, s.

    ``recorded`` (2, M), ``fitted`` (2, M) and ``residual`` (2, K) are rows of time and mN; ``means`` (2, L)
    are the residual's means over short stretches, in which noise no longer hides what the fit leaves. Where
    the row says that there is no fit, all but ``recorded`` are empty.
    """

    path: str
    row: TrialFit
    kind: str
    recorded: FloatArray
    fitted: FloatArray
    residual: FloatArray
    means: FloatArray


def picture_fit(path: str, model: Model, bins: int) -> FitPicture:
    """Fit a trial and return what a panel draws. Raises BadInputError where the file can't be read."""
    if is_locked(Path(path)):
        raise BadInputError(f"{path}: is being written: it is fitted when the trial has ended")
    trial = read_trial(Path(path))
    row = fit_trial(trial, model)
    empty = np.empty((2, 0))
    if not row.fitted:
        return FitPicture(path, row, trial.kind, _recording(trial, bins), empty, empty, empty)
    curve = fitted_curve(trial, row)
    time_s = curve.time_s - curve.hold_start_s
    at = extremes(curve.force_mn, bins)
    fitted_at = at[np.isfinite(curve.fitted_mn[at])]
    known = np.flatnonzero(np.isfinite(curve.fitted_mn))
    residual_mn = (curve.force_mn - curve.fitted_mn)[known]
    thinned = extremes(residual_mn, bins)
    return FitPicture(
        path,
        row,
        trial.kind,
        np.stack([time_s[at], curve.force_mn[at]]),
        np.stack([time_s[fitted_at], curve.fitted_mn[fitted_at]]),
        np.stack([time_s[known][thinned], residual_mn[thinned]]),
        _means(time_s[known], residual_mn),
    )


def _recording(trial: Trial, bins: int) -> FloatArray:
    hold = trial.phase("hold")
    begins_s = 0.0 if hold is None else hold.start / trial.sample_rate_hz
    at = extremes(trial.force_mn, bins)
    return np.stack([at / trial.sample_rate_hz - begins_s, trial.force_mn[at]])


def _means(time_s: FloatArray, values: FloatArray) -> FloatArray:
    width = max(1, len(values) // _MEANS)
    n = len(values) // width * width
    means: NDArray[np.float64] = np.stack([time_s[:n], values[:n]]).reshape(2, -1, width).mean(axis=2)
    return means


def fit_rows(paths: Sequence[str], model: Model) -> list[TrialFit]:
    """Return one row a file; a file that can't be read has one that says so."""
    return fit_files([Path(path) for path in paths], model)
