"""How the cells of trials are weighed: by the noise of what a fit leaves in stretches at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.event_at import EventAt
from analysis.mismatch.joint import JointFit, reduced
from analysis.mismatch.linearised import linearise, shared_columns
from analysis.mismatch.noise import NoiseModel, Whitener, measure_noise
from analysis.mismatch.problem import REPEATS, Problem
from analysis.mismatch.shared import Simulation
from analysis.mismatch.tissue_scatter import scatter_of_repeats
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial

FloatArray = NDArray[np.float64]

LONG_SEGMENT_S = 6.4
ABOUT_EVENT_S = 0.05
SHORTEST_STRETCH = 64


def quiet_residuals(problem: Problem, fit: JointFit) -> list[FloatArray]:
    """Return full-rate residuals of stretches at rest, from which the noise is measured.

    The moments of events that were named are left out: what their laws leave there is quick and large.
    """
    events = [a.latent.times_s for a in fit.simulation.additions if isinstance(a.latent, EventAt)]
    found = []
    for j, t in enumerate(problem.trials):
        r = problem.full_residual(fit, j)
        at = np.repeat(np.arange(len(t.counts)), t.counts.astype(np.int64))
        at = at[np.repeat(t.fitted, t.counts.astype(np.int64))]
        steady = np.ones(len(at), dtype=bool)
        for times_s in events:
            if t.label in times_s:
                steady &= np.abs(t.time_s[at] - times_s[t.label]) > ABOUT_EVENT_S
        settle = round(0.3 * t.sample_rate_hz)
        for name in ("dwell", "hold", "clear", "sweep"):
            part = np.flatnonzero(t.in_phase(name)[at])
            part = part[0 if name == "sweep" else min(settle, len(part) // 3) :]
            part = part[steady[part]]
            stretches = np.split(part, np.flatnonzero(np.diff(part) > 1) + 1)
            found += [r[stretch] for stretch in stretches if len(stretch) >= SHORTEST_STRETCH]
    return found or [problem.full_residual(fit, j) for j in range(len(problem.trials))]


def first_noise(trials: Sequence[CellTrial]) -> float:
    """Return the white noise (mN) of single samples, from differences of neighbours."""
    spread = [np.median(np.abs(np.diff(t.full_force_mn))) / 0.6745 / np.sqrt(2.0) for t in trials]
    peak = max(float(np.ptp(t.full_force_mn)) for t in trials)
    return max(float(np.median(spread)), 1e-6 * peak)


def noise_of(problem: Problem, fit: JointFit) -> NoiseModel:
    """Return the noise of a fit's residual.

    Of one or two trials only its size, since nothing tells what repeats; so too of trials sampled differently.
    """
    rate = problem.common_rate_hz
    if len(problem.trials) < REPEATS or rate is None:
        left = np.concatenate([problem.full_residual(fit, j) for j in range(len(problem.trials))])
        return NoiseModel(float(np.sqrt(np.mean(left**2))))
    return measure_noise(quiet_residuals(problem, fit), rate)


def weighed(trials: Sequence[CellTrial], noise: NoiseModel) -> Problem:
    """Return the problem with its cells weighed by a noise model."""
    return Problem(tuple(trials), tuple(Whitener(t, noise) for t in trials), noise.white_mn)


def loosened(problem: Problem, fit: JointFit) -> Problem:
    """Return the problem with its trials free to deviate in their tissue as repeats of one condition are seen to.

    A gain or a finger that differs from trial to trial is noise, far larger than that of the samples.
    """
    additions = fit.simulation.additions
    of_laws = sum(len(a.mechanism.parameters) for a in additions if a.mechanism.form == "law")
    information, gradients, columns = [], [], []
    for trial, whitener, own, latents in zip(
        problem.trials, problem.whiteners, fit.own, fit.latents, strict=True
    ):
        surface_mm, _ = fit.simulation.latent_part(trial, own, latents)
        force_mn = fit.simulation.force_mn(trial, own, surface_mm)
        by_shared = shared_columns(trial, fit.simulation, own, problem.trials, force_mn, surface_mm)
        tissue = by_shared.shape[1] - of_laws
        line = linearise(trial, whitener.tight, fit.simulation, own, problem.trials, latents, frozen=True)
        of_trial = reduced(replace(line, J=whitener.tight(by_shared)))
        information.append(of_trial.hessian[:tissue, :tissue])
        gradients.append(of_trial.gradient[:tissue])
        if np.any(surface_mm):
            # a movement that is in the columns would be explained by tissues that differ, wherever it is left out
            still_mn = fit.simulation.force_mn(trial, own)
            by_shared = shared_columns(trial, fit.simulation, own, problem.trials, still_mn)
        columns.append(by_shared[:, :tissue])
    scatter = scatter_of_repeats(information, gradients, [t.condition for t in problem.trials])
    if not scatter.spread.shape[1]:
        return problem.tight
    deviations = [c @ scatter.spread for c in columns]
    energy = sum(
        float(t.counts @ (d**2).sum(axis=1)) for t, d in zip(problem.trials, deviations, strict=True)
    )
    samples = sum(float(t.counts.sum()) for t in problem.trials)
    return Problem(
        problem.trials,
        tuple(w.tight.loosened(d) for w, d in zip(problem.whiteners, deviations, strict=True)),
        problem.white_mn,
        float(np.sqrt(energy / samples)),
    )


def settled(
    trials: Sequence[CellTrial], noise: NoiseModel, simulation: Simulation, own: Sequence[PerTrial]
) -> tuple[Problem, JointFit, NoiseModel]:
    """Return trials weighed by noise and by how repeats deviate, a simulation fitted to them, and the noise.

    Where repeats deviate, the noise is measured again without that.
    """
    problem = weighed(trials, noise)
    fit = problem.fit(simulation, own)
    if len(trials) < REPEATS:
        return problem, fit, noise
    loose = loosened(problem, fit)
    if not loose.scatter_mn:
        return problem, fit, noise
    fit = loose.fit(fit.simulation, fit.own)
    noise = noise_of(loose, fit)
    problem = loosened(weighed(trials, noise), fit)
    return problem, problem.fit(fit.simulation, fit.own), noise


def weighs_otherwise(before: NoiseModel, after: NoiseModel, sample_rate_hz: float) -> bool:
    """Tell whether a noise model weighs a trial's cells otherwise than another, by more than a part in ten."""
    frequency_hz = np.geomspace(0.1, 0.4 * sample_rate_hz, 50)
    ratio = before.power(frequency_hz, sample_rate_hz) / after.power(frequency_hz, sample_rate_hz)
    return bool(np.max(np.abs(np.log(ratio))) > np.log(1.1))


def weighed_slow(problem: Problem, fit: JointFit) -> Problem:
    """Return the problem with its cells weighed by noise measured in long stretches, its slow part included.

    A step in a slow wander of the noise is no event. For laws the slow part is left out, as a mismatch that is not
    named yet is slow too; it has no steps. The same problem, where there is no such part.
    """
    rate = problem.common_rate_hz
    if len(problem.trials) < REPEATS or rate is None:
        return problem
    residuals = quiet_residuals(problem, fit)
    long = min(round(LONG_SEGMENT_S * rate), max(len(r) for r in residuals))
    noise = measure_noise([r for r in residuals if len(r) >= long], rate, LONG_SEGMENT_S)
    if not weighs_otherwise(measure_noise(residuals, rate), noise, rate):
        return problem
    return weighed(problem.trials, noise)
