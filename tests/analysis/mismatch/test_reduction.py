"""Trials in cells: a sample counts once, and what was interpolated between samples is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.recordings.trial import NativeSamples, Trial
from analysis.simulation.arm_path import SLOW_SMOOTHING_S
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Tissue
from analysis.simulation.motion import estimate_motion
from analysis.simulation.reduction import reduce_trial
from analysis.simulation.response import Steps, arms_force
from sim_hardware.concealment.offline import study_plans

FloatArray = NDArray[np.float64]


@pytest.fixture(scope="module")
def trial(record: Callable[..., list[Trial]]) -> Trial:
    return record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=1.0, dwell_s=0.2))[0]


def reduced(trial: Trial) -> CellTrial:
    return reduce_trial(trial, estimate_motion(trial))


def taken_at(trial: Trial, times_s: FloatArray) -> Trial:
    """Return the trial as if its samples had been taken at these times only."""
    position_mm, force_mn = (np.interp(times_s, trial.time_s, s) for s in (trial.position_mm, trial.force_mn))
    return replace(trial, native=NativeSamples(times_s, position_mm, force_mn))


def test_samples_that_were_evenly_taken_make_the_same_cells_either_way(trial: Trial) -> None:
    plain = reduced(trial)
    native = NativeSamples(trial.time_s, trial.position_mm, trial.force_mn)
    same = reduced(replace(trial, native=native))
    np.testing.assert_array_equal(same.starts, plain.starts)
    np.testing.assert_array_equal(same.phase, plain.phase)
    for name in ("counts", "time_s", "position_mm", "velocity_mm_s", "force_mn", "widths_s", "full_time_s"):
        np.testing.assert_allclose(getattr(same, name), getattr(plain, name), atol=1e-9, err_msg=name)


@pytest.mark.parametrize("speed_mm_s", [5.0, 20.0])
def test_a_simulation_by_cells_is_one_by_samples(
    record: Callable[..., list[Trial]], speed_mm_s: float
) -> None:
    """What the cells lose of it is far below the noise of a study, 0.25 mN a sample."""
    plans = study_plans(depths_mm=(0.8,), repeats=1, hold_s=1.0, dwell_s=0.2, ramp_speed_mm_s=speed_mm_s)
    (trial,) = record(45, plans=plans)
    motion = estimate_motion(trial)
    cells = reduce_trial(trial, motion)
    tissue, z0_mm = Tissue(120.0, 44.0, 2.3, 35.0, 0.15), cells.z0_start_mm
    depth_mm = np.maximum(motion.position_mm - z0_mm, 0.0)
    times, weights = np.array([tissue.tau1, tissue.tau2]), np.array([tissue.k1, tissue.k2])
    force_mn = tissue.k0 * depth_mm + arms_force(depth_mm, Steps.between(trial.time_s), times, weights)
    by_samples = np.add.reduceat(np.maximum(force_mn, 0.0), cells.starts) / cells.counts
    lost = simulate_force(cells, tissue, PerTrial(z0_mm, 0.0)) - by_samples
    z = lost * np.sqrt(cells.counts) / 0.25
    print(f"\n{speed_mm_s:g} mm/s: {len(z)} cells, chi2 {z @ z:.3g}, largest {np.abs(lost).max():.3g} mN")
    assert z @ z < 1.0


@pytest.mark.parametrize("seed", range(5))
def test_every_sample_as_it_was_taken_is_in_one_cell(trial: Trial, seed: int) -> None:
    random = np.random.default_rng(seed)
    length_s = float(trial.time_s[-1])
    # dense at first, then ever sparser, as creep is recorded
    between_s = np.geomspace(1e-3, 0.2, 300) * random.uniform(0.5, 1.5, 300)
    times_s = np.concatenate([[0.0], np.cumsum(between_s)])
    times_s = np.append(times_s[times_s < 0.95 * length_s], length_s)
    cells = reduced(taken_at(trial, times_s))
    assert cells.counts.sum() == len(times_s)
    assert (cells.counts >= 1).all()
    assert np.all(np.diff(cells.time_s) > 0)
    assert (cells.widths_s < 0.5 * length_s).all()
    force_mn = np.interp(times_s, trial.time_s, trial.force_mn)
    np.testing.assert_allclose(cells.force_mn, np.add.reduceat(force_mn, cells.starts) / cells.counts)
    single = cells.counts == 1
    np.testing.assert_allclose(cells.time_s[single], times_s[cells.starts[single]])
    np.testing.assert_allclose(cells.widths_s[single], 1.0 / trial.sample_rate_hz)


@pytest.mark.parametrize("hz", [11.0, 25.0])
def test_cells_give_a_quick_rhythm_back_to_the_samples(trial: Trial, hz: float) -> None:
    """Lines between the cells' averages would leave a tenth of a millinewton of a tremor of 3 mN."""
    cells = reduced(trial)
    wave = np.sin(2.0 * np.pi * hz * cells.full_time_s)
    averages = np.add.reduceat(wave, cells.starts) / cells.counts
    back = cells.at_samples(averages)
    np.testing.assert_allclose(np.add.reduceat(back, cells.starts) / cells.counts, averages, atol=0.01)
    at_rest = np.repeat(cells.in_phase("hold"), cells.counts.astype(int))
    within = at_rest & (np.abs(cells.full_time_s - np.median(cells.full_time_s[at_rest])) < 0.3)
    lost = 1.0 - (back[within] @ wave[within]) / (wave[within] @ wave[within])
    assert abs(lost) < 0.01
    assert np.std((back - wave)[within]) < 0.02


def test_one_sample_of_a_heavy_tail_is_no_event_at_rest(trial: Trial) -> None:
    """Among the few samples of a cell it would be some tenths of a millinewton; in a motion it may be the arm's."""
    plain = reduced(trial)
    hold, ramp = (np.flatnonzero(plain.in_phase(name)) for name in ("hold", "ramp"))
    resting, moving = int(hold[len(hold) // 2]), int(ramp[len(ramp) // 2])
    # where a ramp has ended a cell is a sample, and that sample is still no more than noise
    ended = int(np.flatnonzero(plain.time_s > plain.time_s[hold[0]] + 0.01)[0])
    assert plain.counts[ended] < plain.counts[resting]
    for cell, least_mn, most_mn in ((resting, 0.0, 3.0), (ended, 0.0, 3.0), (moving, 16.0, 16.0)):
        off_mn = 16.0 * (np.arange(len(plain.full_force_mn)) == plain.starts[cell])
        there = plain.cell_means(plain.full_force_mn + off_mn)
        changed_mn = (there - plain.cell_means(plain.full_force_mn.astype(np.float64))) * plain.counts
        assert least_mn <= changed_mn[cell] <= most_mn + 1e-6
        assert not np.any(np.delete(changed_mn, cell))


def test_a_cell_of_one_sample_is_that_sample(trial: Trial) -> None:
    """Of sparse recordings most are: nothing is left of what was read from the samples themselves."""
    times_s = np.arange(0.0, trial.time_s[-1], 0.005)
    cells = reduced(taken_at(trial, times_s))
    alone = cells.starts[cells.counts == 1]
    assert len(alone) > 0.5 * len(times_s)
    back = cells.at_samples(cells.force_mn)
    np.testing.assert_allclose(back[alone], np.interp(times_s, trial.time_s, trial.force_mn)[alone])


def test_the_noise_of_a_position_is_no_motion_in_a_hold(record: Callable[..., list[Trial]]) -> None:
    """It would be a force in contact, and bend the bristles of a bearing until they hold nothing."""
    (trial,) = record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=7.0, dwell_s=0.5))
    motion = estimate_motion(trial)
    hold = trial.phase("hold")
    assert hold is not None
    inside = slice(hold.start + 800, hold.stop - 800)
    left_by_5_ms_mm = 2.5e-4 / np.sqrt(2.0 * np.sqrt(np.pi) * SLOW_SMOOTHING_S * trial.sample_rate_hz)
    assert np.std(motion.position_mm[inside]) < 0.7 * left_by_5_ms_mm
    assert np.abs(motion.velocity_mm_s[inside]).mean() < 1e-5
