"""Where simulation and recordings differ: windows of the phases, what they hold, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.signflip import flip_test
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_OWN, FEW_TRIALS, LEVEL
from analysis.mismatch.locate.session import Trend
from analysis.mismatch.locate.transients import Bursts
from analysis.mismatch.locate.windows import PLACES, own_evidence, window_columns

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Located:
    """One stretch of a phase: times from a trial's first sample (median of trials), mean and rms of what differs.

    ``share`` of all ``energy`` beyond noise, mN^2 samples; ``common``: whether trials have it in common;
    ``with_depth``: whether it grows with depth.
    """

    phase: str
    start_s: float
    stop_s: float
    mean_mn: float
    rms_mn: float
    p_value: float
    share: float
    common: bool
    with_depth: bool
    told: str = ""
    energy: float = 0.0

    @property
    def words(self) -> str:
        """Say in which trials it shows, or what is told of it."""
        if self.told:
            return self.told
        if not self.common:
            return "every trial, differently in each"
        return "every trial, more with depth" if self.with_depth else "every depth"


def locate(fit: StudyFit, rng: np.random.Generator, *, somewhere: bool = False) -> tuple[Located, ...]:
    """Return the stretches in which trials differ significantly from the simulation, largest share first.

    H0 of what trials have in common: each trial's score is as likely turned round (sign-flips of whole trials, maximum
    over all windows and their growth with depth); of what differs from trial to trial: the noise measured at rest, by
    the odds for a window's variance (an e-value; P(odds >= x) <= 1/x). With fewer than eight trials only the latter.
    Where trials are known to differ ``somewhere`` it returns the largest stretch if none is significant by itself.
    """
    columns = [window_columns(t) for t in fit.trials]
    white = [p(c) for p, c in zip(fit.projectors, columns, strict=True)]
    scores = np.array([p.residual @ w for p, w in zip(fit.projectors, white, strict=True)])
    depth = np.array([t.depth_mm / t.study_depth_mm for t in fit.trials])[:, None]
    n = len(fit.trials)
    common_p = np.ones((2, len(PLACES)))
    if n >= FEW_TRIALS:
        both = np.hstack([scores, scores * (depth - depth.mean())])
        common_p = flip_test(both, np.zeros(both.shape[1], dtype=bool), rng).p_value.reshape(2, -1)
    _, odds = own_evidence(fit)
    own_p = np.minimum(1.0, len(PLACES) * np.exp(-np.clip(odds, 0.0, 700.0)))
    p = np.minimum(common_p.min(axis=0), own_p)
    energy, mean, weight = energies(fit, columns)
    total = max(float(energy[p <= LEVEL].sum()), 1e-30)
    significant = p <= LEVEL
    if somewhere and not significant.any() and energy.max() > 0:
        significant = energy >= energy.max()
        total = float(energy.sum())
    found = []
    for group in _merged(significant, weight > 0):
        samples = float(weight[group].sum())
        start, stop = _times(fit, group)
        found.append(
            Located(
                PLACES[group[0]].phase,
                start,
                stop,
                float((mean * weight)[group].sum() / samples),
                float(np.sqrt(energy[group].sum() / samples)),
                float(p[group].min()),
                min(1.0, float(energy[group].sum()) / total),
                bool(common_p[:, group].min() <= LEVEL),
                bool(common_p[1, group].min() <= LEVEL),
                energy=float(energy[group].sum()),
            )
        )
    return tuple(sorted(found, key=lambda w: -w.share))


def with_bursts(windows: Sequence[Located], bursts: Bursts) -> tuple[Located, ...]:
    """Return windows with where bursts lie, if there are any: about the largest; largest share first."""
    if not bursts.phase or bursts.evidence <= ENOUGH_OWN:
        return tuple(windows)
    at, p = bursts.at_s, float(np.exp(-min(bursts.evidence, 700.0)))
    whole = bursts.energy + max((w.energy / max(w.share, 1e-30) for w in windows), default=0.0)
    share = bursts.energy / whole if windows else 1.0
    burst = Located(
        bursts.phase,
        at,
        at,
        0.0,
        bursts.rms_mn,
        p,
        share,
        common=False,
        with_depth=False,
        energy=bursts.energy,
    )
    beside = (replace(w, share=(1.0 - share) * w.share) for w in windows)
    return tuple(sorted((burst, *beside), key=lambda w: -w.share))


def where_trend(trend: Trend) -> tuple[Located, ...]:
    """Return where a trend over the session shows, if there is one: while the tissue is held."""
    if not trend.significant:
        return ()
    p = float(np.exp(-min(trend.evidence, 700.0)))
    return (
        Located(
            "hold",
            trend.start_s,
            trend.stop_s,
            0.0,
            trend.rms_mn,
            p,
            1.0,
            common=False,
            with_depth=False,
            told=trend.words,
        ),
    )


def energies(fit: StudyFit, columns: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return energy beyond noise (mN^2 samples), mean residual (mN) and samples of every window, each (W,).

    Of a window's squared residual the noise's share is that of its whitened squares, of which noise leaves one a cell.
    """
    energy, total, weight = np.zeros(len(PLACES)), np.zeros(len(PLACES)), np.zeros(len(PLACES))
    whitened, cells = np.zeros(len(PLACES)), np.zeros(len(PLACES))
    for j, (trial, inside) in enumerate(zip(fit.trials, columns, strict=True)):
        r = fit.residual_mn(j)
        counts = trial.counts * trial.fitted
        energy += inside.T @ (counts * r**2)
        total += inside.T @ (counts * r)
        weight += inside.T @ counts
        whitened += inside[trial.fitted].T @ fit.whiteners[j](r) ** 2
        cells += inside[trial.fitted].sum(axis=0)
    beyond = np.maximum(1.0 - cells / np.maximum(whitened, 1e-300), 0.0)
    return energy * beyond, total / np.maximum(weight, 1.0), weight


def _merged(significant: NDArray[np.bool_], present: NDArray[np.bool_]) -> list[list[int]]:
    """Join significant windows of one phase that are neighbours."""
    groups: list[list[int]] = []
    for b in np.flatnonzero(significant & present):
        if groups and groups[-1][-1] == b - 1 and PLACES[groups[-1][-1]].phase == PLACES[b].phase:
            groups[-1].append(int(b))
        else:
            groups.append([int(b)])
    return groups


def _times(fit: StudyFit, group: Sequence[int]) -> tuple[float, float]:
    starts = [s[0] for t in fit.trials if (s := PLACES[group[0]].span(t)) is not None]
    stops = [s[1] for t in fit.trials if (s := PLACES[group[-1]].span(t)) is not None]
    return max(float(np.median(starts)), 0.0), float(np.median(stops))
