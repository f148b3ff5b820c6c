"""Noise that is there in contact only is none: what a sensor does, it does before and after contact too."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.baseline import noise_left
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.slow_noise import restricted_deviance
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import OwnShape, OwnShapes, TrialState, tissue_force
from analysis.simulation.cells import CellTrial
from analysis.simulation.samples import kept_by_mean

SHARES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 0.0)
"""Shares of the variance of correlated noise that are tried out of contact."""
FEWEST_CELLS = 50


@dataclass(frozen=True)
class Quiet:
    """The noise out of contact, how many nats likelier it is there than that of whole trials, and what is heard in
    contact alone: the force's rms (mN) about its mean over a hold.
    """

    noise: NoiseModel
    gain: float
    wander_mn: float = 0.0


def out_of_contact(fit: StudyFit) -> Quiet:
    """Weigh the noise of whole trials by what they are while nothing is touched (likelihood ratio, one share free).

    Under H0, noise of the sensor, the gain is half a chi2 of one degree of freedom. A block is so stiff that the noise
    of the position is a force: of what wanders on skin its trials say nothing.
    """
    fit = _on_skin(fit)
    noise, away = fit.noise, _away(fit)
    if not (noise.exponentials or noise.bands) or away is None:
        return Quiet(noise, 0.0)
    white, others = NoiseModel(noise.white_mn), replace(noise, white_mn=0.0)
    tried = [white + others.times(float(np.sqrt(s))) for s in SHARES]
    deviances = [restricted_deviance(away, n) for n in tried]
    best = int(np.argmin(deviances))
    hold_s = float(np.median([np.ptp(t.hold_window_s) for t in fit.trials]))
    about_mean = sum(v * (1.0 - kept_by_mean(np.array(hold_s / t_s))) for v, t_s in noise.exponentials)
    swaying = sum(band.variance for band in noise.bands)
    wander_mn = float(np.sqrt((1.0 - SHARES[best]) * max(about_mean + swaying, 0.0)))
    return Quiet(tried[best], 0.5 * (deviances[0] - deviances[best]), wander_mn)


def heard_out_of_contact(fit: StudyFit, without: NoiseModel) -> float:
    """Return by how many nats a fit's noise is likelier than another while nothing is touched; 0 where all touch."""
    fit = _on_skin(fit)
    away = _away(fit)
    if away is None:
        return 0.0
    return 0.5 * (restricted_deviance(away, without) - restricted_deviance(away, fit.noise))


def _away(fit: StudyFit) -> StudyFit | None:
    """Return what is left of a fit's trials out of contact, as a study of its own; None if nothing is."""
    apart = [_apart(fit, j) for j in range(len(fit.trials))]
    kept = [a for a in apart if a is not None]
    if not kept:
        return None
    return replace(
        fit,
        trials=tuple(t for t, _ in kept),
        states=tuple(s for _, s in kept),
        whiteners=fit.whiteners[: len(kept)],
        shared=replace(fit.shared, laws=()),
    )


def _on_skin(fit: StudyFit) -> StudyFit:
    """Return the fit of the trials that press no block, weighed by their own noise."""
    kept = [j for j, trial in enumerate(fit.trials) if trial.kind != "rigid_target"]
    if not kept or len(kept) == len(fit.trials):
        return fit
    skin = replace(
        fit,
        trials=tuple(fit.trials[j] for j in kept),
        states=tuple(fit.states[j] for j in kept),
        whiteners=tuple(fit.whiteners[j] for j in kept),
    )
    return skin.weighed_by(noise_left(skin))


def _apart(fit: StudyFit, j: int) -> tuple[CellTrial, TrialState] | None:
    """Return what is left of the j-th trial out of contact, as a trial that touches nothing; None if it always does.

    None, too, of a coarse converter: there the same reading may come again and again, or two by turns, as a force lies
    on a level or between two.
    """
    trial, state = fit.trials[j], fit.states[j]
    if trial.levels is not None:
        return None
    contact = np.abs(tissue_force(trial, state, fit.shared)) > 0.0
    touched = np.flatnonzero(contact)
    free: NDArray[np.bool_] = trial.fitted.copy()
    if len(touched):
        free[touched[0] : touched[-1] + 1] = False
    if free.sum() < FEWEST_CELLS:
        return None
    left = replace(trial, kind="air_sweep", force_mn=fit.residual_mn(j), fitted=free)
    # a level of its own before contact and after: skin clings, and hysteresis stays
    first = np.arange(len(free)) < (touched[0] if len(touched) else len(free))
    levels = OwnShapes(
        OwnShape("level", "force", part.astype(np.float64), 1e6 * fit.noise.rms_mn**2)
        for part in (first, ~first)
    )
    return left, TrialState(np.zeros(0), state.z0_mm, 0.0, levels, np.zeros(2))
