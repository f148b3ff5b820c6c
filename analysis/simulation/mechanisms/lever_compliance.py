"""The lever bends under the force it carries."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class LeverCompliance(Mechanism):
    """z = x - C F: the tip stays behind the recorded position by the bending of the lever."""

    name = "lever_compliance"
    stage = "lever"
    parameters = (Parameter("compliance_um_per_mn", "um/mN", 0.0, 20.0),)
    amplitude = "compliance_um_per_mn"
    null = {"compliance_um_per_mn": 0.0}
    probes = ({"compliance_um_per_mn": 0.02}, {"compliance_um_per_mn": 0.5})
    typical = {"compliance_um_per_mn": 0.5}
    words = (
        "the lever (or what holds it) bends under load, so that the punch stays behind the recorded position"
    )
    source = "spring in series"
    separated_by = "rigid_target"

    @property
    def needs_force(self) -> bool:
        """The tip depends on the force."""
        return True

    def tip_mm(self, trial: CellTrial, tip_mm: FloatArray, force_mn: FloatArray, p: Values) -> FloatArray:
        """z = x - C F."""
        return tip_mm - 1e-3 * p["compliance_um_per_mn"] * force_mn
