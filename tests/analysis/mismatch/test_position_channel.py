"""The lever's position given its command: what is an output's, and what is unknown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.locate.position_channel import look_at_position
from analysis.mismatch.report import wording
from analysis.mismatch.report.windows import servo_named
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import TrialPlan, study_plans

RATE_HZ = 8000.0


@pytest.mark.parametrize(("later_samples", "known"), [(0.0, True), (1.0, True), (4.0, False)])
def test_an_output_that_steps_is_half_a_sample_late_at_any_speed(
    bench_trials: Callable[[str, Sequence[TrialPlan]], list[Trial]], later_samples: float, known: bool
) -> None:
    """So may two converters be apart, by as many samples as force and position may: no more."""
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
    assert not known or found.late_s == pytest.approx((0.5 + later_samples) / RATE_HZ, rel=0.05)


def test_a_delay_is_no_other_servo_nor_another_servo_a_delay(
    bench_trials: Callable[[str, Sequence[TrialPlan]], list[Trial]],
) -> None:
    """By the shape of its corners: of 0.17 ms more at 2 mm/s a third of a micrometre, and 15 nats."""
    plans = study_plans(
        depths_mm=(0.3, 0.7),
        repeats=4,
        ramp_speed_mm_s=2.0,
        retract_speed_mm_s=4.0,
        hold_s=1.0,
    )
    slower = "seed = 32\n[lever]\nnatural_frequency_rad_s = 3500.0\ndamping_ratio = 1.0\n"
    intake = take_in_memory(bench_trials(slower, plans))
    found = look_at_position(intake.trials, np.random.default_rng(1))
    assert found is not None
    assert not found.late_s
    assert servo_named(cast(Diagnosis, SimpleNamespace(position=found, intake=intake)))
    as_late = take_in_memory([_read_late(t, 1.4) for t in bench_trials("seed = 33\n", plans)])
    found = look_at_position(as_late.trials, np.random.default_rng(1))
    assert found is not None
    assert found.late_s == pytest.approx(1.4 / RATE_HZ, rel=0.1)
    said = SimpleNamespace(position=found, intake=as_late)
    assert not servo_named(cast(Diagnosis, said))
    assert "a delay of 1.4 samples" in wording.late(found, RATE_HZ)[0]


def _read_late(trial: Trial, samples: float) -> Trial:
    """Return a trial whose position was read so many samples late."""
    at = np.arange(trial.n_samples, dtype=np.float64)
    return replace(trial, position_v=np.interp(at - samples, at, trial.position_v))


@pytest.mark.parametrize(("speed_mm_s", "named"), [(8.0, True), (1.0, False)], ids=["shows", "hardly shows"])
def test_a_servo_s_lag_is_known_better_than_its_frequency(
    bench_trials: Callable[[str, Sequence[TrialPlan]], list[Trial]], speed_mm_s: float, named: bool
) -> None:
    """One that lags by 40 us less is off by a third of a micrometre at 8 mm/s, and by twice that at kinks of 16."""
    text = "seed = 32\n[lever]\nnatural_frequency_rad_s = 5978.0\ndamping_ratio = 1.075\n"
    plans = study_plans(repeats=3, ramp_speed_mm_s=2.0 * speed_mm_s, retract_speed_mm_s=2.0 * speed_mm_s)
    intake = take_in_memory(bench_trials(text, plans))
    found = look_at_position(intake.trials, np.random.default_rng(1))
    assert found is not None
    assert found.lag_error < 0.1 * found.standard_errors[0]
    wn, zeta = intake.servo.of_lines
    assert 2.0 * zeta / wn == pytest.approx(2.0 * 1.075 / 5978.0, abs=1e-5)
    # of fewer trials, or slower samples, its frequency would tell no servo from another
    unsure = replace(found, standard_errors=(0.07, 0.07))
    assert servo_named(cast(Diagnosis, SimpleNamespace(position=unsure, intake=intake))) is named
