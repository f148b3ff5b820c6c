"""Dry friction in the bearing."""

from __future__ import annotations

import numpy as np
from numba import njit

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

RESTING_MM_S = 0.15
NEVER = 1e-9
"""A rate (1/s) at which nothing happens."""


@njit(cache=True)
def _bristle_force(velocity: FloatArray, step_s: FloatArray, bristle_mm: float, fades: float) -> FloatArray:
    out = np.empty_like(velocity)
    z = 0.0
    for i in range(velocity.shape[0]):
        v = velocity[i]
        slide = abs(v) / bristle_mm
        fade = np.exp(-((v / RESTING_MM_S) ** 2)) * fades
        rate = slide + fade + NEVER
        settled = v / bristle_mm / rate
        decay = np.exp(-rate * step_s[i])
        share = (1.0 - decay) / (rate * step_s[i])
        out[i] = settled + (z - settled) * share
        z = settled + (z - settled) * decay
    return out


class CoulombFriction(Mechanism):
    """F gains Fc sign(dx/dt), built up over a little travel and let go over a little time.

    The sign is that of Dahl's bristles: they bend over a share ``bristle`` of the study's depth before they slide, and
    at rest they carry a share ``carried`` of what they hold on and on, while the other fades with ``fade_ms``. All
    towards zero is the textbook's sign function.
    """

    name = "coulomb_friction"
    stage = "sensor"
    parameters = (
        Parameter("force_mn", "mN", 0.0, 1.0e6),
        Parameter("bristle", "1", 2e-5, 0.05, "log", inner=True),
        Parameter("fade_ms", "ms", 0.1, 1.0e4, "log", inner=True),
        Parameter("carried", "1", 0.0, 1.0, inner=True),
    )
    amplitude = "force_mn"
    null = {"force_mn": 0.0, "bristle": 1e-4, "fade_ms": 1.0, "carried": 0.0}
    probes = (
        {"force_mn": 0.1, "bristle": 1e-4, "fade_ms": 1.0, "carried": 0.0},
        {"force_mn": 0.1, "bristle": 2e-3, "fade_ms": 30.0, "carried": 0.0},
        {"force_mn": 0.1, "bristle": 2e-3, "fade_ms": 30.0, "carried": 1.0},
    )
    typical = {"force_mn": 1.0, "bristle": 1e-4, "fade_ms": 1.0, "carried": 0.0}
    needs_contact = False
    words = "dry friction in the bearing: a force that opposes motion and does not depend on its speed"
    source = "Coulomb's law; onset and release after Dahl (1968)"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + Fc z."""
        v, step_s = trial.velocity_mm_s, trial.widths_s
        bristle_mm = p["bristle"] * trial.study_depth_mm
        z = (1.0 - p["carried"]) * _bristle_force(v, step_s, bristle_mm, 1e3 / p["fade_ms"])
        if p["carried"]:
            z += p["carried"] * _bristle_force(v, step_s, bristle_mm, 0.0)
        return np.asarray(force_mn + p["force_mn"] * z)
