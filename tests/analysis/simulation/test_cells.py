"""Recordings cut into cells: fine where skin lets go, which is later than where the force first comes down."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from analysis.mismatch.study.intake import take_in_memory

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans

CLINGING = (
    'seed = 5\n[specimens]\npublished_tissue = true\n[[effects]]\nname = "adhesion"\npull_off_mn = 6.0\n'
)


def test_cells_are_single_samples_until_the_skin_has_let_go() -> None:
    trials = bench_trials(CLINGING, study_plans(depths_mm=(0.4,), repeats=1, hold_s=0.5, dwell_s=0.2))
    (cells,) = take_in_memory(trials).trials
    least = int(np.argmin(np.where(cells.retracting, cells.force_mn, np.inf)))
    # the pull lasts longer than what is fine about the first zero of the force
    assert cells.force_mn[least] - cells.offset_start_mn < -5.0
    np.testing.assert_array_equal(cells.counts[least - 8 : least + 9], 1.0)
    first = int(np.flatnonzero(cells.retracting & (cells.force_mn < cells.offset_start_mn))[0])
    assert cells.time_s[least] - cells.time_s[first] > 0.003
    assert cells.counts.sum() == len(cells.full_force_mn)
