"""Fit one simulation to many trials at once: tissue and mechanisms shared, contact point and offset per trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.linearised import Linearised, linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.shared import Simulation
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial

FloatArray = NDArray[np.float64]

MANY_TRIALS = 8
BLOCKS_A_TRIAL = 40


@dataclass(frozen=True)
class JointFit:
    """A simulation fitted to trials.

    ``own`` holds one PerTrial a trial, ``latents`` the coefficients of its latent columns; ``cost`` is the
    whitened sum of squares of each trial, (T,); ``covariance`` (P, P) of the shared vector, from a sandwich
    over trials (over stretches of them where there are few). ``heldout_cost`` (T,) is each trial's cost at the shared
    parameters of all other trials (its own parameters refitted), to the accuracy of one Gauss-Newton step.
    """

    simulation: Simulation
    own: tuple[PerTrial, ...]
    latents: tuple[FloatArray, ...]
    cost: FloatArray
    covariance: FloatArray
    heldout_cost: FloatArray


def fit_jointly(
    trials: Sequence[CellTrial],
    whiteners: Sequence[Whitener],
    simulation: Simulation,
    own: Sequence[PerTrial],
    *,
    rounds: int = 12,
    tolerance: float = 1e-3,
    frozen: bool = False,
) -> JointFit:
    """Fit shared and per-trial parameters by Levenberg-Marquardt, the per-trial ones eliminated.

    ``frozen`` keeps the shared parameters as they are and fits each trial's own only.

    Stops when a step promises less than ``tolerance`` of a unit of chi2 per trial, or after ``rounds``.
    """
    own = list(own)
    latent = [simulation.latent_columns(t, o) for t, o in zip(trials, own, strict=True)]
    coefficients = [np.zeros(c.shape[1]) for c in latent]
    damping = 1e-6
    lines, cost = _linearise_all(trials, whiteners, simulation, own, latent, coefficients, frozen)
    for _ in range(rounds):
        hessian, gradient, reduced = _normal_equations(lines)
        known = 0.0
        if len(gradient):
            known_JJ, known_Jr, known = simulation.known(trials)
            hessian, gradient = hessian + known_JJ, gradient + known_Jr
        accepted = False
        for _ in range(8):
            scale = np.diag(np.maximum(np.diag(hessian), 1e-12))
            shared_step: FloatArray = np.zeros(0)
            moved = simulation
            if len(gradient):
                free = ~simulation.pinned(gradient, trials)
                solved = np.linalg.lstsq(
                    (hessian + damping * scale)[np.ix_(free, free)], gradient[free], rcond=1e-13
                )[0]
                shared_step = np.zeros(len(gradient))
                shared_step[free] = solved
                moved = simulation.moved_to(
                    simulation.vector(trials) + _kept_short(shared_step, simulation, trials), trials
                )
            promised = float(gradient @ shared_step)
            new_own, new_coefficients = [], []
            for trial, o, c, (beta_r, beta_J) in zip(trials, own, coefficients, reduced, strict=True):
                step = list(beta_r - beta_J @ shared_step)
                offset = o.offset_mn + (float(step.pop(0)) if trial.frees_offset else 0.0)
                z0 = o.z0_mm
                if trial.touches:
                    z0 = max(z0 + float(np.clip(step.pop(0), -0.3, 0.3)), trial.begins_mm)
                new_own.append(PerTrial(z0, offset))
                new_coefficients.append(c + np.array(step))
            new_latent = [
                moved.latent_columns(t, o, c)
                for t, o, c in zip(trials, new_own, new_coefficients, strict=True)
            ]
            new_lines, new_cost = _linearise_all(
                trials, whiteners, moved, new_own, new_latent, new_coefficients, frozen
            )
            new_known = moved.known(trials)[2] if len(gradient) else 0.0
            if new_cost.sum() + new_known <= (cost.sum() + known) * (1 + 1e-12):
                accepted = True
                break
            damping = max(damping * 30, 1e-4)
        if not accepted:
            break
        gain = float(cost.sum() - new_cost.sum())
        simulation, own, latent, coefficients = moved, new_own, new_latent, new_coefficients
        lines, cost = new_lines, new_cost
        damping = max(damping / 10, 1e-9)
        if gain < tolerance * len(trials) and promised < 10 * tolerance * len(trials):
            break
    covariance, heldout = _spread_over_trials(lines, cost, simulation, trials)
    return JointFit(simulation, tuple(own), tuple(coefficients), cost, covariance, heldout)


def _spread_over_trials(
    lines: Sequence[Linearised], cost: FloatArray, simulation: Simulation, trials: Sequence[CellTrial]
) -> tuple[FloatArray, FloatArray]:
    """Return the sandwich covariance (P, P), zero for what is at its bound, and each trial's held-out cost (T,)."""
    parts = [reduced(line)[:2] for line in lines]
    gradients = np.array([g for _, g in parts])
    n = len(lines)
    if not gradients.size:
        return np.zeros((0, 0)), cost.copy()
    known_JJ, known_Jr, _ = simulation.known(trials)
    hessian = np.sum([h for h, _ in parts], axis=0) + known_JJ
    pinned = simulation.pinned(gradients.sum(axis=0) + known_Jr, trials)
    # what is known beforehand of a parameter leaves it as unsure as it is, at its bound or not
    free = ~pinned | (np.diag(known_JJ) > 0)
    units = gradients if n >= MANY_TRIALS else np.concatenate([_block_gradients(line) for line in lines])
    spread = units.T @ units * (len(units) / (len(units) - 1)) + known_JJ
    inverse = np.linalg.pinv(hessian[np.ix_(free, free)], rcond=1e-13, hermitian=True)
    covariance = np.zeros_like(hessian)
    covariance[np.ix_(free, free)] = inverse @ spread[np.ix_(free, free)] @ inverse
    heldout = cost.copy()
    if n == 1:
        return covariance, heldout
    kept = np.ix_(~pinned, ~pinned)
    for j, (h, g) in enumerate(parts):
        step = np.linalg.pinv((hessian - h)[kept], rcond=1e-10, hermitian=True) @ g[~pinned]
        heldout[j] += 2.0 * float(g[~pinned] @ step) + float(step @ h[kept] @ step)
    return covariance, heldout


def _block_gradients(line: Linearised) -> FloatArray:
    """Return what stretches of a trial add to J'r, (B, P): what is left of an effect is correlated within them."""
    left, _ = project_out(line.A, np.column_stack([line.r, line.J]))
    edges = np.unique(np.linspace(0, len(line.r), BLOCKS_A_TRIAL + 1).astype(int))
    return np.array([left[a:b, 1:].T @ left[a:b, 0] for a, b in zip(edges[:-1], edges[1:], strict=True)])


def _kept_short(step: FloatArray, simulation: Simulation, trials: Sequence[CellTrial]) -> FloatArray:
    """Keep steps on logarithmic scales below a factor e^1.5, where a linear model means nothing any more."""
    logarithmic = np.array([p.scale == "log" for p in simulation.parameters(trials)])
    return np.where(logarithmic, np.clip(step, -1.5, 1.5), step)


def _linearise_all(
    trials: Sequence[CellTrial],
    whiteners: Sequence[Whitener],
    simulation: Simulation,
    own: Sequence[PerTrial],
    latent: Sequence[FloatArray],
    coefficients: Sequence[FloatArray],
    frozen: bool,
) -> tuple[list[Linearised], FloatArray]:
    lines = [
        linearise(t, w, simulation, o, trials, c, b, frozen=frozen)
        for t, w, o, c, b in zip(trials, whiteners, own, latent, coefficients, strict=True)
    ]
    return lines, np.array([float(line.r @ line.r) for line in lines])


def reduced(line: Linearised) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return J'J, J'r after the own columns are projected out, and their coefficients on r and J."""
    stacked = np.column_stack([line.r, line.J])
    left, beta = project_out(line.A, stacked)
    J = left[:, 1:]
    return J.T @ J, J.T @ left[:, 0], beta[:, 0], beta[:, 1:]


def _normal_equations(
    lines: Sequence[Linearised],
) -> tuple[FloatArray, FloatArray, list[tuple[FloatArray, FloatArray]]]:
    p = lines[0].J.shape[1]
    hessian, gradient = np.zeros((p, p)), np.zeros(p)
    betas = []
    for line in lines:
        h, g, beta_r, beta_J = reduced(line)
        hessian += h
        gradient += g
        betas.append((beta_r, beta_J))
    return hessian, gradient, betas
