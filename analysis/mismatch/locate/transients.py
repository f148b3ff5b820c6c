"""Bursts: some milliseconds, once or a few times in a trial, in which samples agree that something was there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.special import logsumexp

from analysis.mismatch.evidence.marginal import log_ratio
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial, near

FloatArray = NDArray[np.float64]

WIDTHS = (4, 8, 16, 32, 64)
"""Samples that a burst may last: fewer are a heavy tail of the noise."""
CLIPPED = 3.0
"""Robust deviations beyond which a single sample or cell says no more: tails of the noise may be heavy."""
STRENGTHS = (10.0, 30.0, 100.0)
"""Variances of a burst that are tried, in units of the noise of its mean."""
OFTEN = (0.1, 0.5, 0.95)
"""Shares of trials with a burst that are tried."""
PRICE = float(np.log(len(STRENGTHS) * len(OFTEN)))


@dataclass(frozen=True)
class Bursts:
    """Evidence in nats for bursts, the phase with most of them, and rms (mN) and time (s) of the largest of a trial.

    ``energy`` is that of all trials beyond what noise makes, mN^2 samples.
    """

    evidence: float
    phase: str
    at_s: float
    rms_mn: float
    energy: float = 0.0


NO_BURSTS = Bursts(0.0, "", 0.0, 0.0)


def find_bursts(fit: StudyFit) -> Bursts:
    """Weigh a burst at any time at rest in every trial, its size, length and how often it comes marginalised.

    H0: samples are independent about a level that wanders slower than any burst, clipped; a sum of w of them is
    normal. The evidence is that of a mixture over times, as for events.
    """
    scored = [_scores(fit, j) for j in range(len(fit.trials))]
    best = -np.inf
    for strength in STRENGTHS:
        ratio = np.array([_log_ratio(z, strength) if z.size else 0.0 for z, _, _ in scored])
        for share in OFTEN:
            best = max(best, float(np.logaddexp(np.log1p(-share), np.log(share) + ratio).sum()))
    tops = [float(np.abs(z).max()) if z.size else 0.0 for z, _, _ in scored]
    j = int(np.argmax(tops))
    z, times, sigma = scored[j]
    if not z.size:
        return NO_BURSTS
    row, column = divmod(int(np.abs(z).argmax()), z.shape[1])
    at_s = float(times[column])
    size_mn = sigma * tops[j] / float(np.sqrt(WIDTHS[row]))
    # of so many sums of noise alone the largest is hardly larger than that (Donoho and Johnstone 1994)
    noise = (2.0 * np.log(max(z.size, 1)) for z, _, _ in scored)
    energy = sum(s**2 * max(top**2 - n, 0.0) for (_, _, s), top, n in zip(scored, tops, noise, strict=True))
    return Bursts(best - PRICE, phase_at(fit.trials[j], at_s), at_s, size_mn, energy)


def phase_at(trial: CellTrial, at_s: float) -> str:
    """Return the name of a trial's phase at a time, or nothing between phases."""
    code = int(trial.phase[min(int(np.searchsorted(trial.time_s, at_s)), len(trial.phase) - 1)])
    return PHASE_NAMES[code] if code >= 0 else ""


def _scores(fit: StudyFit, j: int) -> tuple[FloatArray, FloatArray, float]:
    """Return standardised sums (W, N) of samples about every time (N,), and the deviation of one, mN."""
    trial = fit.trials[j]
    residual = trial.as_loud_as_rest(fit.unrounded_residual_mn(j))
    # a level that follows what lasts longer than any burst
    level_n = 8 * WIDTHS[-1]
    if len(residual) < 4 * level_n:
        return np.zeros((0, 0)), np.zeros(0), 0.0
    level = uniform_filter1d(residual, level_n, mode="nearest")
    sigma = 1.4826 * float(np.median(np.abs(residual - level)))
    white = np.clip((residual - level) / max(sigma, 1e-12), -CLIPPED, CLIPPED)
    total = np.concatenate([[0.0], np.cumsum(white)])
    kept = at_rest(fit, j)
    kept[:level_n] = kept[-level_n:] = False  # there the level is guessed
    rows = []
    for width in WIDTHS:
        sums = np.full(len(white), 0.0)
        sums[: len(white) - width + 1] = total[width:] - total[:-width]
        # correlated noise makes sums of its own size: they are measured by the middle of their own
        spread = 1.4826 * float(np.median(np.abs(sums[kept]))) if kept.any() else 0.0
        rows.append(sums / max(spread, np.sqrt(width), 1e-12))
    return np.array(rows)[:, kept], trial.full_time_s[kept], sigma


def at_rest(fit: StudyFit, j: int) -> NDArray[np.bool_]:
    """Return which samples (N,) are away from motion and from named steps: what a law leaves there is no burst."""
    trial, state = fit.trials[j], fit.states[j]
    steps = np.array([s.at for s in state.shapes if s.acts != "force" and not s.kind and s.at > 0])
    return np.asarray(trial.at_rest & ~near(trial.full_time_s, steps))


def _log_ratio(z: FloatArray, strength: float) -> float:
    """Return ln of the mean likelihood ratio over times and lengths of a burst whose size is normal about zero."""
    ratio = log_ratio(1.0, z**2, strength)
    return float(logsumexp(ratio) - np.log(ratio.size))
