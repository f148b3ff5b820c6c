"""The hand trembles."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class Tremor(Mechanism):
    """The surface moves by ``amplitude_um`` at ``frequency_hz``; the phase is new in every trial."""

    name = "tremor"
    stage = "specimen"
    form = "oscillation"
    parameters = (
        Parameter("amplitude_um", "um", 0.0, 1.0e3),
        Parameter("frequency_hz", "Hz", 6.0, 14.0),
    )
    amplitude = "amplitude_um"
    null = {"amplitude_um": 0.0, "frequency_hz": 6.0}
    words = "the hand trembles: the skin moves in a narrow band"
    source = "physiological tremor, 6 to 14 Hz"
    separated_by = "rigid_target"
