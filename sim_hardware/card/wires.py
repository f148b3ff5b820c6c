"""Faults of the wires between the sensors and the card: what an input reads of what was sent to it."""

from dataclasses import dataclass

from sim_hardware.card.plant import FloatArray

INPUT_OF_LINE = {"position": 0, "force": 1, "loopback": 2}


@dataclass(frozen=True)
class Wire:
    """A wire whose reading is gain * volts + offset_v, cut off at low_v and high_v; 0 for the gain: a dead one."""

    gain: float = 1.0
    offset_v: float = 0.0
    low_v: float = -10.0
    high_v: float = 10.0

    def read(self, volts: FloatArray) -> FloatArray:
        """What arrives of these volts, (n,)."""
        return (self.gain * volts + self.offset_v).clip(self.low_v, self.high_v)
