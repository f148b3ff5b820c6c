"""Deflection of the skin under a line, for calibrated pads of any ratio and thickness of the epidermis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from analysis.fingertip.calibrate import SCAN_RATIOS, CalibratedPad, calibrate, scan, target_of
from analysis.fingertip.calibration_file import Calibration
from analysis.fingertip.contact import Pressed, press, ramp_and_hold
from analysis.fingertip.contact_pad import ContactPad, contact_pad
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.reduced import chebyshev_ratios
from analysis.recordings.trial import FloatArray

THICKNESSES = (2 / 3, 4 / 3)
"""Of the pad file's epidermis, that it is let free between: 0.2 to 0.4 mm of an assumed 0.3 mm."""
SNAPSHOTS = chebyshev_ratios(0.009, 3.2, 6)
"""Ratios that shapes are taken at: from the softest core, relaxed, to the stiffest at once."""
_RAMP_STEPS, _HOLD_STEPS = 20, 16
COARSER = 1.5
"""Size of the elements of a second mesh over that of the first: by how much both differ says how far off they are.

A mesh of the user's own, and elements of order 2, have a second order of elements instead."""
_LOCKED = 2
"""Order of the elements that nearly incompressible tissue stiffens."""


@dataclass(frozen=True, slots=True)
class LineMotion:
    """How the line is pressed: to a depth, at a speed, held until the surface is measured."""

    depth_mm: float = 0.5  # Kumar et al. 2015, as the rest
    speed_mm_s: float = 0.5
    hold_s: float = 3.0


@dataclass(frozen=True, slots=True)
class LineAnswers:
    """Deflections (mm) at places along the finger (q,) mm for pads of many ratios and thicknesses.

    Attributes:
        ratios, thickness_mm: (R,) relaxed core over epidermis, and (T,) of the epidermis, one where it is held.
        layered: (T, R, q); homogeneous: (q,).
        mesh_error: of the layered pads at the file's own thickness, (R, q) mm: by how much a mesh of elements as
            large again by half differs, over that half (an error in proportion to the elements, as at the edges
            of a punch and a line, where stress has no bound); for a mesh of the user's own, or of order 2, by how
            much elements of another order differ, over what that is to an error as one over the order squared.
        pads: the calibrated layered pads, by thickness and ratio.
        pressed: the homogeneous pad, and the layered pad of every ratio at the file's own thickness.
        model: the pad at the file's own thickness.
    """

    motion: LineMotion
    position_mm: FloatArray
    ratios: FloatArray
    thickness_mm: FloatArray
    layered: FloatArray
    homogeneous: FloatArray
    mesh_error: FloatArray
    pads: tuple[tuple[CalibratedPad, ...], ...]
    pressed: tuple[Pressed, ...]
    model: ContactPad

    def layered_at(self, position_mm: FloatArray) -> Callable[[float, float], FloatArray]:
        """Return a function of log ratio and thickness (mm): the deflection (N,) mm at places (N,) mm.

        Cubic splines along the finger and in log ratio, a parabola in thickness.
        """
        there = CubicSpline(self.position_mm, self.layered, axis=2)(position_mm)
        by_ratio = CubicSpline(np.log(self.ratios), there, axis=1)

        def deflection(log_ratio: float, thickness_mm: float) -> FloatArray:
            curve: FloatArray = _lagrange(self.thickness_mm, thickness_mm) @ by_ratio(log_ratio)
            return curve

        return deflection

    def mesh_error_at(self, position_mm: FloatArray, log_ratio: float) -> FloatArray:
        """Return how far off the mesh may put the skin, (N,) mm, at places (N,) mm, at a log ratio."""
        there = CubicSpline(self.position_mm, self.mesh_error, axis=1)(position_mm)
        error: FloatArray = CubicSpline(np.log(self.ratios), there, axis=0)(log_ratio)
        return error

    def homogeneous_at(self, position_mm: FloatArray) -> FloatArray:
        """Return the homogeneous pad's deflection, (N,) mm, at places (N,) mm."""
        curve: FloatArray = CubicSpline(self.position_mm, self.homogeneous)(position_mm)
        return curve


def _lagrange(nodes: FloatArray, at: float) -> FloatArray:
    return np.array(
        [np.prod([(at - b) / (a - b) for j, b in enumerate(nodes) if j != i]) for i, a in enumerate(nodes)]
    )


def press_line(pad: ContactPad, calibrated: CalibratedPad, motion: LineMotion) -> Pressed:
    """Press the line into a calibrated pad and hold it."""
    time_s, depth_mm = ramp_and_hold(
        motion.depth_mm, motion.depth_mm / motion.speed_mm_s, motion.hold_s, _RAMP_STEPS, _HOLD_STEPS
    )
    return press(pad, calibrated.materials(pad.relative), time_s, depth_mm)


def answer_lines(
    found: Calibration,
    motion: LineMotion,
    cache: Path,
    ratios: Sequence[float] = SCAN_RATIOS,
    snapshots: FloatArray = SNAPSHOTS,
) -> LineAnswers:
    """Calibrate and press pads of every ratio, at three thicknesses of the epidermis; a mesh of the user's own has one.

    ``snapshots`` are the ratios that the pads' shapes under the line are taken at.
    """
    target = target_of(found.measured)
    terms = found.pad.calibration.prony_terms

    def of_ratios(settings: PadFile) -> tuple[ContactPad, tuple[CalibratedPad, ...], list[Pressed]]:
        line = contact_pad(settings, "line", snapshots, cache)
        calibrated = tuple(scan(punch_pad(settings, cache), target, terms, ratios))
        return line, calibrated, [press_line(line, one, motion) for one in calibrated]

    own = found.pad
    model, calibrated, answers = of_ratios(own)
    plain = press_line(model, calibrate(punch_pad(own, cache), target, "homogeneous", 1.0, terms), motion)
    here = np.array([model.deflection @ one.weights[-1] for one in answers])
    nominal_mm = float(model.borders_mm[0])
    layered, pads = {nominal_mm: here}, {nominal_mm: calibrated}
    for share in THICKNESSES if own.mesh.file is None else ():
        thickness_mm = share * nominal_mm
        line, pads[thickness_mm], bent = of_ratios(own.with_epidermis(thickness_mm))
        layered[thickness_mm] = np.array([line.deflection @ one.weights[-1] for one in bent])
    other, errors = other_mesh(own)
    # of the same materials: a punch on other elements gives them another scale, which deflection does not feel
    beside = contact_pad(other, "line", snapshots, cache)
    differ = (
        np.array([beside.deflection @ press_line(beside, p, motion).weights[-1] for p in calibrated]) - here
    )
    rising = sorted(layered)
    return LineAnswers(
        motion,
        model.position_mm,
        np.array(ratios),
        np.array(rising),
        np.array([layered[thickness] for thickness in rising]),
        model.deflection @ plain.weights[-1],
        errors * differ,
        tuple(pads[thickness] for thickness in rising),
        (plain, *answers),
        model,
    )


def other_mesh(pad: PadFile) -> tuple[PadFile, float]:
    """Return the pad on other elements, and the error of its own ones over the difference of both.

    Under edges, where stress has no bound, an error goes as the elements' size, and as one over their order squared
    (Babuska and Suri 1987: there order gains twice what size does). Nearly incompressible tissue locks elements of
    order 2 and below, larger ones of that order alike, so that only a higher order tells how far off they are.
    """
    order = pad.mesh.order
    if pad.mesh.file is None and order > _LOCKED:
        return pad.with_elements(COARSER), 1 / (COARSER - 1.0)
    other = order - 1 if order > _LOCKED else order + 1
    return pad.with_order(other), other**2 / (order**2 - other**2)
