"""A coarse pad under the punch, solved once a session."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("ngsolve")

from analysis.fingertip.commands import need_solver
from analysis.fingertip.fits_file import MeasuredTrial
from analysis.fingertip.meshing import PadMesh, mesh_pad
from analysis.fingertip.pad_file import PadFile, example_text, read_pad
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.reduced import PunchPad


def coarse(pad: PadFile) -> PadFile:
    """Return the pad with a mesh for tests: a second's work."""
    sizes = {"order": 2, "contact_size_mm": 0.05, "size_mm": 1.0, "grading": 0.7}
    shorter = pad.plate.length_mm.model_copy(update={"value": 4.0})
    return pad.model_copy(
        update={
            "mesh": pad.mesh.model_copy(update=sizes),
            "plate": pad.plate.model_copy(update={"length_mm": shorter}),
        }
    )


@pytest.fixture(scope="session")
def coarse_pad() -> PadFile:
    """The shipped pad on a coarse mesh."""
    need_solver()
    return coarse(read_pad(None))


@pytest.fixture(scope="session")
def flat_pad(coarse_pad: PadFile) -> PadFile:
    """The same with flat elements of order 1: a file of corners says all of such a mesh."""
    return coarse_pad.with_order(1)


@pytest.fixture(scope="session")
def punch_mesh(coarse_pad: PadFile) -> PadMesh:
    """The coarse pad's mesh under the punch."""
    return mesh_pad(coarse_pad, "punch")


@pytest.fixture(scope="session")
def bodies(module_at: Callable[[Path], ModuleType]) -> ModuleType:
    """Bodies whose answers are known."""
    return module_at(Path(__file__).with_name("known_bodies.py"))


@pytest.fixture(scope="session")
def full_march(module_at: Callable[[Path], ModuleType]) -> ModuleType:
    """The pad without short cuts."""
    return module_at(Path(__file__).with_name("full_march.py"))


@pytest.fixture(scope="session")
def written(module_at: Callable[[Path], ModuleType]) -> ModuleType:
    """Meshes written to files."""
    return module_at(Path(__file__).with_name("written_mesh.py"))


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of this session's own, which all its workers share: a pad is solved once, not once a worker."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "pads"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def punch(coarse_pad: PadFile, cache: Path) -> PunchPad:
    """The coarse pad under the punch."""
    return punch_pad(coarse_pad, cache)


@pytest.fixture(scope="session")
def measured() -> MeasuredTrial:
    """A trial of the published constants, as a ramp fit gives it."""
    return MeasuredTrial(
        "trial", "index", "ramp", 0.4, 0.08, 7.0, 120.0 * np.array([1.0, 0.371, 0.294]),
        np.array([2.279, 0.149]), np.diag([0.05, 0.1, 0.1, 2e-3, 3e-3]) ** 2,
    )  # fmt: skip


@pytest.fixture(scope="session")
def pad_text() -> Callable[[PadFile], str]:
    """The shipped pad.toml with a pad's mesh and the length of its plate."""

    def text_of(pad: PadFile) -> str:
        text = example_text()
        mesh = ("order", "size_mm", "contact_size_mm", "line_size_mm", "grading")
        given = {f"{name} = ": getattr(pad.mesh, name) for name in mesh}
        for begin, value in (given | {"length_mm = { value = ": pad.plate.length_mm.value}).items():
            there = rf"^{re.escape(begin).replace('=', ' *=', 1)}[\d.]+"
            text, count = re.subn(there, f"{begin}{value}", text, flags=re.MULTILINE)
            assert count == 1
        return text

    return text_of


@pytest.fixture(scope="session")
def fits_of() -> Callable[[Path, MeasuredTrial], Path]:
    """What `indenter fit` writes of a trial."""

    def written(folder: Path, measured: MeasuredTrial) -> Path:
        arms = len(measured.times_s)
        covariance = np.zeros((4 + 2 * arms, 4 + 2 * arms))
        rows = [*range(1 + arms), *range(2 + arms, 2 + 2 * arms)]
        covariance[np.ix_(rows, rows)] = measured.covariance
        row = {
            "file": measured.file, "finger": "index", "failure": "", "discarded": "", "model": "ramp",
            "depth_mm": 0.4, "ramp_s": 0.08, "hold_s": 7.0, "estimates": {},
            "solid": {"stiffness_mn_per_mm": measured.stiffness_mn_per_mm.tolist(),
                      "times_s": measured.times_s.tolist(), "covariance": covariance.tolist()},
        }  # fmt: skip
        path = folder / "fits.json"
        path.write_text(json.dumps({"format": "indenter-fits", "trials": [row]}))
        return path

    return written
