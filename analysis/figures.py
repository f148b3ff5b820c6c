"""Figures on paper: one style, and every figure as a PNG and beside it as a PDF with real text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

# Okabe and Ito's palette, told apart by everyone
BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, YELLOW = "#E69F00", "#56B4E9", "#F0E442"
COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, "#000000")

_STYLE: Any = {
    "pdf.fonttype": 42,
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "savefig.dpi": 160,
}


def save_figures(
    out: Path, drawers: Mapping[str, tuple[tuple[float, float], Callable[[Any], None]]]
) -> dict[str, Path]:
    """Draw figures into ``out``; return name -> PNG.

    ``drawers`` by name: a figure's width and height in inches, and what draws on it.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawn = {}
    with rc_context(_STYLE):
        for name, (size_inches, draw) in drawers.items():
            figure = Figure(figsize=size_inches, layout="constrained")
            FigureCanvasAgg(figure)
            draw(figure)
            for suffix in (".png", ".pdf"):
                figure.savefig(out / f"{name}{suffix}")
            drawn[name] = out / f"{name}.png"
    return drawn
