"""The punch slips once in the hold."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism, Parameter


class Slip(Mechanism):
    """F_t drops by ``drop_mn`` within milliseconds at ``time_s``, once, in the hold."""

    name = "slip"
    stage = "contact"
    form = "event"
    parameters = (
        Parameter("drop_mn", "mN", 0.0, 1.0e3),
        Parameter("time_s", "s", 0.0, 1.0e4),
    )
    amplitude = "drop_mn"
    null = {"drop_mn": 0.0, "time_s": 0.0}
    words = "the punch slipped on the skin: the force dropped within milliseconds in the hold"
    source = "loss of tangential hold"
    separated_by = "a roughened or glued punch"
