"""The punch sits on a lever and moves on an arc."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_MIDDLE_MM = 5.0
_SHEAR_MN_PER_MM = 40.0


class LeverArc(Effect):
    """The motor turns by x / R; the punch rises along R sin and drifts sideways along R cos of the angle.

    The sensor feels the torque about the pivot over R: the normal force at the arm R cos and, rough, the
    drag of the skin that the sideways drift shears, at the arm R sin. Shows wherever the arm is far from the
    middle of its travel and there is force; the punch's path differs from the motor's in air as well.
    """

    name = "lever_arc"
    stage = "lever"
    in_library = True
    phases = IN_CONTACT
    parameters = (Parameter("radius_mm", "mm", 30.0, 6.0, 300.0, "distance of the punch from the pivot"),)

    def tip(self, block: Block) -> None:
        """Move the punch on its arc."""
        radius = self["radius_mm"]
        angle = (block.fine_position_mm - _MIDDLE_MM) / radius
        bent = radius * np.sin(angle) - radius * angle
        block.fine_tip_mm = block.fine_tip_mm + bent

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Return torque over R."""
        radius = self["radius_mm"]
        angle = (block.fine_position_mm - _MIDDLE_MM) / radius
        landed = np.arcsin(np.clip((block.fine_tip_mm - block.fine_gap_mm - _MIDDLE_MM) / radius, -1, 1))
        aside_mm = radius * (np.cos(landed) - np.cos(angle))
        drag_mn = np.where(block.fine_force_mn > 0, self.rough * _SHEAR_MN_PER_MM * aside_mm, 0.0)
        if not block.skin:
            drag_mn = np.zeros_like(drag_mn)
        other_mn = force_mn - block.fine_force_mn
        return np.asarray(block.fine_force_mn * np.cos(angle) + drag_mn * np.sin(angle) + other_mn)
