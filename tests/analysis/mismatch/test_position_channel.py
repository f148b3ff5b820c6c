"""The lever's position given its command: what is an output's, and what is unknown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.locate.position_channel import look_at_position
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import TrialPlan, study_plans

RATE_HZ = 8000.0


@pytest.mark.parametrize(("later_samples", "known"), [(0.0, True), (1.0, False)])
def test_an_output_that_steps_is_half_a_sample_late_at_any_speed(
    bench_trials: Callable[[str, Sequence[TrialPlan]], list[Trial]], later_samples: float, known: bool
) -> None:
    text = "seed = 31\n[converters]\nstepwise_output = true\n"
    trials = bench_trials(text, study_plans(repeats=3, ramp_speed_mm_s=20.0, retract_speed_mm_s=20.0))
    intake = take_in_memory(trials)
    later = [
        replace(t, servo_residual_mm=t.servo_residual_mm - later_samples / RATE_HZ * t.velocity_mm_s)
        for t in intake.trials
    ]
    found = look_at_position(later, np.random.default_rng(1))
    assert found is not None
    assert (len(found.unknown_bins) == 0) == known
