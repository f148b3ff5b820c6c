"""Noise slower than a spectrum of a hold can show: as much as makes the trials most likely (restricted likelihood)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from analysis.mismatch.fit.noise import FASTEST_SLOW_S, NoiseModel
from analysis.mismatch.fit.own import from_mean, log_determinant, own_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.effects import TISSUE_SIZE

LADDER = 4.0
"""Ratio of neighbouring times: a sum of Ornstein-Uhlenbeck parts so spaced is a power law within a few per cent."""
EXPONENTS = (0.0, 0.5, 1.0)
"""How the variance of a part grows with its time: 0 is 1/f noise, 1 a random walk; electronics lie between."""
SMALLEST, LARGEST, FACTOR = 0.03, 60.0, 2.0
"""Changes in a second that are tried, rms in units of the white noise of a sample."""
NOTHING_GAINED = 1.0


def change_in_a_second(parts: Iterable[tuple[float, float]]) -> float:
    """Return how much Ornstein-Uhlenbeck parts (variance mN^2, time s) change in a second, rms mN."""
    return float(np.sqrt(sum(-2.0 * variance * np.expm1(-1.0 / time_s) for variance, time_s in parts)))


def power_law(fast: NoiseModel, change_mn: float, exponent: float, longest_s: float) -> NoiseModel:
    """Return the noise with slow parts of a power law that change by ``change_mn`` rms in a second."""
    times_s = [FASTEST_SLOW_S]
    while times_s[-1] < longest_s:
        times_s.append(times_s[-1] * LADDER)
    shares = np.array(times_s) ** exponent
    variances = (change_mn / change_in_a_second(zip(shares, times_s, strict=True))) ** 2 * shares
    return NoiseModel(
        fast.white_mn, (*fast.parts, *((float(v), t) for v, t in zip(variances, times_s, strict=True)))
    )


def restricted_deviance(fit: StudyFit, noise: NoiseModel) -> float:
    """Return -2 ln of the likelihood of a noise, own parameters integrated out and the population's mean at its best.

    As in restricted maximum likelihood (Patterson and Thompson, Biometrika 58:545, 1971), at the columns of the fit.
    """
    A, b, deviance = np.zeros((TISSUE_SIZE, TISSUE_SIZE)), np.zeros(TISSUE_SIZE), 0.0
    for trial, force, state in zip(fit.trials, fit.force_columns, fit.states, strict=True):
        whitener = Whitener(trial, noise, state.rhythms)
        own = own_columns(force, whitener, state, fit.population)
        residual = own.residual + own.columns @ from_mean(own)
        X = np.column_stack([own.columns[:, own.tissue], residual])
        inside = own.columns.T @ X
        G = X.T @ X - inside.T @ own.solve(inside)
        deviance += float(G[-1, -1]) + whitener.log_determinant + log_determinant(own)
        if state.has_tissue:
            A, b = A + G[:-1, :-1], b + G[:-1, -1]
    return deviance - float(b @ np.linalg.lstsq(A, b, rcond=None)[0])


def with_slow_noise(fit: StudyFit, near: NoiseModel) -> StudyFit:
    """Return the fit with as much slow noise, of one power law, as the trials themselves make most likely.

    It is looked for about that of the noise ``near``, or from none upwards where that has none.
    A wander slower than a hold can't be seen in a residual from which a tissue was fitted.
    """
    if len(fit.trials) < FEWEST_HELD_OUT:
        return fit
    fast = fit.noise
    best, smallest = fast, restricted_deviance(fit, fast) - NOTHING_GAINED
    slow = [part for part in near.parts if part[1] >= FASTEST_SLOW_S]
    start_mn = float(np.clip(change_in_a_second(slow), SMALLEST * fast.white_mn, LARGEST * fast.white_mn))
    before = np.inf
    for exponent in EXPONENTS:
        noise, deviance = min(_descent(fit, fast, exponent, start_mn), key=lambda found: found[1])
        if deviance < smallest:
            best, smallest = noise, deviance
        if deviance > before:
            # the further from the likeliest exponent, the less likely
            break
        start_mn, before = change_in_a_second(noise.parts[len(fast.parts) :]), deviance
    return fit.weighed_by(best)


def _descent(
    fit: StudyFit, fast: NoiseModel, exponent: float, start_mn: float
) -> Iterator[tuple[NoiseModel, float]]:
    """Yield noises of one exponent with their deviances: coarse steps from a size downhill, then the vertex."""
    longest_s = max(float(t.time_s[-1] - t.time_s[0]) for t in fit.trials)
    tried: dict[int, tuple[NoiseModel, float]] = {}

    def size_mn(at: float) -> float:
        return float(start_mn * FACTOR**at)

    def weighed(at: float) -> tuple[NoiseModel, float]:
        noise = power_law(fast, size_mn(at), exponent, longest_s)
        return noise, restricted_deviance(fit, noise)

    def deviance(at: int) -> float:
        if not SMALLEST * 0.99 <= size_mn(at) / fast.white_mn <= LARGEST * 1.01:
            return np.inf
        if at not in tried:
            tried[at] = weighed(at)
        return tried[at][1]

    best, way = 0, 1 if deviance(1) < deviance(0) else -1
    while deviance(best + way) < deviance(best):
        best += way
    yield from tried.values()
    below, middle, above = deviance(best - 1), deviance(best), deviance(best + 1)
    if np.isfinite(below + above):
        yield weighed(best + 0.5 * (below - above) / max(below - 2.0 * middle + above, 1e-12))
