"""What a user would try instead of a diagnosis, on the same trials.

Each is given what a careful user has: the ramp fit of every trial, its own tissue, contact point and offset free,
and the textbook's laws as terms of a regression on what that fit leaves. They say `Said`: names, best first
(empty: nothing differs), and seconds of processor time.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from analysis.recordings.trial import Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.response import force_response

LAGS = 20
CELL = 8
"""Samples that are averaged before anything is regressed."""
FEATURES = {
    "position_crosstalk": "x",
    "viscous_friction": "v",
    "coulomb_friction": "sign(v)",
    "arm_inertia": "a",
    "force_drift": "t",
    "stiffening": "d^2",
    "parallel_dashpot": "v in contact",
    "force_lag": "dF/dt",
    "adhesion": "retract, where the force ends",
}
"""Which term of a regression stands for which mechanism."""


@dataclass(frozen=True)
class Said:
    """What a rival said: names, best first, and seconds of processor time."""

    names: tuple[str, ...]
    cpu_s: float


@dataclass(frozen=True)
class Left:
    """What the ramp fit leaves of one trial: every sample (n,), cells (m,), and the terms (m, 9).

    Cells and terms have what the trial's own tissue, contact point and offset could take up projected out.
    """

    samples_mn: Any
    cells_mn: Any
    terms: Any


def left_of(trial: Trial) -> Left:
    """Fit a trial's own solid to all of it; ValueError where the ramp fit has no start for it."""
    c, rate = trial.calibration, trial.sample_rate_hz
    x = (trial.position_v - c.position_zero_v) / c.volts_per_mm
    force = (trial.force_v - c.force_zero_v) / c.volts_per_mn
    start = fit_trial(trial).solid
    if start is None:
        raise ValueError(f"{trial.trial_id}: no ramp fit")
    (k0, k1, k2), (tau1, tau2) = start.stiffness_mn_per_mm, start.times_s
    offset = start.offset_mn

    def model(p: Any) -> Any:
        k = np.exp(p[:5])
        depth = np.maximum(x - p[5], 0.0)
        return _cells(force_response(depth, 1 / rate, k[0], [(k[1], k[2]), (k[3], k[4])])) + p[6]

    first = np.array([*np.log([k0, k1, tau1, k2, tau2]), start.contact_mm, offset])
    felt = _cells(force)
    fitted = least_squares(lambda p: model(p) - felt, first, x_scale=[0.1, 0.1, 0.1, 0.1, 0.1, 1e-3, 0.1])
    depth = np.maximum(x - fitted.x[5], 0.0)
    velocity = np.gradient(_smooth(x)) * rate
    moving = np.abs(velocity) > 0.5  # well above the noise of the position, below the approach
    t = np.arange(len(x)) / rate
    retract = next(p for p in trial.phases if p.name == "retract")
    leaving = (t * rate >= retract.start) & (t * rate < retract.stop) & (np.abs(x - fitted.x[5]) < 0.03)
    terms = [
        x,
        velocity,
        np.sign(velocity) * moving,
        np.gradient(_smooth(velocity)) * rate,
        t,
        depth**2,
        velocity * (depth > 0),
        np.gradient(_smooth(force)) * rate,
        leaving,
    ]
    columns = np.column_stack([_cells(np.asarray(term, dtype=float)) for term in terms])
    basis, _ = np.linalg.qr(fitted.jac)
    both = np.column_stack([felt - model(fitted.x), columns])
    both -= basis @ (basis.T @ both)
    k = np.exp(fitted.x[:5])
    whole = force_response(depth, 1 / rate, k[0], [(k[1], k[2]), (k[3], k[4])]) + fitted.x[6]
    return Left(force - whole, both[:, 0], both[:, 1:])


def _cells(signal: Any) -> Any:
    n = len(signal) // CELL * CELL
    return signal[:n].reshape(-1, CELL).mean(axis=1)


def _smooth(signal: Any) -> Any:
    return np.convolve(np.pad(signal, 8, mode="edge"), np.ones(17) / 17, mode="valid")


def by_information(left: Sequence[Left]) -> dict[str, Said]:
    """Add the law that lowers AIC, or BIC, the most, as long as one does: ordinary least squares, white noise."""
    said = {}
    for criterion in ("AIC", "BIC"):
        began = time.process_time()
        r, terms = _stacked(left)
        n = len(r)
        penalty = 2.0 if criterion == "AIC" else float(np.log(n))
        chosen: list[int] = []
        best = n * float(np.log(r @ r / n))
        while len(chosen) < terms.shape[1]:
            scores = {}
            for i in set(range(terms.shape[1])) - set(chosen):
                columns = terms[:, [*chosen, i]]
                rest = r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]
                scores[i] = n * float(np.log(rest @ rest / n)) + penalty * (len(chosen) + 1)
            i = min(scores, key=lambda k: scores[k])
            if scores[i] >= best:
                break
            best, chosen = scores[i], [*chosen, i]
        said[criterion] = Said(tuple(list(FEATURES)[i] for i in chosen), time.process_time() - began)
    return said


def _stacked(left: Sequence[Left]) -> tuple[Any, Any]:
    """Return all residuals (n,) and terms (n, 9), each of unit rms."""
    r, terms = np.concatenate([one.cells_mn for one in left]), np.concatenate([one.terms for one in left])
    return r / np.sqrt(np.mean(r**2)), terms / np.sqrt(np.mean(terms**2, axis=0))


def by_whiteness(left: Sequence[Left], level: float = 0.05) -> Said:
    """Test each trial's residual for whiteness (Ljung and Box 1978), by Bonferroni over the trials."""
    began = time.process_time()
    smallest = 1.0
    for one in left:
        r = one.samples_mn - one.samples_mn.mean()
        n, power = len(r), float(r @ r)
        rho = np.array([float(r[:-k] @ r[k:]) / power for k in range(1, LAGS + 1)])
        q = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, LAGS + 1))))
        smallest = min(smallest, float(chi2.sf(q, LAGS)))
    alarm = smallest < level / len(left)
    return Said(("something",) if alarm else (), time.process_time() - began)


def by_sparse_regression(left: Sequence[Left], threshold: float = 0.1) -> Said:
    """Let pysindy choose the terms that explain the residual, all of unit rms, at its default threshold."""
    import pysindy

    began = time.process_time()
    r, terms = _stacked(left)
    optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
    model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it eliminated all terms is an answer
        model.fit(terms, t=1.0, x_dot=r[:, None])
    size = np.abs(np.asarray(model.coefficients()))[0]
    ranked = np.array(list(FEATURES))[np.argsort(-size)][: int((size > 0).sum())]
    return Said(tuple(map(str, ranked)), time.process_time() - began)
