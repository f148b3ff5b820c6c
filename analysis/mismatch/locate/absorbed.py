"""Laws that a fitted tissue imitates so well that these trials can't show them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.mismatch.fit.gram import gram, solve
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ABSORBED_SHARE, HIDDEN_STRENGTH
from analysis.mismatch.model.dictionary import Template, template_columns
from analysis.mismatch.model.effects import TISSUE_NAMES, TISSUE_SIZE
from analysis.simulation.mechanism import Mechanism, Values, library

SLIGHT = 0.01
HARDLY_SEEN = 5.0


@dataclass(frozen=True)
class Absorbed:
    """A mechanism this data can't see, and what it would do to the tissue."""

    mechanism: Mechanism
    values: Values
    shift_percent: dict[str, float]


def find_absorbed(fit: StudyFit) -> tuple[Absorbed, ...]:
    """Return the laws whose effect at typical size the population's mean takes up, so that no trial shows it."""
    present = {law.name for law in fit.shared.laws}
    wanted = [
        Template(m, slight(m), (m.amplitude,))
        for m in library().values()
        if m.form == "law" and m.typical and m.name not in present and any(m.applies(t) for t in fit.trials)
    ]
    if not wanted or not any(s.has_tissue for s in fit.states):
        return ()
    columns = [
        template_columns(t, s, fit.shared, wanted) / SLIGHT
        for t, s in zip(fit.trials, fit.states, strict=True)
    ]
    raw = sum(
        np.einsum("nk,nk->k", w, w) for w in (h(c) for h, c in zip(fit.whiteners, columns, strict=True))
    )
    grams = gram(fit, columns)
    total = grams.total()
    found = []
    for k, template in enumerate(wanted):
        # the column stands for the residual: what the population's mean makes of it, and what is left
        of_column = total.copy()
        of_column[:, -1] = total[:, TISSUE_SIZE + k]
        mean, _ = solve(of_column, grams.ridge, range(TISSUE_SIZE))
        left2 = float(total[TISSUE_SIZE + k, TISSUE_SIZE + k] - mean @ total[:TISSUE_SIZE, TISSUE_SIZE + k])
        left, whole = float(np.sqrt(max(left2, 0.0))), float(np.sqrt(np.asarray(raw)[k]))
        if whole < HIDDEN_STRENGTH or left > HARDLY_SEEN * HIDDEN_STRENGTH:
            continue
        if left > ABSORBED_SHARE * whole and left > HIDDEN_STRENGTH:
            continue
        shift = {n: 100.0 * float(m) for n, m in zip(TISSUE_NAMES, mean, strict=True)}
        values = {**template.mechanism.null, **template.mechanism.typical}
        found.append(Absorbed(template.mechanism, values, shift))
    return tuple(found)


def slight(mechanism: Mechanism) -> dict[str, float]:
    """Return the typical parameters with a hundredth of their amplitude, at which every law is linear."""
    values = {**mechanism.null, **mechanism.typical}
    name = mechanism.amplitude
    parameter = mechanism.parameter(name)
    if parameter.scale == "linear":
        values[name] = mechanism.null[name] + SLIGHT * (values[name] - mechanism.null[name])
    else:
        values[name] = parameter.from_fit(SLIGHT * parameter.to_fit(values[name]))
    return values
