"""The live curves: limits, threshold and surface across them, room for names above them, gaps in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyqtgraph as pg
from pytestqt.qtbot import QtBot

from rig.engine.progress import BenchFacts, Snapshot
from rig.engine.states import State
from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.live_marks import LimitLines
from rig.gui.live_plot import LivePlot

FACTS = BenchFacts("", True, 0.0, 9.5, 0.5, 400.0, 8000.0)


def test_a_line_out_of_view_leaves_no_piece_of_its_name(qtbot: QtBot) -> None:
    position, force = pg.PlotWidget(), pg.PlotWidget()
    for plot in (position, force):
        qtbot.addWidget(plot)
    lines = LimitLines(position, force)
    position.setYRange(0.1, 4.0, padding=0)
    state = BenchState(link="open", snapshot=Snapshot("", State.IDLE, surface_mm=3.0, bench=FACTS))
    lines.show(state, in_volts=False)

    def seen() -> set[str]:
        return {name.strip() for name, line in lines._made.items() if line.isVisible()}

    assert seen() == {"surface"}
    position.setYRange(-0.1, 4.0, padding=0)
    assert seen() == {"surface", "travel limit"}
    force.setYRange(-10.0, 410.0, padding=0)
    assert seen() == {"surface", "travel limit", "force limit"}
    lines.show(state, in_volts=True)
    assert seen() == set()
    force.setYRange(-10.0, 420.0, padding=0)
    assert seen() == set()


def test_the_axis_holds_the_curve_and_leaves_room_for_the_phases_names(qtbot: QtBot, tmp_path: Path) -> None:
    link = BenchLink(tmp_path / "bench.log")
    plot = LivePlot(link)
    qtbot.addWidget(plot)
    plot._scale(0, np.full(5, np.nan))  # a gap as wide as the view: nothing is known, nothing is warned of
    assert plot._ranges[0] is None
    for top in np.linspace(1.0, 9.0, 200):
        plot._scale(0, np.array([0.5, np.nan, top]))
        below, above = plot._ranges[0] or (0.0, 0.0)
        assert below < 0.5
        assert above - top >= 0.08 * (above - below)
    link.close()
