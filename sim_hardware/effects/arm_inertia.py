"""The sensor feels the arm's own mass when it is accelerated."""

from __future__ import annotations

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.filters import Resonance
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray


class ArmInertia(Effect):
    """F gains m x'': what the instrument's inertia cancellation leaves.

    Shows for some milliseconds after every change of speed. Rough: the arm is no rigid body; what it
    passes on rings with its first bending mode (2500 Hz, damping ratio 0.4).
    """

    name = "arm_inertia"
    stage = "sensor"
    in_library = True
    phases = (*IN_MOTION, "dwell", "hold", "clear")
    parameters = (Parameter("mass_g", "g", 0.5, -20.0, 20.0, "mass at the tip that is not cancelled"),)
    bending: Resonance | None = None

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the force of inertia."""
        if self.bending is None:
            self.bending = Resonance(2500.0, 0.4, 1 / (SAMPLE_RATE_HZ * block.substeps))
        inertia_mn = self["mass_g"] * 1e-3 * block.fine_acceleration_mm_s2
        rung_mn = self.bending(inertia_mn)
        return force_mn + inertia_mn + self.rough * (rung_mn - inertia_mn)
