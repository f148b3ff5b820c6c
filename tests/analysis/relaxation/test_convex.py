"""Convex punches: the exponent beside the relaxation, at any rate, and what is said where it is not told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.recordings.trial import Trial
from analysis.relaxation.block_response import block_answer, block_rows
from analysis.relaxation.blocks import condense
from analysis.relaxation.contact import find_contact
from analysis.relaxation.contact_law import ContactLaw
from analysis.relaxation.convex_response import convex_answer, law_knots
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.joint import fit_joint
from analysis.relaxation.prediction import fitted_curve
from analysis.relaxation.profile import profile_interval
from analysis.relaxation.windows import cut_window

Convex = Callable[..., Trial]
NAMES = ("t1_s", "t2_s", "A1_over_A0", "A2_over_A0")
# rate, and what a recording of that rate can be of: the faster time lasts some samples
RECORDINGS: dict[float, dict[str, Any]] = {
    5.0: {"times_s": (40.0, 4.0), "hold_s": 100.0, "ramp_s": 8.0},
    10.0: {"times_s": (40.0, 4.0), "hold_s": 100.0, "ramp_s": 8.0},
    50.0: {"ramp_s": 0.3},
    100.0: {"ramp_s": 0.2},
    2000.0: {},
    1e5: {"times_s": (0.3, 0.03), "hold_s": 1.0},
}


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("rate_hz", list(RECORDINGS))
def test_exponent_and_times_at_any_rate(convex: Convex, rate_hz: float, exponent: float):
    kind = RECORDINGS[rate_hz]
    row = fit_trial(convex(exponent, rate_hz=rate_hz, seed=3, signal_to_noise=2000.0, **kind))
    assert row.fitted, row.failure
    assert row.exponent is not None
    assert row.exponent.value == pytest.approx(exponent, abs=0.05)
    for name, true_s in zip(("t1_s", "t2_s"), kind.get("times_s", (2.279, 0.149)), strict=True):
        assert row.estimates[name].value == pytest.approx(true_s, rel=0.03), name
    assert row.estimates["A0_mn"].value == pytest.approx(48.0, rel=0.01)
    assert row.estimates["A1_over_A0"].value == pytest.approx(0.371, rel=0.03)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_unevenly_sampled(convex: Convex, exponent: float):
    trial = convex(exponent, rate_hz=50.0, ramp_s=0.3, seed=5, signal_to_noise=2000.0, uneven=True)
    row = fit_trial(trial)
    assert row.exponent is not None
    assert row.exponent.value == pytest.approx(exponent, abs=0.05)
    assert row.estimates["t2_s"].value == pytest.approx(0.149, rel=0.03)


def test_exponent_can_be_said(convex: Convex):
    trial = convex(1.5, rate_hz=100.0, ramp_s=0.2, signal_to_noise=500.0)
    said, asked = fit_trial(trial, exponent=1.5), fit_trial(trial)
    assert said.exponent is None
    assert said.solid is not None
    assert said.solid.exponent == 1.5
    assert "exponent" not in said.solid.parameters
    for name in NAMES:
        assert said.estimates[name].value == pytest.approx(asked.estimates[name].value, rel=0.02)
        assert said.estimates[name].se <= 1.01 * asked.estimates[name].se


def test_slopes_of_the_answer_are_its_derivatives(convex: Convex):
    window = cut_window(convex(1.5, rate_hz=200.0, signal_to_noise=500.0))
    contact_mm, reference_mm, times_s = 0.3017, 0.4, [2.0, 0.1]
    blocks = law_knots(condense(window, find_contact(window).sample), contact_mm, reference_mm)
    flat, same = (
        block_answer(blocks, contact_mm, times_s),
        convex_answer(blocks, contact_mm, times_s, ContactLaw(1.0, reference_mm)),
    )
    np.testing.assert_allclose(same.rows, flat.rows, atol=1e-12)
    np.testing.assert_allclose(same.contact_slopes, flat.contact_slopes, atol=1e-9)
    np.testing.assert_allclose(same.tau_slopes, flat.tau_slopes, atol=1e-9)
    step = 1e-6
    for exponent in (1.3, 2.0):
        answer = convex_answer(blocks, contact_mm, times_s, ContactLaw(exponent, reference_mm))

        def rows(p: float = exponent, c: float = contact_mm, t: float = times_s[1]) -> np.ndarray:
            return block_rows(blocks, c, [times_s[0], t], ContactLaw(p, reference_mm).level)

        by_p = (rows(p=exponent + step) - rows(p=exponent - step)) / (2 * step)
        by_c = (rows(c=contact_mm + step) - rows(c=contact_mm - step)) / (2 * step)
        by_t = (rows(t=times_s[1] + step) - rows(t=times_s[1] - step)) / (2 * step)
        np.testing.assert_allclose(answer.exponent_slopes, by_p, atol=1e-7)
        np.testing.assert_allclose(answer.contact_slopes, by_c, atol=1e-5)
        np.testing.assert_allclose(answer.tau_slopes[1], by_t[2], atol=1e-7)


def test_fitted_curve_profile_and_joint_follow_the_law(convex: Convex):
    trials = [convex(2.0, rate_hz=100.0, ramp_s=0.2, seed=seed, signal_to_noise=500.0) for seed in range(3)]
    row = fit_trial(trials[0])
    curve = fitted_curve(trials[0], row)
    assert np.std(curve.force_mn - curve.fitted_mn) < 2 * curve.force_mn.max() / 500.0
    interval = profile_interval(trials[0], "t2_s")
    estimate = row.estimates["t2_s"]
    assert interval.low == pytest.approx(estimate.value - 1.96 * estimate.se, rel=0.05)
    joint = fit_joint(trials)
    assert joint.law.exponent == pytest.approx(2.0, abs=0.1)
    assert joint.estimates["t1_s"].value == pytest.approx(2.279, rel=0.02)
    assert joint.estimates["t1_s"].se < estimate.se + row.estimates["t1_s"].se


def test_a_single_time_is_not_told_as_two(convex: Convex):
    row = fit_trial(convex(1.0, shares=(0.4, 0.0), signal_to_noise=100.0, ramp_s=0.2))
    if row.fitted:
        assert {"t1_s", "t2_s"} & row.untold.keys()
        assert "times_not_identifiable" in row.flags
    for name, estimate in row.estimates.items():
        assert estimate.se < abs(estimate.value), name


def test_a_hold_that_never_levels_off_says_so(convex: Convex):
    trial = convex(1.5, shares=(40.0, 10.0), times_s=(300.0, 0.5), k0=2.0, signal_to_noise=2000.0, ramp_s=0.2)
    row = fit_trial(trial)
    told = {**row.estimates}
    assert "A0_mn" not in told or told["A0_mn"].se < 0.5 * told["A0_mn"].value
    if not row.fitted:
        assert "still falls at the end of the hold" in row.failure


def test_start_in_contact_keeps_the_flat_law(convex: Convex):
    trial = convex(1.5, rate_hz=100.0, ramp_s=0.4, signal_to_noise=500.0)
    inside = int(np.flatnonzero(trial.position_mm > 0.45)[0])
    cut = replace(
        trial,
        position_v=trial.position_v[inside:],
        force_v=trial.force_v[inside:],
        phases=tuple(
            replace(p, start=max(0, p.start - inside), stop=p.stop - inside) for p in trial.phases[1:]
        ),
    )
    row = fit_trial(cut)
    assert row.exponent is None
    assert "contact_not_seen" in row.flags or not row.fitted
