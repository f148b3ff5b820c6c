"""The finger moved once."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class MotionArtefact(Mechanism):
    """In some trials the surface shifts once by ``shift_um`` at ``time_s`` and stays shifted."""

    name = "motion_artefact"
    stage = "specimen"
    form = "event"
    parameters = (
        Parameter("shift_um", "um", -1.0e3, 1.0e3),
        Parameter("time_s", "s", 0.0, 1.0e4),
    )
    amplitude = "shift_um"
    null = {"shift_um": 0.0, "time_s": 0.0}
    one_sided = False
    words = "in some trials the finger moved once and stayed there"
    source = "involuntary movement of the subject"
    separated_by = "a repeat with the finger strapped down"
