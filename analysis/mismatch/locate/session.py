"""What changes as a session goes on: constants of the tissue that follow the order of the trials."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_ONCE
from analysis.mismatch.model.effects import TISSUE_NAMES, TISSUE_SIZE, simulate
from analysis.mismatch.model.words import listed

FloatArray = NDArray[np.float64]

LEAST_FREEDOM = 3
"""Degrees of freedom of the test below which it is not asked: of few trials nobody knows how tissues scatter."""
CONFOUNDED = 0.05
"""Share of the order's variance that finger and depth must leave, or nobody could tell a trend from them."""
WORTH_SAYING = 0.05


@dataclass(frozen=True)
class Trend:
    """How the constants follow the order of trials: evidence (-ln p), change (5,) of their logarithms over the session.

    ``rms_mn`` is what it does to the force from ``start_s`` to ``stop_s`` of a trial.
    """

    evidence: float
    change: FloatArray
    rms_mn: float = 0.0
    start_s: float = 0.0
    stop_s: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether it is more than how sites and fingers scatter."""
        return self.evidence > ENOUGH_ONCE

    @property
    def words(self) -> str:
        """Say what changes."""
        told = [
            f"{name.split('_')[0]} by {100.0 * np.expm1(c):+.0f} %"
            for name, c in zip(TISSUE_NAMES, self.change, strict=True)
            if abs(c) > WORTH_SAYING
        ]
        return (
            f"a trend over the session, from first trial to last: {listed(told)}"
            if told
            else "a trend over the session"
        )


NO_TREND = Trend(0.0, np.zeros(TISSUE_SIZE))


def find_trend(fit: StudyFit) -> Trend:
    """Return how the tissues' constants follow the order in which the trials were recorded, evenly or levelling off.

    H0: beside finger and depth the order says nothing of a trial's five log constants; what is left of them is normal,
    independent and of one covariance. Statistic: Wilks' Lambda of the order as one more regressor; with m degrees of
    freedom left, (1 - Lambda) / Lambda * (m - 4) / 5 is exactly F(5, m - 4) (Mardia, Kent, Bibby 1979, section 6.3).
    Of the two courses that are looked at the better one's p-value counts twice.
    """
    used = [j for j, s in enumerate(fit.states) if s.has_tissue]
    trials = [fit.trials[j] for j in used]
    known = np.array([[t.finger == name for t in trials] for name in sorted({t.finger for t in trials})])
    known = np.column_stack([known.T, [t.depth_mm for t in trials]]).astype(np.float64)
    freedom = len(used) - int(np.linalg.matrix_rank(known)) - 1 - TISSUE_SIZE + 1 if used else 0
    if freedom < LEAST_FREEDOM:
        return NO_TREND

    def beside_known(v: FloatArray) -> FloatArray:
        return np.asarray(v - known @ np.linalg.lstsq(known, v, rcond=None)[0])

    y = beside_known(np.array([fit.states[j].log_tissue for j in used]))
    order = np.array([t.order for t in trials], dtype=np.float64)
    best, slope, along = 0.0, np.zeros(TISSUE_SIZE), order
    courses = (order, np.log1p(order))
    for course in courses:
        x = beside_known(course)
        if x @ x < CONFOUNDED * float(np.var(course)) * len(used):
            continue
        b = x @ y / (x @ x)
        left = y - np.outer(x, b)
        wilks = float(np.exp(np.linalg.slogdet(left.T @ left)[1] - np.linalg.slogdet(y.T @ y)[1]))
        statistic = (1.0 - wilks) / max(wilks, 1e-300) * freedom / TISSUE_SIZE
        evidence = -float(f_distribution.logsf(statistic, TISSUE_SIZE, freedom)) - np.log(len(courses))
        if evidence > best:
            best, slope, along = float(evidence), b, course - course.mean()
    squares = samples = 0.0
    for j, way in zip(used, along, strict=True):
        trial, state = fit.trials[j], fit.states[j]
        without = replace(state, log_tissue=state.log_tissue - slope * way)
        held = trial.in_phase("hold")
        moved = simulate(trial, state, fit.shared) - simulate(trial, without, fit.shared)
        squares += float(trial.counts @ (held * moved**2))
        samples += float(trial.counts @ held)
    start_s, stop_s = (float(np.median([t.hold_window_s[k] for t in trials])) for k in (0, 1))
    rms_mn = float(np.sqrt(squares / max(samples, 1.0)))
    return Trend(best, slope * float(np.ptp(along)), rms_mn, start_s, stop_s)
