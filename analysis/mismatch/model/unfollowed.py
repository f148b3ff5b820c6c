"""A law that the library does not name: recorded motion that the force knows nothing of."""

from __future__ import annotations

from typing import ClassVar

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class UnfollowedMotion(Mechanism):
    """The tip goes without a share of what the recorded position has beside the servo's answer.

    A position that is misread, as through a gear, has what the tip never did; what the arm did is felt by the skin.
    """

    name = "unfollowed_motion"
    stage = "lever"
    parameters = (Parameter("share", "1", -2.0, 2.0),)
    amplitude = "share"
    null: ClassVar[Values] = {"share": 0.0}
    probes: ClassVar[tuple[Values, ...]] = ({"share": 0.5},)
    words = "the recorded position does something beside the servo's answer that the force does not follow"
    source = "a position sensor that errs"

    def applies(self, trial: CellTrial) -> bool:
        """Where the position has anything that no servo explains."""
        beside_mm = trial.beside_servo_mm
        return super().applies(trial) and beside_mm is not None and bool(beside_mm.any())

    def tip_mm(self, trial: CellTrial, tip_mm: FloatArray, force_mn: FloatArray, p: Values) -> FloatArray:
        """x - s (x - x_servo)."""
        return tip_mm if trial.beside_servo_mm is None else tip_mm - p["share"] * trial.beside_servo_mm


UNFOLLOWED = UnfollowedMotion()
