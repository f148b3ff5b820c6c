"""A slow rhythm with fewer overtones: they lie where a quicker rhythm has its own frequency."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.model.effects import TrialState
from analysis.mismatch.model.rhythm import HARMONIC

PLAINER = (2, 1)
"""Up to which overtone a slow rhythm may go instead: out is not as in, or not even that."""


def plainer(account: Account) -> Iterator[Account]:
    """Yield the account, by laws that are exact, with slow rhythms of ever fewer overtones; nothing where none has any.

    Free in every trial, the overtones of a breath take a pulse up that is near one of them. All else stays where it
    stands: what is looked for is told by what the trials' own parameters can't take up.
    """
    before = account
    for most in PLAINER:
        states = tuple(_with_overtones(state, most) for state in before.fit.states)
        if any(new is not old for new, old in zip(states, before.fit.states, strict=True)):
            fit = replace(before.fit, states=states).weighed_by(account.fit.noise)
            before = replace(before.exact, fit=fit)
            yield before


def _with_overtones(state: TrialState, most: int) -> TrialState:
    """Return the state with no more than so many overtones of its slow rhythms, their own frequency the first."""
    own_hz = {shape.effect: shape.at for shape in state.shapes if not shape.kind}
    kept = [
        k
        for k, shape in enumerate(state.shapes)
        if shape.kind != HARMONIC or shape.at < (most + 0.5) * own_hz[shape.effect]
    ]
    return state if len(kept) == len(state.shapes) else state.with_only(kept)
