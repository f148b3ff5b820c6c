"""A law's arm exchanged with one of the tissue's: recordings show a set of arms, not which of them the law added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch.fit.start import longest_s
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import Law
from analysis.mismatch.model.population import Population
from analysis.simulation.mechanism import Tissue


def weakest_apart(fit: StudyFit, law: Law) -> StudyFit | None:
    """Return the fit, to be refitted, with the weakest of all arms as the law's; None where it is, or the law is none.

    Where all trials have one tissue no force changes.
    """
    typical, size = Tissue(*np.exp(fit.population.mean)), law.size.name
    exchanged = {arm: law.mechanism.exchanged(typical, law.values, arm) for arm in (1, 2)}
    weaker = {arm: e for arm, e in exchanged.items() if e and e[1][size] < law.values[size]}
    if not weaker:
        return None
    arm, (tissue, values) = min(weaker.items(), key=lambda e: e[1][1][size])
    states = []
    for state in fit.states:
        own = law.mechanism.exchanged(state.tissue, law.values, arm) if state.has_tissue else None
        states.append(replace(state, log_tissue=own[0].logarithms) if own else state)
    laws = tuple(replace(law, values=values) if one is law else one for one in fit.shared.laws)
    return replace(
        fit,
        states=tuple(states),
        shared=replace(fit.shared, laws=laws),
        population=Population.weak(tissue.logarithms, longest_s(fit.trials)),
    ).with_population(1)
