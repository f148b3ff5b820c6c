"""What a user would try instead of a diagnosis, on the same trials and with the same library.

Each is given what a careful user has: the baseline fitted to all trials, contact points and offsets found,
the library's laws as extra terms. They say `Said`: names (empty: nothing differs) and how long it took.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from analysis.mismatch.intake import Intake
from analysis.mismatch.joint import JointFit
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.problem import Problem
from analysis.mismatch.shared import Addition, Simulation
from analysis.mismatch.start import start_own, start_tissue
from analysis.mismatch.weighing import first_noise, weighed
from analysis.simulation.mechanism import Mechanism, library

PROBE = 0.02
LAGS = 20
MAXIMUM_CALLS = 200


@dataclass(frozen=True)
class Said:
    """What a rival said: names, best first, and seconds of processor time."""

    names: tuple[str, ...]
    cpu_s: float


def baseline(intake: Intake) -> tuple[Problem, JointFit]:
    """Fit the baseline to all trials, white noise taken from neighbouring samples."""
    trials = intake.trials
    problem = weighed(trials, NoiseModel(first_noise(trials)))
    return problem, problem.fit(Simulation(start_tissue(trials)), start_own(trials), rounds=25)


def by_information(problem: Problem, fit: JointFit) -> dict[str, Said]:
    """Fit the baseline and each law with lmfit, tissue and law free, and take the lowest AIC, and BIC."""
    import lmfit

    def fitted(mechanism: Mechanism | None) -> Any:
        parameters = lmfit.Parameters()
        for p, value in zip(
            fit.simulation.parameters(problem.trials), fit.simulation.vector(problem.trials), strict=True
        ):
            parameters.add(p.name, value=float(value))
        start: dict[str, float] = {}
        if mechanism is not None:
            start = _start(mechanism, problem)
            for p in mechanism.parameters:
                at = p.to_fit(start[p.name])
                low, high = sorted((p.to_fit(p.lower), p.to_fit(p.upper)))
                parameters.add(f"law_{p.name}", value=at, min=low, max=high)

        def residual(values: Any) -> Any:
            vector = np.array([values[p.name].value for p in fit.simulation.parameters(problem.trials)])
            simulation = fit.simulation.moved_to(vector, problem.trials)
            if mechanism is not None:
                law = {p.name: p.from_fit(values[f"law_{p.name}"].value) for p in mechanism.parameters}
                simulation = replace(simulation, additions=(Addition(mechanism, law),))
            parts = []
            for t, own, whiten in zip(problem.trials, fit.own, problem.whiteners, strict=True):
                parts.append(whiten(t.force_mn - simulation.force_mn(t, own)))
            return np.concatenate(parts)

        return lmfit.minimize(residual, parameters, method="leastsq", max_nfev=MAXIMUM_CALLS)

    began = time.process_time()
    results = {"": fitted(None)}
    for mechanism in library().values():
        if mechanism.form == "law":
            results[mechanism.name] = fitted(mechanism)
    taken = time.process_time() - began
    said = {}
    for criterion in ("aic", "bic"):
        ranked = sorted(results, key=lambda name: getattr(results[name], criterion))
        better = ranked[: ranked.index("")]
        said[criterion] = Said(tuple(better), taken)
    return said


def _start(mechanism: Mechanism, problem: Problem) -> dict[str, float]:
    peak = max(float(t.force_mn.max() - t.offset_start_mn) for t in problem.trials)
    settings = mechanism.probe_settings(peak)
    return {**mechanism.null, **(settings[len(settings) // 2] if settings else mechanism.typical)}


def by_whiteness(problem: Problem, fit: JointFit, level: float = 0.05) -> Said:
    """Test each trial's residual for whiteness (Ljung and Box 1978), by Bonferroni over the trials."""
    began = time.process_time()
    smallest = 1.0
    for j in range(len(problem.trials)):
        r = problem.full_residual(fit, j)
        r = r - r.mean()
        n, power = len(r), float(r @ r)
        rho = np.array([float(r[:-k] @ r[k:]) / power for k in range(1, LAGS + 1)])
        q = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, LAGS + 1))))
        smallest = min(smallest, float(chi2.sf(q, LAGS)))
    alarm = smallest < level / len(problem.trials)
    return Said(("something",) if alarm else (), time.process_time() - began)


FEATURES = {
    "position_crosstalk": "x",
    "viscous_friction": "v",
    "coulomb_friction": "sign(v)",
    "arm_inertia": "a",
    "force_drift": "t",
    "stiffening": "d^2",
    "parallel_dashpot": "v in contact",
    "force_lag": "dF/dt",
    "lever_compliance": "F",
}
"""Which term of a sparse regression stands for which mechanism."""


def by_sparse_regression(problem: Problem, fit: JointFit, threshold: float = 0.1) -> Said:
    """Let pysindy choose the terms that explain the residual, all of unit rms, at its default threshold."""
    import pysindy

    began = time.process_time()
    columns, residuals = [], []
    for j, t in enumerate(problem.trials):
        weight = np.sqrt(t.counts / t.counts.mean())
        force = t.force_mn - fit.own[j].offset_mn
        depth = np.maximum(t.position_mm - fit.own[j].z0_mm, 0.0)
        features = [
            t.angle_travel_mm,
            t.velocity_mm_s,
            np.sign(t.velocity_mm_s) * (np.abs(t.velocity_mm_s) > 0.01),
            t.acceleration_mm_s2,
            t.time_s - t.time_s.mean(),
            depth**2,
            t.velocity_mm_s * (depth > 0),
            np.gradient(force, t.time_s),
            force,
        ]
        columns.append(np.column_stack(features) * weight[:, None])
        residuals.append(problem.residual(fit, j) * weight)
    x, r = np.concatenate(columns), np.concatenate(residuals)
    x = x / np.sqrt((x**2).mean(axis=0))
    r = r / np.sqrt((r**2).mean())
    optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
    model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it eliminated all terms is an answer
        model.fit(x, t=1.0, x_dot=r[:, None])
    size = np.abs(np.asarray(model.coefficients()))[0]
    names = np.array(list(FEATURES))
    ranked = names[np.argsort(-size)][: int((size > 0).sum())]
    return Said(tuple(map(str, ranked)), time.process_time() - began)


def first_names(said: Sequence[Said]) -> list[str]:
    """Return what each named first, "" for nothing."""
    return [s.names[0] if s.names else "" for s in said]
