"""The laws as columns: what each would add to a fitted simulation, at every setting of its shape."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.model.effects import Law, Shared, TrialState, own_effects, simulate
from analysis.mismatch.model.unfollowed import UNFOLLOWED
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, Values, library

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Template:
    """A law at one setting; its column is the change it makes there: a coefficient of 1 is the setting itself."""

    mechanism: Mechanism
    values: Values
    free: tuple[str, ...]

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    def as_law(self, coefficient: float) -> Law:
        """Return the law with its amplitude scaled by a coefficient, where its scale is linear."""
        values = dict(self.values)
        name = self.mechanism.amplitude if self.mechanism.amplitude in self.free else self.free[0]
        p = self.mechanism.parameter(name)
        null = self.mechanism.null[name]
        if p.scale == "linear":
            values[name] = min(max(null + coefficient * (values[name] - null), p.lower), p.upper)
        elif p.scale == "inverse_square":
            values[name] = p.from_fit(coefficient * p.to_fit(values[name]))
        return Law(self.mechanism, values, self.free)


def templates(trials: Sequence[CellTrial], without: Collection[str] = ()) -> list[Template]:
    """Return the settings at which these trials could show each law that is none of those ``without``: of the library,
    and one that has no name there.

    Of those that relax there is one: beside it another would say no more than how rough it is.
    """
    peak_mn = max(float(np.ptp(t.force_mn)) for t in trials)
    depth_mm = max(t.study_depth_mm for t in trials)
    found = []
    relaxing = any(library()[name].relaxes for name in without if name in library())
    for m in (*library().values(), UNFOLLOWED):
        is_another = m.name not in without and not (m.relaxes and relaxing)
        if m.form != "law" or not is_another or not any(m.applies(t) for t in trials):
            continue
        for probe in m.probe_settings(peak_mn, depth_mm):
            found.append(Template(m, {**m.null, **probe}, tuple(probe)))
    return found


def template_columns(
    trial: CellTrial, state: TrialState, shared: Shared, wanted: Sequence[Template]
) -> FloatArray:
    """Return the change of force (n, K) that each template makes to a fitted simulation, mN."""
    own = own_effects(state)
    base = simulate(trial, state, shared, own)
    columns = np.zeros((len(base), len(wanted)))
    for k, t in enumerate(wanted):
        if t.mechanism.applies(trial):
            law = Law(t.mechanism, t.values, t.free)
            columns[:, k] = simulate(trial, state, replace(shared, laws=(*shared.laws, law)), own) - base
    return columns
