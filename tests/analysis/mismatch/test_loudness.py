"""Noise that grows with force: found where there is some, and no mismatch of what is pressed hardest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.levels import ENOUGH_OWN
from analysis.mismatch.locate.remainder import remainder_of
from analysis.mismatch.study.intake import take_in_memory
from analysis.mismatch.study.loudness import with_loudness
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial

GROWS = 9.0
"""b of sd^2 = a (1 + b F^2 / F_max^2): noise is three times as large at the largest force."""


@pytest.fixture(scope="module")
def quiet(record: Callable[..., list[Trial]]) -> tuple[CellTrial, ...]:
    return take_in_memory(record(81)).trials


def flickering(trials: Sequence[CellTrial], seed: int) -> list[CellTrial]:
    """Return trials to whose noise, of 0.3 mN, a gain that flickers was added."""
    random, found = np.random.default_rng(seed), []
    largest_mn = max(float((t.force_mn - t.offset_start_mn).max()) for t in trials)
    for trial in trials:
        force_mn = trial.at_samples(trial.force_mn - trial.offset_start_mn)
        flicker_mn = 0.3 * np.sqrt(GROWS) * force_mn / largest_mn * random.normal(size=len(force_mn))
        full_mn = trial.full_force_mn + flicker_mn.astype(np.float32)
        force_mn = trial.cell_means(full_mn.astype(np.float64))
        found.append(replace(trial, full_force_mn=full_mn, force_mn=force_mn))
    return found


def test_noise_that_is_alike_at_any_force_is_left_as_it_is(quiet: tuple[CellTrial, ...]) -> None:
    assert all(trial.louder is None for trial in quiet)


def test_noise_that_grows_with_force_is_found(quiet: tuple[CellTrial, ...]) -> None:
    trials = with_loudness(flickering(quiet, 1))
    ratios = [float(t.louder.max() / t.louder.min()) for t in trials if t.louder is not None]
    assert len(ratios) == len(quiet)
    assert max(ratios) == pytest.approx(np.sqrt(1.0 + GROWS), rel=0.15)


def test_what_is_louder_where_it_is_pressed_hardest_is_noise(quiet: tuple[CellTrial, ...]) -> None:
    """By noise of one size, what differs from trial to trial in ramps and where holds begin had no name."""
    flickers = flickering(quiet, 1)
    as_it_is, as_alike = (Account(fit_baseline(t)) for t in (with_loudness(flickers), flickers))
    assert as_it_is.nats > as_alike.nats + ENOUGH_OWN
    assert not remainder_of(as_it_is, as_it_is).significant
