"""What effects that are nearly right leave over: off by a share of their size, and in what happens within a sample."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from analysis.mismatch.evidence.shares import OffCoefficients, Shares, likeliest_shares
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT, UNFORESEEN
from analysis.mismatch.model.effects import OwnShape, Shared, TrialState, own_effects, simulate
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

INEXACT_KIND, SIZE_KIND = OFF_KINDS = ("inexact", "size")
SMOOTH, ROUGHER = 3, 4
PER_PHASE, IN_TRIAL = SMOOTH + 1 + ROUGHER, 2
"""Shapes of an effect's inexactness in every phase: smooth ones, what comes at once, and those of higher orders; and
how many of them are free in every trial anew."""
BESIDE = np.where(np.arange(PER_PHASE) < SMOOTH + 1, 1.0, UNFORESEEN)
"""How large they are beside what an effect is off by: those of higher orders are what is not foreseen."""
MOMENTS = 2
"""Of a kernel of a sample's length, in every phase: no recording says what happens within a sample."""
NEGLIGIBLE = 0.01
SETTLES_S = 0.02
"""What of a law comes at once when a phase begins is over in such a time."""


def with_inexactness(fit: StudyFit, shares: Shares, names: Sequence[str]) -> StudyFit:
    """Return the fit in which effects (of `inexact_names`) may be off by shares of their size, differently in every
    trial and phase, and laws as large in each trial as they are there.
    """
    priors = shares.of(names).ravel() ** 2
    every = inexact_names(fit)
    states = []
    for j, state in enumerate(fit.states):
        effects = dict(zip(every, inexact_effects(fit, j, every), strict=True))
        added = [
            OwnShape(name, "force", effects[name], share**2, 0.0, SIZE_KIND)
            for name, share in shares.sizes.items()
            if np.any(effects.get(name, 0.0))
        ]
        own = inexact_columns(fit.trials[j], [effects[n] for n in names] if shares.by_effect else [])
        added += [
            # by itself: a column of a matrix would keep all of it, and most of it is not each trial's own
            OwnShape(names[g // len(PHASE_NAMES)], "force", own[:, k].copy(), priors[g], 0.0, INEXACT_KIND)
            for g, k in ((k // PER_PHASE, k) for k in range(own.shape[1]))
            if np.any(own[:, k]) and k % PER_PHASE < IN_TRIAL
        ]
        states.append(exact_state(state).with_shapes(added))
    return replace(fit, states=tuple(states))


def inexact_precision(shares: Shares, names: Sequence[str]) -> FloatArray:
    """Return what is known (D,) of the coefficients of `inexact_columns` of effects that are right to shares."""
    return np.asarray(np.outer(shares.of(names).ravel() ** -2.0, BESIDE**-2.0).ravel())


def off_coefficients(fit: StudyFit, names: Sequence[str]) -> OffCoefficients:
    """Return which coefficients of a fit `with_inexactness` say by how much effects are off.

    Groups are effects by phases, and after all of these the sizes of the laws.
    """
    n_groups, laws = len(names) * len(PHASE_NAMES), [law.name for law in fit.shared.laws]
    own = []
    for trial, state, columns in zip(fit.trials, fit.states, fit.own, strict=True):
        group = np.full(columns.n_own, -1)
        for k, x in enumerate(state.shapes):
            if x.kind == SIZE_KIND:
                group[columns.tissue.stop + k] = n_groups + laws.index(x.effect)
            if x.kind == INEXACT_KIND:
                phase = trial.phase[np.flatnonzero(x.shape)[0]]
                group[columns.tissue.stop + k] = names.index(x.effect) * len(PHASE_NAMES) + phase
        own.append(group)
    shared = np.repeat(np.arange(n_groups), PER_PHASE)
    return OffCoefficients(shared, np.tile(BESIDE, n_groups), tuple(own))


def likely_shares(
    fit: StudyFit, columns: Iterable[FloatArray], known: FloatArray, names: Sequence[str]
) -> Shares:
    """Return the shares by which effects of a fit `with_inexactness` are off, by `likeliest_shares`."""
    found = likeliest_shares(fit, columns, known, off_coefficients(fit, names))
    by_phase = found[: len(names) * len(PHASE_NAMES)].reshape(len(names), -1)
    # the last laws may be nothing in any trial, and have no coefficients
    of_laws = zip(fit.shared.laws, found[by_phase.size :].tolist(), strict=False)
    return Shares(dict(zip(names, by_phase, strict=True)), {law.name: share for law, share in of_laws})


def inexact_names(fit: StudyFit) -> tuple[str, ...]:
    """Return the names of what is granted to be off: the laws, then what has shapes of its own in some trial.

    A rhythm of many cycles, a band, wanders by itself.
    """
    laws = [law.name for law in fit.shared.laws]
    own = (x.effect for s in fit.states for x in s.shapes if not x.is_number and x.kind not in OFF_KINDS)
    return tuple(dict.fromkeys((*laws, *own)))


def inexact_effects(fit: StudyFit, j: int, names: Sequence[str]) -> list[FloatArray]:
    """Return what each of some of `inexact_names`, or of rhythms, changes in the j-th trial's force, (n,) mN each."""
    of_laws = dict(zip([law.name for law in fit.shared.laws], law_effects(fit, j), strict=True))
    found = [effect for name, effect in of_laws.items() if name in names]
    own = [name for name in names if name not in of_laws]
    if not own:
        return found
    trial, state = fit.trials[j], exact_state(fit.states[j])
    whole = simulate(trial, state, fit.shared)
    for name in own:
        without = state.without(name)
        same = without is state
        effect = np.zeros_like(whole) if same else whole - simulate(trial, without, fit.shared)
        # the line of a rhythm is no part of a simulation
        found.append(effect + sum(r.passed_mn for r in state.rhythms if r.effect == name))
    return found


def exact_state(state: TrialState, effect: str = "") -> TrialState:
    """Return the state of a trial without what its effects, or one of them, are granted to be off by."""
    return state.with_only(
        [k for k, x in enumerate(state.shapes) if x.kind not in OFF_KINDS or effect not in ("", x.effect)]
    )


def law_effects(fit: StudyFit, j: int) -> list[FloatArray]:
    """Return what each law changes in the j-th trial's force, (n,) mN each."""
    trial, state, shared = fit.trials[j], fit.states[j], fit.shared
    own = own_effects(state)
    whole = simulate(trial, state, shared, own)
    found = []
    for at in range(len(shared.laws)):
        others = shared.laws[:at] + shared.laws[at + 1 :]
        found.append(whole - simulate(trial, state, replace(shared, laws=others), own))
    return found


def inexact_columns(trial: CellTrial, effects: Sequence[FloatArray]) -> FloatArray:
    """Return what each effect may leave over in every phase of a trial (n, D), mN; coefficients about 0.1.

    Its effect times smooth functions, and a part of it that comes at once when the phase begins: what is right to a
    tenth may act less or more at once. What it so leaves over is expected there, and no evidence for another.
    """
    columns = [np.zeros((len(trial.time_s), 0))]
    for effect in effects:
        least = NEGLIGIBLE * float(np.abs(effect).max())
        for code in range(len(PHASE_NAMES)):
            inside = trial.phase == code
            columns.append(np.zeros((len(effect), PER_PHASE)))
            if np.count_nonzero(inside) > 1 and float(np.abs(effect[inside]).max()) > least:
                mine, t = effect[inside], trial.time_s[inside]
                # over what the effect does there, not over time: it may act in a moment of the phase
                done = np.cumsum(np.abs(mine) * trial.counts[inside])
                u = 2.0 * done / max(float(done[-1]), 1e-300) - 1.0
                at_once = mine[np.argmax(np.abs(mine))] * np.exp((t[0] - t) / SETTLES_S)
                orders = mine[:, None] * legvander(u, SMOOTH + ROUGHER - 1)
                columns[-1][inside] = np.column_stack((orders[:, :SMOOTH], at_once, orders[:, SMOOTH:]))
    return np.hstack(columns)


def foreseen_columns(fit: StudyFit, j: int, effects: Sequence[FloatArray]) -> FloatArray:
    """Return what is left over in the j-th trial, exact or not (n, D), mN: in a sample, and in other ways.

    Whether a card averages over a sample no recording says, and a punch that leaves quickly makes of that an
    eighth of what the force changes by in one.
    """
    return np.hstack([other_columns(fit, j), sample_columns(fit.trials[j], effects)])


def foreseen_precision(shared: Shared, n_effects: int) -> FloatArray:
    """Return what is known (D,) of the coefficients of `foreseen_columns`: a law is right to a tenth."""
    of_laws = np.full(len(other_ways(shared)) - 1, INEXACT**-2.0)
    return np.concatenate([[1.0], of_laws, np.ones(n_effects * len(PHASE_NAMES) * MOMENTS)])


def other_ways(shared: Shared) -> list[Shared]:
    """Return what is shared as of a card that averages, and with each law acting in each of its other ways (K)."""
    of_laws = (
        replace(shared, laws=(*shared.laws[:at], replace(law, values=values), *shared.laws[at + 1 :]))
        for at, law in enumerate(shared.laws)
        for values in law.mechanism.otherwise(law.values)
    )
    return [replace(shared, averaged=True), *of_laws]


def other_columns(fit: StudyFit, j: int) -> FloatArray:
    """Return how the j-th trial's force differs (n, K), mN, in each of `other_ways`."""
    trial, state = fit.trials[j], fit.states[j]
    own = own_effects(state)
    whole = simulate(trial, state, fit.shared, own)
    return np.column_stack([simulate(trial, state, way, own) - whole for way in other_ways(fit.shared)])


def sample_columns(trial: CellTrial, effects: Sequence[FloatArray]) -> FloatArray:
    """Return what each effect leaves over in every phase of a trial by acting through a kernel (n, D), mN.

    The kernel's first two moments, that of a sample's length each: sooner or later, and less sharply.
    """
    sample_s = 1.0 / trial.sample_rate_hz
    columns = [np.zeros((len(trial.time_s), 0))]
    for effect in effects:
        late = sample_s * np.gradient(effect, trial.time_s)
        spread = 0.5 * sample_s * np.gradient(late, trial.time_s)
        columns += [
            np.column_stack((late, spread)) * (trial.phase == code)[:, None]
            for code in range(len(PHASE_NAMES))
        ]
    return np.hstack(columns)
