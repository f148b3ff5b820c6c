"""Fit one simulation to many trials at once: tissue and mechanisms shared, contact point and offset per trial."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.block_prior import BLOCK_PARAMETER, block_information
from analysis.mismatch.noise import Whitener
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import RIGID_STIFFNESS_MN_PER_MM, PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Parameter, Tissue, Values

FloatArray = NDArray[np.float64]
LatentColumns = Callable[[CellTrial, Tissue, PerTrial], FloatArray]

TISSUE_PARAMETERS = (
    Parameter("k0_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("k1_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("tau1_s", "s", 1e-4, 1e4, "log"),
    Parameter("k2_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("tau2_s", "s", 1e-4, 1e4, "log"),
)
RIGID_PARAMETER = Parameter(BLOCK_PARAMETER, "mN/mm", RIGID_STIFFNESS_MN_PER_MM, 1e7, "log")
Z0_STEP_MM = 5e-5
MANY_TRIALS = 8
BLOCKS_A_TRIAL = 40
AT_BOUND = 1e-9


@dataclass(frozen=True, slots=True)
class Hum:
    """A line too quick for cells: frequency (Hz) and, by trial label, cosine and sine (mN) at full rate."""

    frequency_hz: float
    quadratures_mn: Mapping[str, tuple[float, float]]

    def at(self, label: str, time_s: FloatArray, width_s: FloatArray | float = 0.0) -> FloatArray:
        """Return the line's force at times (n,), averaged over ``width_s``."""
        c, s = self.quadratures_mn.get(label, (0.0, 0.0))
        phase = 2 * np.pi * self.frequency_hz * time_s
        return np.asarray((c * np.cos(phase) + s * np.sin(phase)) * np.sinc(self.frequency_hz * width_s))


@dataclass(frozen=True, slots=True)
class Addition:
    """A mechanism with the values of its shared parameters.

    ``latent`` gives the columns (n, q) of force whose coefficients are free in every trial: the phase of an
    oscillation, the size of an event. None for a law. ``hum`` is measured at full rate beforehand and added as it is.
    """

    mechanism: Mechanism
    values: Values
    latent: LatentColumns | None = None
    hum: Hum | None = None


@dataclass(frozen=True, slots=True)
class Simulation:
    """Everything that is shared over the trials."""

    tissue: Tissue
    additions: tuple[Addition, ...] = ()
    rigid_stiffness: float = RIGID_STIFFNESS_MN_PER_MM
    ideal_step: bool = False

    def force_mn(self, trial: CellTrial, own: PerTrial) -> FloatArray:
        """Return the simulated force of a trial (n,), without what is latent in it."""
        force = simulate_force(
            trial,
            self.tissue,
            own,
            [(a.mechanism, a.values) for a in self.additions],
            rigid_stiffness=self.rigid_stiffness,
            ideal_step=self.ideal_step,
        )
        for a in self.additions:
            if a.hum is not None:
                force = force + a.hum.at(trial.label, trial.time_s, trial.counts / trial.sample_rate_hz)
        return force

    def latent_columns(self, trial: CellTrial, own: PerTrial) -> FloatArray:
        """Return the columns (n, q) with coefficients of their own in this trial."""
        columns = [a.latent(trial, self.tissue, own) for a in self.additions if a.latent is not None]
        return np.column_stack(columns) if columns else np.zeros((len(trial.time_s), 0))

    def parameters(self, trials: Sequence[CellTrial]) -> list[Parameter]:
        """Return the shared parameters that these trials can speak of, in the order of `vector`."""
        found: list[Parameter] = []
        if any(t.kind not in ("air_sweep", "rigid_target") for t in trials):
            found += TISSUE_PARAMETERS
        if any(t.kind == "rigid_target" and t.target_stiffness_mn_per_mm is None for t in trials):
            found.append(RIGID_PARAMETER)
        for a in self.additions:
            if a.mechanism.form == "law":
                found += a.mechanism.parameters
        return found

    def vector(self, trials: Sequence[CellTrial]) -> FloatArray:
        """Return the shared parameters on the scale of the fit, (P,)."""
        values: list[float] = []
        if any(t.kind not in ("air_sweep", "rigid_target") for t in trials):
            s = self.tissue
            values += [s.k0, s.k1, s.tau1, s.k2, s.tau2]
        if any(t.kind == "rigid_target" and t.target_stiffness_mn_per_mm is None for t in trials):
            values.append(self.rigid_stiffness)
        for a in self.additions:
            if a.mechanism.form == "law":
                values += [a.values[p.name] for p in a.mechanism.parameters]
        return np.array([p.to_fit(v) for p, v in zip(self.parameters(trials), values, strict=True)])

    def known(self, trials: Sequence[CellTrial]) -> tuple[FloatArray, FloatArray, float]:
        """Return J'J (P, P), J'r (P,) and r^2 of what is known of the shared parameters without any trial."""
        return block_information([p.name for p in self.parameters(trials)], self.rigid_stiffness)

    def pinned(self, gradient: FloatArray, trials: Sequence[CellTrial]) -> NDArray[np.bool_]:
        """Mask (P,) of the parameters at a bound that the fit would pass if it could: they are no freedom of it.

        ``gradient`` (P,) points to where the cost falls, on the scale of the fit.
        """
        found = np.zeros(len(gradient), dtype=bool)
        pairs = zip(self.parameters(trials), self.vector(trials), strict=True)
        for k, (parameter, fitted) in enumerate(pairs):
            ends = sorted((parameter.to_fit(parameter.lower), parameter.to_fit(parameter.upper)))
            near = AT_BOUND * max(1.0, abs(float(fitted)))
            found[k] = (fitted <= ends[0] + near and gradient[k] < 0) or (
                fitted >= ends[1] - near and gradient[k] > 0
            )
        return found

    def moved_to(self, vector: FloatArray, trials: Sequence[CellTrial]) -> Simulation:
        """Return the simulation with its shared parameters at ``vector`` (P,), kept within bounds."""
        parameters = self.parameters(trials)
        values = [p.from_fit(float(v)) for p, v in zip(parameters, vector, strict=True)]
        i = 0
        tissue, rigid = self.tissue, self.rigid_stiffness
        if any(t.kind not in ("air_sweep", "rigid_target") for t in trials):
            tissue = Tissue(*values[:5])
            i = 5
        if any(t.kind == "rigid_target" and t.target_stiffness_mn_per_mm is None for t in trials):
            rigid = values[i]
            i += 1
        additions = []
        for a in self.additions:
            if a.mechanism.form != "law":
                additions.append(a)
                continue
            names = [p.name for p in a.mechanism.parameters]
            found = dict(zip(names, values[i : i + len(names)], strict=True))
            additions.append(replace(a, values=found))
            i += len(names)
        return replace(self, tissue=tissue, rigid_stiffness=rigid, additions=tuple(additions))


@dataclass(frozen=True)
class Linearised:
    """One trial around a simulation, whitened: residual r (n,), shared J (n, P), own A (n, q)."""

    r: FloatArray
    J: FloatArray
    A: FloatArray


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


def linearise(
    trial: CellTrial,
    whitener: Whitener,
    simulation: Simulation,
    own: PerTrial,
    trials: Sequence[CellTrial],
    latent: FloatArray,
    coefficients: FloatArray,
    *,
    frozen: bool = False,
) -> Linearised:
    """Return residual and derivatives of one trial; ``latent`` (n, q) are columns with free coefficients.

    ``frozen`` leaves the shared parameters out (P = 0).
    """
    force = simulation.force_mn(trial, own)
    vector = np.zeros(0) if frozen else simulation.vector(trials)
    parameters = [] if frozen else simulation.parameters(trials)
    columns = np.empty((len(force), len(vector)))
    for k, parameter in enumerate(parameters):
        step = _step(parameter, float(vector[k]))
        moved = vector.copy()
        moved[k] += step
        columns[:, k] = (simulation.moved_to(moved, trials).force_mn(trial, own) - force) / step
    own_columns = [np.ones_like(force)] if trial.frees_offset else []
    if trial.touches:
        deeper = simulation.force_mn(trial, replace(own, z0_mm=own.z0_mm + Z0_STEP_MM))
        own_columns.append((deeper - force) / Z0_STEP_MM)
    A = np.column_stack([*own_columns, latent])
    residual = trial.force_mn - force - latent @ coefficients
    stacked = whitener(np.column_stack([residual, columns, A]))
    p = columns.shape[1]
    r, J, A = stacked[:, 0], stacked[:, 1 : 1 + p], stacked[:, 1 + p :]
    if trial.touches and own.z0_mm <= trial.begins_mm:
        at = len(own_columns) - 1
        if float(project_out(A, r[:, None])[1][at, 0]) < 0.0:
            # a trial begins before contact: a contact point at its beginning has nowhere to go
            A[:, at] = 0.0
    return Linearised(r, J, A)


def _step(parameter: Parameter, fitted: float) -> float:
    """Return a finite-difference step on the scale of the fit that stays within the bounds."""
    if parameter.scale == "log":
        step = 1e-4
    elif parameter.scale == "inverse_square":
        step = 1e-3
    else:
        step = 1e-4 * max(abs(fitted), 0.05 * min(1.0, parameter.upper))
    ends = sorted((parameter.to_fit(parameter.lower), parameter.to_fit(parameter.upper)))
    return step if fitted + step <= ends[1] else -step


def project_out(A: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M (n, m) without what the columns of A (n, q) explain, and the coefficients (q, m)."""
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    q, r = np.linalg.qr(A / scale)
    keep = np.abs(np.diag(r)) > 1e-9
    if not keep.all():
        beta, *_ = np.linalg.lstsq(A / scale, M, rcond=1e-9)
        return M - (A / scale) @ beta, beta / scale[:, None]
    inner = q.T @ M
    beta = np.linalg.solve(r, inner)
    return M - q @ inner, beta / scale[:, None]


def column_space(A: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, p), p <= q, of what the columns of A (n, q) span."""
    scale = np.linalg.norm(A, axis=0)
    u, size, _ = np.linalg.svd(A[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(u[:, size > 1e-9])


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
            new_latent = [moved.latent_columns(t, o) for t, o in zip(trials, new_own, strict=True)]
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
    parts = [_reduced(line)[:2] for line in lines]
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


def _reduced(line: Linearised) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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
        h, g, beta_r, beta_J = _reduced(line)
        hessian += h
        gradient += g
        betas.append((beta_r, beta_J))
    return hessian, gradient, betas
