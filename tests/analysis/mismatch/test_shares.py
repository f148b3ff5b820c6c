"""By what share an effect is off in a phase is told by the trials, as far as they can."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import is_off
from analysis.mismatch.evidence.shares import EXACT, OffCoefficients, Shares, even_shares, likeliest_shares
from analysis.mismatch.fit.own import OwnColumns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT, ROUGH
from analysis.recordings.trial import PHASE_NAMES

N_TRIALS, N_CELLS, N_SHARED, N_OWN = 20, 120, 8, 2


def _found(shares: list[float], size_mn: float, seed: int) -> np.ndarray:
    """Return the likeliest shares of effects that are off by shares, a size of them in noise of 1 mN."""
    random = np.random.default_rng(seed)
    group = np.repeat(np.arange(len(shares)), N_SHARED)
    own_group = np.concatenate([[-1], np.repeat(np.arange(len(shares)), N_OWN)])
    coefficients = np.array(shares)[group] * random.standard_normal(len(group))
    owns, columns = [], []
    for _ in range(N_TRIALS):
        shared = size_mn * random.standard_normal((N_CELLS, len(group)))
        own = size_mn * random.standard_normal((N_CELLS, len(own_group)))
        of_own = np.where(
            own_group < 0, 3.0, np.array(shares)[own_group] * random.standard_normal(len(own_group))
        )
        residual = shared @ coefficients + own @ of_own + random.standard_normal(N_CELLS)
        prior = np.diag(np.where(own_group < 0, 0.0, INEXACT**-2.0))
        owns.append(OwnColumns(own, residual, prior, np.zeros(len(prior)), slice(1, 1)))
        columns.append(shared)
    whiteners = [lambda columns_mn: columns_mn] * N_TRIALS
    fit = cast(StudyFit, SimpleNamespace(own=owns, whiteners=whiteners))
    off = OffCoefficients(group, np.ones(len(group)), (own_group,) * N_TRIALS)
    return likeliest_shares(fit, columns, np.full(len(group), INEXACT**-2.0), off)


@pytest.mark.parametrize("seed", range(5))
def test_each_effect_is_off_by_its_own_share(seed: int) -> None:
    """Of 48 coefficients a share is known to a tenth of itself: five of these standard errors."""
    found = _found([0.01, 0.2, 0.05], 30.0, seed)
    assert found == pytest.approx([0.01, 0.2, 0.05], rel=0.5)


def test_what_shows_nothing_stays_right_to_a_tenth() -> None:
    assert _found([0.1], 1e-6, 0) == pytest.approx([INEXACT], rel=0.05)


def test_what_is_off_by_more_than_a_third_is_another_law() -> None:
    assert _found([2.0], 30.0, 0) == pytest.approx([ROUGH])


@pytest.mark.parametrize(
    ("in_hold", "in_ramp", "granted", "another"),
    [(ROUGH, 0.1, 6666.0, True), (ROUGH, 0.1, 774.0, False), (0.1, ROUGH, 6666.0, False)],
    ids=["another", "blunt", "elsewhere"],
)
def test_a_law_is_another_where_it_is_off_by_a_third_and_gains_by_that(
    in_hold: float, in_ramp: float, granted: float, another: bool
) -> None:
    """An adhesion that lets go by and by gained 3 % by being off on the way back, a lag for what rings 60 %."""
    off = np.full(len(PHASE_NAMES), INEXACT)
    explained = np.ones((1, len(PHASE_NAMES)))
    for phase, share, of_it in (("ramp", in_ramp, 10.0), ("hold", in_hold, 90.0)):
        off[PHASE_NAMES.index(phase)], explained[0, PHASE_NAMES.index(phase)] = share, of_it
    account = _Off(23e3, Shares({"arm": off}), explained, granted)
    assert is_off(cast(Account, account), "arm", 23e3) is another
    assert not is_off(cast(Account, account), "drift", 1.0)
    # what is likelier exact is not off, by whatever it would be were it granted
    assert not is_off(cast(Account, replace(account, inexact=EXACT)), "arm", 1.0)


@pytest.mark.parametrize(
    ("share", "gained", "another"), [(ROUGH, 6000.0, True), (ROUGH, 700.0, False), (0.12, 6000.0, False)]
)
def test_a_law_whose_size_differs_by_a_third_from_trial_to_trial_is_another(
    share: float, gained: float, another: bool
) -> None:
    """A charge that drains goes with the force of each trial, and was a drift of another rate in each."""
    shares = Shares({}, {"drift": share})
    account = _Off(23e3, shares, np.ones((1, len(PHASE_NAMES))), 0.0, of_sizes=gained)
    assert is_off(cast(Account, account), "drift", 23e3) is another
    assert not is_off(cast(Account, account), "arm", 23e3)


@dataclass(frozen=True)
class _Off:
    """An account of an arm with evidence (nats), and what it is granted beyond that of an exact one, or of one size."""

    nats: float
    inexact: Shares
    explained_by_phase: np.ndarray
    granted: float
    taken_as_exact: frozenset[str] = frozenset()
    of_sizes: float = 0.0

    @property
    def may_be_off(self) -> tuple[str, ...]:
        return () if self.taken_as_exact else ("arm",)

    @property
    def exact(self) -> _Off:
        return replace(self, nats=self.nats - self.granted, inexact=EXACT)

    def inexact_to(self, shares: Shares) -> _Off:
        lost = self.of_sizes if self.inexact.sizes and not shares.sizes else 0.0
        return replace(self, nats=self.nats - lost, inexact=shares)

    def gain_over(self, other: _Off) -> tuple[float, float]:
        return self.nats - other.nats, 0.0


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0.001, 0.3), min_size=2, max_size=2))
def test_of_two_shares_the_larger_is_granted_to_both(shares: list[float]) -> None:
    one, other = (
        even_shares(["slip", name], s) for name, s in zip(("adhesion", "force_lag"), shares, strict=True)
    )
    both = one.or_larger(other)
    assert both.of(["slip"]) == pytest.approx(max(shares) * np.ones((1, len(PHASE_NAMES))))
    assert both.of(["adhesion", "force_lag"]) == pytest.approx(np.outer(shares, np.ones(len(PHASE_NAMES))))
    assert both.or_larger(one).of(["slip"]) == pytest.approx(both.of(["slip"]))
    bounded = both.no_more_than(one, ["slip"])
    assert bounded.of(["slip"]) == pytest.approx(one.of(["slip"]))
    assert bounded.of(["force_lag"]) == pytest.approx(both.of(["force_lag"]))


def test_an_effect_that_was_not_looked_at_is_right_to_a_tenth() -> None:
    assert not EXACT
    assert Shares({"slip": np.full(len(PHASE_NAMES), 0.02)}).of(["adhesion"]) == pytest.approx(
        np.full((1, len(PHASE_NAMES)), INEXACT)
    )
