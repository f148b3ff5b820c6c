"""The ramp fit: exact without noise, unbiased with it, whatever of the recording is missing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.recordings.trial import NativeSamples, Trial
from analysis.relaxation.block_response import sampled_force
from analysis.relaxation.blocks import condense
from analysis.relaxation.contact import find_contact
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.motion import curved_stretches, positions_at, servo_answer, straight_pieces
from analysis.relaxation.ramp_fit import fit_ramp
from analysis.relaxation.windows import cut_window

Simulate = Callable[..., Trial]


@pytest.mark.parametrize("depth_mm", [0.2, 0.8])
def test_noise_free_trial_gives_the_truth(simulate: Simulate, truth: dict[str, float], depth_mm: float):
    row = fit_trial(simulate(depth_mm, noise_mn=0.0, position_noise_mm=0.0, offset_mn=1.7))
    assert row.failure == ""
    for name, value in truth.items():
        if name in row.estimates:
            assert row.estimates[name].value == pytest.approx(value, rel=2e-4), name
    assert row.stiffness_mn_per_um == pytest.approx(0.12, rel=1e-4)
    assert row.solid is not None
    assert row.solid.offset_mn == pytest.approx(1.7, abs=2e-3)
    assert row.estimates["A0_mn"].value == pytest.approx(120 * (depth_mm + 0.066), rel=1e-4)


@pytest.mark.parametrize("changes", [{}, {"with_command": False}, {"preload_mm": 0.05}, {"short_mm": 0.02}])
def test_estimates_lie_within_their_errors(
    simulate: Simulate, truth: dict[str, float], changes: dict[str, float]
):
    # five standard errors, 5 estimates, 4 cases: false failure below 2e-5
    row = fit_trial(simulate(0.4, seed=3, **changes))
    for name in ("A1_over_A0", "A2_over_A0", "t1_s", "t2_s"):
        estimate = row.estimates[name]
        assert abs(estimate.value - truth[name]) < 5 * estimate.se, name
        assert estimate.se < 0.01 * estimate.value, name
    assert row.rms_mn == pytest.approx(0.3, rel=0.02)
    assert row.flags == ""


@pytest.mark.parametrize("n_arms", [1, 3])
def test_other_numbers_of_arms(simulate: Simulate, n_arms: int):
    arms = ((0.4, 2.5), (0.3, 0.4), (0.2, 0.05))[:n_arms]
    trial = simulate(0.8, arms=arms, noise_mn=0.02, position_noise_mm=1e-5)
    found = fit_ramp(cut_window(trial), n_arms)
    np.testing.assert_allclose(found.times_s, [tau for _, tau in arms], rtol=0.03)
    np.testing.assert_allclose(found.stiffness_mn_per_mm[1:] / 120.0, [k for k, _ in arms], rtol=0.03)
    with pytest.raises(ValueError, match="arms"):
        fit_ramp(cut_window(trial), 5)


def test_unevenly_sampled_import_is_used_as_it_was_taken(simulate: Simulate, truth: dict[str, float]):
    trial = simulate(0.4, noise_mn=0.02, position_noise_mm=0.0)
    phases = {phase.name: phase for phase in trial.phases}
    kept = np.unique(
        np.concatenate(
            [
                np.arange(0, phases["dwell"].start + 400, 16),
                np.arange(phases["dwell"].start, phases["ramp"].start, 400),
                np.arange(phases["ramp"].start - 40, phases["hold"].start + 80, 4),
                phases["hold"].start + np.geomspace(80, 55000, 600).astype(int),
            ]
        )
    )
    native = NativeSamples(trial.time_s[kept], trial.position_mm[kept], trial.force_mn[kept])
    row = fit_trial(replace(trial, native=native, command_v=None))
    assert row.n_samples == len(kept)
    for name in ("A1_over_A0", "A2_over_A0", "t1_s", "t2_s"):
        assert row.estimates[name].value == pytest.approx(truth[name], rel=0.01), name


def test_sampled_force_has_the_block_means(simulate: Simulate):
    window = cut_window(simulate(0.6, noise_mn=0.0))
    contact = find_contact(window)
    blocks = condense(window, contact.sample)
    found = fit_ramp(window)
    force = (
        sampled_force(blocks, found.contact_mm, found.stiffness_mn_per_mm, found.times_s) + found.offset_mn
    )
    assert len(force) == len(window.time_s) - 1
    means = np.add.reduceat(force, blocks.edges[:-1]) / blocks.counts
    assert np.abs(means - blocks.force_mn).max() < 0.2
    assert len(blocks.counts) < 800


def test_contact_is_found_within_micrometres(simulate: Simulate):
    trial = simulate(0.4, seed=9)
    contact = find_contact(cut_window(trial))
    assert contact.seen
    assert contact.position_mm == pytest.approx(trial.surface.position_mm - 0.066, abs=0.004)


def test_recording_that_begins_in_contact_says_so(simulate: Simulate):
    trial = simulate(0.4)
    start = trial.phases[1].start + 800
    cut = replace(
        trial,
        position_v=trial.position_v[start:],
        force_v=trial.force_v[start:],
        command_v=trial.command_v[start:],
        surface=None,
        phases=tuple(
            replace(phase, start=max(0, phase.start - start), stop=phase.stop - start)
            for phase in trial.phases[1:]
        ),
    )
    row = fit_trial(cut)
    assert "contact_not_seen" in row.flags
    # what the tissue still remembers of the approach is unknown to such a recording
    assert row.estimates["t2_s"].value == pytest.approx(0.149, rel=0.05)
    assert row.stiffness_mn_per_um == pytest.approx(0.12, rel=0.05)


def test_servo_is_the_second_order_system():
    rate, wn = 80000.0, 5.0e3
    time_s = np.arange(4000) / rate
    step = servo_answer(np.where(time_s > 0, 1.0, 0.0), 1 / rate)
    settled = np.interp(1.0 / rate + np.array([0.2e-3, 1e-3]), time_s, step)
    want = [1 - (1 + wn * t) * np.exp(-wn * t) for t in (0.2e-3, 1e-3)]
    np.testing.assert_allclose(settled, want, atol=0.04)
    ramp = servo_answer(5.0 * time_s, 1 / rate)
    assert 5.0 * time_s[-1] - ramp[-1] == pytest.approx(5.0 * 2 / wn, rel=1e-6)


def test_straight_pieces_reproduce_straight_pieces():
    knots = np.array([0, 3, 50, 51, 400, 999])
    values = np.interp(np.arange(1000), knots, [1.0, 2.0, -1.0, 5.0, 5.0, 4.0])
    np.testing.assert_allclose(straight_pieces(values, knots), values[knots], atol=1e-9)


@pytest.mark.parametrize("with_command", [True, False])
def test_smoothed_motion_is_closer_than_the_recording(simulate: Simulate, with_command: bool):
    noisy = cut_window(simulate(0.6, seed=4, with_command=with_command))
    clean = cut_window(simulate(0.6, seed=4, position_noise_mm=0.0))
    curved = curved_stretches(noisy)
    edges = condense(noisy, 4000).edges
    missed = positions_at(noisy, edges, curved) - clean.position_mm[edges]
    assert np.sqrt(np.mean(missed**2)) < 0.16e-3
    if with_command:
        inside = np.any((edges[:, None] >= curved[:, 0]) & (edges[:, None] < curved[:, 1]), axis=1)
        assert np.abs(missed[inside]).max() < 0.15e-3


def test_a_command_channel_that_was_not_wired_is_not_believed(simulate: Simulate, truth: dict[str, float]):
    trial = simulate(0.4, seed=5)
    unwired = replace(trial, command_v=np.zeros_like(trial.command_v))
    assert fit_trial(unwired).estimates["t2_s"].value == pytest.approx(truth["t2_s"], rel=0.02)
