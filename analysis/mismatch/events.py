"""Events with a time of their own in every trial: the punch slips, the finger moves once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, logsumexp

from analysis.mismatch.event_at import event_rows
from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import column_space, linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.surface_motion import in_contact
from analysis.mismatch.tissue_scatter import Scatter, scatter_over
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

STEP_S = 0.02
MOST_TIMES = 1000
EDGE_S = 0.06
FEWEST_TIMES = 10
STRONGEST_OF_NOISE = 2.2
TAIL = 1.12
EVENT_SIZES = (2.0, 3.0, 4.0, 5.0, 7.0)


@dataclass(frozen=True)
class EventScan:
    """Standardised scores of a step at each time: one array (times,) a trial; positive is the law's own sign.

    ``widths``: of each trial that was scanned, the strongest score that is left when its strongest step is taken out,
    in units of what white noise has there. Noise that was not weighed as slow as it is has many strong steps, an event
    is one. ``evidence``: twice the logarithm of the likelihood of what rest there is, with the best event in each
    trial that is worth its time.
    """

    mechanism: Mechanism
    times_s: tuple[FloatArray, ...]
    scores: tuple[FloatArray, ...]
    widths: tuple[float, ...]
    evidence: float

    def strongest(self) -> tuple[FloatArray, FloatArray]:
        """Return the score of largest size (T,) and its time (T,) in each trial (0, 0 where nothing was scanned)."""
        best, at = np.zeros(len(self.scores)), np.zeros(len(self.scores))
        for j, (t, s) in enumerate(zip(self.times_s, self.scores, strict=True)):
            if len(s):
                k = int(np.argmax(np.abs(s)))
                best[j], at[j] = s[k], t[k]
        return best, at

    @property
    def width(self) -> float:
        """The median trial's width; never below 1, what white noise has."""
        return max(1.0, float(np.median(self.widths))) if self.widths else 1.0

    def asymmetry(self) -> FloatArray:
        """Return max(score) - max(-score) of each trial (T,): symmetric about 0 without an event of known sign."""
        return np.array([float(s.max() - (-s).max()) if len(s) else 0.0 for s in self.scores])


def event_mechanisms() -> list[Mechanism]:
    """Return the library's events."""
    return [m for m in library().values() if m.form == "event"]


@dataclass(frozen=True)
class _Rest:
    """What an event is looked for in: whitened residual r (n,), shared derivatives J (n, P), own columns out of both.

    ``inside`` (N,) masks the cells that count, of those fitted; ``basis`` (n, q) spans the own columns there.
    """

    inside: NDArray[np.bool_]
    times_s: FloatArray
    r: FloatArray
    J: FloatArray
    basis: FloatArray


def scan_events(
    mechanism: Mechanism, trials: Sequence[CellTrial], whiteners: Sequence[Whitener], fit: JointFit
) -> EventScan:
    """Score a step at every 20 ms, in long holds a thousand times, of the hold (slip) or all contact (artefact).

    Events in some trials bend the shared parameters for all, and trials may differ in their tissue. Steps are scored
    beside one tissue for all, and beside tissues that scatter as these trials do; what explains more is kept.
    """
    rests: dict[int, _Rest] = {}
    for j, (trial, whitener) in enumerate(zip(trials, whiteners, strict=True)):
        window = _event_window(mechanism, trial, fit.own[j])
        if window.sum() < 20:
            continue
        line = linearise(trial, whitener, fit.simulation, fit.own[j], trials, fit.latents[j])
        # only rest counts: what a contact point that is off leaves at the kink of contact is no event
        inside = (window | trial.in_phase("dwell") | trial.in_phase("clear"))[trial.fitted]
        basis = column_space(line.A[inside])
        r, J = line.r[inside], line.J[inside]
        times_s = _event_times(trial.time_s[window])
        rests[j] = _Rest(inside, times_s, r - basis @ (basis.T @ r), J - basis @ (basis.T @ J), basis)
    rests = dict(zip(rests, _best_at_rest(list(rests.values())), strict=True))
    scatter = scatter_over([rest.r for rest in rests.values()], [rest.J for rest in rests.values()])
    choices = [Scatter.none(len(scatter.spread))] + ([scatter] if scatter.gain > 0 else [])
    scored: list[dict[int, _Scored]] = [{} for _ in choices]
    for j, rest in rests.items():
        rows = event_rows(mechanism, trials[j], fit.simulation.tissue, fit.own[j], rest.times_s)
        C = whiteners[j](rows.T)[rest.inside]
        C -= rest.basis @ (rest.basis.T @ C)
        for choice, found in zip(choices, scored, strict=True):
            found[j] = _scored(C, rest, choice)
    evidence = [sum(s.gain + _worth(s.scores) for s in found.values()) for found in scored]
    best = scored[int(np.argmax(evidence))]
    unexplained = sum(
        float(rest.r @ rest.r) - 2.0 * float(np.sum(np.log(whiteners[j].scale[rest.inside])))
        for j, rest in rests.items()
    )
    nothing = np.zeros(0)
    return EventScan(
        mechanism,
        tuple(rests[j].times_s if j in rests else nothing for j in range(len(trials))),
        tuple(best[j].scores if j in best else nothing for j in range(len(trials))),
        tuple(s.width for s in best.values() if len(s.scores) >= FEWEST_TIMES),
        max(evidence) - unexplained,
    )


def _worth(scores: FloatArray) -> float:
    """Return what the best of the steps gains, less what the best of so many is expected to gain by chance."""
    return max(float(np.max(scores**2)) - by_chance(len(scores)), 0.0) if len(scores) else 0.0


def by_chance(n_times: int) -> float:
    """Return the squared score that the best of so many steps has by chance."""
    return 2.0 * float(np.log(max(n_times, 1)))


def _best_at_rest(rests: Sequence[_Rest]) -> list[_Rest]:
    """Return the rests with the shared parameters that fit them best: what bends these in motion is no event either."""
    if not rests:
        return []
    J, r = np.concatenate([rest.J for rest in rests]), np.concatenate([rest.r for rest in rests])
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    step = np.linalg.lstsq(J / scale, r, rcond=1e-9)[0] / scale
    return [replace(rest, r=rest.r - rest.J @ step) for rest in rests]


def _event_window(mechanism: Mechanism, trial: CellTrial, own: PerTrial) -> NDArray[np.bool_]:
    """Mask (n,) of the cells in which an event is looked for."""
    if trial.kind in ("air_sweep", "rigid_target"):
        return np.zeros(len(trial.time_s), dtype=bool)
    window = trial.in_phase("hold")
    if mechanism.stage != "contact":
        window = window | trial.in_phase("dwell")
    return np.asarray(window & in_contact(trial, own) & trial.fitted)


def _event_times(t: FloatArray) -> FloatArray:
    """Return the times (m,) at which steps are tried in a window's cells at times ``t``.

    Within each stretch at rest, clear of its ends: at a kink of the motion its smoothing looks like a step.
    """
    step_s = max(STEP_S, float(t[-1] - t[0]) / MOST_TIMES)
    ends = np.flatnonzero(np.diff(t) > EDGE_S)
    firsts, lasts = np.append(t[0], t[ends + 1]), np.append(t[ends], t[-1])
    stretches = zip(firsts, lasts, strict=True)
    return np.concatenate([np.arange(a + EDGE_S, b - EDGE_S, step_s) for a, b in stretches])


@dataclass(frozen=True)
class _Scored:
    """Scores (m,) of steps in one trial, its width, and what the scatter gains in it: twice a log-likelihood."""

    scores: FloatArray
    width: float
    gain: float


def _scored(C: FloatArray, rest: _Rest, scatter: Scatter) -> _Scored:
    """Score steps C (n, m) in a trial whose tissue scatters.

    The scatter adds J S S' J' to the unit covariance of the whitened residual (Woodbury's identity).
    """
    loose = rest.J @ scatter.spread
    factor = np.linalg.cholesky(np.eye(loose.shape[1]) + loose.T @ loose)
    known = np.linalg.solve(factor, loose.T)
    B = known @ C
    norm = np.sqrt(np.maximum(np.einsum("nf,nf->f", C, C) - np.einsum("kf,kf->f", B, B), 1e-24))
    explained = known @ rest.r
    gain = float(explained @ explained) - 2.0 * float(np.sum(np.log(np.diag(factor))))
    scores = (C.T @ rest.r - B.T @ explained) / norm
    if not len(scores):
        return _Scored(scores, 0.0, gain)
    k = int(np.argmax(np.abs(scores)))
    left = scores - (C.T @ C[:, k] - B.T @ B[:, k]) / (norm * norm[k]) * scores[k]
    return _Scored(scores, float(np.max(np.abs(left))) / STRONGEST_OF_NOISE, gain)


def event_p_value(scan: EventScan) -> float:
    """Return the chance that the steps of all trials are noise: by the strongest of any, or by all together.

    Scores are measured in units of the median trial's width, and the tail is taken an eighth wider than Gaussian, so
    that correlated noise does not pass for an event.
    """
    scored = [s / (scan.width * TAIL) for s in scan.scores if len(s) >= FEWEST_TIMES]
    if not scan.widths or not scored:
        return 1.0
    strongest = max(float(np.max(np.abs(s))) for s in scored)
    looks = sum(len(s) for s in scored)
    by_strongest = looks * erfc(strongest / np.sqrt(2.0))
    by_all = np.exp(-_together(scored, one_sided=scan.mechanism.one_sided))
    return float(min(1.0, 2.0 * min(by_strongest, by_all)))


def _together(scored: Sequence[FloatArray], *, one_sided: bool) -> float:
    """Return the logarithm of how much likelier all scores are with an event in half of the trials than without.

    Its time is anywhere, its size the same in all; over some sizes the mean. By Markov's inequality noise of unit
    variance makes such a ratio exceed 1 / p with a chance below p (an e-value; Vovk, Wang, Ann. Stat. 49:1736, 2021).
    """
    signs = (1.0,) if one_sided else (1.0, -1.0)
    ratios = []
    for size in EVENT_SIZES:
        log_ratio = 0.0
        for s in scored:
            each = np.concatenate([sign * size * s - 0.5 * size**2 for sign in signs])
            log_ratio += float(np.logaddexp(np.log(0.5), np.log(0.5) + logsumexp(each) - np.log(len(each))))
        ratios.append(log_ratio)
    return float(logsumexp(ratios) - np.log(len(ratios)))


def refine_time(
    mechanism: Mechanism,
    trials: Sequence[CellTrial],
    whitener: Whitener,
    fit: JointFit,
    index: int,
    about_s: float,
) -> float:
    """Return the time of an event to the millisecond, by a finer scan about a first estimate."""
    trial = trials[index]
    times = about_s + np.arange(-STEP_S, STEP_S + 5e-4, 1e-3)
    own, tissue = fit.own[index], fit.simulation.tissue
    columns = whitener(event_rows(mechanism, trial, tissue, own, times).T)
    line = linearise(trial, whitener, fit.simulation, own, trials, fit.latents[index])
    left, _ = project_out(np.column_stack([line.A, line.J]), np.column_stack([line.r, columns]))
    gain = (left[:, 1:].T @ left[:, 0]) ** 2 / np.maximum((left[:, 1:] ** 2).sum(axis=0), 1e-12)
    return float(times[int(np.argmax(gain))])
