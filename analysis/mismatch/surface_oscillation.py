"""An oscillating surface as columns of a fit: each trial's own frequency, phase and wandering amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.shared import Addition
from analysis.mismatch.surface_motion import pressed, surface_force
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Mechanism, Tissue

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SurfaceOscillation:
    """The columns of an oscillating surface.

    Each trial has its own frequency (Hz, by label); ``knot_s`` is the spacing of its envelope's knots.
    """

    frequencies_hz: Mapping[str, float]
    harmonics: int
    knot_s: float

    def __call__(
        self, trial: CellTrial, tissue: Tissue, own: PerTrial, inside: NDArray[np.bool_] | None = None
    ) -> FloatArray:
        """Return the force (n, q) of unit amplitudes (um), cosine and sine of each knot in turn."""
        f = self.frequencies_hz.get(trial.label)
        if f is None or trial.kind in ("air_sweep", "rigid_target"):
            return np.zeros((len(trial.time_s), 0))
        turning = 1e-3 * _turning(trial, f, self.harmonics)
        waves = np.stack([turning.real, turning.imag], axis=1)
        rows = waves[:, None] * hat_functions(trial, self.knot_s)[None, :, None]
        if inside is None:
            inside = pressed(trial, own)
        return surface_force(trial, tissue, own, rows.reshape(-1, len(trial.time_s)), inside).T

    def n_columns(self, trial: CellTrial) -> int:
        """Return cosine and sine of every harmonic at every knot."""
        if trial.label not in self.frequencies_hz or trial.kind in ("air_sweep", "rigid_target"):
            return 0
        return 2 * self.harmonics * max(1, len(_knots(trial, self.knot_s)))

    def surface_mm(self, trial: CellTrial, coefficients: FloatArray) -> FloatArray | None:
        """Return how the surface moves (n,) for coefficients (q,), um."""
        if not self.n_columns(trial):
            return None
        knots = _knots(trial, self.knot_s)
        by_knot = coefficients.reshape(self.harmonics, -1, 2)
        moved = np.zeros(len(trial.time_s))
        waves = _turning(trial, self.frequencies_hz[trial.label], self.harmonics)
        for wave, (cosine, sine) in zip(waves, by_knot.transpose(0, 2, 1), strict=True):
            by_time = [np.interp(trial.time_s, knots, c) if len(knots) else c for c in (cosine, sine)]
            moved += wave.real * by_time[0] + wave.imag * by_time[1]
        return 1e-3 * moved


def is_overtone(
    oscillation: SurfaceOscillation, others: Sequence[SurfaceOscillation], within: float = 0.1
) -> bool:
    """Tell whether an oscillation's frequency is a whole multiple of another's, to a share ``within`` of that."""
    frequency = float(np.median(list(oscillation.frequencies_hz.values())))
    ratios = [frequency / float(np.median(list(o.frequencies_hz.values()))) for o in others]
    return any(round(r) >= 1 and abs(r - round(r)) < within for r in ratios)


def surface_addition(
    mechanism: Mechanism, frequencies_hz: Mapping[str, float], harmonics: int, knot_s: float
) -> Addition:
    """Return the oscillation as an addition with free phase, its amplitude free to wander over ``knot_s``."""
    median = float(np.median(list(frequencies_hz.values())))
    columns = SurfaceOscillation(frequencies_hz, harmonics, knot_s)
    return Addition(mechanism, {"amplitude_um": 0.0, "frequency_hz": median}, columns)


def _turning(trial: CellTrial, frequency_hz: float, harmonics: int) -> NDArray[np.complex128]:
    """Return cosine and sine (real and imaginary part) of a frequency and its multiples, (harmonics, n)."""
    first = np.exp(2j * np.pi * frequency_hz * trial.time_s)
    return np.cumprod(np.broadcast_to(first, (harmonics, len(first))), axis=0)


def _knots(trial: CellTrial, knot_s: float) -> FloatArray:
    """Return the knots (m,) of an amplitude that wanders over the time in contact, s; none for one that does not."""
    # by the first contact point: the number of knots must not change while a fit moves its own
    touching = trial.time_s[trial.position_mm > trial.z0_start_mm]
    if len(touching) < 2 or not np.isfinite(knot_s):
        return np.zeros(0)
    first, last = float(touching[0]), float(touching[-1])
    return np.linspace(first, last, max(2, 1 + round((last - first) / knot_s)))


def hat_functions(trial: CellTrial, knot_s: float) -> FloatArray:
    """Return hat functions (m, n) that add up to one over the time in contact, knots ``knot_s`` apart."""
    knots = _knots(trial, knot_s)
    if not len(knots):
        return np.ones((1, len(trial.time_s)))
    inside = np.clip(trial.time_s, knots[0], knots[-1])
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(inside - knots[:, None]) / (knots[1] - knots[0])))
