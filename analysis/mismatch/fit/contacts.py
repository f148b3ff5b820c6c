"""Where contacts begin beside a surface that moves: each trial's is begun anew from both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch.fit.own import force_columns, own_columns
from analysis.mismatch.fit.rhythms import followed, where_found
from analysis.mismatch.fit.study_fit import AT_REST, StudyFit
from analysis.mismatch.fit.trial_fit import fit_trial
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import TrialState

AWAY = (-1.4, -0.7, -0.35, 0.35, 0.7, 1.4)
"""Times the rms by which a surface moves: as far as the ends of a sine, half of that, and half of it again."""
LIKELIER = 2.0
"""Deviance that another beginning must gain."""
MOST_MOVES = 4
"""How often a contact is begun anew from where that led."""


def contacts_begun_anew(fit: StudyFit) -> StudyFit:
    """Return the fit with each trial's contact where that is likeliest of several beginnings, beside its rhythms.

    A punch that dwells on skin that goes to and fro hardly touches it at times: then a contact that is too low and a
    surface that moves too little do nearly what the true ones do, and no small step leads from these to those.
    """
    states, whiteners = list(fit.states), list(fit.whiteners)
    for j, state in enumerate(fit.states):
        rms_mm = _moves_mm(fit, j)
        if not (rms_mm > 0.0 and fit.trials[j].touches):
            continue
        best, whitener, deviance = _from(fit, j, state)
        for _ in range(MOST_MOVES):
            starts = (replace(best, z0_mm=best.z0_mm + share * rms_mm) for share in AWAY)
            there = min((_from(fit, j, start) for start in starts), key=lambda found: found[2])
            if there[2] > deviance - LIKELIER:
                break
            best, whitener, deviance = there
        states[j], whiteners[j] = best, whitener
    if all(new is old for new, old in zip(states, fit.states, strict=True)):
        return fit
    return replace(fit, states=tuple(states), whiteners=tuple(whiteners))


def _moves_mm(fit: StudyFit, j: int) -> float:
    """Return by how much rhythms move the j-th surface about a punch at rest on it, rms mm; 0 if it stays on."""
    trial, state = fit.trials[j], fit.states[j]
    if not state.rhythms:
        return 0.0
    at_rest = trial.in_phase(*AT_REST)
    if not np.any(at_rest):
        return 0.0
    surface_mm = where_found(trial, state)["surface"]
    rms_mm = float(np.std(surface_mm[at_rest]))
    shallowest_mm = float(np.min((trial.position_mm + surface_mm)[at_rest])) - state.z0_mm
    return rms_mm if shallowest_mm < AWAY[-1] * rms_mm else 0.0


def _from(fit: StudyFit, j: int, start: TrialState) -> tuple[TrialState, Whitener, float]:
    """Return the j-th trial's state fitted from a beginning, what weighs it there, and its deviance."""
    trial = fit.trials[j]
    there, whitener = followed(trial, start, fit.shared, fit.whiteners[j])
    own = own_columns(force_columns(trial, there, fit.shared), whitener, there, fit.population)
    state, cost = fit_trial(trial, whitener, there, fit.shared, fit.population, own)
    return state, whitener, cost + whitener.log_determinant
