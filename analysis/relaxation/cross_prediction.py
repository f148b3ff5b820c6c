"""One ramp fitted, the others predicted: the test that R2 of each fit alone can't give.

A linear solid of two arms that is right says every ramp; where the tissue has more relaxation times than
that, or stiffens, the times that a fit finds follow the ramp it was given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.recordings.reading import read_trial
from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.contact_law import ContactLaw
from analysis.relaxation.prediction import predict
from analysis.relaxation.ramp_fit import fit_ramp
from analysis.relaxation.result import Check, TrialFit
from analysis.relaxation.windows import CannotFitError, cut_window

_RATIO = 1.5  # ramps are told apart from this ratio of their times on
_LEAST_RAMP_S = 1e-3
_LIMIT_SHARE = 0.03  # of the range of force that may be missed beyond its noise: twice a calibration's error
_LIMIT_NOISE = 1.5  # what is missed must exceed the noise by this, or it may be noise


@dataclass(frozen=True, slots=True)
class CrossPrediction:
    """A trial's solid against a trial of another ramp time.

    ``rms_mn`` of the other's force is missed, ``share`` is that in its range of force; ``peak_share`` by how
    much its largest force is said too high, in the same range.
    """

    fitted: str
    ramp_s: float
    other: str
    other_ramp_s: float
    rms_mn: float
    share: float
    peak_share: float
    r2: float
    failed: bool


def cross_predict(files: Sequence[Path], rows: Sequence[TrialFit]) -> list[CrossPrediction]:
    """Return predictions between one trial a ramp time of each finger, both ways."""
    chosen: dict[tuple[str, str, float], list[tuple[Path, TrialFit]]] = {}
    pairs = [(f, r) for f, r in zip(files, rows, strict=True) if r.ramp_s and not r.discarded]
    for file, row in sorted(pairs, key=lambda pair: pair[1].ramp_s or 0.0):
        group = chosen.setdefault(_specimen(row), [])
        ramp_s = row.ramp_s or 0.0
        if ramp_s >= _LEAST_RAMP_S and (not group or ramp_s > _RATIO * (group[-1][1].ramp_s or 0.0)):
            group.append((file, row))
    found: list[CrossPrediction] = []
    for group in chosen.values():
        if len(group) < 2:
            continue
        asked = []
        for file, row in group:
            trial = read_trial(file)
            asked.append((row, trial, _nearest_solid(row, trial)))
        for row, _, solid in asked:
            if solid is not None:
                found.extend(_predictions(row, solid, [one for one in asked if one[0] is not row]))
    return found


@dataclass(frozen=True, slots=True)
class _Solid:
    """Stiffnesses (1 + n_arms,) mN/mm, k0 first; times (n_arms,) s; where it was touched, and by which law."""

    stiffness_mn_per_mm: FloatArray
    times_s: FloatArray
    contact_mm: float
    law: ContactLaw


_Asked = tuple[TrialFit, Trial, _Solid | None]


def _nearest_solid(row: TrialFit, trial: Trial) -> _Solid | None:
    if row.solid is not None:
        times_s = np.array(row.solid.times_s)
        law = ContactLaw(row.solid.exponent, row.solid.reference_mm)
        return _Solid(np.array(row.solid.stiffness_mn_per_mm), times_s, row.solid.contact_mm, law)
    if row.model != "ramp":
        return None
    for n_arms in (2, 1):
        try:
            with np.errstate(all="ignore"):
                near = fit_ramp(cut_window(trial), n_arms)
        except (CannotFitError, ArithmeticError, ValueError):
            continue
        return _Solid(near.stiffness_mn_per_mm, near.times_s, near.contact_mm, near.law)
    return None


def _specimen(row: TrialFit) -> tuple[str, str, float]:
    """Return what says that two trials are of one specimen: its labels, or without any the same depth."""
    labelled = bool(row.subject or row.finger)
    return row.subject, row.finger, 0.0 if labelled else float(f"{row.depth_mm or 0.0:.1g}")


def _predictions(row: TrialFit, solid: _Solid, others: Sequence[_Asked]) -> list[CrossPrediction]:
    found = []
    for other, trial, _ in others:
        # a trial that was not fitted has the contact point of the one that is: the same lever coordinate
        contact_mm = (other.solid or solid).contact_mm
        try:
            said = predict(solid.stiffness_mn_per_mm, solid.times_s, trial, contact_mm, solid.law)
        except CannotFitError:
            continue
        beyond_noise = said.share * float(np.sqrt(max(1.0 - (said.noise_mn / said.rms_mn) ** 2, 0.0)))
        largest = max(beyond_noise, abs(said.peak_share))
        failed = largest > _LIMIT_SHARE and said.rms_mn > _LIMIT_NOISE * said.noise_mn
        found.append(
            CrossPrediction(
                row.file,
                row.ramp_s or 0.0,
                other.file,
                other.ramp_s or 0.0,
                said.rms_mn,
                said.share,
                said.peak_share,
                said.r2,
                failed,
            )
        )
    return found


def _worst(item: CrossPrediction) -> float:
    return max(item.share, abs(item.peak_share))


def flag_failures(rows: Sequence[TrialFit], predictions: Sequence[CrossPrediction]) -> list[TrialFit]:
    """Return the rows, those whose solid was asked for another ramp with the check ``other_ramp_missed``."""
    worst: dict[str, CrossPrediction] = {}
    for said in predictions:
        if said.fitted not in worst or _worst(said) > _worst(worst[said.fitted]):
            worst[said.fitted] = said
    flagged = []
    for row in rows:
        item = worst.get(row.file)
        if item is None:
            flagged.append(row)
            continue
        percent = 100.0 * _worst(item)
        asked = [p for p in predictions if p.fitted == row.file]
        text = (
            f"misses the force of {item.other} (ramp of {item.other_ramp_s:.3g} s): "
            f"{100.0 * item.share:.3g} % of its range rms, {100.0 * item.peak_share:+.3g} % at its peak; "
            f"its own R2 is {'unknown' if row.r2 is None else format(row.r2, '.4f')}; of "
            f"{len(asked)} other ramps {sum(p.failed for p in asked)} are missed"
        )
        raised = any(p.failed for p in asked)
        check = Check("other_ramp_missed", percent, 100.0 * _LIMIT_SHARE, "%", raised, text)
        flagged.append(replace(row, checks=(*row.checks, check)))
    return flagged
