from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import calibrate, scan, target_of
from analysis.fingertip.fits_file import MeasuredTrial, mean_trial
from analysis.fingertip.viscoelastic import Prony, relaxation


def test_the_reduced_pad_is_the_full_mesh_at_the_ratios_it_was_made_of(punch):
    found = [punch.stiffness(punch.layer_moduli(r)) for r in punch.ratios]
    np.testing.assert_allclose(found, punch.exact, rtol=1e-9)


def test_a_homogeneous_pad_has_the_measured_relaxation(punch, measured):
    found = calibrate(punch, target_of(measured), "homogeneous", 1.0, 2)
    assert found.core.relaxed_kpa == pytest.approx(120 / punch.stiffness(punch.layer_moduli(1.0)), rel=1e-6)
    assert found.core.g == pytest.approx([0.371 / 1.665, 0.294 / 1.665], rel=1e-5)
    assert [t for _, t in found.core.arms] == pytest.approx([2.279, 0.149], rel=1e-5)
    assert found.rms_share < 1e-6
    # its errors are the trial's own
    assert found.errors() == pytest.approx(
        [0.05 / 120, 0.1 / (120 * 0.371), 0.1 / (120 * 0.294), 2e-3, 3e-3], rel=1e-3
    )


def test_force_alone_cannot_choose_between_the_ratios(punch, measured):
    found = scan(punch, target_of(measured), 2, (0.02, 0.1, 0.4, 1.0))
    assert all(pad.rms_share < 1e-3 for pad in found)
    assert all(pad.core.relaxed_kpa / pad.epidermis.relaxed_kpa == pytest.approx(pad.ratio) for pad in found)
    moduli = [pad.core.relaxed_kpa for pad in found]
    assert moduli == sorted(moduli)


def test_what_is_known_of_a_pad_comes_back(punch):
    epidermis, core = Prony(600.0), Prony(60.0, ((50.0, 2.0), (40.0, 0.15)))
    truth = relaxation(punch.layers, [epidermis, core, core])
    # its answer to a ramp, in as many arms as it has
    trial = MeasuredTrial(
        "", "", "ramp", 0.4, 0.08, 7.0, np.array([truth.relaxed_mn_per_mm, *truth.arms_mn_per_mm]), truth.times_s,
        np.diag(np.full(1 + 2 * len(truth.times_s), 1e-8)),
    )  # fmt: skip
    found = calibrate(punch, target_of(trial), "layered", 0.1, 2)
    assert found.core.relaxed_kpa == pytest.approx(60, rel=1e-4)
    np.testing.assert_allclose(found.core.arms, core.arms, rtol=1e-2)


def test_a_step_fit_is_taken_as_a_step_fit(punch, measured):
    """The ramp makes a step fit's fast arm too small; a pad driven by the ramp undoes it."""
    kept = 0.149 / 0.08 * -np.expm1(-0.08 / 0.149)
    seen = measured.stiffness_mn_per_mm * [1, 2.279 / 0.08 * -np.expm1(-0.08 / 2.279), kept]
    step = replace(measured, model="step", stiffness_mn_per_mm=seen)
    found = calibrate(punch, target_of(step), "homogeneous", 1.0, 2)
    assert found.core.g == pytest.approx([0.371 / 1.665, 0.294 / 1.665], rel=1e-4)


def test_the_mean_of_trials_has_the_error_of_their_scatter(measured):
    rng = np.random.default_rng(1)
    trials = [
        replace(
            measured, stiffness_mn_per_mm=measured.stiffness_mn_per_mm * (1 + 0.1 * rng.standard_normal())
        )
        for _ in range(20)
    ]
    mean = mean_trial(trials)
    k0 = np.array([t.stiffness_mn_per_mm[0] for t in trials])
    assert np.sqrt(mean.covariance[0, 0]) == pytest.approx(k0.std(ddof=1) / np.sqrt(20))
    with pytest.raises(BadInputError, match="mix models"):
        mean_trial([measured, replace(measured, model="step")])
