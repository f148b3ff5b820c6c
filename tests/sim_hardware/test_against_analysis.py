"""Two independent accounts of the same physics: what the bench plays, the analysis finds."""

from __future__ import annotations

from typing import Any

import pytest

from analysis.relaxation.fit import fit_trial
from sim_hardware.concealment.offline import study_plans

TRUTH = {"A1_over_A0": 0.371, "A2_over_A0": 0.294, "t1_s": 2.279, "t2_s": 0.149}


@pytest.mark.parametrize("seed", [2, 3])
def test_a_ramp_fit_finds_the_tissue_of_the_bench(bench_trials: Any, seed: int) -> None:
    """8 fits of 5 numbers, none further off than 5 of its standard errors: fails by chance once in 40,000."""
    settings = f"seed = {seed}\n[specimens]\npublished_tissue = true"
    for trial in bench_trials(settings, study_plans(repeats=1)):
        row = fit_trial(trial)
        assert not row.failure
        for name, true in TRUTH.items():
            found = row.estimates[name]
            assert abs(found.value - true) < 5 * found.se, name
        assert row.stiffness_mn_per_um == pytest.approx(0.120, rel=1e-3)
        assert row.rms_mn == pytest.approx(0.3, rel=0.02)
