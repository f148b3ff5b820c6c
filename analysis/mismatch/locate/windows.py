"""Where simulation and recordings may differ, whatever the reason: windows and courses of the phases, as columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.evidence.marginal import log_ratio
from analysis.mismatch.fit.gram import gram, solve
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ROUGH
from analysis.mismatch.locate.transients import CLIPPED
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

SPLITS: dict[str, tuple[float, ...]] = {
    "approach": (0.0, 0.5, 1.0),
    "dwell": (0.0, 0.02, 0.2, 1.0),
    "ramp": (0.0, 0.06, 0.25, 0.5, 0.75, 0.94, 1.0),
    "hold": (0.0, 0.004, 0.02, 0.06, 0.15, 0.35, 0.65, 1.0),
    "retract": (0.0, 0.06, 0.25, 0.5, 0.75, 1.0),
    "clear": (0.0, 0.1, 1.0),
    "sweep": tuple(np.linspace(0.0, 1.0, 17).tolist()),
}
"""Edges of windows in shares of a phase: narrow where a phase begins, where quick things show."""
SIZES = (3.0, 30.0, 300.0, 3000.0)
UNKNOWN_SIZE = 1.5


@dataclass(frozen=True)
class Place:
    """One window: phase and the shares of it that it spans."""

    phase: str
    begin: float
    end: float

    def span(self, trial: CellTrial) -> tuple[float, float] | None:
        """Return when the window begins and ends in a trial (s from its first sample); None where it has none."""
        cells = np.flatnonzero(trial.in_phase(self.phase))
        if not len(cells):
            return None
        a, b = trial.span_s(cells)
        return a + self.begin * (b - a), a + self.end * (b - a)


PLACES = tuple(
    Place(p, a, b) for p, edges in SPLITS.items() for a, b in zip(edges[:-1], edges[1:], strict=True)
)


def shares_of_phase(trial: CellTrial, phase: str) -> tuple[IntArray, FloatArray]:
    """Return a phase's cells (m,), and what share (m,) of it is over in the middle of each."""
    cells = np.flatnonzero(trial.in_phase(phase))
    if not len(cells):
        return cells, np.zeros(0)
    start, stop = trial.span_s(cells)
    return cells, (trial.time_s[cells] - start) / max(stop - start, 1e-12)


def window_columns(trial: CellTrial) -> FloatArray:
    """Return which cells (n, W) lie in each window."""
    columns = np.zeros((len(trial.time_s), len(PLACES)))
    shares = {phase: shares_of_phase(trial, phase) for phase in SPLITS}
    for k, place in enumerate(PLACES):
        cells, u = shares[place.phase]
        columns[cells, k] = (u >= place.begin) & (u < place.end)
    return columns


def course_columns(trial: CellTrial) -> FloatArray:
    """Return a piecewise linear course of every phase (n, V): a height at each edge of its windows, 0 in other phases.

    Laws change smoothly within a phase: steps between windows would leave most of what they do.
    """
    blocks = []
    for phase, edges in SPLITS.items():
        block = np.zeros((len(trial.time_s), len(edges)))
        cells, u = shares_of_phase(trial, phase)
        for k, height in enumerate(np.eye(len(edges))):
            block[cells, k] = np.interp(u, edges, height)
        blocks.append(block)
    return np.hstack(blocks)


@dataclass(frozen=True)
class CommonShape:
    """A shape that all trials have in common: its gain in nats, held out, and by trial what it adds (n_j,) mN."""

    gain: float
    force_mn: tuple[FloatArray, ...]


def common_shape(fit: StudyFit, present: Callable[[int], FloatArray], precision: FloatArray) -> CommonShape:
    """Return the shape that trials have in common beside what is present, whatever it is.

    The course of every phase has a part that is the same in all trials, and one that grows with depth. ``present``
    gives the j-th trial's columns (n_j, P) that are there anyway, ``precision`` (P,) what is known of them.
    """

    def shapes(trial: CellTrial) -> FloatArray:
        course = course_columns(trial)
        return np.hstack([course, course * (trial.depth_mm / trial.study_depth_mm)])

    columns = (np.hstack([present(j), shapes(trial)]) for j, trial in enumerate(fit.trials))
    P, W = len(precision), 2 * sum(map(len, SPLITS.values()))
    norm = gram(fit, columns, np.concatenate([precision, np.ones(W)]))
    total = norm.total()
    of_course = np.diag(total)[TISSUE_SIZE + P : TISSUE_SIZE + P + W]
    typical = float(np.median(of_course[of_course > 0]))
    before = predictive_deviance(norm, range(P))
    best, heights = -np.inf, np.zeros(W)
    for size in SIZES:
        ridge = np.concatenate([np.zeros(TISSUE_SIZE), precision, np.full(W, typical / size), [0.0]])
        gain = 0.5 * float((before - predictive_deviance(replace(norm, ridge=ridge), range(P + W))).sum())
        if gain > best:
            best, heights = gain, solve(total, ridge, range(TISSUE_SIZE + P + W))[0][-W:]
    return CommonShape(best, tuple(shapes(t) @ heights for t in fit.trials))


def own_evidence(fit: StudyFit) -> tuple[float, FloatArray]:
    """Return the gain in nats of windows in which trials differ each in its own way, the best one's and each one's.

    They may have a height of their own there, or be louder, whatever it is that goes to and fro.
    """
    norms, scores = [], []
    energy, count = np.zeros(len(PLACES)), np.zeros(len(PLACES))
    for trial, projector in zip(fit.trials, fit.projectors, strict=True):
        inside = window_columns(trial)
        white = projector(inside)
        energy += np.clip(projector.residual, -CLIPPED, CLIPPED) ** 2 @ inside[trial.fitted]
        count += inside[trial.fitted].sum(axis=0)
        norms.append(np.einsum("nk,nk->k", white, white))
        scores.append(projector.residual @ white)
    a, c = np.array(norms), np.array(scores)
    best = np.full(a.shape[1], -np.inf)
    for size in np.geomspace(1.0, 3e4, 10):
        v = size**2 / max(float(np.median(a[a > 0])), 1e-300)
        ratio = log_ratio(a, c**2, v).sum(axis=0)
        best = np.maximum(best, ratio)
    best = np.maximum(best, _louder(energy, count))
    return float(logsumexp(best) - np.log(len(best)) - UNKNOWN_SIZE), best


def _louder(energy: FloatArray, count: FloatArray) -> FloatArray:
    """Return the gain in nats (W,) of windows that are louder than the noise is by more than a third.

    ``energy`` (W,) is the sum of the squared whitened residuals of ``count`` (W,) cells, clipped, as the noise's tails
    may be heavy. H0: they are normal, of a size that the noise measured at rest is right to. The gain is the largest
    likelihood ratio of their variance.
    """
    louder = np.maximum(energy / np.maximum(count, 1.0) / (1.0 + ROUGH) ** 2, 1.0)
    return np.asarray(0.5 * count * (louder - 1.0 - np.log(louder)))
