"""A coarse pad under the punch, solved once a session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ngsolve")

from analysis.fingertip.commands import need_solver
from analysis.fingertip.fits_file import MeasuredTrial
from analysis.fingertip.pad_file import PadFile, read_pad
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.reduced import PunchPad


def coarse(pad: PadFile) -> PadFile:
    """Return the pad with a mesh for tests: a second's work."""
    sizes = {"order": 2, "contact_size_mm": 0.05, "size_mm": 1.2}
    return pad.model_copy(update={"mesh": pad.mesh.model_copy(update=sizes)})


@pytest.fixture(scope="session")
def coarse_pad() -> PadFile:
    """The shipped pad on a coarse mesh."""
    need_solver()
    return coarse(read_pad(None))


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of this session's own."""
    return tmp_path_factory.mktemp("pads")


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
