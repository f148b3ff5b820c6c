"""How well planned trials would tell two accounts apart that fit the recorded ones alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.amplitude_t import CONTRIBUTES, FEWEST_TRIALS
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.planned import PlannedTrial
from analysis.mismatch.report import Report
from analysis.mismatch.shared import Addition
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Values, library

FloatArray = NDArray[np.float64]

MOST_ITEMS = 4
SLIGHT = 0.01
LAWS_HOLD_TO = 1e-3
SHOWN_BY_T = 6.0
"""Strength at which a t over trials is significant beside all others, with some to spare."""


@dataclass(frozen=True)
class Item:
    """Two accounts that fit alike: ``fit`` is free to adapt, ``other`` with a tissue is what it must imitate.

    ``scale`` undoes that a signature was taken at a fraction of its typical size.
    """

    pair: tuple[str, str]
    fit: JointFit
    other: tuple[tuple[Mechanism, Values], ...]
    tissue_of: JointFit
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
        return float(e.sum() / np.sqrt(max(float((e**2 + e).sum()), 1e-300)))

    def can_show(self, critical: float) -> bool:
        """Whether the trials could make it significant: by flips, or, where enough speak of it, by a t."""
        e = self.energy
        enough = int((e > CONTRIBUTES * e.max()).sum()) >= FEWEST_TRIALS
        return self.flip_statistic >= critical or (enough and float(np.sqrt(e.sum())) >= SHOWN_BY_T)


def separation(
    diagnosis: Diagnosis, item: Item, cells: Sequence[CellTrial], plans: Sequence[PlannedTrial]
) -> Separation:
    """Return what planned trials tell between the two accounts of an item."""
    # every trial speaks of the same shared parameters, whether it touches skin or a block
    recorded = diagnosis.problem.trials
    skin = [t for t in recorded if t.kind == "ramp_hold_retract"][:1]
    block = [t for t in recorded if t.kind == "rigid_target"][:1]
    block = block or [replace(t, kind="rigid_target", target_stiffness_mn_per_mm=None) for t in skin]
    spoken_of = [*skin, *block]
    parts = []
    for trial, plan in zip(cells, plans, strict=True):
        own = PerTrial(plan.z0_mm, 0.0)
        whitener = Whitener(trial, diagnosis.noise)
        line = linearise(trial, whitener, item.fit.simulation, own, spoken_of, None)
        other = item.tissue_of.simulation
        true = simulate_force(
            trial,
            other.tissue,
            own,
            item.other,
            rigid_stiffness=item.fit.simulation.rigid_stiffness,
            ideal_step=other.ideal_step and trial.kind == "ramp_hold_retract",
        )
        difference = whitener(true - item.fit.simulation.force_mn(trial, own))
        left, _ = project_out(line.A, np.column_stack([difference, line.J]))
        g, J = item.scale * left[:, 0], left[:, 1:]
        parts.append((J.T @ J, J.T @ g, float(g @ g)))
    return Separation(
        np.array([p[0] for p in parts]),
        np.array([p[1] for p in parts]),
        np.array([p[2] for p in parts]),
        item.fit.simulation.known(spoken_of)[0],
    )


def confusable(diagnosis: Diagnosis, report: Report) -> list[Item]:
    """Return what needs separating: rivals of what was named first, then what could hide."""
    fit, found = diagnosis.improved, []
    for listed_one in report.mechanisms:
        names = [a.mechanism.name for a in fit.simulation.additions]
        place = names.index(listed_one.name) if listed_one.name in names else None
        if place is None or fit.simulation.additions[place].mechanism.form != "law":
            continue
        for name in listed_one.alternatives:
            rival = _rival(diagnosis, place, name)
            if rival is not None:
                here = tuple((a.mechanism, a.values) for a in fit.simulation.additions)
                found.append(Item((listed_one.name, name), rival, here, fit, 1.0))
    present = tuple((a.mechanism, a.values) for a in fit.simulation.additions if a.latent is None)
    named = {n for item in found for n in item.pair}
    for absorbed in diagnosis.absorbed:
        if absorbed.mechanism.name in named:
            continue
        m, values = absorbed.mechanism, dict(absorbed.values)
        p = m.parameter(m.amplitude)
        scale = 1.0 / SLIGHT
        if p.scale == "linear":
            values[m.amplitude] = m.null[m.amplitude] + SLIGHT * (values[m.amplitude] - m.null[m.amplitude])
        else:
            values[m.amplitude] = p.from_fit(SLIGHT * p.to_fit(values[m.amplitude]))
        found.append(Item((m.name, "tissue"), _without_latents(fit), (*present, (m, values)), fit, scale))
    return found[:MOST_ITEMS]


def _without_latents(fit: JointFit) -> JointFit:
    kept = tuple(a for a in fit.simulation.additions if a.latent is None)
    return replace(fit, simulation=replace(fit.simulation, additions=kept))


def _rival(diagnosis: Diagnosis, place: int, name: str) -> JointFit | None:
    """Return the fit with another mechanism in the place of a named one."""
    mechanism = library().get(name)
    if mechanism is None or mechanism.form != "law":
        return None
    fit = diagnosis.improved
    considered = [c for step in diagnosis.named.considered for c in step if c.mechanism.name == name]
    values = (
        considered[0].fit.simulation.additions[-1].values
        if considered
        else {**mechanism.null, **mechanism.typical}
    )
    start = considered[0].fit if considered else fit
    additions = list(fit.simulation.additions)
    additions[place] = Addition(mechanism, values)
    simulation = replace(start.simulation, additions=tuple(additions))
    return _without_latents(diagnosis.problem.fit(simulation, start.own, rounds=6))
