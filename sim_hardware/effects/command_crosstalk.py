"""The command's wire couples into the force channel."""

from __future__ import annotations

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.filters import LowPass
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray


class CommandCrosstalk(Effect):
    """Command and force share a ground; an input capacitor passes changes and forgets them.

    Shows as a bump with every motion, contact or not, that dies away with the capacitor's time in the dwell,
    the hold and after the retract.
    """

    name = "command_crosstalk"
    stage = "sensor"
    in_library = False
    phases = ALWAYS
    order = 40
    parameters = (
        Parameter("coupling_mn_per_mm", "mN/mm", 3.0, -50.0, 50.0, "force read per sudden change of command"),
        Parameter("time_constant_s", "s", 0.25, 0.001, 10.0, "time of the capacitor"),
    )
    low: LowPass | None = None

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the crosstalk."""
        if self.low is None:
            self.low = LowPass(self["time_constant_s"], 1 / SAMPLE_RATE_HZ)
        return force_mn + self["coupling_mn_per_mm"] * (block.command_mm - self.low(block.command_mm))

    def rest(self, duration_s: float) -> None:
        """Discharge."""
        if self.low is not None and duration_s > 10 * self["time_constant_s"]:
            self.low.settle()
