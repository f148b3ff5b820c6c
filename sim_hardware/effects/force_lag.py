"""The force channel answers late."""

from __future__ import annotations

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.filters import LowPass
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray


class ForceLag(Effect):
    """F passes the amplifier's low-pass.

    Shows wherever the force changes: after contact, in the ramp and just after it, in the retract. Rough:
    two poles that share the time constant 9 to 1.
    """

    name = "force_lag"
    stage = "sensor"
    in_library = True
    phases = IN_CONTACT
    order = 60
    parameters = (Parameter("time_constant_ms", "ms", 2.0, 0.0, 500.0, "delay of a steady ramp of force"),)
    poles: tuple[LowPass, ...] | None = None

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Return the force as it leaves the amplifier."""
        if self.poles is None:
            second = 0.1 * self.rough
            times = [self["time_constant_ms"] * 1e-3 * share for share in (1 - second, second)]
            self.poles = tuple(LowPass(t, 1 / (SAMPLE_RATE_HZ * block.substeps)) for t in times if t > 0)
        for pole in self.poles:
            force_mn = pole(force_mn)
        return force_mn

    def rest(self, duration_s: float) -> None:
        """Settle."""
        for pole in self.poles or ():
            pole.settle()
