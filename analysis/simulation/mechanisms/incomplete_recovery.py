"""The tissue has not forgotten the indentation before."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Values


class IncompleteRecovery(Mechanism):
    """A slow arm starts loaded by L = fraction * k0 * d exp(-rest / T), d the depth of the indentation before.

    So much the force lacks when the trial begins, and less by and by as L falls with exp(-t / T). Trials without an
    indentation before, or of unknown rest, are taken as recovered.
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
    source = "a Maxwell arm that is slow to let go: what it still bears, spring and quick arms need not"
    separated_by = "rests of different length in shuffled order"

    def applies(self, trial: CellTrial) -> bool:
        """Only skin remembers."""
        return trial.kind == "ramp_hold_retract"

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue, p: Values
    ) -> FloatArray | float:
        """What the slow arm takes from the force."""
        if trial.pressed_before is None:
            return 0.0
        (before_mm, rest_s), T = trial.pressed_before, p["time_constant_s"]
        return -p["fraction"] * tissue.k0 * before_mm * np.exp(-(rest_s + trial.time_s) / T)
