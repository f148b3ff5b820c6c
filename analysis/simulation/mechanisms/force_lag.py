"""The force channel is slow."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import low_pass, resonance

_TEXTBOOK = {"shared": 0.0, "damping": 0.98}


class ForceLag(Mechanism):
    """F passes a low-pass that is late by T: (1 - q) T y' + y = F, then S^2 z'' + 2 D S z' + z = y, 2 D S = q T.

    The textbook's has one pole, q = 0. Filters of instruments have more: Bessel's of two have q = 1 and a damping D of
    0.87, Butterworth's 0.71. Three that are equal (q = 2/3, D = 1) spread a step as long as a moving average does.
    """

    name = "force_lag"
    stage = "sensor"
    parameters = (
        Parameter("time_constant_ms", "ms", 0.0, 500.0),
        Parameter("shared", "1", 0.0, 1.0, inner=True),
        Parameter("damping", "1", 0.4, 0.98, inner=True),
    )
    amplitude = "time_constant_ms"
    null = {"time_constant_ms": 0.0, **_TEXTBOOK}
    probes = (
        {"time_constant_ms": 0.1, **_TEXTBOOK},
        {"time_constant_ms": 1.0, **_TEXTBOOK},
        {"time_constant_ms": 8.0, **_TEXTBOOK},
    )
    typical = {"time_constant_ms": 2.0, **_TEXTBOOK}
    sensor_rank = 1
    words = "the force channel answers late: a low-pass filter smears every quick change of force"
    source = "first-order filter; more of its poles after Butterworth's and Bessel's filters"
    separated_by = "rigid_target"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F after the filter."""
        T, q = 1e-3 * p["time_constant_ms"], p.get("shared", 0.0)
        force_mn = low_pass(force_mn, trial.steps, (1.0 - q) * T)
        D = p.get("damping", _TEXTBOOK["damping"])
        return resonance(force_mn, trial.steps, 0.5 * q * T / D, D) if q * T > 0.0 else force_mn
