"""The tissue has not forgotten the indentations before."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Values


class IncompleteRecovery(Mechanism):
    """A slow arm starts loaded by L = fraction * k0 * sum over the indentations before of d exp(-rest / T).

    Nothing presses the skin yet, so that it sinks in until its spring and its quick arms bear that load, and comes back
    as L falls with exp(-t / T): `sinking`. Trials without an indentation before, or of unknown rest, are taken as
    recovered.
    """

    name = "incomplete_recovery"
    stage = "tissue"
    parameters = (
        Parameter("fraction", "1", 0.0, 50.0),
        Parameter("time_constant_s", "s", 0.5, 2000.0, "log"),
    )
    amplitude = "fraction"
    null = {"fraction": 0.0, "time_constant_s": 60.0}
    probes = tuple(
        {"fraction": 0.01, "time_constant_s": t} for t in (4.0, 7.0, 12.0, 20.0, 35.0, 60.0, 120.0, 300.0)
    )
    typical = {"fraction": 0.1, "time_constant_s": 60.0}
    words = "the tissue had not recovered from the previous indentation when the next one began"
    source = (
        "a slow Maxwell arm that keeps its load over the rest; free surface by the correspondence principle"
    )
    separated_by = "rests of different length in shuffled order"

    def applies(self, trial: CellTrial) -> bool:
        """Only skin remembers."""
        return trial.kind == "ramp_hold_retract"

    def surface_mm(self, trial: CellTrial, tissue: Tissue, p: Values) -> FloatArray | float:
        """How far the skin lies lower."""
        T = p["time_constant_s"]
        left_mm = float(sum(d * np.exp(-ago_s / T) for d, ago_s in trial.pressed_before))
        return -p["fraction"] * tissue.k0 * left_mm * sinking(tissue, trial.time_s, T)


def sinking(tissue: Tissue, time_s: FloatArray, T: float) -> FloatArray:
    """Return how far (n,) a free surface sinks under a load exp(-t / T) that begins at t = 0, mm per mN.

    The relaxation modulus k0 + sum k_i s tau_i / (1 + s tau_i) is inverted by partial fractions: the numerator of its
    compliance is (1 + s tau1)(1 + s tau2), its denominator a s^2 + b s + k0.
    """
    k0, k1, k2, tau1, tau2 = tissue.k0, tissue.k1, tissue.k2, tissue.tau1, tissue.tau2
    a, b = tau1 * tau2 * (k0 + k1 + k2), k0 * (tau1 + tau2) + k1 * tau1 + k2 * tau2
    root = np.sqrt(max(b * b - 4.0 * a * k0, 0.0))
    poles = np.array([-(b + root) / (2.0 * a), -2.0 * k0 / (b + root)])

    def numerator(s: FloatArray | float) -> FloatArray | float:
        return (1.0 + s * tau1) * (1.0 + s * tau2)

    slow = -1.0 / T
    found = numerator(slow) / (a * slow**2 + b * slow + k0) * np.exp(slow * time_s)
    residues = numerator(poles) / ((poles - slow) * (2.0 * a * poles + b))
    return np.asarray(found + residues @ np.exp(np.outer(poles, time_s)))
