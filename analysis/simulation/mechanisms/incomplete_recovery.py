"""The tissue has not forgotten the indentation before."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Tissues, Values

NO_REACH_MM = 1e-12
_TEXTBOOK = {"dimple": 0.0, "reach": 2e-3}
_OTHERS = ({"dimple": 0.0, "reach": 2e-2}, {"dimple": 1.0, "reach": 2e-3})


class IncompleteRecovery(Mechanism):
    """A slow arm starts loaded by L = fraction * k0 * d exp(-rest / T), d the depth of the indentation before.

    So much the force lacks when the trial begins, and less by and by as L falls with exp(-t / T). It may lack it from
    first contact on, or come to lack it within a share ``reach`` of the study's depth. Of a share ``dimple`` the
    surface lies lower by fraction * d instead, until it has filled again. Trials without an indentation before, or of
    unknown rest, are taken as recovered.
    """

    name = "incomplete_recovery"
    stage = "tissue"
    parameters = (
        Parameter("fraction", "1", 0.0, 50.0),
        Parameter("time_constant_s", "s", 0.5, 2000.0, "log"),
        Parameter("dimple", "1", 0.0, 1.0, inner=True),
        Parameter("reach", "1", 1e-5, 0.5, "log", inner=True),
    )
    amplitude = "fraction"
    null = {"fraction": 0.0, "time_constant_s": 60.0, **_TEXTBOOK}
    probes = (
        *(
            {"fraction": 0.01, "time_constant_s": t, **_TEXTBOOK}
            for t in (4.0, 7.0, 12.0, 20.0, 35.0, 60.0, 120.0, 300.0)
        ),
        *({"fraction": 0.01, "time_constant_s": t, **form} for form in _OTHERS for t in (7.0, 20.0, 60.0)),
    )
    typical = {"fraction": 0.1, "time_constant_s": 60.0, **_TEXTBOOK}
    words = "the tissue had not recovered from the previous indentation when the next one began"
    source = "a Maxwell arm that is slow to let go: what it still bears, spring and quick arms need not"
    separated_by = "rests of different length in shuffled order"

    def applies(self, trial: CellTrial) -> bool:
        """Only skin remembers."""
        return trial.kind == "ramp_hold_retract"

    def surface_mm(self, trial: CellTrial, tissue: Tissue | Tissues, p: Values) -> FloatArray | float:
        """How far the dimple lies below the surface, negative."""
        return -p.get("dimple", 0.0) * self._left_mm(trial, p)

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray | float:
        """What the slow arm takes from the force."""
        reach_mm = max(p.get("reach", 0.0) * trial.study_depth_mm, NO_REACH_MM)
        come_to_lack = -np.expm1(-np.maximum(depth_mm, 0.0) / reach_mm)
        return -(1.0 - p.get("dimple", 0.0)) * tissue.k0 * self._left_mm(trial, p) * come_to_lack

    @staticmethod
    def _left_mm(trial: CellTrial, p: Values) -> FloatArray | float:
        """Return what is left of the indentation before, (n,) mm."""
        if trial.pressed_before is None:
            return 0.0
        (before_mm, rest_s), T = trial.pressed_before, p["time_constant_s"]
        return np.asarray(p["fraction"] * before_mm * np.exp(-(rest_s + trial.time_s) / T))
