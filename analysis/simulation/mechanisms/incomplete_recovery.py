"""The tissue has not forgotten the previous indentation."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Values


class IncompleteRecovery(Mechanism):
    """A slow arm starts loaded: F_t loses fraction * k0 * d_previous * exp(-(rest + t) / T) while in contact.

    ``fraction`` is positive when the tissue starts still pressed in. Trials without a previous indentation, or
    of unknown rest, are taken as recovered.
    """

    name = "incomplete_recovery"
    stage = "tissue"
    parameters = (
        Parameter("fraction", "1", -5.0, 50.0),
        Parameter("time_constant_s", "s", 0.5, 2000.0, "log"),
    )
    amplitude = "fraction"
    null = {"fraction": 0.0, "time_constant_s": 60.0}
    probes = tuple({"fraction": 0.01, "time_constant_s": t} for t in (3.0, 10.0, 30.0, 100.0, 300.0))
    typical = {"fraction": 0.1, "time_constant_s": 60.0}
    one_sided = False
    words = "the tissue had not recovered from the previous indentation when the next one began"
    source = "a slow Maxwell arm that keeps its load over the rest"
    separated_by = "rests of different length in shuffled order"

    def applies(self, trial: CellTrial) -> bool:
        """Only skin remembers."""
        return trial.kind == "ramp_hold_retract"

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue, p: Values
    ) -> FloatArray | float:
        """Force that the unrecovered arm lacks."""
        if trial.rest_s is None or trial.previous_depth_mm is None:
            return 0.0
        T = p["time_constant_s"]
        left = np.exp(-(trial.rest_s + trial.time_s) / T)
        inside = np.clip(depth_mm / 1e-3, 0.0, 1.0)
        return np.asarray(-p["fraction"] * tissue.k0 * trial.previous_depth_mm * left * inside)
