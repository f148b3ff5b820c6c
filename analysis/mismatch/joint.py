"""Fit one simulation to many trials at once: tissue and mechanisms shared, contact point and offset per trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.linearised import Linearised, compressed, linearise, project_out, weighed_residual
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


@dataclass(frozen=True, slots=True)
class Reduced:
    """One trial's share of the normal equations: J'J (P, P) and J'r (P,) without its own q parameters.

    ``left`` is r'r without them; ``own_r`` (q,) and ``own_J`` (q, P) are their coefficients on r and J.
    """

    hessian: FloatArray
    gradient: FloatArray
    left: float
    own_r: FloatArray
    own_J: FloatArray  # noqa: N815 - J as in J'r


@dataclass(frozen=True, slots=True)
class _Step:
    """A step of the shared vector (P,) and of each trial's own parameters (q,), and the fall of cost it promises."""

    shared: FloatArray
    own: tuple[FloatArray, ...]
    promised: float


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
    coefficients = [np.zeros(simulation.n_latent(t)) for t in trials]
    damping = 1e-6
    lines = _linearise_all(trials, whiteners, simulation, own, coefficients, frozen)
    cost = np.array([float(line.r @ line.r) for line in lines])
    enough = tolerance * len(trials)
    for _ in range(rounds):
        accepted = False
        small = [compressed(line) for line in lines]
        for _ in range(8):
            step = _step_of(small, simulation, trials, damping)
            moved = simulation
            if len(step.shared):
                moved = simulation.moved_to(simulation.vector(trials) + step.shared, trials)
            new_own, new_coefficients = [], []
            for trial, o, c, by in zip(trials, own, coefficients, step.own, strict=True):
                of_own = list(by)
                offset = o.offset_mn + (float(of_own.pop(0)) if trial.frees_offset else 0.0)
                z0 = o.z0_mm
                if trial.touches:
                    z0 = max(z0 + float(np.clip(of_own.pop(0), -0.3, 0.3)), trial.begins_mm)
                new_own.append(PerTrial(z0, offset))
                new_coefficients.append(c + np.array(of_own))
            new_cost = np.array(
                [
                    float(np.sum(weighed_residual(t, w, moved, o, c) ** 2))
                    for t, w, o, c in zip(trials, whiteners, new_own, new_coefficients, strict=True)
                ]
            )
            gain = float(cost.sum() - new_cost.sum())
            if len(step.shared):
                gain += simulation.known(trials)[2] - moved.known(trials)[2]
            if gain >= -1e-12 * float(cost.sum()):
                accepted = True
                break
            if step.promised < enough:
                break
            damping = max(damping * 30, 1e-4)
        if not accepted:
            break
        simulation, own, coefficients, cost = moved, new_own, new_coefficients, new_cost
        lines = _linearise_all(trials, whiteners, simulation, own, coefficients, frozen)
        damping = max(damping / 10, 1e-9)
        if gain < enough and step.promised < 10 * enough:
            break
    covariance, heldout = _spread_over_trials(lines, cost, simulation, trials)
    return JointFit(simulation, tuple(own), tuple(coefficients), cost, covariance, heldout)


def _spread_over_trials(
    lines: Sequence[Linearised], cost: FloatArray, simulation: Simulation, trials: Sequence[CellTrial]
) -> tuple[FloatArray, FloatArray]:
    """Return the sandwich covariance (P, P), zero for what is at its bound, and each trial's held-out cost (T,)."""
    parts = [reduced(line) for line in lines]
    gradients = np.array([p.gradient for p in parts])
    n = len(lines)
    if not gradients.size:
        return np.zeros((0, 0)), cost.copy()
    known_JJ, known_Jr, _ = simulation.known(trials)
    hessian = np.sum([p.hessian for p in parts], axis=0) + known_JJ
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
    for j, part in enumerate(parts):
        h, g = part.hessian, part.gradient
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
    coefficients: Sequence[FloatArray],
    frozen: bool,
) -> list[Linearised]:
    return [
        linearise(t, w, simulation, o, trials, c, frozen=frozen)
        for t, w, o, c in zip(trials, whiteners, own, coefficients, strict=True)
    ]


def reduced(line: Linearised, damping: float = 0.0) -> Reduced:
    """Return the normal equations of the shared parameters after the own columns are projected out.

    ``damping``: the own parameters' steps are held back by it, as Levenberg and Marquardt have it.
    """
    A, stacked = line.A, np.column_stack([line.r, line.J])
    if damping:
        q = A.shape[1]
        A = np.vstack([A, np.sqrt(damping) * np.diag(np.linalg.norm(A, axis=0))])
        stacked = np.vstack([stacked, np.zeros((q, stacked.shape[1]))])
    left, beta = project_out(A, stacked)
    r, J = left[:, 0], left[:, 1:]
    return Reduced(J.T @ J, J.T @ r, float(r @ r), beta[:, 0], beta[:, 1:])


def _step_of(
    lines: Sequence[Linearised], simulation: Simulation, trials: Sequence[CellTrial], damping: float
) -> _Step:
    """Return the damped step of everything from where a simulation stands."""
    parts = [reduced(line, damping) for line in lines]
    gradient = np.sum([p.gradient for p in parts], axis=0)
    shared: FloatArray = np.zeros(len(gradient))
    if len(gradient):
        known_JJ, known_Jr, _ = simulation.known(trials)
        hessian = np.sum([p.hessian for p in parts], axis=0) + known_JJ
        gradient = gradient + known_Jr
        scale = np.diag(np.maximum(np.diag(hessian), 1e-12))
        free = ~simulation.pinned(gradient, trials)
        # a direction that these trials say nothing of stays where it is
        shared[free] = np.linalg.lstsq(
            (hessian + damping * scale)[np.ix_(free, free)], gradient[free], rcond=1e-13
        )[0]
    of_own = sum(float(line.r @ line.r) - p.left for line, p in zip(lines, parts, strict=True))
    promised = of_own + float(gradient @ shared)
    if len(shared):
        shared = _kept_short(shared, simulation, trials)
    return _Step(shared, tuple(p.own_r - p.own_J @ shared for p in parts), promised)
