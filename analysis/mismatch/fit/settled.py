"""What a law changes once a trial's own parameters have followed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.own import moved
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.trial_fit import limited
from analysis.mismatch.model.dictionary import Template, template_columns
from analysis.mismatch.model.effects import TISSUE_SIZE, simulate

FloatArray = NDArray[np.float64]

STEPS = 2


@dataclass(frozen=True)
class Settled:
    """What K templates change in one trial once its own parameters have moved to undo it.

    ``force_mn`` (n, K) is what is left, ``log_tissue`` (K, 5) by how much the constants' logarithms have moved.
    """

    force_mn: FloatArray
    log_tissue: FloatArray


def settled_columns(fit: StudyFit, wanted: Sequence[Template]) -> list[Settled]:
    """Return what each template changes in each trial, its own parameters moved to undo it."""
    return [_settled(fit, j, wanted) for j in range(len(fit.trials))]


def _settled(fit: StudyFit, j: int, wanted: Sequence[Template]) -> Settled:
    """Return what each template changes in the j-th trial, its own parameters moved to undo it.

    A law that moves the surface by microns moves the kink of first contact, which is linear in nothing: the contact
    point must follow before a linear share is taken.
    """
    trial, state, own = fit.trials[j], fit.states[j], fit.own[j]
    base = simulate(trial, state, fit.shared)
    columns = template_columns(trial, state, fit.shared, wanted)
    log_tissue = np.zeros((len(wanted), TISSUE_SIZE))
    for k, template in enumerate(wanted):
        if not np.any(columns[:, k]):
            continue
        shared = replace(fit.shared, laws=(*fit.shared.laws, template.as_law(1.0)))
        there, before = state, float(np.sum(fit.whiteners[j](columns[:, k]) ** 2))
        for _ in range(STEPS):
            step = own.solve(own.columns.T @ fit.whiteners[j](columns[:, k]))
            there = moved(there, trial, -limited(trial, state, own, step))
            followed = simulate(trial, there, shared) - base
            left = float(np.sum(fit.whiteners[j](followed) ** 2))
            if not left < before:
                break
            columns[:, k], before = followed, left
            if state.has_tissue:
                log_tissue[k] = there.log_tissue - state.log_tissue
    return Settled(columns, log_tissue)
