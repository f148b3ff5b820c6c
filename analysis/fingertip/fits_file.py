"""What `indenter fit` measured, read back from fits.json or fits.csv: a spring and Maxwell arms a trial."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.fingertip.viscoelastic import Relaxation
from analysis.recordings.trial import FloatArray
from analysis.relaxation.result import Model

_RAMP_MM_S = 5.0
"""Where a row doesn't say how long its ramp was: the published speed."""
_HOLD_S = 7.0


@dataclass(frozen=True, slots=True)
class MeasuredTrial:
    """A trial's relaxation for 1 mm: stiffnesses (1 + n,) mN/mm, k0 first, times (n,) s, longest first.

    ``covariance`` (1 + 2 n, 1 + 2 n) is that of the stiffnesses and the logarithms of the times. For the
    step ``model`` it is the answer to a step at the end of the ramp.
    """

    file: str
    finger: str
    model: Model
    depth_mm: float
    ramp_s: float
    hold_s: float
    stiffness_mn_per_mm: FloatArray
    times_s: FloatArray
    covariance: FloatArray

    @property
    def a0_mn(self) -> float:
        """The relaxed force, mN."""
        return float(self.stiffness_mn_per_mm[0] * self.depth_mm)

    def parameters(self) -> FloatArray:
        """Return what ``covariance`` is the covariance of, (1 + 2 n,)."""
        return np.concatenate([self.stiffness_mn_per_mm, np.log(self.times_s)])

    def curve_mn_per_mm(self, parameters: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the force for 1 mm at times (N,) since the ramp began, of parameters as of this trial."""
        arms = len(self.times_s)
        relaxed = Relaxation(float(parameters[0]), parameters[1 : 1 + arms], np.exp(parameters[1 + arms :]))
        if self.model == "ramp":
            return relaxed.after_ramp(time_s, self.ramp_s)
        return relaxed.after_step(time_s - self.ramp_s)


def read_fits(path: Path, finger: str | None = None) -> list[MeasuredTrial]:
    """Read the fitted trials of fits.json or fits.csv that were not discarded, of one finger if given.

    Raises BadInputError where the file can't be read, is of another kind, or has no such trial.
    """
    if path.is_dir():
        path = path / "fits.json"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise BadInputError(
            f"{path}: can't be read: {reason}: give fits.json or fits.csv of `indenter fit`"
        ) from error
    rows = _from_csv(path, text) if path.suffix == ".csv" else _from_json(path, text)
    if not rows:
        raise BadInputError(f"{path}: holds no fitted trial: nothing can be calibrated on it")
    chosen = [row for row in rows if finger is None or row.finger == finger]
    if not chosen:
        there = ", ".join(sorted({row.finger or "(none)" for row in rows}))
        raise BadInputError(f"{path}: holds no fitted trial of finger {finger!r}: there are {there}")
    return chosen


def _from_json(path: Path, text: str) -> list[MeasuredTrial]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise BadInputError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != "indenter-fits":
        raise BadInputError(f"{path}: is not a fits.json of `indenter fit`")
    found = []
    for row in document["trials"]:
        if row["failure"] or row["discarded"] or row.get("untold") or not row["depth_mm"]:
            continue
        try:
            found.append(_from_solid(row) if row["solid"] else _from_estimates(row, _estimates(row)))
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(
                f"{path}: the row of {row.get('file')} is damaged ({error}): fit again"
            ) from error
    return found


def _from_solid(row: Mapping[str, Any]) -> MeasuredTrial:
    solid = row["solid"]
    arms = len(solid["times_s"])
    # rows of its covariance: stiffnesses, offset, logarithms of the times, contact
    rows = [*range(1 + arms), *range(2 + arms, 2 + 2 * arms)]
    covariance = np.array(solid["covariance"], dtype=float)[np.ix_(rows, rows)]
    return MeasuredTrial(
        row["file"],
        row["finger"],
        row["model"],
        float(row["depth_mm"]),
        float(row["ramp_s"]),
        float(row["hold_s"]),
        np.array(solid["stiffness_mn_per_mm"], dtype=float),
        np.array(solid["times_s"], dtype=float),
        covariance,
    )


def _estimates(row: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    return {name: (row[name]["value"], row[name]["se"] or 0.0) for name in _COLUMNS}


def _from_estimates(row: Mapping[str, Any], estimates: Mapping[str, tuple[float, float]]) -> MeasuredTrial:
    """Take a row by its published parameters, as if their errors were independent: the table has no more."""
    depth_mm = float(row["depth_mm"])
    values, errors = (np.array([estimates[name][i] for name in _COLUMNS]) for i in (0, 1))
    # the table's own stiffness counts depth from the first touch, the protocol's from where the approach stopped
    k0 = 1e3 * float(row.get("stiffness_mn_per_um") or values[0] / depth_mm / 1e3)
    per_mm, ratios, times = k0 / values[0], values[1:3], values[3:5]
    if not (np.isfinite(values).all() and k0 > 0 and (times > 0).all()):
        raise ValueError("a stiffness or a time is not positive")
    by = np.zeros((5, 5))
    by[0, 0], by[1, 0], by[2, 0] = per_mm, ratios[0] * per_mm, ratios[1] * per_mm
    by[1, 1] = by[2, 2] = k0
    by[3, 3], by[4, 4] = 1 / times
    covariance = by @ np.diag(errors**2) @ by.T
    ramp_s, hold_s = row.get("ramp_s") or depth_mm / _RAMP_MM_S, row.get("hold_s") or _HOLD_S
    return MeasuredTrial(
        row["file"],
        row["finger"],
        row["model"],
        depth_mm,
        float(ramp_s),
        float(hold_s),
        np.array([k0, *(k0 * ratios)]),
        times,
        covariance,
    )


_COLUMNS = ("A0_mn", "A1_over_A0", "A2_over_A0", "t1_s", "t2_s")


def _from_csv(path: Path, text: str) -> list[MeasuredTrial]:
    reader = csv.DictReader(text.splitlines())
    needed = {"file", "finger", "depth_mm", "model", *_COLUMNS}
    missing = sorted(needed - set(reader.fieldnames or ()))
    if missing:
        raise BadInputError(f"{path}: column {missing[0]!r} is missing: give a fits.csv of `indenter fit`")
    found = []
    for number, row in enumerate(reader, start=2):
        if not row["A0_mn"] or "discarded" in (row.get("flags") or ""):
            continue
        try:
            estimates = {n: (float(row[n]), float(row.get(f"{n}_se") or 0.0)) for n in _COLUMNS}
            found.append(_from_estimates(row, estimates))
        except ValueError as error:
            raise BadInputError(f"{path}: line {number}: {error}: fit again") from error
    return found


def mean_trial(trials: Sequence[MeasuredTrial]) -> MeasuredTrial:
    """Return the mean of trials: parameters, ramp, hold, depth, and the covariance of the mean.

    Raises BadInputError where trials of both models, or of different numbers of arms, are mixed.
    """
    if len({(trial.model, len(trial.times_s)) for trial in trials}) > 1:
        raise BadInputError(
            "the fits mix models or numbers of arms: calibrate on those of one run of `indenter fit`"
        )
    first, split = trials[0], len(trials[0].times_s) + 1
    parameters = np.mean([trial.parameters() for trial in trials], axis=0)
    depth_mm, ramp_s, hold_s = np.mean([(t.depth_mm, t.ramp_s, t.hold_s) for t in trials], axis=0).tolist()
    fingers = {trial.finger for trial in trials}
    return MeasuredTrial(
        f"mean of {len(trials)} trials" if len(trials) > 1 else first.file,
        first.finger if len(fingers) == 1 else "",
        first.model,
        depth_mm,
        ramp_s,
        hold_s,
        parameters[:split],
        np.exp(parameters[split:]),
        _mean_covariance(trials),
    )


def _mean_covariance(trials: Sequence[MeasuredTrial]) -> FloatArray:
    """Return the covariance of the mean: from the trials' scatter where it can be had, else from the fits."""
    values = np.stack([trial.parameters() for trial in trials])
    count, size = values.shape
    if count > size:
        scatter: FloatArray = np.cov(values.T) / count
        return scatter
    within: FloatArray = np.sum([trial.covariance for trial in trials], axis=0) / count**2
    if count > 1:
        # too few for a whole covariance: their scatter at least widens every parameter's own variance
        spread = values.var(axis=0, ddof=1) / count
        factor = np.sqrt(np.maximum(spread / np.maximum(np.diag(within), math.ulp(0.0)), 1.0))
        within = within * factor[:, None] * factor
    return within
