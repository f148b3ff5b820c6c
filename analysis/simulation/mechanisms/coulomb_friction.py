"""Dry friction in the bearing."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from analysis.simulation.cells import CellMotion, CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

RESTING_MM_S = 0.15
HELD_S = 0.03
STILL_MM_S = 1e-6
"""Slower than this a bearing rests: a line that was commanded through rounded codes is as flat as that."""
NEVER = 1e-9
"""A rate (1/s) at which nothing happens."""


@njit(cache=True)
def _bristle_force(
    velocity: FloatArray,
    step_s: FloatArray,
    bristle_mm: float,
    fades: float,
    creeping: float,
    creeping_mm_s: float,
    before: float,
) -> FloatArray:
    out = np.empty_like(velocity)
    z = before
    for i in range(velocity.shape[0]):
        v = velocity[i]
        rate = fades + NEVER
        settled = 0.0
        if abs(v) > STILL_MM_S:
            # dz/dt = v / l (1 - |z| / g(v)), g what they hold when they slide: the more the slower
            slide = abs(v) / bristle_mm / (1.0 + creeping * np.exp(-((v / creeping_mm_s) ** 2)))
            rate = slide + np.exp(-((v / RESTING_MM_S) ** 2)) * fades + NEVER
            settled = v / bristle_mm / rate
        decay = np.exp(-rate * step_s[i])
        share = (1.0 - decay) / (rate * step_s[i])
        out[i] = settled + (z - settled) * share
        z = settled + (z - settled) * decay
    return out


@lru_cache(maxsize=1024)
def _bent(
    motion: CellMotion, bristle_mm: float, fades: float, creeping: float, creeping_mm_s: float, before: float
) -> FloatArray:
    """Return what bristles bear (n,): no more depends on it than their lengths, however often a force is simulated."""
    forms = bristle_mm, fades, creeping, creeping_mm_s, before
    bent = _bristle_force(motion.velocity_mm_s, motion.widths_s, *forms)
    bent.flags.writeable = False
    return bent


class CoulombFriction(Mechanism):
    """F gains Fc sign(dx/dt), built up over a little travel and let go over a little time.

    The sign is that of Dahl's bristles, which bend over a share of the study's depth before they slide. Some are as
    short as ``bristle`` and let go of what they hold within ``fade_ms`` at rest; a share ``longer`` of them is
    ``bend`` long and holds a share ``held`` of it after 30 ms; when the trial begins a share ``before`` of it, by the
    motion before that. At creeping speed all hold a share ``creeping`` more (Stribeck), less of it from
    ``creeping_mm_s`` on. The textbook's sign function has short ones only, which let go at once and hold no more.
    """

    name = "coulomb_friction"
    stage = "sensor"
    parameters = (
        Parameter("force_mn", "mN", 0.0, 1.0e6),
        Parameter("bristle", "1", 2e-5, 0.05, "log", inner=True),
        Parameter("fade_ms", "ms", 0.1, 1.0e4, "log", inner=True),
        Parameter("longer", "1", 0.0, 1.0, inner=True),
        Parameter("bend", "1", 2e-5, 0.05, "log", inner=True),
        Parameter("held", "1", 1e-6, 1.0, inner=True),
        Parameter("before", "1", -1.0, 1.0, inner=True),
        Parameter("creeping", "1", 0.0, 1.0, inner=True),
        Parameter("creeping_mm_s", "mm/s", 0.05, 20.0, "log", inner=True),
    )
    amplitude = "force_mn"
    typical = {
        "force_mn": 1.0,
        "bristle": 1e-4,
        "fade_ms": 1.0,
        "longer": 0.0,
        "bend": 2e-3,
        "held": 0.5,
        "before": 0.0,
        "creeping": 0.0,
        "creeping_mm_s": 1.0,
    }
    null = {**typical, "force_mn": 0.0}
    probes = (
        {**typical, "force_mn": 0.1},
        {**typical, "force_mn": 0.1, "bristle": 2e-3, "fade_ms": 30.0},
        {**typical, "force_mn": 0.1, "longer": 1.0, "held": 1.0},
        {**typical, "force_mn": 0.1, "longer": 1.0, "held": 1.0, "before": -0.9},
    )
    needs_contact = False
    words = "dry friction in the bearing: a force that opposes motion and does not depend on its speed"
    source = "Coulomb's law; onset and release after Dahl (1968), creep after Canudas de Wit et al. (1995)"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + Fc z."""

        def bent(bend: float, fades: float, before: float) -> FloatArray:
            forms = fades, p["creeping"], p["creeping_mm_s"], before
            return _bent(trial.motion, bend * trial.study_depth_mm, *forms)

        z = (1.0 - p["longer"]) * bent(p["bristle"], 1e3 / p["fade_ms"], 0.0)
        if p["longer"]:
            z = z + p["longer"] * bent(p["bend"], -np.log(p["held"]) / HELD_S, p["before"])
        return np.asarray(force_mn + p["force_mn"] * z)
