"""Figures of the finger pad, as PNG and as PDF with real text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.figures import COLOURS, save_figures
from analysis.fingertip.calibrate import CalibratedPad, Target
from analysis.fingertip.calibration_file import Calibration
from analysis.fingertip.compare import Located
from analysis.fingertip.line_load import LineAnswers
from analysis.fingertip.pad_file import LAYERS
from analysis.fingertip.reduced import PunchPad
from analysis.fingertip.view import MeshView
from analysis.recordings.trial import FloatArray

_NAMES = {"homogeneous": "homogeneous", "layered": "elastic epidermis"}
_GAP = 2.5
"""Of the usual step from place to place: a longer one is a gap."""
_LAYER_COLOURS = ("#f2c9a1", "#e58f7b", "#f6e3a4")


def draw_calibration(out: Path, found: Calibration, target: Target, punch: PunchPad) -> dict[str, Path]:
    """Draw force and fit, the scan over ratios, and the pressed sections into ``out``; name -> PNG."""
    return save_figures(
        out,
        {
            "force": ((7.0, 4.4), lambda figure: _force(figure, found, target)),
            "scan": ((7.0, 3.0), lambda figure: _scan(figure, found.scan)),
            "sections": ((7.0, 3.6), lambda figure: _sections(figure, found, punch)),
        },
    )


def _force(figure: Any, found: Calibration, target: Target) -> None:
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.3))
    depth_mm = found.measured.depth_mm
    above.plot(target.time_s, depth_mm * target.force_mn_per_mm, color="#999999", lw=4, label="measured")
    for colour, pad in zip(COLOURS, found.pads, strict=False):
        force = pad.force.after_ramp(target.time_s, found.measured.ramp_s)
        above.plot(target.time_s, depth_mm * force, color=colour, lw=1.2, label=_NAMES[pad.kind])
        share = 100 * (force - target.force_mn_per_mm) / target.relaxed_mn_per_mm
        below.plot(target.time_s, share, color=colour, lw=1.0)
    above.set_ylabel(f"force at {depth_mm:.2g} mm (mN)")
    above.legend()
    below.set_ylabel("off by (% of A0)")
    below.set_xlabel("time since the ramp began (s)")


def _scan(figure: Any, pads: Sequence[CalibratedPad]) -> None:
    left, right = figure.subplots(1, 2)
    ratios = [pad.ratio for pad in pads]
    left.loglog(ratios, [100 * pad.rms_share for pad in pads], "o-", color=COLOURS[0], ms=3)
    left.axhline(0.1, color="#999999", lw=0.8, ls="--")
    left.set_ylabel("rms off (% of A0)")
    right.loglog(
        ratios, [p.epidermis.relaxed_kpa for p in pads], "o-", ms=3, color=COLOURS[1], label="epidermis"
    )
    right.loglog(ratios, [p.core.relaxed_kpa for p in pads], "o-", ms=3, color=COLOURS[2], label="core")
    right.set_ylabel("relaxed modulus (kPa)")
    right.legend()
    for axes in (left, right):
        axes.set_xlabel("core / epidermis, relaxed")


def _sections(figure: Any, found: Calibration, punch: PunchPad) -> None:
    panels = np.atleast_1d(figure.subplots(1, len(found.pads), sharex=True, sharey=True))
    for axes, pad in zip(panels, found.pads, strict=True):
        moduli = np.array([m.relaxed_kpa for m in pad.materials(punch.relative)])
        moved = punch.view.displaced(found.measured.depth_mm * punch.answer(moduli))
        draw_section(axes, punch.view, moved)
        axes.set_title(_NAMES[pad.kind], fontsize=9)


def draw_section(axes: Any, view: MeshView, moved_mm: FloatArray) -> None:
    """Draw the deformed mesh in the plane of symmetry, z to the right and y up, in mm."""
    from matplotlib.colors import ListedColormap

    z_mm, y_mm = (view.corners_mm + moved_mm)[:, 2], (view.corners_mm + moved_mm)[:, 1]
    if len(view.section):
        colours = ListedColormap(_LAYER_COLOURS[: len(LAYERS)])
        axes.tripcolor(
            z_mm, y_mm, view.section, facecolors=view.section_layer.astype(float), cmap=colours,
            vmin=-0.5, vmax=len(LAYERS) - 0.5, edgecolors="#6b5847", linewidth=0.15,
        )  # fmt: skip
    axes.set_aspect("equal")
    axes.set_xlabel("along the finger (mm)")
    axes.set_ylabel("out of the pad (mm)")


def draw_comparison(out: Path, found: Located, answers: LineAnswers) -> dict[str, Path]:
    """Draw surface and pads, the profile of the ratio and the pressed section into ``out``; name -> PNG."""
    return save_figures(
        out,
        {
            "surface": ((7.0, 4.8), lambda figure: _surface(figure, found)),
            "profile": ((4.6, 3.0), lambda figure: _profile(figure, found)),
            "line_section": ((7.0, 3.4), lambda figure: _line_section(figure, found, answers)),
        },
    )


def _surface(figure: Any, found: Located) -> None:
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    at, measured = found.surface.position_mm, found.surface.deflection_mm
    steps_mm = np.diff(at)
    gaps = 1 + np.flatnonzero(steps_mm > _GAP * np.median(steps_mm))
    above.errorbar(at, measured, found.error_mm, fmt=".", color="black", ms=4, lw=0.8, label="measured")
    for colour, pad in zip(COLOURS, found.pads, strict=False):
        # the pads' own curve: straight from one measured place to the next it would be cut off under the line
        label = pad.name + (" (fails)" if pad.fails else "")
        above.plot(found.along_mm, pad.curve_mm, color=colour, lw=1.2, label=label)
        off_um = 1e3 * (measured - pad.deflection_mm)
        # no line over a gap, as there is under the tool: nothing was measured there
        below.plot(
            np.insert(at, gaps, np.nan), np.insert(off_um, gaps, np.nan), ".-", color=colour, lw=0.8, ms=3
        )
    above.invert_yaxis()
    above.set_ylabel("deflection (mm)")
    above.legend()
    below.axhspan(-2e3 * found.error_mm.mean(), 2e3 * found.error_mm.mean(), color="#dddddd", zorder=0)
    below.set_ylabel("measured - pad (um)")
    below.set_xlabel("along the finger from the line, towards the tip (mm)")


def _profile(figure: Any, found: Located) -> None:
    axes = figure.subplots()
    near = found.profile_misfit < 12 * found.limit
    axes.semilogx(np.exp(found.profile_log_ratio[near]), found.profile_misfit[near], color=COLOURS[0])
    axes.axhline(found.limit, color="#999999", lw=0.8, ls="--")
    axes.axvspan(found.ratio_low, found.ratio_high, color="#dddddd", zorder=0)
    axes.set_xlabel("core / epidermis, relaxed")
    axes.set_ylabel("misfit above the least")


def _line_section(figure: Any, found: Located, answers: LineAnswers) -> None:
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    nearest = int(np.argmin(np.abs(np.log(answers.ratios) - np.log(found.ratio))))
    shown = (
        ("homogeneous", answers.pressed[0]),
        (f"ratio {answers.ratios[nearest]:.2g}", answers.pressed[1 + nearest]),
    )
    for axes, (title, pressed) in zip(panels, shown, strict=True):
        draw_section(axes, answers.model.view, answers.model.view.displaced(pressed.weights[-1]))
        axes.set_title(title, fontsize=9)
