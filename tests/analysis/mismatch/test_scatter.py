"""A law that explains why tissues differ is found by their scattering less beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.evidence.scatter import scatter_explained
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.settled import Settled
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_law_that_moves_tissues_as_they_differ_explains_their_scatter(
    record: Callable[..., list[Trial]], seed: int
) -> None:
    fit = fit_baseline(take_in_memory(record(53)).trials)
    random = np.random.default_rng(seed)
    n = len(fit.trials)
    differ = 0.02 * random.normal(size=(n, 1)) * np.array([1.0, 1.0, 0.0, 1.0, 0.0])
    states = [
        replace(s, log_tissue=fit.population.mean + by) for s, by in zip(fit.states, differ, strict=True)
    ]
    # at a coefficient of 0.5 the first undoes it; the others move tissues anyhow
    anyhow = 0.02 * random.normal(size=(3, n, 5))
    settled = [Settled(np.zeros((1, 4)), np.array([-2.0 * differ[j], *anyhow[:, j]])) for j in range(n)]
    (gain, at), *others = scatter_explained(replace(fit, states=tuple(states)), settled)
    assert at == pytest.approx(0.5, rel=0.01)
    # n trials that scatter by 2 % about what is known to some thousandths
    assert gain > 1.5 * n
    assert max(by_chance for by_chance, _ in others) < 0.5 * gain
