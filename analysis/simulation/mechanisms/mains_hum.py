"""Hum of the mains in the force channel."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class MainsHum(Mechanism):
    """F gains a sine at the mains frequency or a harmonic, contact or not; phase new in every trial."""

    name = "mains_hum"
    stage = "sensor"
    form = "oscillation"
    parameters = (
        Parameter("amplitude_mn", "mN", 0.0, 1.0e4),
        Parameter("frequency_hz", "Hz", 45.0, 400.0),
    )
    amplitude = "amplitude_mn"
    null = {"amplitude_mn": 0.0, "frequency_hz": 50.0}
    needs_contact = False
    words = "hum of the mains in the force channel"
    source = "50 or 60 Hz supply and its harmonics"
    separated_by = "air_sweep"
