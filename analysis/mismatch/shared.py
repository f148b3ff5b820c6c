"""What is shared over trials: the tissue, the mechanisms added to it, and the scale they are fitted on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.block_prior import BLOCK_PARAMETER, block_information
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import RIGID_STIFFNESS_MN_PER_MM, PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Parameter, Tissue, Values

FloatArray = NDArray[np.float64]

TISSUE_PARAMETERS = (
    Parameter("k0_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("k1_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("tau1_s", "s", 1e-4, 1e4, "log"),
    Parameter("k2_mn_per_mm", "mN/mm", 1e-9, 1e9, "log"),
    Parameter("tau2_s", "s", 1e-4, 1e4, "log"),
)
RIGID_PARAMETER = Parameter(BLOCK_PARAMETER, "mN/mm", RIGID_STIFFNESS_MN_PER_MM, 1e7, "log")
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


class Latent(Protocol):
    """What has coefficients of its own in every trial."""

    def __call__(
        self, trial: CellTrial, tissue: Tissue, own: PerTrial, inside: NDArray[np.bool_] | None = None
    ) -> FloatArray:
        """Return the force (n, q) that unit coefficients make; ``inside`` (n,): where the punch presses, if known."""
        ...

    def n_columns(self, trial: CellTrial) -> int:
        """Return q."""
        ...

    def surface_mm(self, trial: CellTrial, coefficients: FloatArray) -> FloatArray | None:
        """Return the movement (n,) of the skin that coefficients (q,) stand for; None: to be taken as linear."""
        ...


@dataclass(frozen=True, slots=True)
class Addition:
    """A mechanism with the values of its shared parameters.

    ``latent`` gives the columns (n, q) of force whose coefficients are free in every trial: the phase of an
    oscillation, the size of an event. None for a law. ``hum`` is measured at full rate beforehand and added as it is.
    """

    mechanism: Mechanism
    values: Values
    latent: Latent | None = None
    hum: Hum | None = None


@dataclass(frozen=True, slots=True)
class Simulation:
    """Everything that is shared over the trials."""

    tissue: Tissue
    additions: tuple[Addition, ...] = ()
    rigid_stiffness: float = RIGID_STIFFNESS_MN_PER_MM
    ideal_step: bool = False

    def force_mn(self, trial: CellTrial, own: PerTrial, surface_mm: FloatArray | float = 0.0) -> FloatArray:
        """Return the simulated force of a trial (n,), without what is latent in it but for a surface that moves."""
        force = simulate_force(
            trial,
            self.tissue,
            own,
            [(a.mechanism, a.values) for a in self.additions],
            rigid_stiffness=self.rigid_stiffness,
            surface_mm=surface_mm,
            ideal_step=self.ideal_step,
        )
        for a in self.additions:
            if a.hum is not None:
                force = force + a.hum.at(trial.label, trial.time_s, trial.counts / trial.sample_rate_hz)
        return force

    def whole_force_mn(self, trial: CellTrial, own: PerTrial, coefficients: FloatArray) -> FloatArray:
        """Return the simulated force of a trial (n,) with what is latent in it, by its coefficients (q,).

        Skin that moves by tens of micrometres is met and let go of at another place: it moves the surface itself.
        """
        surface, linear = self.latent_part(trial, own, coefficients)
        return self.force_mn(trial, own, surface) + linear

    def latent_part(
        self, trial: CellTrial, own: PerTrial, coefficients: FloatArray
    ) -> tuple[FloatArray | float, FloatArray | float]:
        """Return how what is latent in a trial moves the surface (n,), mm, and what force (n,) it adds; 0 for none."""
        surface: FloatArray | float = 0.0
        force: FloatArray | float = 0.0
        at = 0
        for latent in self._latents():
            of_this = coefficients[at : at + latent.n_columns(trial)]
            at += len(of_this)
            track = latent.surface_mm(trial, of_this)
            if track is not None:
                surface = surface + track
            elif len(of_this):
                force = force + latent(trial, self.tissue, own) @ of_this
        return surface, force

    def _latents(self) -> list[Latent]:
        return [a.latent for a in self.additions if a.latent is not None]

    def n_latent(self, trial: CellTrial) -> int:
        """Return how many coefficients of their own a trial's latent parts have."""
        return sum(latent.n_columns(trial) for latent in self._latents())

    def latent_columns(
        self, trial: CellTrial, own: PerTrial, inside: NDArray[np.bool_] | None = None
    ) -> FloatArray:
        """Return the columns (n, q) with coefficients of their own in this trial.

        ``inside`` (n,): where the punch presses; a surface that has moved far is touched elsewhere.
        """
        columns = [latent(trial, self.tissue, own, inside) for latent in self._latents()]
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
