"""A trial of the simulated bench in cells, for tests of single laws."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from analysis.mismatch.study.intake import take_in_memory
from analysis.simulation.cells import CellTrial

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans


@pytest.fixture(scope="session")
def trial() -> CellTrial:
    plans = study_plans(depths_mm=(0.4,), repeats=1)
    return take_in_memory(bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)).trials[0]
