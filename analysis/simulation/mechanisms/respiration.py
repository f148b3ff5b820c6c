"""The hand moves with the breath."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class Respiration(Mechanism):
    """The surface moves by ``amplitude_um`` at ``frequency_hz``; the phase is new in every trial."""

    name = "respiration"
    stage = "specimen"
    form = "oscillation"
    parameters = (
        Parameter("amplitude_um", "um", 0.0, 1.0e3),
        Parameter("frequency_hz", "Hz", 0.15, 0.7),
    )
    amplitude = "amplitude_um"
    null = {"amplitude_um": 0.0, "frequency_hz": 0.15}
    words = "breathing moves the hand and with it the skin"
    source = "breath, 0.15 to 0.7 Hz"
    separated_by = "rigid_target"
