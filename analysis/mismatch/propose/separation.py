"""How well planned trials would tell two accounts apart that fit the recorded ones alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit.law_fit import fit_laws, law_columns, law_prior
from analysis.mismatch.fit.own import Projector, force_columns, own_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.locate.absorbed import SLIGHT, slight
from analysis.mismatch.model.effects import TISSUE_SIZE, Law, Shared, TrialState, simulate
from analysis.mismatch.model.population import Population
from analysis.mismatch.propose.planned import PlannedTrial
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

FloatArray = NDArray[np.float64]

MOST_ITEMS = 4
CONTRIBUTES, FEWEST_TRIALS = 0.05, 4
"""A t over trials needs four that each hold a twentieth of what the clearest holds."""
LAWS_HOLD_TO = 1e-3
SHOWN_BY_T = 6.0
"""Strength at which a t over trials is significant beside all others, with some to spare."""


@dataclass(frozen=True)
class Shares:
    """What trials share by one account: laws, and the population of tissues."""

    shared: Shared
    population: Population


@dataclass(frozen=True)
class Item:
    """Two accounts that fit alike: ``fitted`` is free to adapt, ``true`` is what it must imitate.

    ``scale`` undoes that a signature was taken at a fraction of its typical size.
    """

    pair: tuple[str, str]
    fitted: Shares
    true: Shares
    scale: float


@dataclass(frozen=True)
class Separation:
    """What planned trials tell between the two accounts of an item; trials are joined by ``+``.

    By trial, with its own parameters taken out: ``JJ`` (n, P, P) of the fitted account's shared parameters, ``gg`` (n,)
    of the difference of the accounts, ``Jg`` (n, P); in noise standard deviations. ``known`` (P, P): what is known of
    these parameters without any trial.
    """

    JJ: FloatArray
    Jg: FloatArray
    gg: FloatArray
    known: FloatArray

    def __add__(self, other: Separation) -> Separation:
        return Separation(
            np.concatenate([self.JJ, other.JJ]),
            np.concatenate([self.Jg, other.Jg]),
            np.concatenate([self.gg, other.gg]),
            self.known,
        )

    def repeated(self, n: int) -> Separation:
        """Return the separation by the same trials n times."""
        return Separation(
            np.tile(self.JJ, (n, 1, 1)), np.tile(self.Jg, (n, 1)), np.tile(self.gg, n), self.known
        )

    def silenced(self) -> Separation:
        """Return trials that are run but tell nothing."""
        return Separation(0.0 * self.JJ, 0.0 * self.Jg, 0.0 * self.gg, self.known)

    @property
    def energy(self) -> FloatArray:
        """Squared noise standard deviations (n,) that each trial keeps of the difference after a refit.

        What is bounded by prior knowledge has gone to its bound in that refit, and takes no further part in it.
        """
        free = np.diag(self.known) == 0
        information = self.JJ.sum(axis=0)[np.ix_(free, free)]
        moved = np.zeros(len(free))
        moved[free] = np.linalg.pinv(information, rcond=1e-12, hermitian=True) @ self.Jg.sum(axis=0)[free]
        kept = self.gg - 2.0 * self.Jg @ moved + np.einsum("p,npq,q->n", moved, self.JJ, moved)
        return np.asarray(np.maximum(kept, 0.0))

    @property
    def strength(self) -> float:
        """Noise standard deviations that remain of the difference over all trials, and against what is known.

        What is left of a thousandth of the difference is not counted: no law holds so well, nor is computed so well.
        """
        information = self.JJ.sum(axis=0) + self.known
        moved = np.linalg.pinv(information, rcond=1e-12, hermitian=True) @ self.Jg.sum(axis=0)
        against_known = float(moved @ self.known @ moved)
        kept = float(self.gg.sum()) - float(self.Jg.sum(axis=0) @ moved) - against_known
        return float(np.sqrt(against_known + max(kept - LAWS_HOLD_TO**2 * float(self.gg.sum()), 0.0)))

    @property
    def flip_statistic(self) -> float:
        """Expected statistic of a sign-flip test over the trials.

        Never above the root of their number however strong the difference is: flips trust no noise, and pay for it.
        """
        e = self.energy
        most = max(float(e.max()), 1e-150)
        # in units of the largest: what a law does far from where it was fitted may be beyond any square
        shares = e / most
        return float(shares.sum() / np.sqrt(max(float((shares**2 + shares / most).sum()), 1e-300)))

    def can_show(self, critical: float) -> bool:
        """Whether the trials could make it significant: by flips, or, where enough speak of it, by a t."""
        e = self.energy
        enough = int((e > CONTRIBUTES * e.max()).sum()) >= FEWEST_TRIALS
        return self.flip_statistic >= critical or (enough and float(np.sqrt(e.sum())) >= SHOWN_BY_T)


def separation(
    diagnosis: Diagnosis, item: Item, cells: Sequence[CellTrial], plans: Sequence[PlannedTrial]
) -> Separation:
    """Return what planned trials tell between the two accounts of an item, each trial's tissue its own."""
    noise = diagnosis.improved.fit.noise
    parts = []
    for trial, plan in zip(cells, plans, strict=True):
        whitener = Whitener(trial, noise)
        state = _state_of(trial, plan, item.fitted)
        own = own_columns(
            force_columns(trial, state, item.fitted.shared), whitener, state, item.fitted.population
        )
        projector = Projector(own, whitener)
        true = simulate(trial, _state_of(trial, plan, item.true), item.true.shared)
        difference = true - simulate(trial, state, item.fitted.shared)
        g = item.scale * projector(difference[:, None])[:, 0]
        laws = projector(law_columns(trial, state, item.fitted.shared))
        J = np.column_stack([projector.mean_columns, laws])
        parts.append((J.T @ J, J.T @ g, float(g @ g)))
    known = np.concatenate([np.zeros(TISSUE_SIZE), law_prior(item.fitted.shared.laws)[0]])
    return Separation(
        np.array([p[0] for p in parts]),
        np.array([p[1] for p in parts]),
        np.array([p[2] for p in parts]),
        np.diag(known),
    )


def _state_of(trial: CellTrial, plan: PlannedTrial, shares: Shares) -> TrialState:
    skin = trial.kind == "ramp_hold_retract"
    return TrialState(shares.population.mean if skin else np.zeros(0), plan.z0_mm, 0.0)


def confusable(diagnosis: Diagnosis) -> list[Item]:
    """Return what needs separating: rivals of what was named first, then what could hide."""
    fit = diagnosis.improved.fit
    here = Shares(fit.shared, fit.population)
    found: list[Item] = []
    for finding in diagnosis.findings:
        rivals = {r.name: r.account.fit for r in diagnosis.named.rivals.get(finding.name, ())}
        if all(law.name != finding.name for law in fit.shared.laws):
            continue
        for name in finding.alternatives:
            other = rivals.get(name) or _replaced(fit, finding.name, name)
            if other is not None and any(law.name == name for law in other.shared.laws):
                pair = (finding.name, name)
                found.append(Item(pair, Shares(other.shared, other.population), here, 1.0))
    named = {n for item in found for n in item.pair}
    for absorbed in diagnosis.absorbed:
        m = absorbed.mechanism
        if m.name in named:
            continue
        law = Law(m, slight(m), (m.amplitude,))
        true = replace(here, shared=replace(fit.shared, laws=(*fit.shared.laws, law)))
        found.append(Item((m.name, "tissue"), here, true, 1.0 / SLIGHT))
    return found[:MOST_ITEMS]


def _replaced(fit: StudyFit, name: str, other: str) -> StudyFit | None:
    """Return the fit with another law of typical size in the place of a named one; None where it is no law."""
    m = library().get(other)
    if m is None or m.form != "law":
        return None
    law = Law(m, {**m.null, **m.typical}, tuple(p.name for p in m.parameters))
    laws = tuple(law if old.name == name else old for old in fit.shared.laws)
    return fit_laws(replace(fit, shared=replace(fit.shared, laws=laws)), rounds=6)
