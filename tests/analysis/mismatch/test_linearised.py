"""Derivatives are those of the simulated force where the surface stands, and so fits arrive."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch.joint import fit_jointly
from analysis.mismatch.linearised import compressed, linearise, weighed_residual
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.problem import Problem
from analysis.mismatch.shared import Simulation
from analysis.mismatch.start import start_own, start_tissue
from analysis.mismatch.surface_oscillation import surface_addition
from analysis.mismatch.weighing import loosened, weighed
from analysis.simulation.mechanism import library

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from analysis.mismatch.intake import take_in_memory
from sim_hardware.concealment.offline import study_plans

BENCH = "seed = 3\n[specimens]\npublished_tissue = true\n"
BREATH = '[[effects]]\nname = "respiration"\namplitude_um = 30.0\nfrequency_hz = 0.3\n'


@pytest.fixture(scope="module")
def far_breath() -> tuple[Problem, Simulation]:
    """Four trials on skin that breathes, and a simulation of the same skin that may breathe."""
    plans = study_plans(depths_mm=(0.3, 0.6), repeats=2, hold_s=4.0)
    still, trials = (take_in_memory(bench_trials(bench, plans)).trials for bench in (BENCH, BENCH + BREATH))
    breath = surface_addition(library()["respiration"], {t.label: 0.3 for t in trials}, 1, np.inf)
    return weighed(trials, NoiseModel(0.3)), Simulation(start_tissue(still), (breath,))


def test_derivatives_are_taken_where_the_surface_stands(far_breath: tuple[Problem, Simulation]) -> None:
    problem, simulation = far_breath
    trial, whitener, own = problem.trials[0], problem.whiteners[0], start_own(problem.trials)[0]
    moved_um = np.array([20.0, -15.0])
    line = linearise(trial, whitener, simulation, own, problem.trials, moved_um)

    def falls(i: int, size: float) -> np.ndarray:
        shared, by_own, by_surface = simulation, own, moved_um.copy()
        p = line.J.shape[1]
        if i < p:
            at = simulation.vector(problem.trials)
            at[i] += size
            shared = simulation.moved_to(at, problem.trials)
        elif i == p:
            by_own = replace(own, offset_mn=own.offset_mn + size)
        elif i == p + 1:
            by_own = replace(own, z0_mm=own.z0_mm + size)
        else:
            by_surface[i - p - 2] += size
        return weighed_residual(trial, whitener, shared, by_own, by_surface)

    both = np.column_stack([line.J, line.A])
    assert both.shape[1] == 5 + 2 + 2
    np.testing.assert_allclose(line.r, falls(0, 0.0))
    for i in range(both.shape[1]):
        size = 1e-5 if i == 6 else 1e-3
        measured = (falls(i, -size) - falls(i, size)) / (2 * size)
        # but for the few cells in which the punch meets the skin or leaves it
        assert np.linalg.norm(both[:, i] - measured) < 0.05 * np.linalg.norm(measured), i


def test_a_trial_in_few_rows_has_the_same_inner_products(far_breath: tuple[Problem, Simulation]) -> None:
    problem, simulation = far_breath
    own = start_own(problem.trials)[1]
    line = linearise(problem.trials[1], problem.whiteners[1], simulation, own, problem.trials, np.zeros(2))
    small = compressed(line)
    assert len(small.r) == 5 + 2 + 2 + 1
    for a, b in ((small, line),):
        np.testing.assert_allclose(a.A.T @ a.A, b.A.T @ b.A, rtol=1e-9)
        np.testing.assert_allclose(a.J.T @ a.r, b.J.T @ b.r, rtol=1e-9, atol=1e-6)


def test_a_far_surface_and_the_tissue_below_it_are_found_together(
    far_breath: tuple[Problem, Simulation],
) -> None:
    problem, simulation = far_breath
    rng = np.random.default_rng(5)
    sizes_um = [rng.normal(0.0, 20.0, 2) for _ in problem.trials]
    own = start_own(problem.trials)
    trials = [
        replace(t, force_mn=simulation.whole_force_mn(t, o, c) + rng.normal(0.0, 0.3 / np.sqrt(t.counts)))
        for t, o, c in zip(problem.trials, own, sizes_um, strict=True)
    ]
    tissue = simulation.tissue
    softer = replace(simulation, tissue=replace(tissue, k0=0.8 * tissue.k0, tau1=1.3 * tissue.tau1))
    fit = weighed(trials, NoiseModel(0.3)).fit(softer, own, rounds=25)
    cells, free = sum(int(t.fitted.sum()) for t in trials), 5 + 4 * len(trials)
    # chi2 to six standard deviations: fails once in 10^9
    assert abs(fit.cost.sum() - (cells - free)) < 6.0 * np.sqrt(2.0 * (cells - free))
    assert fit.simulation.tissue.k0 == pytest.approx(tissue.k0, rel=0.01)
    np.testing.assert_allclose(fit.latents, sizes_um, atol=0.1)


def test_frozen_parameters_stay(far_breath: tuple[Problem, Simulation]) -> None:
    problem, simulation = far_breath
    fit = fit_jointly(
        problem.trials, problem.whiteners, simulation, start_own(problem.trials), rounds=30, frozen=True
    )
    assert fit.simulation.tissue == simulation.tissue
    start = sum(
        float(np.sum(weighed_residual(t, w, simulation, o, np.zeros(2)) ** 2))
        for t, w, o in zip(problem.trials, problem.whiteners, start_own(problem.trials), strict=True)
    )
    assert fit.cost.sum() < 0.5 * start


def test_tissues_that_differ_explain_no_movement_that_is_left_out() -> None:
    plans = study_plans(depths_mm=(0.3, 0.6), repeats=4, hold_s=3.0)
    bench = (
        BENCH + "[noise]\ngain_jitter = 0.01\n" + BREATH.replace("respiration", "tremor").replace("0.3", "11")
    )
    trials = take_in_memory(bench_trials(bench.replace("30.0", "2.0"), plans)).trials
    problem = weighed(trials, NoiseModel(0.3))
    still = problem.fit(Simulation(start_tissue(trials)), start_own(trials))
    shakes = surface_addition(library()["tremor"], {t.label: 11.0 for t in trials}, 1, 0.14)
    moving = problem.fit(replace(still.simulation, additions=(shakes,)), still.own)
    loose = loosened(problem, moving)
    assert loose.scatter_mn > 0.0
    left_out = loose.fit(still.simulation, still.own)
    assert left_out.simulation.tissue.k0 == pytest.approx(moving.simulation.tissue.k0, rel=0.1)
    assert left_out.cost.sum() > 10.0 * loose.fit(moving.simulation, moving.own).cost.sum()
