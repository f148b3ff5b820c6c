"""Noise slower than a spectrum of a hold can show: as much as makes the trials most likely (restricted likelihood)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.mismatch.fit.noise import FASTEST_SLOW_S, NoiseModel
from analysis.mismatch.fit.own import from_mean, log_determinant, own_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import TISSUE_SIZE

FEWEST = 3
LADDER = 4.0
"""Ratio of neighbouring times: a sum of Ornstein-Uhlenbeck parts so spaced is a power law within a few per cent."""
EXPONENTS = (0.0, 0.5, 1.0)
"""How the variance of a part grows with its time: 0 is 1/f noise, 1 a random walk; electronics lie between."""
SMALLEST, LARGEST, FACTOR = 0.03, 60.0, 2.0
"""Changes in a second that are tried, rms in units of the white noise of a sample."""
NOTHING_GAINED = 1.0


def power_law(fast: NoiseModel, change_mn: float, exponent: float, longest_s: float) -> NoiseModel:
    """Return the noise with slow parts of a power law that change by ``change_mn`` rms in a second."""
    times_s = [FASTEST_SLOW_S]
    while times_s[-1] < longest_s:
        times_s.append(times_s[-1] * LADDER)
    shares = np.array(times_s) ** exponent
    changes = float(2.0 * np.sum(shares * -np.expm1(-1.0 / np.array(times_s))))
    variances = change_mn**2 / changes * shares
    return NoiseModel(
        fast.white_mn, (*fast.parts, *((float(v), t) for v, t in zip(variances, times_s, strict=True)))
    )


def restricted_deviance(fit: StudyFit, noise: NoiseModel) -> float:
    """Return -2 ln of the likelihood of a noise, own parameters integrated out and the population's mean at its best.

    As in restricted maximum likelihood (Patterson and Thompson, Biometrika 58:545, 1971), at the columns of the fit.
    """
    A, b, deviance = np.zeros((TISSUE_SIZE, TISSUE_SIZE)), np.zeros(TISSUE_SIZE), 0.0
    for trial, force, state in zip(fit.trials, fit.force_columns, fit.states, strict=True):
        whitener = Whitener(trial, noise)
        own = own_columns(force, whitener, state, fit.population)
        residual = own.residual + own.columns @ from_mean(own)
        X = np.column_stack([own.columns[:, own.tissue], residual])
        inside = own.columns.T @ X
        G = X.T @ X - inside.T @ np.linalg.solve(own.information, inside)
        deviance += float(G[-1, -1]) + whitener.log_determinant + log_determinant(own)
        if state.has_tissue:
            A, b = A + G[:-1, :-1], b + G[:-1, -1]
    return deviance - float(b @ np.linalg.lstsq(A, b, rcond=None)[0])


def with_slow_noise(fit: StudyFit) -> StudyFit:
    """Return the fit with as much slow noise, of one power law, as the trials themselves make most likely.

    A wander slower than a hold can't be seen in a residual from which a tissue was fitted.
    """
    if len(fit.trials) < FEWEST:
        return fit
    fast = fit.noise
    best, smallest = fast, restricted_deviance(fit, fast) - NOTHING_GAINED
    for exponent in EXPONENTS:
        for noise, deviance in _descent(fit, fast, exponent):
            if deviance < smallest:
                best, smallest = noise, deviance
    return fit.weighed_by(best)


def _descent(fit: StudyFit, fast: NoiseModel, exponent: float) -> Iterator[tuple[NoiseModel, float]]:
    """Yield noises of one exponent with their deviances: a coarse ascent of sizes, then the vertex about the best."""
    longest_s = max(float(t.time_s[-1] - t.time_s[0]) for t in fit.trials)

    def at(log_change: float) -> tuple[NoiseModel, float]:
        noise = power_law(fast, float(np.exp(log_change)), exponent, longest_s)
        return noise, restricted_deviance(fit, noise)

    sizes = np.arange(np.log(SMALLEST), np.log(LARGEST), np.log(FACTOR)) + np.log(fast.white_mn)
    tried: list[float] = []
    for size in sizes:
        noise, deviance = at(float(size))
        yield noise, deviance
        tried.append(deviance)
        if len(tried) > 1 and deviance > tried[-2]:
            break
    k = int(np.argmin(tried))
    if 0 < k < len(tried) - 1:
        bend = tried[k - 1] - 2.0 * tried[k] + tried[k + 1]
        yield at(float(sizes[k] + 0.5 * np.log(FACTOR) * (tried[k - 1] - tried[k + 1]) / max(bend, 1e-12)))
