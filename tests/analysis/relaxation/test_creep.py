"""A pause in which force was held: the same solid from its creep, against the relaxation's own law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.recordings.trial import Calibration, Event, Phase, Trial
from analysis.relaxation.creep import solid_of
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.prediction import fitted_curve
from analysis.relaxation.response import arm_response, force_response

ARMS = ((44.52, 2.279), (35.28, 0.149))  # stiffness, time
# the compliance of 120 mN/mm beside these arms: checked below against the relaxation's law
GLASS, PARTS, LAGS = 0.005005005, (0.00102555, 0.00230278), (0.18024788, 3.13671212)
HELD_MN, RAMP_S, PAUSE_S = 50.0, 0.15, 8.0


def creeping(seed: int, rate_hz: float = 200.0, exponent: float = 1.0, noise_mm: float = 2e-4) -> Trial:
    """Return a trial whose force rises in a ramp and is held, the punch pressing as depth^exponent."""
    rng = np.random.default_rng([5, seed])
    finer = 20
    fine_s = np.arange(int((1 + RAMP_S + PAUSE_S) * rate_hz) * finer) / (rate_hz * finer)
    force_mn = HELD_MN * np.clip((fine_s - 1.0) / RAMP_S, 0.0, 1.0)
    level = GLASS * force_mn
    for compliance, lag in zip(PARTS, LAGS, strict=True):
        level = level + compliance * (force_mn - arm_response(force_mn, 1 / (rate_hz * finer), lag))
    again = force_response(level, 1 / (rate_hz * finer), 120.0, ARMS)
    np.testing.assert_allclose(again, force_mn, atol=1e-2)  # straight between samples, both
    depth = 0.5 * (level / 0.5) ** (1 / exponent)
    position_mm = np.where(fine_s < 1.0, -0.5 * (1.0 - fine_s), depth)[::finer]
    n = len(position_mm)
    pause = int(np.ceil((1 + RAMP_S) * rate_hz))
    return Trial(
        trial_id="creep",
        started="2026-01-31T12:00:00+01:00",
        kind="ramp_hold_retract",
        source="imported",
        status="complete",
        sample_rate_hz=rate_hz,
        position_v=position_mm + rng.normal(size=n) * noise_mm,
        force_v=force_mn[::finer] + rng.normal(size=n) * 0.05,
        command_v=None,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        phases=(Phase("approach", 0, int(rate_hz)), Phase("ramp", int(rate_hz), pause)),
        events=(Event(pause, "force_held", "force held at 50 mN for 8 s"),),
    )


@given(
    st.floats(0.1, 1e3),
    st.floats(0.05, 5.0),
    st.floats(0.05, 5.0),
    st.floats(0.01, 1.0),
    st.floats(3.0, 50.0),
)
@settings(max_examples=50, deadline=None)
def test_compliance_and_modulus_are_reciprocal(k0, first, second, lag, apart):
    """The solid found has, to a step of depth, the force that gives that step back by its creep."""
    glass, parts, lags = 1.0 / k0, np.array([first, second]) / k0, np.array([lag, lag * apart])
    stiffness, times_s = solid_of(glass, parts, lags)
    assert np.all(stiffness > 0)
    assert times_s[0] > times_s[1] > 0
    for s in (0.01 / lag, 1.0 / lag, 100.0 / lag):
        compliance = glass + np.sum(parts / (1.0 + s * lags))
        modulus = stiffness[0] + np.sum(stiffness[1:] * s * times_s / (1.0 + s * times_s))
        assert modulus * compliance == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("rate_hz", "exponent"), [(200.0, 1.0), (50.0, 1.0), (200.0, 1.5)])
def test_the_solid_is_found_from_its_creep(rate_hz: float, exponent: float):
    row = fit_trial(creeping(1, rate_hz, exponent), exponent=exponent if exponent != 1.0 else None)
    assert row.fitted, row.failure
    assert row.creep
    assert np.isnan(fitted_curve(creeping(1, rate_hz, exponent), row).fitted_mn).all()
    assert "no phase named hold" in row.flags
    for name, value in (("t1_s", 2.279), ("t2_s", 0.149), ("A1_over_A0", 0.371), ("A2_over_A0", 0.294)):
        estimate = row.estimates[name]
        assert estimate.value == pytest.approx(value, rel=0.06), name
        assert abs(estimate.value - value) < 5 * estimate.se, name


def test_intervals_hold():
    """Of 40 trials with four intervals of 95 % each 137 to 160 hold: false failures in 1 of 10,000."""
    names = {"t1_s": 2.279, "t2_s": 0.149, "A1_over_A0": 0.371, "A2_over_A0": 0.294}
    inside = 0
    for seed in range(40):
        row = fit_trial(creeping(100 + seed, 50.0))
        inside += sum(abs(row.estimates[n].value - v) < 1.96 * row.estimates[n].se for n, v in names.items())
    assert 137 <= inside <= 160


def test_the_step_model_refuses_a_creep():
    row = fit_trial(creeping(0), "step")
    assert "no phase named hold" in row.failure
    assert "force held at 50 mN" in row.failure


def test_a_creep_that_begins_in_contact_is_refused():
    trial = creeping(0)
    cut = 230
    begun = replace(
        trial,
        position_v=trial.position_v[cut:],
        force_v=trial.force_v[cut:],
        phases=(),
        events=(replace(trial.events[0], sample=0),),
    )
    row = fit_trial(begun)
    assert not row.fitted
    assert "begins in contact" in row.failure
    assert "no phase named hold" in row.flags
