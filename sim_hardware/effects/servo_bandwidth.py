"""The motor follows its command faster or slower than its data sheet says."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.parts import Parts


class ServoBandwidth(Effect):
    """The servo's gains were set for another arm: x follows u with another frequency and damping.

    Shows in the recorded position for some milliseconds after every change of speed. Rough: the current
    loop in front of it adds a pole of its own, 20 times as fast as the servo.
    """

    name = "servo_bandwidth"
    stage = "lever"
    in_library = True
    phases = IN_MOTION
    parameters = (
        Parameter("natural_frequency_rad_s", "rad/s", 3.5e3, 100.0, 2.0e4, "natural frequency of the servo"),
        Parameter("damping_ratio", "1", 0.8, 0.1, 5.0, "damping ratio of the servo"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the other servo in."""
        frequency = self["natural_frequency_rad_s"]
        return replace(
            parts,
            natural_frequency_rad_s=frequency,
            damping_ratio=self["damping_ratio"],
            command_lag_s=0.05 * self.rough / frequency,
        )
