"""Noise slower than a spectrum of a hold can show: as much as makes the trials most likely (restricted likelihood)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from analysis.mismatch.fit.noise import FASTEST_SLOW_S, SMOOTH_TIMES_S, NoiseModel
from analysis.mismatch.fit.own import from_mean, log_determinant, own_columns
from analysis.mismatch.fit.study_fit import StudyFit, tells_noise
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import TISSUE_SIZE

LADDER = 4.0
"""Ratio of neighbouring times: a sum of Ornstein-Uhlenbeck parts so spaced is a power law within a few per cent."""
EXPONENTS = (0.0, 0.5, 1.0)
"""How the variance of a part grows with its time: 0 is 1/f noise, 1 a random walk; electronics lie between."""
CUT_S = SMOOTH_TIMES_S[-1]
"""Time of the filter through which smooth slow noise went besides: the slowest that lets a breath and a pulse pass."""
SMALLEST, LARGEST = 0.03, 60.0
"""Changes in a second that are tried, rms in units of the white noise of a sample."""
FIRST_STEP, NEAR = 0.1, 0.05
"""Logarithms of a size: how far from it another is tried first, and how near to the likeliest is near enough."""
OFFSET = 10.0
"""Added to the logarithms that are searched: the search is told how near by a share of what it finds."""
NOTHING_GAINED = 1.0


def change_in_a_second(noise: NoiseModel) -> float:
    """Return how much the parts of a noise change in a second, rms mN."""
    squares = sum(-2.0 * variance * np.expm1(-1.0 / time_s) for variance, time_s in noise.exponentials)
    return float(np.sqrt(squares))


def power_law(
    fast: NoiseModel, change_mn: float, exponent: float, longest_s: float, *, smooth: bool = False
) -> NoiseModel:
    """Return the noise with slow parts of a power law that change by ``change_mn`` rms in a second.

    ``smooth`` ones went through another filter, as a band that is cut off.
    """
    times_s = [FASTEST_SLOW_S]
    while times_s[-1] < longest_s:
        times_s.append(times_s[-1] * LADDER)
    if smooth:
        ladder = NoiseModel(0.0, (), tuple((t**exponent, t, CUT_S) for t in times_s))
    else:
        ladder = NoiseModel(0.0, tuple((t**exponent, t) for t in times_s))
    return fast + ladder.times(change_mn / change_in_a_second(ladder))


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


def with_slow_noise(fit: StudyFit, near: NoiseModel, *, smooth: bool = False) -> StudyFit:
    """Return the fit with as much slow noise, of one power law, as the trials themselves make most likely.

    It is looked for about that of the noise ``near``, or about what the fit leaves where that has none; ``smooth``
    noise went through another filter, too.
    A wander slower than a hold can't be seen in a residual from which a tissue was fitted.
    """
    if not tells_noise(fit.trials):
        return fit
    fast, longest_s = fit.noise, max(float(t.time_s[-1] - t.time_s[0]) for t in fit.trials)
    slow = near.slower_from(FASTEST_SLOW_S)
    nothing = restricted_deviance(fit, fast)
    least = (power_law(fast, SMALLEST * fast.white_mn, exponent, longest_s) for exponent in EXPONENTS)
    if not slow.exponentials and all(restricted_deviance(fit, noise) >= nothing for noise in least):
        # where the least of it is worse than nothing, more is
        return fit
    change_mn = change_in_a_second(slow) if slow.exponentials else fit.left_mn
    first = EXPONENTS.index(_exponent(slow))
    best, smallest = _likeliest(fit, EXPONENTS[first], change_mn, longest_s, smooth=smooth)
    for others in (EXPONENTS[:first][::-1], EXPONENTS[first + 1 :]):
        for exponent in others:
            change_mn = change_in_a_second(best.slower_from(FASTEST_SLOW_S))
            noise, deviance = _likeliest(fit, exponent, change_mn, longest_s, smooth=smooth)
            if deviance >= smallest:
                # the further from the likeliest exponent, the less likely
                break
            best, smallest = noise, deviance
    return fit.weighed_by(best) if smallest < nothing - NOTHING_GAINED else fit


def _exponent(slow: NoiseModel) -> float:
    """Return the exponent of slow parts of one power law; that of a random walk where there are none."""
    variances = [v for v, *_ in slow.parts or slow.smooth]
    if len(variances) < 2:
        return EXPONENTS[-1]
    first, second = variances[:2]
    return min(EXPONENTS, key=lambda exponent: abs(exponent - np.log(second / first) / np.log(LADDER)))


def _likeliest(
    fit: StudyFit, exponent: float, start_mn: float, longest_s: float, *, smooth: bool
) -> tuple[NoiseModel, float]:
    """Return the likeliest noise of one exponent, and its deviance, looked for from a size."""
    lower, upper = np.log([SMALLEST, LARGEST])

    def at(log_size: float) -> NoiseModel:
        change_mn = fit.noise.white_mn * float(np.exp(np.clip(log_size - OFFSET, lower, upper)))
        return power_law(fit.noise, change_mn, exponent, longest_s, smooth=smooth)

    start = OFFSET + float(np.clip(np.log(max(start_mn / fit.noise.white_mn, 1e-9)), lower, upper))
    found = minimize_scalar(
        lambda log_size: restricted_deviance(fit, at(log_size)),
        bracket=(start, start - FIRST_STEP if start + FIRST_STEP > OFFSET + upper else start + FIRST_STEP),
        options={"xtol": NEAR / OFFSET},
    )
    return at(found.x), float(found.fun)
