"""What no law has the shape of: a tissue that scatters over trials, tones that wander; and quiet where nothing is."""

import numpy as np
import pytest

from analysis.mismatch.tissue_scatter import Scatter, scatter_of_repeats, scatter_over
from analysis.mismatch.wandering_tone import wandering_tone

RATE = 8000.0


def _columns(rng: np.random.Generator, n_trials: int = 20) -> list[np.ndarray]:
    return [rng.normal(size=(400, 4)) * [1.0, 10.0, 0.1, 1.0] for _ in range(n_trials)]


def _repeats(deviation: np.ndarray, *, of_condition: float, seed: int) -> Scatter:
    """Scatter of 20 trials under 4 conditions whose three parameters deviate by ``deviation`` times a number each.

    ``of_condition``: what all trials of a condition share.
    """
    rng = np.random.default_rng(seed)
    information, gradients, conditions = [], [], []
    shared = of_condition * rng.normal(size=4)
    for j in range(20):
        root = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
        H = (1.0 + j % 4) * root.T @ root
        noise = np.linalg.cholesky(H) @ rng.normal(size=3)
        information.append(H)
        gradients.append(H @ (deviation * rng.normal() + deviation * shared[j % 4]) + noise)
        conditions.append(f"condition {j % 4}")
    return scatter_of_repeats(information, gradients, conditions)


def test_repeats_that_are_alike_but_for_noise_deviate_by_little() -> None:
    # what is shared by a condition's trials repeats, and is no scatter however large it is
    found = [_repeats(np.zeros(3), of_condition=0.0, seed=s) for s in range(50)]
    found += [_repeats(np.array([1e-6, 0.0, 0.0]), of_condition=1e7, seed=s) for s in range(50)]
    # the largest of three noise variances exceeds its edge in a few of a hundred; each then holds about one sigma
    assert sum(f.spread.shape[1] for f in found) <= 15


@pytest.mark.parametrize("size", [3.0, 100.0])
def test_repeats_that_deviate_are_measured(size: float) -> None:
    direction = np.array([1.0, -2.0, 0.5])
    found = _repeats(size * direction, of_condition=0.0, seed=4)
    assert found.gain > 50.0
    covariance = found.spread @ found.spread.T
    strongest = np.linalg.eigh(covariance)[1][:, -1]
    assert abs(strongest @ direction) / np.linalg.norm(direction) > 0.999
    # 16 degrees of freedom tell a standard deviation to 18 %; five of these are a chance below one in a million
    assert np.sqrt(np.trace(covariance)) == pytest.approx(size * np.linalg.norm(direction), rel=0.9)


def test_one_tissue_for_all_scatters_in_no_direction() -> None:
    # the largest of 4 eigenvalues of 20 trials passes the edge in about one set of twenty, by a little
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        columns = _columns(rng)
        found.append(scatter_over([rng.normal(size=400) for _ in columns], columns))
    assert sum(s.gain > 0 for s in found) <= 8
    assert max(s.gain for s in found) < 60


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0, 0.0], [0.5, 0.05, 5.0, 0.0]])
def test_a_scattering_tissue_is_found_in_its_direction(direction: list[float]) -> None:
    rng = np.random.default_rng(3)
    columns = _columns(rng)
    spread = np.array(direction)
    residuals = [rng.normal(size=400) + J @ (spread * rng.normal()) for J in columns]
    found = scatter_over(residuals, columns)
    covariance = found.spread @ found.spread.T
    assert found.gain > 500
    # 20 trials tell a variance to a third: wrong by more than a factor of 3.5 less than once in 10^4
    along = spread @ np.linalg.pinv(covariance, rcond=1e-3, hermitian=True) @ spread
    assert 1 / 3.5 < along < 3.5


def test_steady_noise_has_no_wandering_tone() -> None:
    p = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        white = rng.normal(size=(10, 50_000))
        coloured = np.cumsum(white, axis=1) * 0.01 + white
        p.append(wandering_tone(list(coloured), RATE).p_value)  # type: ignore[union-attr]
    assert min(p) > 1e-3


def test_noise_whose_level_changes_has_no_wandering_tone() -> None:
    rng = np.random.default_rng(5)
    stretches = [rng.normal(size=50_000) * np.linspace(1.0, 2.0, 50_000) for _ in range(10)]
    found = wandering_tone(stretches, RATE)
    assert found is not None
    assert found.p_value > 1e-3


def test_a_wandering_tone_is_found_with_its_size() -> None:
    rng = np.random.default_rng(6)
    t = np.arange(50_000) / RATE
    stretches = []
    for _ in range(10):
        frequency = 600.0 + 250.0 * np.sin(2 * np.pi * 0.2 * t + rng.uniform(0, 6))
        tone = 0.2 * np.sin(2 * np.pi * np.cumsum(frequency) / RATE)
        stretches.append(tone + rng.normal(size=len(t)))
    found = wandering_tone(stretches, RATE)
    assert found is not None
    assert found.p_value < 1e-8
    assert found.lower_hz < 600 < found.upper_hz
    assert found.rms == pytest.approx(0.2 / np.sqrt(2), rel=0.4)


def test_stretches_too_short_for_a_spectrum_say_nothing() -> None:
    assert wandering_tone([np.zeros(100)], RATE) is None
    assert wandering_tone([np.zeros(50_000)], 100.0) is None
