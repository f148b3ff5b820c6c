"""Events judged by all trials together; what moves the surface moves it in the simulation."""

import sys
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch.candidates import Candidate, refit_added
from analysis.mismatch.event_at import EventAt
from analysis.mismatch.events import EventScan, event_mechanisms, event_p_value
from analysis.mismatch.intake import take_in_memory
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.search import repeats
from analysis.mismatch.shared import Addition, Simulation
from analysis.mismatch.start import start_own, start_tissue
from analysis.mismatch.surface_oscillation import SurfaceOscillation, is_overtone, surface_addition
from analysis.mismatch.weighing import weighed
from analysis.simulation.mechanism import library

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans

SLIP, ARTEFACT = (next(m for m in event_mechanisms() if m.name == n) for n in ("slip", "motion_artefact"))


def _scan(rng: np.random.Generator, strength: float) -> EventScan:
    """Scores of steps, correlated over neighbours as those of overlapping steps are, an event in every trial."""
    scores = []
    for _ in range(20):
        smooth = np.convolve(rng.normal(size=340), np.ones(20) / np.sqrt(20.0), mode="valid")
        smooth[rng.integers(len(smooth))] += strength
        scores.append(smooth)
    times = tuple(np.arange(len(s)) * 0.02 for s in scores)
    return EventScan(SLIP, times, tuple(scores), (1.0,) * 20, 0.0)


def test_steps_of_noise_are_no_events() -> None:
    rng = np.random.default_rng(1)
    p = [event_p_value(_scan(rng, 0.0)) for _ in range(200)]
    # Markov's bound holds: 200 chances of below 1e-3 give more than 4 with a chance of 2e-6
    assert sum(x <= 1e-3 for x in p) <= 4


def test_many_weak_events_are_seen_together() -> None:
    rng = np.random.default_rng(2)
    assert np.median([event_p_value(_scan(rng, 4.5)) for _ in range(20)]) < 1e-4


@pytest.mark.parametrize(
    ("frequency_hz", "overtone"), [(0.6, True), (0.93, True), (0.45, False), (0.78, False), (0.2, False)]
)
def test_whole_multiples_of_a_breath_are_its_overtones(frequency_hz: float, overtone: bool) -> None:
    breath = SurfaceOscillation({"a": 0.3, "b": 0.31}, 1, np.inf)
    assert is_overtone(SurfaceOscillation({"a": frequency_hz}, 1, np.inf), [breath]) is overtone


@pytest.mark.parametrize(
    ("effect", "the_same"),
    [
        ('name = "third_relaxation"\nratio_to_k0 = 0.05\ntime_constant_s = 0.6', True),
        ('name = "respiration"\namplitude_um = 1.0\nfrequency_hz = 0.25', False),
    ],
)
def test_what_is_the_same_in_every_trial_is_no_breath(effect: str, the_same: bool) -> None:
    plans = study_plans(depths_mm=(0.3, 0.6), repeats=5)
    bench = f"seed = 3\n[specimens]\npublished_tissue = true\n[[effects]]\n{effect}\n"
    trials = take_in_memory(bench_trials(bench, plans)).trials
    problem = weighed(trials, NoiseModel(0.3))
    plain = problem.fit(Simulation(start_tissue(trials)), start_own(trials))
    breath = library()["respiration"]
    # free to swell and fade, a slow wave follows a law's remainder too
    waves = surface_addition(breath, {t.label: 0.25 for t in trials}, 3, 2.0)
    fit = refit_added(problem, plain, waves, rounds=3)
    gain = plain.heldout_cost - fit.heldout_cost
    assert gain.sum() > 1000.0
    assert repeats(problem, problem.weighed_repeatable(plain), Candidate(breath, fit, gain, 1e-3)) is the_same


def test_a_surface_that_shifts_far_is_let_go_of_elsewhere() -> None:
    plans = study_plans(depths_mm=(0.3,), repeats=1)
    trials = take_in_memory(bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)).trials
    trial, own = trials[0], start_own(trials)[0]
    shifts = EventAt(ARTEFACT, {trial.label: 5.0})
    simulation = Simulation(start_tissue(trials), (Addition(ARTEFACT, {}, shifts),))
    columns = simulation.latent_columns(trial, own)
    bare = simulation.force_mn(trial, own)
    np.testing.assert_array_equal(simulation.whole_force_mn(trial, own, np.zeros(3)), bare)
    pressed = trial.in_phase("hold") & (trial.time_s > 5.1)
    slight, far = (simulation.whole_force_mn(trial, own, np.array([um, 0.0, 0.0])) for um in (0.1, 30.0))
    # in the hold the tissue is linear, so that 30 um are 30 times 1 um
    np.testing.assert_allclose((slight - bare)[pressed], 0.1 * columns[pressed, 0], rtol=1e-3)
    np.testing.assert_allclose((far - bare)[pressed], 30.0 * columns[pressed, 0], rtol=1e-3)
    # nearer to the arm the skin is left later, by what of 30 um is not relaxed; a linear effect would end with contact
    let_go = [
        float(trial.position_mm[trial.retracting][np.argmax(f[trial.retracting] < 0.1)]) for f in (bare, far)
    ]
    assert 0.015 < let_go[0] - let_go[1] <= 0.030


def test_an_oscillating_surface_moves_as_its_columns_say() -> None:
    plans = study_plans(depths_mm=(0.3,), repeats=1)
    trials = take_in_memory(bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)).trials
    trial, own, tissue = trials[0], start_own(trials)[0], start_tissue(trials)
    wave = SurfaceOscillation({trial.label: 0.4}, 2, 3.0)
    simulation = Simulation(tissue, (Addition(ARTEFACT, {}, wave),))
    columns = simulation.latent_columns(trial, own)
    sizes = 0.01 * np.random.default_rng(4).normal(size=columns.shape[1])
    assert wave.n_columns(trial) == len(sizes)
    moved = simulation.whole_force_mn(trial, own, sizes) - simulation.force_mn(trial, own)
    # a force that relaxes remembers what the surface did before the contact that the columns begin with
    late = trial.in_phase("hold") & (trial.time_s > 8.0)
    np.testing.assert_allclose(moved[late], (columns @ sizes)[late], atol=0.05 * np.abs(moved[late]).max())
