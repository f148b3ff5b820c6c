"""Noise of a recorded position that lasts: what wanders beside a servo's answer, and no force follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.simulation.cells import CellTrial


def freed_of_position_noise(fit: StudyFit) -> StudyFit:
    """Return the fit to positions without noise that lasts, if trials show that it is noise; else the fit itself.

    What an arm did the skin has felt, what its sensor makes up it has not. H0: the force follows what wanders while the
    arm rests; against it stands the likelihood ratio of trials that go without that at rest, all that is their own
    fitted anew. A sensor's noise goes on while the arm moves; there a gear may err, too, and says nothing of noise.
    """
    if all(trial.if_noise_lasts is None for trial in fit.trials):
        return fit
    at_rest = replace(fit, trials=tuple(map(_calmer_at_rest, fit.trials))).with_population(1)
    if 0.5 * (fit.with_population(1).cost - at_rest.cost) < ENOUGH_SHARED:
        return fit
    return replace(fit, trials=tuple(map(_calmer, fit.trials))).with_population(1)


def _calmer_at_rest(trial: CellTrial) -> CellTrial:
    if trial.if_noise_lasts is None:
        return trial
    rests = trial.at_rest[trial.starts]
    return replace(trial, position_mm=np.where(rests, trial.if_noise_lasts.position_mm, trial.position_mm))


def _calmer(trial: CellTrial) -> CellTrial:
    path = trial.if_noise_lasts
    return trial if path is None else replace(trial, **vars(path), if_noise_lasts=None)
