"""The published procedure: right for an ideal step, biased by the ramp exactly as the formula says."""

from collections.abc import Callable

import numpy as np
import pytest

from analysis.recordings.trial import Trial
from analysis.relaxation.constants import ramp_bias
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.step_fit import fit_step
from analysis.relaxation.windows import cut_window


@pytest.mark.parametrize("depth_mm", [0.2, 0.4, 0.6, 0.8])
def test_bias_follows_the_formula(simulate: Callable[..., Trial], depth_mm: float):
    trial = simulate(depth_mm, noise_mn=0.0, position_noise_mm=0.0, preload_mm=0.0, dwell_s=0.0)
    found = fit_step(cut_window(trial))
    for i, (share, tau) in enumerate(((0.371, 2.279), (0.294, 0.149))):
        want = 120 * depth_mm * share * ramp_bias(depth_mm / 5.0, tau)
        assert found.amplitudes_mn[1 + i] == pytest.approx(want, rel=0.01)
        assert found.times_s[i] == pytest.approx(tau, rel=0.01)
    assert fit_trial(trial, "step").r2 > 0.98


def test_step_row_has_its_own_meaning_of_stiffness(simulate: Callable[..., Trial]):
    row = fit_trial(simulate(0.4, seed=2), "step")
    assert row.stiffness_mn_per_um == pytest.approx(row.estimates["A0_mn"].value / 400.0)
    assert row.n_samples == pytest.approx(7.0 * 8000, abs=2)
    assert row.solid is None


def test_plain_curve_fit_agrees(simulate: Callable[..., Trial]):
    from scipy.optimize import curve_fit

    window = cut_window(simulate(0.4, seed=8))
    t = window.time_s[window.hold_start :] - window.time_s[window.hold_start]
    force = window.force_mn[window.hold_start :]
    found = fit_step(window)
    start = [50, 15, 10, 2.0, 0.1]
    best, covariance = curve_fit(
        lambda t, a, b, c, t1, t2: a + b * np.exp(-t / t1) + c * np.exp(-t / t2), t, force, start
    )
    errors = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose([*found.amplitudes_mn, *found.times_s], best, atol=0.1 * errors.max())
    own = np.sqrt(np.diag(found.covariance)) * [1, 1, 1, *found.times_s]
    np.testing.assert_allclose(own, errors, rtol=0.15)
