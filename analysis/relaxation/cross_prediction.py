"""One ramp fitted, the others predicted: the test that R2 of each fit alone can't give.

A linear solid of two arms that is right says every ramp; where the tissue has more relaxation times than
that, or stiffens, the times that a fit finds follow the ramp it was given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.recordings.reading import read_trial
from analysis.recordings.trial import Trial
from analysis.relaxation.prediction import predict
from analysis.relaxation.result import Check, TrialFit
from analysis.relaxation.windows import CannotFitError

_RATIO = 1.5  # ramps are told apart from this ratio of their times on
_LEAST_RAMP_S = 1e-3
_LIMIT_SHARE = 0.05  # of the range of force that may be missed, and at least three times the noise
_LIMIT_NOISE = 3.0


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
        trials = {row.file: read_trial(file) for file, row in group}
        for row in (row for _, row in group if row.solid is not None):
            found.extend(
                _predictions(row, [(other, trials[other.file]) for _, other in group if other is not row])
            )
    return found


def _specimen(row: TrialFit) -> tuple[str, str, float]:
    """Return what says that two trials are of one specimen: its labels, or without any the same depth."""
    labelled = bool(row.subject or row.finger)
    return row.subject, row.finger, 0.0 if labelled else float(f"{row.depth_mm or 0.0:.1g}")


def _predictions(row: TrialFit, others: Sequence[tuple[TrialFit, Trial]]) -> list[CrossPrediction]:
    found = []
    for other, trial in others:
        # a trial without a contact point of its own has that of the fit: the same lever coordinate
        solid = other.solid if other.solid is not None else row.solid
        assert solid is not None
        try:
            said = predict(row, trial, solid.contact_mm)
        except CannotFitError:
            continue
        largest = max(said.share, abs(said.peak_share))
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
        text = (
            f"misses the force of {item.other} (ramp of {item.other_ramp_s:.3g} s): "
            f"{100.0 * item.share:.3g} % of its range rms, {100.0 * item.peak_share:+.3g} % at its peak; "
            f"its own R2 is {'unknown' if row.r2 is None else format(row.r2, '.4f')}"
        )
        raised = any(p.failed for p in predictions if p.fitted == row.file)
        check = Check("other_ramp_missed", percent, 100.0 * _LIMIT_SHARE, "%", raised, text)
        flagged.append(replace(row, checks=(*row.checks, check)))
    return flagged
