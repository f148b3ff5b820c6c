"""The lever follows its command differently than the rig file says."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class ServoBandwidth(Mechanism):
    """x follows u through a second-order servo with another natural frequency or damping.

    It is looked for in the recorded position given the command; force given position does not know of it.
    """

    name = "servo_bandwidth"
    stage = "lever"
    form = "servo"
    parameters = (
        Parameter("natural_frequency_rad_s", "rad/s", 50.0, 1.0e5, "log"),
        Parameter("damping_ratio", "1", 0.05, 10.0, "log"),
    )
    amplitude = "natural_frequency_rad_s"
    null = {"natural_frequency_rad_s": 5.0e3, "damping_ratio": 1.0}
    needs_contact = False
    words = "the lever follows its command with another speed or damping than the rig file says"
    source = "Aurora 300C manual: critically damped step response 1.3 ms"
    separated_by = "air_sweep"
