"""The page of what a receptor feels under the plate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.figures import COLOURS, save_figures
from analysis.fingertip.figures import draw_section
from analysis.fingertip.page import render
from analysis.fingertip.receptor import Felt, PlateMotion, SpikeRate, drop
from analysis.fingertip.view import IntArray, write_vtu

_NAMES = {"homogeneous": "homogeneous", "layered": "elastic epidermis"}
_CAPTIONS = {
    "energy": "Strain energy density over time: line, in the middle of the depths; band, over the depths. "
    "Broken: half of stress times strain. Dots, if any: the rate.",
    "depth": "End of the ramp over end of the hold, by depth.",
    "plate_section": "Section in the plane of symmetry under the plate at the end of the hold, true to scale.",
}


def write_receptor_page(
    out: Path, felt: Sequence[Felt], motion: PlateMotion, band_mm: tuple[float, float], rate: SpikeRate | None
) -> Path:
    """Draw the figures, write VTU files and ``receptor.html`` into ``out``; return the page's path."""
    figures = save_figures(
        out,
        {
            "energy": ((7.0, 3.6), lambda figure: _energy(figure, felt, band_mm, rate)),
            "depth": ((4.6, 3.0), lambda figure: _depth(figure, felt, motion)),
            "plate_section": ((7.0, 3.4), lambda figure: _section(figure, felt)),
        },
    )
    for one in felt:
        moved = one.model.view.displaced(one.pressed.weights[-1])
        write_vtu(out / f"{one.pad.kind}_plate.vtu", one.model.view, {"displacement_mm": moved})
    return render(
        out / "receptor.html",
        "receptor.html.j2",
        figures,
        _CAPTIONS,
        motion=motion,
        band=band_mm,
        rate=rate,
        pads=[_cells(one, motion, band_mm, rate) for one in felt],
        overlap=max(one.pressed.overlap_mm for one in felt),
        pull=max(one.pressed.pull_kpa for one in felt),
    )


def _inside(one: Felt, band_mm: tuple[float, float]) -> IntArray:
    return np.flatnonzero((one.depth_mm >= band_mm[0] - 1e-9) & (one.depth_mm <= band_mm[1] + 1e-9))


def _cells(
    one: Felt, motion: PlateMotion, band_mm: tuple[float, float], rate: SpikeRate | None
) -> dict[str, Any]:
    inside = _inside(one, band_mm)
    stored, half = (drop(v[inside], one.time_s, motion) for v in (one.stored, one.half_stress_strain))
    apart = np.abs(one.half_stress_strain / one.stored - 1).max()
    touching_mm2 = one.model.area_mm2 @ (one.pressed.pressure_kpa > 0).T
    return {
        "name": _NAMES[one.pad.kind],
        "stored": f"{stored.min():.2f} to {stored.max():.2f}",
        "half": f"{half.min():.2f} to {half.max():.2f}",
        "force": f"{drop(one.force_mn, one.time_s, motion):.2f}",
        "apart": f"{100 * apart:.1f}",
        "area": f"{touching_mm2[-1]:.1f}",
        "r2": "" if rate is None else ", ".join(f"{r:.3f}" for r in _explained(one, inside, rate)),
    }


def _explained(one: Felt, inside: IntArray, rate: SpikeRate) -> list[float]:
    """Return R2 of the rate as a straight line of either energy in the middle of the depths."""
    middle = inside[len(inside) // 2]
    found = []
    for values in (one.stored[middle], one.half_stress_strain[middle]):
        energy = np.interp(rate.time_s, np.append(0.0, one.time_s), np.append(0.0, values))
        found.append(float(np.corrcoef(energy, rate.rate_hz)[0, 1] ** 2))
    return found


def _energy(figure: Any, felt: Sequence[Felt], band_mm: tuple[float, float], rate: SpikeRate | None) -> None:
    panels = figure.subplots(1, len(felt), sharey=True, squeeze=False)[0]
    for axes, colour, one in zip(panels, COLOURS, felt, strict=False):
        inside = _inside(one, band_mm)
        middle = inside[len(inside) // 2]
        time_s = np.append(0.0, one.time_s)
        low, high = (np.append(0.0, edge(one.stored[inside], axis=0)) for edge in (np.min, np.max))
        axes.fill_between(time_s, low, high, color=colour, alpha=0.25, lw=0)
        axes.plot(time_s, np.append(0.0, one.stored[middle]), color=colour, lw=1.3)
        axes.plot(time_s, np.append(0.0, one.half_stress_strain[middle]), color=colour, lw=1.0, ls="--")
        axes.set_title(_NAMES[one.pad.kind], fontsize=9)
        axes.set_xlabel("time since the plate touched (s)")
        if rate is not None:
            beside = axes.twinx()
            beside.plot(rate.time_s, rate.rate_hz, ".", color="black", ms=3)
            # both scales from nothing, so that what is in proportion looks so
            beside.set_ylim(0, 1.1 * rate.rate_hz.max() or 1)
            if one is felt[-1]:
                beside.set_ylabel("rate (Hz)")
            beside.spines["right"].set_visible(True)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel("strain energy density (kPa)")


def _depth(figure: Any, felt: Sequence[Felt], motion: PlateMotion) -> None:
    axes = figure.subplots()
    for colour, one in zip(COLOURS, felt, strict=False):
        axes.plot(
            one.depth_mm, drop(one.stored, one.time_s, motion), color=colour, label=_NAMES[one.pad.kind]
        )
        axes.plot(one.depth_mm, drop(one.half_stress_strain, one.time_s, motion), color=colour, ls="--", lw=1)
        axes.axhline(float(drop(one.force_mn, one.time_s, motion)), color=colour, lw=0.8, ls=":")
    axes.set_xlabel("depth (mm); dotted: force")
    axes.set_ylabel("end of ramp / end of hold")
    axes.legend()


def _section(figure: Any, felt: Sequence[Felt]) -> None:
    panels = figure.subplots(1, len(felt), sharex=True, sharey=True, squeeze=False)[0]
    for axes, one in zip(panels, felt, strict=True):
        draw_section(axes, one.model.view, one.model.view.displaced(one.pressed.weights[-1]))
        axes.set_title(_NAMES[one.pad.kind], fontsize=9)
