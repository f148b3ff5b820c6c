"""The pad's shape: nested capsules that any mesher takes, and the map that makes a finger of them.

The mesher sees half of four concentric capsules (cylinder and hemisphere): skin, both borders between layers,
bone. The map moves each of their surfaces onto its superellipsoid and what lies between in proportion, so that
thin layers, a bone off the axis and superelliptic sections never meet the geometry kernel, whose booleans of
free-form surfaces take half a minute and fail. The map leaves the lines x = 0 on the tube where
they are but for the height, so the punch stays round within 0.1 % of its radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.recordings.trial import FloatArray

if TYPE_CHECKING:
    from analysis.fingertip.pad_file import Geometry

FAR_MM = 50.0
_TINY = 1e-12
_SKIN_MM = 1e-4


@dataclass(frozen=True, slots=True)
class Surface:
    """A surface of the pad: radius of its capsule, half-axes of its superellipsoid, shift along y (mm)."""

    capsule_mm: float
    half_width_mm: float
    half_height_mm: float
    tip_mm: float
    shift_mm: float = 0.0


def surfaces(geometry: Geometry) -> tuple[Surface, Surface, Surface, Surface]:
    """Return skin, the border of epidermis and dermis, that of dermis and fat, and the bone."""
    g = geometry
    depths = (0.0, g.epidermis_mm.value, g.epidermis_mm.value + g.dermis_mm.value)
    width, height, tip = g.half_width_mm.value, g.half_height_mm.value, g.tip_length_mm.value
    skin, first, second = (Surface(width - d, width - d, height - d, tip - d) for d in depths)
    bone = Surface(
        g.bone_half_width_mm.value,
        g.bone_half_width_mm.value,
        g.bone_half_height_mm.value,
        g.bone_tip_mm.value,
        -g.bone_dorsal_shift_mm.value,
    )
    return skin, first, second, bone


def skin_height_mm(geometry: Geometry, x_mm: FloatArray) -> FloatArray:
    """Return the height y of the pad's skin on the tube, (N,) mm, at x (N,) mm; ValueError beside the pad."""
    width, height = geometry.half_width_mm.value, geometry.half_height_mm.value
    share = np.abs(np.asarray(x_mm, dtype=float)) / width
    if np.any(share > 1):
        raise ValueError(f"the pad ends at x = {width:g} mm")
    n = geometry.superellipse_exponent.value
    height_mm: FloatArray = height * (1 - share**n) ** (1 / n)
    return height_mm


def inside_point(geometry: Geometry, depth_mm: float, z_mm: float) -> tuple[float, float, float]:
    """Return the mesher's point whose image lies on x = 0 at ``z_mm``, ``depth_mm`` under the top of the tube.

    Beyond the tube (z > 0) the depth counts along the way to the middle, as a share of the skin's height.
    Raises ValueError where that is in the bone or outside of the pad.
    """
    nested = surfaces(geometry)
    # the mesh's faces bend a little less than the capsule: a tenth of a micrometre below its skin is inside
    depth_mm = max(depth_mm, _SKIN_MM)
    y_mm = geometry.half_height_mm.value - depth_mm
    tops = [s.half_height_mm + s.shift_mm for s in nested]
    if not tops[-1] <= y_mm < tops[0]:
        raise ValueError(
            f"a depth of {depth_mm:g} mm lies outside of the soft tissue of {tops[0] - tops[-1]:g} mm"
        )
    radius = float(np.interp(y_mm, tops[::-1], [s.capsule_mm for s in nested[::-1]]))
    if z_mm <= 0:
        return 0.0, radius, z_mm
    share = z_mm / geometry.tip_length_mm.value
    if share >= 1:
        raise ValueError(f"z = {z_mm:g} mm lies beyond the tip")
    return 0.0, radius * math.sqrt(1 - share**2), radius * share


def capsule_x_mm(geometry: Geometry, x_mm: float) -> float:
    """Return the mesher's x of the tube's skin at ``x_mm``."""
    height = float(skin_height_mm(geometry, np.array([x_mm]))[0])
    across = x_mm / geometry.half_width_mm.value
    return geometry.half_width_mm.value * math.sin(math.atan2(across, height / geometry.half_height_mm.value))


def displacement_of_map(geometry: Geometry, inner: int, x: Any, y: Any, z: Any) -> Any:
    """Return what the map adds to a point between surface ``inner`` - 1 and ``inner``, as an NGSolve function."""
    from ngsolve import CoefficientFunction, IfPos, sqrt

    nested = surfaces(geometry)
    outer, bottom = nested[inner - 1], nested[inner]
    n = geometry.superellipse_exponent.value
    beyond = IfPos(z, z, 0.0)
    radius = sqrt(x * x + y * y + beyond * beyond)
    across = sqrt(x * x + y * y) + _TINY
    bulge = ((sqrt(x * x + _TINY**2) / across) ** n + (sqrt(y * y + _TINY**2) / across) ** n) ** (-1 / n)

    def image(surface: Surface) -> tuple[Any, Any, Any]:
        return (
            surface.half_width_mm * bulge * x / radius,
            surface.half_height_mm * bulge * y / radius + surface.shift_mm,
            surface.tip_mm * beyond / radius + IfPos(z, 0.0, z),
        )

    down = (outer.capsule_mm - radius) / (outer.capsule_mm - bottom.capsule_mm)
    pairs = zip(image(outer), image(bottom), (x, y, z), strict=True)
    return CoefficientFunction(tuple((1 - down) * a + down * b - here for a, b, here in pairs))
