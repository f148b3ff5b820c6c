"""Heavy tails are noise, sparks are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.levels import ENOUGH_OWN
from analysis.mismatch.locate.outliers import levels_apart, tails
from analysis.simulation.samples import deviations

N = 200_000
"""About two trials. Of 300 draws under H0 the largest evidence was none."""


@settings(deadline=None)
@given(
    st.integers(0, 10**6),
    st.sampled_from(
        ["normal", "t5", "t2.5", "laplace", "rarely five times as large", "t3 beside another", "t3 in levels"]
    ),
)
def test_noise_of_any_tail_holds_no_outliers(seed: int, kind: str) -> None:
    random = np.random.default_rng(seed)
    noise = {
        "normal": lambda: random.normal(size=N),
        "t5": lambda: random.standard_t(5.0, N),
        "t2.5": lambda: random.standard_t(2.5, N),
        "laplace": lambda: random.laplace(size=N),
        "t3 beside another": lambda: random.normal(size=N) + 0.37 * random.standard_t(3.1, N),
        "t3 in levels": lambda: 0.33 * np.round(random.standard_t(3.1, N) / 0.33),
        "rarely five times as large": lambda: (
            random.normal(size=N) * np.where(random.random(N) < 0.01, 5.0, 1.0)
        ),
    }[kind]()
    off = deviations(0.2 * noise, np.ones(N, dtype=bool)).off
    assert tails(off).evidence < ENOUGH_OWN


@settings(deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([3.1, 4.0, np.inf]), st.sampled_from([0.4, 1.0, 1.7, 2.5, 7.0]))
def test_noise_on_the_levels_of_a_converter_holds_no_outliers(
    seed: int, freedom: float, level: float
) -> None:
    """Counted between any edges, tails on levels 1.7 deviations apart had up to 43 nats, and 331 on levels 2.5 apart;
    between edges midway between levels none in 300 draws. Where they are 7 apart, one away is far from what hardly
    ever leaves its level, and 10,000 nats; none as a force is known to a level over sqrt(12).
    """
    random = np.random.default_rng(seed)
    noise = random.normal(size=N) if np.isinf(freedom) else random.standard_t(freedom, N)
    force_mn = 0.2 * level * np.round(noise / level)
    assert levels_apart(force_mn.astype(np.float32)) == pytest.approx(0.2 * level, rel=1e-5)
    found = deviations(force_mn, np.ones(N, dtype=bool), 0.2 * level)
    assert tails(found.off, 0.2 * level / found.sigma_mn).evidence < ENOUGH_OWN


@pytest.mark.parametrize("tail", [5.0, 100.0])
def test_sparks_are_told_from_tails(tail: float) -> None:
    random = np.random.default_rng(5)
    noise = 0.2 * random.standard_t(tail, N)
    sparks = np.zeros(N)
    sparks[random.choice(N, 200, replace=False)] = random.exponential(8.0, 200) * random.choice([-1, 1], 200)
    found = tails(deviations(noise + sparks, np.ones(N, dtype=bool)).off)
    assert found.evidence > ENOUGH_OWN
    assert 20 < found.far_sd < 120


def test_a_step_is_no_outlier() -> None:
    random = np.random.default_rng(6)
    steps = np.where(np.arange(N) // 1000 % 2, 5.0, 0.0)
    off = deviations(0.2 * random.normal(size=N) + steps, np.ones(N, dtype=bool)).off
    assert tails(off).evidence < ENOUGH_OWN


def test_sparks_are_told_from_noise_that_is_no_t() -> None:
    """A bulk of few levels, as of a coarse converter: only with a rarer part of its own does a t fit it."""
    random = np.random.default_rng(8)
    noise = 0.06 * np.round(0.2 * random.normal(size=5 * N) / 0.06) + random.uniform(-0.01, 0.01, 5 * N)
    sparks = np.zeros(5 * N)
    sparks[random.choice(5 * N, 60, replace=False)] = random.exponential(4.0, 60) * random.choice([-1, 1], 60)
    kept = np.ones(5 * N, dtype=bool)
    assert tails(deviations(noise + sparks, kept).off).evidence > ENOUGH_OWN
    assert tails(deviations(noise, kept).off).evidence < ENOUGH_OWN
