"""The finger moves with the pulse."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class Heartbeat(Mechanism):
    """The surface moves by ``amplitude_um`` at ``frequency_hz``; the phase is new in every trial."""

    name = "heartbeat"
    stage = "specimen"
    form = "oscillation"
    parameters = (
        Parameter("amplitude_um", "um", 0.0, 1.0e3),
        Parameter("frequency_hz", "Hz", 1.0, 4.0),
    )
    amplitude = "amplitude_um"
    null = {"amplitude_um": 0.0, "frequency_hz": 1.0}
    words = "the pulse moves the finger pad against the punch"
    source = "pulse, 1 to 4 Hz, with harmonics"
    separated_by = "rigid_target"
