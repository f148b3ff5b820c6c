"""What a fitted solid says of other motions: its own trial at every sample, and trials it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.block_response import sampled_force
from analysis.relaxation.blocks import condense
from analysis.relaxation.contact import find_contact
from analysis.relaxation.contact_law import FLAT, ContactLaw
from analysis.relaxation.convex_response import law_knots
from analysis.relaxation.motion import sample_noise
from analysis.relaxation.result import TrialFit
from analysis.relaxation.windows import FitWindow, cut_creep, cut_window


@dataclass(frozen=True, slots=True)
class Curve:
    """Recorded and fitted force (N,) mN over time (N,) s since the window's first sample."""

    time_s: FloatArray
    position_mm: FloatArray
    force_mn: FloatArray
    fitted_mn: FloatArray
    hold_start_s: float
    ramp_s: float


@dataclass(frozen=True, slots=True)
class Prediction:
    """How well one trial's solid says another's force.

    ``rms_mn`` of the force is missed, ``share`` is that in the force's range; ``peak_share`` by how much the
    peak is said too high, in the same range; ``noise_mn`` the recording's own noise; ``r2`` hides all that.
    """

    rms_mn: float
    share: float
    peak_share: float
    noise_mn: float
    r2: float


def fitted_curve(trial: Trial, row: TrialFit) -> Curve:
    """Return the force that a trial's own fit says; NaN before the hold for the step model, throughout for a creep."""
    creeping = cut_creep(trial) if row.creep else None
    window = cut_window(trial) if creeping is None else creeping
    if row.solid is not None:
        stiffness, times_s = np.array(row.solid.stiffness_mn_per_mm), np.array(row.solid.times_s)
        law = ContactLaw(row.solid.exponent, row.solid.reference_mm)
        found = _solid_force(window, stiffness, times_s, row.solid.contact_mm, law) + row.solid.offset_mn
        fitted = np.append(found, found[-1])
    else:
        fitted = np.full(len(window.time_s), np.nan)
        age_s = window.time_s[window.hold_start :] - window.time_s[window.hold_start]
        if row.step_answer is not None:
            fitted[window.hold_start :] = row.step_answer.force_mn(age_s)
    hold_start_s = float(window.time_s[window.hold_start])
    return Curve(window.time_s, window.position_mm, window.force_mn, fitted, hold_start_s, window.ramp_s)


def predict(
    stiffness_mn_per_mm: FloatArray,
    times_s: FloatArray,
    other: Trial,
    contact_mm: float,
    law: ContactLaw = FLAT,
) -> Prediction:
    """Return how well a solid, fitted elsewhere, says the force of another trial, touched at ``contact_mm``.

    ``stiffness_mn_per_mm`` (1 + n_arms,), k0 first; ``times_s`` (n_arms,). The other trial's force offset
    is free; nothing else is. Raises CannotFitError where the trial has nothing to predict.
    """
    window = cut_window(other)
    said_mn = _solid_force(window, stiffness_mn_per_mm, times_s, contact_mm, law)
    force_mn = window.force_mn[: len(said_mn)]
    said_mn = said_mn + float(np.mean(force_mn - said_mn))
    missed_mn = force_mn - said_mn
    rms_mn = float(np.sqrt(np.mean(missed_mn**2)))
    largest_mn = float(np.ptp(force_mn))
    peak = min(window.hold_start, len(said_mn) - 1)
    return Prediction(
        rms_mn=rms_mn,
        share=rms_mn / largest_mn,
        peak_share=float(said_mn[peak] - force_mn[peak]) / largest_mn,
        noise_mn=sample_noise(force_mn),
        r2=1.0 - rms_mn**2 / float(np.var(force_mn)),
    )


def _solid_force(
    window: FitWindow,
    stiffness_mn_per_mm: FloatArray,
    times_s: FloatArray,
    contact_mm: float,
    law: ContactLaw,
) -> FloatArray:
    blocks = condense(window, find_contact(window).sample)
    if law.exponent != 1.0:
        blocks = law_knots(blocks, contact_mm, law.reference_mm)
    return sampled_force(blocks, contact_mm, stiffness_mn_per_mm, times_s, law)
