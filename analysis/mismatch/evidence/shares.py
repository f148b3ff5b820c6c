"""By what share of its size each effect is off in every phase: likeliest, in the light of all trials."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.gram import solve
from analysis.mismatch.fit.own import solved
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT, ROUGH
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.model.population import DECADE
from analysis.recordings.trial import PHASE_NAMES

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SPREAD = np.log(ROUGH / INEXACT)
"""What is known of the logarithm of a share before the trials are seen."""
MOST_ROUNDS, STILL = 60, 0.03
"""Rounds of expectation and maximisation, until no logarithm of a share moves by more."""
NEWTON = 8


@dataclass(frozen=True)
class Shares:
    """The share of its size by which each effect may be off in every phase (P,), by name; none: they are exact.

    ``sizes`` are the shares of itself by which a law as a whole may be larger or smaller in each trial.
    """

    by_effect: Mapping[str, FloatArray] = field(default_factory=dict)
    sizes: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.by_effect or self.sizes)

    def of(self, names: Sequence[str]) -> FloatArray:
        """Return the shares (E, P) of some effects; one that was not looked at is right to a tenth."""
        tenth = np.full(len(PHASE_NAMES), INEXACT)
        return np.array([self.by_effect.get(name, tenth) for name in names]).reshape(-1, len(PHASE_NAMES))

    def or_larger(self, other: Shares) -> Shares:
        """Return for each effect and phase the larger share of two."""
        both = {**other.by_effect, **self.by_effect}
        sizes = {n: max(s, self.sizes.get(n, s)) for n, s in other.sizes.items()}
        return Shares(
            {n: np.maximum(s, other.by_effect.get(n, s)) for n, s in both.items()}, {**self.sizes, **sizes}
        )

    def no_more_than(self, other: Shares, names: Collection[str]) -> Shares:
        """Return the shares, those of the effects with these names no larger than another's."""
        bounded = {n: np.minimum(self.of([n])[0], other.of([n])[0]) for n in names}
        return replace(self, by_effect={**self.by_effect, **bounded})

    def same(self, other: Shares, names: Sequence[str]) -> bool:
        """Return whether another's are the same of the effects with some names, and of all sizes."""
        alike = self.sizes == other.sizes and bool(self.by_effect) == bool(other.by_effect)
        return alike and np.array_equal(self.of(names), other.of(names))

    @property
    def of_sizes(self) -> Shares:
        """Those of whole laws alone: in form they are exact."""
        return Shares(sizes=self.sizes)


EXACT = Shares()


def even_shares(names: Sequence[str], share: float, laws: Sequence[str] = ()) -> Shares:
    """Return one share for all effects in all phases, and for the sizes of laws."""
    return Shares({name: np.full(len(PHASE_NAMES), share) for name in names}, dict.fromkeys(laws, share))


@dataclass(frozen=True)
class OffCoefficients:
    """Which coefficients say by how much effects are off: in which group (effect and phase, or size), and how large
    they are beside that group's share.

    ``shared`` (D,) is the group of the last of the columns of all trials, ``beside`` (D,) their size; ``own`` (q,) that
    of every trial's own parameters, -1 where they say something else.
    """

    shared: IntArray
    beside: FloatArray
    own: tuple[IntArray, ...]


def likeliest_shares(
    fit: StudyFit,
    columns: Iterable[FloatArray],
    known: FloatArray,
    off: OffCoefficients,
) -> FloatArray:
    """Return the likeliest share (G,) of every group of coefficients.

    A group's coefficients are normal about zero with its share; ln share is normal about ln `INEXACT` by `SPREAD`, and
    no more than ln `ROUGH`: what is off by more is another law, or all that is missing.
    Expectation and maximisation in turn (Dempster et al., J. R. Stat. Soc. B 39:1, 1977; one variance a group: MacKay,
    Neural Comput. 4:415, 1992). All that is needed are products of columns, and they stay.

    ``columns`` (n_j, K) mN are those of `Account.columns` in each trial, ``known`` (K,) their precision.
    """
    products = []
    for own, whitener, added in zip(fit.own, fit.whiteners, columns, strict=True):
        Z = np.column_stack([own.columns, own.mean_columns, whitener(added), own.residual_at_mean])
        products.append(Z.T @ Z)
    shares = np.full(1 + max(int(groups.max(initial=-1)) for groups in (off.shared, *off.own)), INEXACT)
    ridge = np.append(np.concatenate([np.full(TISSUE_SIZE, DECADE**-2), known]), 0.0)
    for _ in range(MOST_ROUNDS):
        ridge[-1 - len(off.shared) : -1] = (off.beside * shares[off.shared]) ** -2.0
        squares, count = _second_moments(fit, products, ridge, off, shares)
        logs = _likeliest(squares, count, np.log(shares))
        moved = np.max(np.abs(logs - np.log(shares)), initial=0.0)
        shares = np.exp(logs)
        if moved < STILL:
            break
    return shares


def _second_moments(
    fit: StudyFit, products: Sequence[FloatArray], ridge: FloatArray, off: OffCoefficients, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sum (G,) of expected squares of each group's coefficients, and how many there are of them."""
    total, solved_own = np.zeros((len(ridge), len(ridge))), []
    for own, M, group in zip(fit.own, products, off.own, strict=True):
        q = own.n_own
        prior = own.prior.copy()
        is_off = np.flatnonzero(group >= 0)
        prior[is_off, is_off] = shares[group[is_off]] ** -2.0
        covariance = solved(M[:q, :q] + prior, np.eye(q))
        by_others = covariance @ M[:q, q:]
        solved_own.append((covariance, by_others))
        total += M[q:, q:] - M[q:, :q] @ by_others
    pick = range(len(ridge) - 1)
    b, of_b = solve(total, ridge, pick)
    squares, count = np.zeros(len(shares)), np.zeros(len(shares))

    def add(group: IntArray, expected: FloatArray) -> None:
        squares[:] += np.bincount(group, expected, len(shares))
        count[:] += np.bincount(group, minlength=len(shares))

    shown = np.flatnonzero(np.diag(total)[-1 - len(off.shared) : -1] > 0.0)
    first = len(b) - len(off.shared)
    at = first + shown
    add(off.shared[shown], (b[at] ** 2 + np.diag(of_b)[at]) / off.beside[shown] ** 2)
    for group, (covariance, by_others) in zip(off.own, solved_own, strict=True):
        k = np.flatnonzero(group >= 0)
        others = by_others[k, :-1]
        mean = by_others[k, -1] - others @ b
        add(group[k], mean**2 + np.diag(covariance)[k] + np.einsum("ki,ij,kj->k", others, of_b, others))
    return squares, count


def _likeliest(squares: FloatArray, count: FloatArray, logs: FloatArray) -> FloatArray:
    """Return the likeliest ln share (G,) by Newton's steps, a third at most; the log of its density is concave."""
    for _ in range(NEWTON):
        expected = squares * np.exp(-2.0 * logs)
        slope = expected - count - (logs - np.log(INEXACT)) / SPREAD**2
        logs = logs + np.clip(slope / (2.0 * expected + SPREAD**-2.0), -1.0, 1.0)
    return np.minimum(logs, np.log(ROUGH))
