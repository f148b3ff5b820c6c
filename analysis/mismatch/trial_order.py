"""What changes from the first trial to the last: a gain that follows the order of the trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import linearise, project_out
from analysis.mismatch.problem import Problem
from analysis.mismatch.signatures import FEW_TRIALS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OrderTrend:
    """A gain that grows with the trials' order: ``per_study`` its change from first to last (1 = 100 %).

    ``p_value`` holds for gains that scatter, but in no order; ``rms_mn`` is the change's share of the force.
    """

    per_study: float
    p_value: float
    rms_mn: float


def order_trend(problem: Problem, fit: JointFit) -> OrderTrend | None:
    """Return how the force's gain goes with the order of the trials; None where there are too few trials on skin.

    The gain of each trial is what of the simulated force, its own contact point and offset taken out, is in its
    residual. Their regression on the order allows for the depth; its t-test takes the scatter from the gains
    themselves.
    """
    gains, weights, orders, depths, power = [], [], [], [], []
    for j, trial in enumerate(problem.trials):
        if trial.kind != "ramp_hold_retract":
            continue
        own, latents = fit.own[j], fit.latents[j]
        # not as repeats are seen to deviate: it is these deviations that are asked for an order
        whitener = problem.whiteners[j].tight
        line = linearise(trial, whitener, fit.simulation, own, problem.trials, latents, frozen=True)
        force_mn = fit.simulation.force_mn(trial, own) - own.offset_mn
        left, _ = project_out(line.A, np.column_stack([line.r, whitener(force_mn)]))
        norm2 = float(left[:, 1] @ left[:, 1])
        if norm2 <= 0:
            continue
        gains.append(float(left[:, 1] @ left[:, 0]) / norm2)
        weights.append(norm2)
        orders.append(float(trial.order))
        depths.append(trial.depth_mm)
        power.append(float(trial.counts @ force_mn**2) / float(trial.counts.sum()))
    if len(gains) < FEW_TRIALS or np.ptp(orders) == 0:
        return None
    order = np.argsort(np.argsort(orders)) / (len(orders) - 1.0) - 0.5
    columns = [np.ones_like(order), order]
    if np.ptp(depths) > 0.01:
        columns.append(np.array(depths) - np.mean(depths))
    # gains scatter for more reasons than noise: a shallow trial weighs less, but not by all of its noise
    gain = np.array(gains)
    error2 = 1.0 / np.array(weights)
    extra = max(float(np.var(gain, ddof=len(columns)) - np.mean(error2)), 0.0)
    weight = 1.0 / np.sqrt(error2 + extra)
    A = np.column_stack(columns) * weight[:, None]
    inverse = np.linalg.pinv(A.T @ A)
    beta = inverse @ (A.T @ (gain * weight))
    left_over = gain * weight - A @ beta
    freedom = len(gain) - A.shape[1]
    t = beta[1] / np.sqrt(inverse[1, 1] * float(left_over @ left_over) / freedom)
    rms_mn = abs(float(beta[1])) * float(np.std(order)) * float(np.sqrt(np.mean(power)))
    return OrderTrend(float(beta[1]), float(2.0 * student_t.sf(abs(t), freedom)), rms_mn)
