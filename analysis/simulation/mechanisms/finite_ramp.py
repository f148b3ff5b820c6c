"""The motion took time: the tissue relaxed during the ramp."""

from __future__ import annotations

from analysis.simulation.mechanism import Mechanism


class FiniteRamp(Mechanism):
    """The step of the textbook analysis undone: the recorded motion drives the tissue.

    It has no parameters; it is a candidate only where the baseline is ``step``.
    """

    name = "finite_ramp"
    stage = "lever"
    form = "ramp"
    words = (
        "the ramp took time: the tissue had already relaxed while the punch was still moving, "
        "so the hold is not the answer to an ideal step"
    )
    source = "Kumar et al. 2015 (idealisation); facts of the instrument"
    separated_by = "a slower and a faster ramp"
