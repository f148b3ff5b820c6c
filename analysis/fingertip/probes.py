"""Where a pad is read: places along the skin, depths under the load, in the coordinates of the mesher."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.fingertip.geometry import inside_point
from analysis.fingertip.meshing import PadMesh
from analysis.fingertip.pad_file import PadFile
from analysis.recordings.trial import FloatArray

NEAR_MM = np.concatenate([[0.0], np.geomspace(0.03, 1.0, 18)])
"""Distances from the line that deflection is read at: close together where it falls fast."""
FAR_STEP_MM = 0.2
SHALLOWEST_MM = 0.1
DEPTHS = 21
BALL_MM = 0.03
"""Radius of the ball in which strain at a depth is taken: a receptor's end is no smaller."""


@dataclass(frozen=True, slots=True)
class Probes:
    """Where a pad is read.

    Attributes:
        position_mm: places along the finger from the middle of the load, towards the tip, (q,).
        skin_mm: the mesher's points there, (q, 3).
        depth_mm: depths under the middle of the load, (d,).
        inside_mm: the mesher's points there, (d, 3).
        borders_mm: depths at which epidermis and dermis end, (2,).
    """

    position_mm: FloatArray
    skin_mm: FloatArray
    depth_mm: FloatArray
    inside_mm: FloatArray
    borders_mm: FloatArray


def probes_of(pad: PadFile, mesh: PadMesh) -> Probes:
    """Return where to read a pad: by the sizes of the parametric one, or on the faces of the user's own mesh."""
    if mesh.geometry is None:
        from analysis.fingertip.user_probes import probes_on

        return probes_on(mesh)
    geometry, middle_mm = pad.geometry, pad.geometry.contact_z_mm.value
    # as far as the tube, and the tip but for its end, reach
    position_mm = along(
        geometry.tube_length_mm.value + middle_mm - 0.1, -middle_mm + 0.8 * geometry.tip_length_mm.value
    )
    borders_mm = np.cumsum([geometry.epidermis_mm.value, geometry.dermis_mm.value])
    depth_mm = depths(borders_mm)
    return Probes(
        position_mm,
        np.array([inside_point(geometry, 0.0, middle_mm + p) for p in position_mm]),
        depth_mm,
        np.array([inside_point(geometry, d, middle_mm) for d in depth_mm]),
        borders_mm,
    )


def along(towards_root_mm: float, towards_tip_mm: float) -> FloatArray:
    """Return places (q,) mm either way from the load."""
    either = [
        np.concatenate([NEAR_MM, np.arange(1.0 + FAR_STEP_MM, reach, FAR_STEP_MM)])
        for reach in (towards_root_mm, towards_tip_mm)
    ]
    return np.unique(np.concatenate([-either[0], either[1]]))


def depths(borders_mm: FloatArray) -> FloatArray:
    """Return depths (d,) mm from within the epidermis to the end of the dermis, none with its ball in two layers."""
    every = np.linspace(SHALLOWEST_MM, float(borders_mm[1]), DEPTHS)
    off = np.abs(every[:, None] - borders_mm).min(axis=1)
    inside: FloatArray = every[off > BALL_MM]
    return inside
