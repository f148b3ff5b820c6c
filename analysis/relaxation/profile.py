"""Profile intervals: how far a time or ratio can be moved before the best fit around it becomes too bad.

Where a parameter is poorly known its error is lopsided; an interval of the profile follows that, plus or
minus two standard errors does not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.contact_law import HIGHEST, LOWEST
from analysis.relaxation.noise import influences
from analysis.relaxation.projection import Rows, solve_separable
from analysis.relaxation.ramp_fit import RampModel, RampSolution, fit_ramp
from analysis.relaxation.result import Interval
from analysis.relaxation.windows import CannotFitError, cut_window

Profiled = Literal["t1_s", "t2_s", "A1_over_A0", "A2_over_A0"]
PROFILED: tuple[Profiled, ...] = ("t1_s", "t2_s", "A1_over_A0", "A2_over_A0")
_MOST_TRIES = 40
_TOLERANCE = 2e-3  # in standard normal units
_FARTHEST = 50.0  # standard errors; beyond, the side is called open


def profile_intervals(
    trial: Trial, confidence: float = 0.95, exponent: float | None = None
) -> dict[str, Interval]:
    """Return the profile intervals of both times and both ratios, by name; errors as `profile_interval`."""
    return {name: profile_interval(trial, name, confidence, exponent) for name in PROFILED}


def profile_interval(
    trial: Trial, name: Profiled, confidence: float = 0.95, exponent: float | None = None
) -> Interval:
    """Return the profile interval of a ramp fit's time or ratio.

    The rise of the sum of squares is measured against the noise as it acts on this parameter (its
    standard error over what white noise of unit variance would give), so that correlated noise widens
    the interval as it should. Raises CannotFitError where the trial can't be fitted, ValueError for a
    name or confidence that makes no sense.
    """
    if name not in PROFILED or not 0 < confidence < 1:
        raise ValueError(f"no profile of {name!r} at confidence {confidence}")
    from scipy.special import ndtri

    with np.errstate(all="ignore"):
        found = fit_ramp(cut_window(trial), exponent=exponent)
        value, error, scale = _centre(found, name)
        target = float(ndtri(0.5 + confidence / 2))
        rise = _rise(found, name, scale)
        low = _crossing(rise, value, -error, target)
        high = _crossing(rise, value, error, target)
    return Interval(0.0 if low is None else low, value, np.inf if high is None else high)


def _centre(found: RampSolution, name: Profiled) -> tuple[float, float, float]:
    """Return value, standard error, and the noise variance that acts on this parameter."""
    arm = int(name[1])
    stiffness, n_arms = found.stiffness_mn_per_mm, len(found.times_s)
    by = np.zeros(len(found.covariance))
    if name.startswith("t"):
        value = float(found.times_s[arm - 1])
        by[n_arms + 1 + arm] = value
    else:
        value = float(stiffness[arm] / stiffness[0])
        by[0], by[arm] = -value / stiffness[0], 1.0 / stiffness[0]
    weights = found.blocks.counts
    influence = influences(found.jacobian, weights)
    white = float(by @ ((influence * weights) @ influence.T) @ by)
    variance = float(by @ found.covariance @ by)
    return value, float(np.sqrt(variance)), variance / white


def _rise(found: RampSolution, name: Profiled, scale: float) -> Callable[[float], float]:
    """Return the function value -> root of the rise of the sum of squares, in standard normal units."""
    blocks, arm, n_arms = found.blocks, int(name[1]), len(found.times_s)
    fixes_time = name.startswith("t")
    free = [i for i in range(n_arms) if not (fixes_time and i == arm - 1)]
    model = RampModel(blocks, n_arms, found.contact_mm, found.contact_seen, found.law, found.exponent_free)
    start = np.log(found.times_s[free])
    low, high = start - 6.0, start + 6.0
    if found.contact_seen:
        start = np.append(start, found.contact_mm)
        low, high = np.append(low, blocks.position_mm.min()), np.append(high, blocks.position_mm.max())
    if found.exponent_free:
        start = np.append(start, found.law.exponent)
        low, high = np.append(low, LOWEST), np.append(high, HIGHEST)

    def rows_at(fixed: float, parameters: FloatArray) -> Rows:
        log_times = np.log(found.times_s)
        log_times[free] = parameters[: len(free)]
        if fixes_time:
            log_times[arm - 1] = np.log(fixed)
        answer = model(np.concatenate([log_times, parameters[len(free) :]]))
        # a fixed ratio ties the arm's row to that of depth
        mix = np.eye(1 + n_arms)
        if not fixes_time:
            mix[0, arm] = fixed
            mix = np.delete(mix, arm, axis=0)
        rows = np.concatenate([mix @ answer.rows[:-1], answer.rows[-1:]])

        def slopes(amplitudes: FloatArray) -> FloatArray:
            by_all = answer.slopes(np.append(amplitudes[:-1] @ mix, amplitudes[-1]))
            return np.concatenate([by_all[free], by_all[n_arms:]])

        return Rows(rows, slopes)

    def rise(value: float) -> float:
        try:
            solution = solve_separable(
                lambda parameters: rows_at(value, parameters),
                blocks.force_mn,
                blocks.counts,
                start=start,
                low=low,
                high=high,
                n_springs=1 + n_arms - (not fixes_time),
            )
        except (CannotFitError, np.linalg.LinAlgError):
            return float(np.inf)
        return float(np.sqrt(max(solution.squares - found.squares, 0.0) / scale))

    return rise


def _crossing(rise: Callable[[float], float], value: float, error: float, target: float) -> float | None:
    """Return where the rise reaches the target on one side of the value, None where it does not."""
    inside, outside, step = value, value + target * error, target * error
    while rise(outside) < target:
        inside, step = outside, 1.6 * step
        outside = inside + step
        if abs(outside - value) > _FARTHEST * abs(error):
            return None
        if outside <= 0:
            outside = 0.1 * inside
            if inside < 1e-3 * value:
                return None
    at_inside, at_outside = rise(inside), rise(outside)
    for _ in range(_MOST_TRIES):
        share = (target - at_inside) / (at_outside - at_inside) if np.isfinite(at_outside) else 0.5
        middle = inside + float(np.clip(share, 0.05, 0.95)) * (outside - inside)
        at_middle = rise(middle)
        if abs(at_middle - target) < _TOLERANCE:
            return middle
        if at_middle < target:
            inside, at_inside = middle, at_middle
        else:
            outside, at_outside = middle, at_middle
    return 0.5 * (inside + outside)
