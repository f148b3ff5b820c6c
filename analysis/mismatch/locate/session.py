"""What changes as a session goes on: constants of the tissue that follow the order of the trials."""

from __future__ import annotations

from collections.abc import Sequence
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

    ``of_repeats``: it is the change over the repeats at one site, the same at all. ``rms_mn`` is what it does to the
    force from ``start_s`` to ``stop_s`` of a trial.
    """

    evidence: float
    change: FloatArray
    rms_mn: float = 0.0
    start_s: float = 0.0
    stop_s: float = 0.0
    of_repeats: bool = False

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
        over, ends = ("repeats at one site", "repeat") if self.of_repeats else ("session", "trial")
        return f"a trend over the {over}" + (f", from first {ends} to last: {listed(told)}" if told else "")


NO_TREND = Trend(0.0, np.zeros(TISSUE_SIZE))


@dataclass(frozen=True)
class _Course:
    """How log constants follow one course of the order: evidence (-ln p) and slopes (5,); the course by trial (n,)."""

    evidence: float
    slope: FloatArray
    along: FloatArray
    of_repeats: bool


def find_trend(fit: StudyFit) -> Trend:
    """Return how the tissues' constants follow the order in which the trials were recorded, evenly or levelling off.

    A site has one tissue for all its repeats: what sites are like on average is one stratum, how repeats at a site
    differ another (Cochran and Cox, Experimental Designs, 1957, section 7.1). Of all that is looked at the best one's
    p-value counts as often as was looked.
    """
    used = [j for j, s in enumerate(fit.states) if s.has_tissue]
    if not used:
        return NO_TREND
    trials = [fit.trials[j] for j in used]
    y = np.array([fit.states[j].log_tissue for j in used])
    order = np.array([t.order for t in trials], dtype=np.float64)
    depth = np.array([[t.depth_mm] for t in trials])
    finger, site = (
        _members(names) for names in ([t.finger for t in trials], [t.site or t.label for t in trials])
    )
    means = (site / site.sum(axis=0)).T
    since = order - np.array([order[here > 0.0].min() for here in site.T]) @ site.T
    found = []
    for at in (order, np.log1p(order)):
        told = _follows(means @ y, means @ np.hstack([finger, depth]), means @ at)
        found += [_Course(*told, at, of_repeats=False)] if told else []
    for at in (since, np.log1p(since)):
        told = _follows(y, np.hstack([site, depth]), at)
        found += [_Course(*told, at, of_repeats=True)] if told else []
    if not found:
        return NO_TREND
    best = max(found, key=lambda course: course.evidence)
    along = best.along - best.along.mean()
    squares = samples = 0.0
    for j, way in zip(used, along, strict=True):
        trial, state = fit.trials[j], fit.states[j]
        without = replace(state, log_tissue=state.log_tissue - best.slope * way)
        held = trial.in_phase("hold")
        moved = simulate(trial, state, fit.shared) - simulate(trial, without, fit.shared)
        squares += float(trial.counts @ (held * moved**2))
        samples += float(trial.counts @ held)
    start_s, stop_s = (float(np.median([t.hold_window_s[k] for t in trials])) for k in (0, 1))
    rms_mn = float(np.sqrt(squares / max(samples, 1.0)))
    evidence, change = best.evidence - float(np.log(len(found))), best.slope * float(np.ptp(along))
    return Trend(evidence, change, rms_mn, start_s, stop_s, of_repeats=best.of_repeats)


def _members(names: Sequence[str]) -> FloatArray:
    """Return which of n trials belong to each of the names (n, K)."""
    return np.array([[name == each for each in dict.fromkeys(names)] for name in names], dtype=np.float64)


def _follows(y: FloatArray, known: FloatArray, course: FloatArray) -> tuple[float, FloatArray] | None:
    """Return how log constants (n, 5) follow a course (n,) beside what is known (n, K): evidence (-ln p), slopes (5,).

    H0: beside what is known the course says nothing of them; what is left of them is normal, independent and of one
    covariance. Statistic: Wilks' Lambda of the course as one more regressor; with m degrees of freedom left,
    (1 - Lambda) / Lambda * (m - 4) / 5 is exactly F(5, m - 4) (Mardia, Kent, Bibby 1979, section 6.3). None where too
    few are left, or hardly any of the course.
    """
    freedom = len(y) - int(np.linalg.matrix_rank(known)) - TISSUE_SIZE
    if freedom < LEAST_FREEDOM:
        return None
    y, x = (np.asarray(v - known @ np.linalg.lstsq(known, v, rcond=None)[0]) for v in (y, course))
    if x @ x < CONFOUNDED * float(np.var(course)) * len(y):
        return None
    slope = x @ y / (x @ x)
    left = y - np.outer(x, slope)
    wilks = float(np.exp(np.linalg.slogdet(left.T @ left)[1] - np.linalg.slogdet(y.T @ y)[1]))
    statistic = (1.0 - wilks) / max(wilks, 1e-300) * freedom / TISSUE_SIZE
    return -float(f_distribution.logsf(statistic, TISSUE_SIZE, freedom)), slope
