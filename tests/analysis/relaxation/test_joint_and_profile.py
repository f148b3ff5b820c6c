"""One solid for many trials, and intervals that follow a lopsided error."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.recordings.trial import Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.joint import fit_joint
from analysis.relaxation.profile import profile_interval
from analysis.relaxation.windows import CannotFitError

Simulate = Callable[..., Trial]
WANTED = {"k0_mn_per_mm": 120.0, "A1_over_A0": 0.371, "A2_over_A0": 0.294, "t1_s": 2.279, "t2_s": 0.149}


def test_joint_fit_shares_the_solid_and_not_the_contact(simulate: Simulate):
    trials = [
        simulate(depth, seed=i, preload_mm=0.05 + 0.005 * i, offset_mn=i - 2.0, hold_s=3.0)
        for i, depth in enumerate((0.2, 0.4, 0.6, 0.8, 0.4, 0.6))
    ]
    useless = replace(trials[0], phases=())
    joint = fit_joint([*trials, useless])
    assert joint.used == (0, 1, 2, 3, 4, 5)
    assert joint.left_out[0][0] == 6
    assert "hold" in joint.left_out[0][1]
    alone = fit_trial(trials[3])
    for name, value in WANTED.items():
        estimate = joint.estimates[name]
        assert abs(estimate.value - value) < 5 * max(estimate.se, joint.repeat_se[name]), name
        assert 0.1 < joint.repeat_se[name] / estimate.se < 4, name
        if name in alone.estimates:
            assert estimate.se < alone.estimates[name].se, name
    np.testing.assert_allclose(joint.offset_mn, np.arange(6) - 2.0, atol=0.1)
    contacts = [t.surface.position_mm - 0.066 for t in (simulate(0.2, seed=i) for i in range(6))]
    np.testing.assert_allclose(joint.contact_mm, contacts, atol=0.002)


def test_joint_fit_counts_what_differs_from_trial_to_trial(simulate: Simulate):
    trials = [simulate(0.6, seed=i, k0=120.0 * (1 + 0.05 * (-1) ** i), hold_s=3.0) for i in range(6)]
    joint = fit_joint(trials)
    assert joint.repeat_se["k0_mn_per_mm"] > 10 * joint.estimates["k0_mn_per_mm"].se


def test_joint_fit_needs_two_trials(simulate: Simulate):
    with pytest.raises(CannotFitError, match="two trials"):
        fit_joint([simulate(0.4)])


def test_profile_is_the_standard_error_where_all_is_well_known(simulate: Simulate):
    trial = simulate(0.6, seed=4)
    row = fit_trial(trial)
    for name in ("t1_s", "t2_s", "A1_over_A0", "A2_over_A0"):
        interval = profile_interval(trial, name)
        estimate = row.estimates[name]
        assert interval.value == pytest.approx(estimate.value, rel=1e-6)
        assert interval.high - interval.value == pytest.approx(1.96 * estimate.se, rel=0.05)
        assert interval.value - interval.low == pytest.approx(1.96 * estimate.se, rel=0.05)


def test_profile_is_lopsided_where_a_time_is_poorly_known(simulate: Simulate):
    trial = simulate(0.2, hold_s=2.0, noise_mn=2.0, seed=0)
    interval = profile_interval(trial, "t1_s")
    assert interval.high - interval.value > 1.5 * (interval.value - interval.low) > 0
    hopeless = profile_interval(simulate(0.2, hold_s=0.5, noise_mn=4.0, seed=1), "t1_s")
    assert hopeless.high > 3 * hopeless.low


def test_profile_of_nonsense_is_refused(simulate: Simulate):
    with pytest.raises(ValueError, match="no profile"):
        profile_interval(simulate(0.4), "t3_s")
