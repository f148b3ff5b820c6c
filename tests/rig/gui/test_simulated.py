"""Simulated rigs are opened in real time; a file of a real rig is opened as it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rig.gui.simulated import rig_for_the_window
from rig.settings.reading import load_rig

TWIN = """name = "twin"
[card]
address = "companion:card"
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 7
time = "virtual"
"""


def test_the_rig_that_ships(tmp_path: Path) -> None:
    rig = load_rig(rig_for_the_window(None, tmp_path))
    assert rig.companion is not None
    assert rig.companion.settings["time"] == "real"
    assert rig.card.read_interval_s == 0.01


def test_a_twin_in_virtual_time_keeps_its_calibrations(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    twin = tmp_path / "study" / "twin.toml"
    twin.write_text(TWIN)
    opened = rig_for_the_window(twin, tmp_path / "copies")
    rig = load_rig(opened)
    assert opened.parent == tmp_path / "copies"
    assert rig.companion is not None
    assert rig.companion.settings == {"seed": 7, "time": "real"}
    assert rig.calibration.folder == str(tmp_path / "study" / "calibrations")
    assert twin.read_text() == TWIN, "the file itself stays as it is"


def test_others_are_left_alone(tmp_path: Path) -> None:
    real = tmp_path / "rig.toml"
    real.write_text('[card]\naddress = ""\n')
    assert rig_for_the_window(real, tmp_path) == real
    assert rig_for_the_window(tmp_path / "none.toml", tmp_path) == tmp_path / "none.toml"
    real.write_text("not [ toml")
    assert rig_for_the_window(real, tmp_path) == real


def test_a_run_without_a_window_never_loads_qt() -> None:
    code = (
        "import sys, rig.cli, rig.commands.run, rig.engine.serving, rig.gui.runner_process; "
        "print([name for name in sys.modules if name.startswith(('PySide6', 'pyqtgraph'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
