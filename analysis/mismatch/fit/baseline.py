"""The baseline simulation fitted, and the noise that is left between trials after their own tissue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.mismatch.fit.noise import FASTEST_SLOW_S, Band, NoiseModel, measure_noise
from analysis.mismatch.fit.position_noise import freed_of_position_noise
from analysis.mismatch.fit.slow_noise import restricted_deviance, with_slow_noise
from analysis.mismatch.fit.start import longest_s, start_rigid, start_tissue
from analysis.mismatch.fit.study_fit import AT_REST, StudyFit, sampled_alike, tells_noise
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.effects import OwnShape, Shared, TrialState, tissue_force
from analysis.mismatch.model.population import Population
from analysis.simulation.cells import CellTrial
from analysis.simulation.smoothing import sample_noise

FloatArray = NDArray[np.float64]

SETTLES_S = 0.15
SHORTEST = 64
HEARD_IN = (*AT_REST, "sweep")
"""Phases in which noise is measured: at rest, and in air."""
FIRST_SLOW = (0.02, 0.1)
"""Variance (in units of white) and time (s) of the slow noise that is assumed before any was measured."""
NOISE_ROUNDS = 2
STATED_BLOCK, UNSTATED_BLOCK = 0.05, 0.5
"""How well it is known what a block gives, as a share."""


def fit_baseline(
    trials: Sequence[CellTrial],
    *,
    ideal_step: bool = False,
    bands: tuple[Band, ...] = (),
) -> StudyFit:
    """Return the baseline simulation with noise, of which ``bands`` are known, and population estimated in turn."""
    mean = start_tissue(
        trials, [t.z0_start_mm for t in trials], [t.force_mn - t.offset_start_mn for t in trials]
    ).logarithms
    nothing = np.zeros(0)
    states = tuple(
        TrialState(mean if t.kind == "ramp_hold_retract" else nothing, t.z0_start_mm, t.offset_start_mn)
        for t in trials
    )
    late_samples = max(t.late_samples for t in trials)
    shared = Shared((), start_rigid(trials), ideal_step, late_samples=late_samples)
    states = tuple(_with_block(t, s) for t, s in zip(trials, states, strict=True))
    white = max(float(np.median([sample_noise(t.full_force_mn.astype(np.float64)) for t in trials])), 1e-12)
    noise = NoiseModel(white, ((FIRST_SLOW[0] * white**2, FIRST_SLOW[1]),), bands=bands)
    fit = StudyFit(
        tuple(trials),
        tuple(Whitener(t, noise) for t in trials),
        noise,
        shared,
        states,
        Population.weak(mean, longest_s(trials)),
    )
    for _ in range(NOISE_ROUNDS):
        fit = fit.with_population()
        fit = fit.weighed_by(noise_left(fit))
    fit = fit.with_population()
    freed = freed_of_position_noise(fit)
    return fit if freed is fit else freed.weighed_by(noise_left(freed)).with_population()


def begun_anew(fit: StudyFit) -> StudyFit:
    """Return the fit with its tissues begun anew beside the laws and shapes that were added.

    A tissue that had stood for a law before it was added may not find back: an arm that imitates a dashpot is far from
    where an arm is missing. Where the effects leave no force that grows with depth it stays as it is.
    """
    forces_mn = [
        fit.residual_mn(j) + tissue_force(trial, state, fit.shared)
        for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True))
    ]
    try:
        mean = start_tissue(fit.trials, [s.z0_mm for s in fit.states], forces_mn).logarithms
    except BadInputError:
        return fit
    states = tuple(replace(s, log_tissue=mean) if s.has_tissue else s for s in fit.states)
    weak = Population.weak(mean, longest_s(fit.trials))
    return replace(fit, states=states, population=weak).with_population(1)


def _with_block(trial: CellTrial, state: TrialState) -> TrialState:
    """Return the state of a run on a stiff block with what that block gives free, as far as it is not stated."""
    if trial.kind != "rigid_target":
        return state
    known = STATED_BLOCK if trial.target_stiffness_mn_per_mm else UNSTATED_BLOCK
    return state.with_shapes([OwnShape("block", "block", np.zeros(0), known**2)])


def noise_of(fit: StudyFit, *, may_be_smooth: bool = False) -> NoiseModel:
    """Return the noise from what differs between trials of one condition at rest, each after its own tissue.

    Where it can't be told from what laws leave over, all of it is weighed as if it were white.
    """
    rate = fit.trials[0].sample_rate_hz
    if sampled_alike(fit.trials):
        noise = measure_noise(_at_rest(fit), rate, may_be_smooth=may_be_smooth, bands=fit.noise.bands)
    else:
        white = [sample_noise(fit.full_residual_mn(j)) for j in range(len(fit.trials))]
        noise = NoiseModel(max(float(np.median(white)), 1e-12))
    if tells_noise(fit.trials):
        return noise
    slow = 2.0 * rate * sum(variance * time_s for variance, time_s in noise.exponentials)
    return NoiseModel(float(np.sqrt(noise.white_mn**2 + slow)))


def _at_rest(fit: StudyFit) -> list[FloatArray]:
    """Return stretches of residual at rest, each less what trials of its condition have in common.

    What is left is the pure error of a lack-of-fit test: what all trials of a condition have in common is no noise,
    whatever it is. Where a condition was run once its residual itself is taken.
    """
    pieces: dict[tuple[str, str], list[FloatArray]] = {}
    for j, t in enumerate(fit.trials):
        residual = fit.drawn_residual_mn(j)
        for name in HEARD_IN:
            cells = np.flatnonzero(t.in_phase(name))
            if not len(cells):
                continue
            a, b = int(t.starts[cells[0]] + SETTLES_S * t.sample_rate_hz), int(t.starts[cells[-1]])
            if b - a > SHORTEST:
                pieces.setdefault((t.condition, name), []).append(residual[a:b])
    stretches: list[FloatArray] = []
    for (_, name), found in pieces.items():
        n = min(len(r) for r in found)
        if name == "hold" and len(found) > 1:
            common = np.mean([r[:n] for r in found], axis=0)
            stretches += [(r[:n] - common) * np.sqrt(len(found) / (len(found) - 1)) for r in found]
        else:
            stretches += found
    return stretches or [fit.full_residual_mn(j) for j in range(len(fit.trials))]


def _likelier_at_rest(fit: StudyFit, quick: NoiseModel) -> NoiseModel:
    """Return a noise measured anew, or the quick parts of a fit's own where trials at rest are likelier by them.

    A spectrum is a sum of few shapes to a few per cent: another sum that is as near is hundreds of nats away.
    """
    known = fit.noise.quicker_than(FASTEST_SLOW_S)
    if known == quick or not tells_noise(fit.trials):
        return quick
    resting = tuple(replace(t, fitted=t.fitted & t.in_phase(*HEARD_IN)) for t in fit.trials)
    if not all(t.fitted.any() for t in resting):
        return quick
    at_rest, slow = replace(fit, trials=resting), fit.noise.slower_from(FASTEST_SLOW_S)
    vars(at_rest)["force_columns"] = fit.force_columns
    return min((quick, known), key=lambda noise: restricted_deviance(at_rest, noise + slow))


def noise_left(fit: StudyFit, *, may_be_smooth: bool = False) -> NoiseModel:
    """Return the noise measured anew from what a fit leaves, smooth if that may be, or if it was.

    Of one or two trials it is no smaller than that, whatever it is: what is quiet at rest would make a law's own
    inexactness infinite. What laws leave over is smooth: where noise can't be told from that, it is not.
    """
    may_be_smooth = (may_be_smooth or bool(fit.noise.smooth)) and tells_noise(fit.trials)
    quick = _likelier_at_rest(fit, noise_of(fit, may_be_smooth=may_be_smooth))
    fit = with_slow_noise(fit.weighed_by(quick), fit.noise, smooth=may_be_smooth)
    if len(fit.trials) >= FEWEST_HELD_OUT:
        return fit.noise
    left = np.concatenate([w(fit.residual_mn(j)) for j, w in enumerate(fit.whiteners)])
    return fit.noise.times(max(float(np.sqrt(np.mean(left**2))), 1.0))
