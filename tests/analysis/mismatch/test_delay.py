"""Two channels that are some samples apart: a delay, whatever corners a ramp has, and no law in its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.model.effects import later, simulate
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans

SAMPLES = 1.3


def _read_late(trial: Trial, samples: float) -> Trial:
    """Return a trial whose position was read so many samples late."""
    at = np.arange(trial.n_samples, dtype=np.float64)
    return replace(trial, position_v=np.interp(at - samples, at, trial.position_v))


@pytest.fixture(scope="module")
def late(record: Callable[..., list[Trial]]) -> StudyFit:
    """The baseline of a study with quick ramps whose position was read late."""
    speeds = {"ramp_speed_mm_s": 10.0, "retract_speed_mm_s": 10.0}
    plans = study_plans(depths_mm=(0.4, 0.8), repeats=5, hold_s=1.0, dwell_s=0.4, **speeds)
    trials = [_read_late(t, SAMPLES) for t in record(81, "", plans)]
    return fit_baseline(take_in_memory(trials).trials)


@settings(deadline=None, max_examples=30)
@given(st.floats(-3.0, 3.0), st.floats(-1e3, 1e3))
def test_a_line_is_shifted(late: StudyFit, samples: float, slope_mn_s: float) -> None:
    """But at its ends, where nothing is before it."""
    trial = late.trials[0]
    line_mn = slope_mn_s * trial.time_s
    shifted_mn = slope_mn_s * (trial.time_s - samples / trial.sample_rate_hz)
    np.testing.assert_allclose(later(trial, line_mn, samples)[3:-3], shifted_mn[3:-3], atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(st.integers(-3, 3))
def test_where_cells_are_samples_whole_ones_are_shifted_exactly(late: StudyFit, samples: int) -> None:
    """Rows of forces as well as one: corners stay corners."""
    trial, state = late.trials[0], late.states[0]
    force_mn = simulate(trial, state, late.shared)
    alone = np.convolve(trial.counts == 1, np.ones(9), mode="same") > 8.5
    there = np.flatnonzero(alone)[10:-10]
    assert len(there) > 20
    rows = later(trial, np.stack([force_mn, 2.0 * force_mn]), samples)
    inside = there[alone[there - samples]]
    np.testing.assert_allclose(rows[0, inside], force_mn[inside - samples], atol=1e-9)
    np.testing.assert_allclose(rows[1], 2.0 * rows[0], atol=1e-9)


def test_a_position_that_is_late_draws_no_dashpot(late: StudyFit) -> None:
    """By a filter's tangent the same had been 0.2 samples, and a dashpot of 60 nats beside an adhesion."""
    assert Account(late).with_laws(()).nats == pytest.approx(Account(late).nats, abs=5.0)
    (template, *_) = (t for t in templates(late.trials) if t.name == "parallel_dashpot")
    dashpot = Account(late).with_laws((template.as_law(0.05),)).weighed_anew()
    nothing = dashpot.without("parallel_dashpot").reweighed()
    assert dashpot.gain_by_itself(nothing)[0] < ENOUGH_SHARED
    assert dashpot.fit.shared.delay_samples == pytest.approx(-SAMPLES, abs=0.5)
