"""Checks on the signals: the lever's hold, the skin's contact, the sensor, the finger's movements."""

from __future__ import annotations

import numpy as np

from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.contact import Contact
from analysis.relaxation.motion import sample_noise
from analysis.relaxation.result import Check
from analysis.relaxation.windows import FitWindow

_BINS = 50
_STEADY_SHARE = 0.01  # of the ramp's travel that the lever may move in the hold
_LEFT_SHARE = 0.05  # of the ramp's travel beyond which the lever no longer holds
_CONVERTER_END_V = 9.995
_FLAT_RUN = 8
_JUMP_WINDOW_S = 0.05
_JUMP_SIGMAS = 7.0
_RING_S = 0.05
_RING_RATIO = 2.0
_DRIFT_SHARE = 0.02
_DEPTH_SHARE = 0.05


def _bin_means(values: FloatArray, bins: int = _BINS) -> FloatArray:
    edges = np.linspace(0, len(values), min(bins, len(values)) + 1).astype(np.int64)
    return np.add.reduceat(values, edges[:-1]) / np.diff(edges)


def _held_mm(window: FitWindow) -> FloatArray:
    """Position in the hold without its first moments, in which the servo settles."""
    hold_mm = window.position_mm[window.hold_start :]
    settled = min(round(0.01 / window.step_s), len(hold_mm) // 20)
    return hold_mm[settled:]


def _travel_mm(window: FitWindow) -> float:
    hold_mm = window.position_mm[window.hold_start :]
    held_mm = float(np.median(hold_mm[:: max(1, len(hold_mm) // 1000)]))
    return abs(held_mm - float(window.position_mm[window.ramp_start]))


def hold_not_constant(window: FitWindow) -> Check:
    """Ask how far the lever moved in the hold."""
    held_mm = _held_mm(window)
    means = _bin_means(held_mm)
    range_um = 1e3 * float(np.ptp(means))
    noise_um = 1e3 * sample_noise(held_mm) * float(np.sqrt(_BINS / len(held_mm)))
    limit = max(1e3 * _STEADY_SHARE * _travel_mm(window), 6.0 * noise_um)
    text = f"the lever moved by {range_um:.3g} um in the hold"
    return Check("hold_not_constant", range_um, limit, "um", range_um > limit, text)


def control_mode_changed(trial: Trial, window: FitWindow) -> Check:
    """Ask whether the lever left the held position for good, as it does when force takes over control.

    An import that saw a change of control mode while it looked for the hold says so in its events.
    """
    stop = window.first_sample + len(window.time_s)
    for event in trial.events:
        if event.kind == "control_mode" and window.first_sample + window.ramp_start <= event.sample <= stop:
            at_s = (event.sample - window.first_sample - window.hold_start) * window.step_s
            return Check("control_mode_changed", at_s, window.hold_s, "s", True, event.message)
    held_mm = _held_mm(window)
    means = _bin_means(held_mm)
    limit_mm = _LEFT_SHARE * _travel_mm(window)
    away = np.abs(means - np.median(means[: max(3, len(means) // 5)])) > limit_mm
    left = away[-1]
    staying = len(away) - int(np.argmin(away[::-1])) if left and not away.all() else len(away)
    time_s = window.hold_s * staying / len(means)
    raised = bool(left) and limit_mm > 0
    text = "the lever held its position to the end"
    if raised:
        moved_um = 1e3 * float(abs(means[-1] - np.median(means[: max(3, len(means) // 5)])))
        text = (
            f"after {time_s:.3g} s of the hold the lever left its position (by {moved_um:.3g} um in the end)"
        )
    return Check("control_mode_changed", time_s, window.hold_s, "s", raised, text)


def contact_lost(window: FitWindow, offset_mn: float) -> Check:
    """Ask for how long the force of the hold was gone."""
    force_mn = window.force_mn[window.hold_start :] - offset_mn
    length = max(1, round(0.01 / window.step_s))
    means = _bin_means(force_mn, max(1, len(force_mn) // length))
    level = max(0.02 * float(np.max(means)), 4.0 * sample_noise(force_mn) / float(np.sqrt(length)))
    lost_ms = 1e3 * window.hold_s * float(np.mean(means < level))
    text = f"the force was gone for {lost_ms:.3g} ms of the hold"
    return Check("contact_lost", lost_ms, 0.0, "ms", lost_ms > 0, text)


def saturation(trial: Trial, window: FitWindow) -> Check:
    """Count samples at the converter's ends and in flat tops of a force that is noisy elsewhere."""
    used = slice(window.first_sample, window.first_sample + len(window.time_s))
    count = 0
    if trial.source != "imported":
        force_v, position_v = trial.force_v[used], trial.position_v[used]
        count = sum(
            int(np.sum(np.abs(volts) >= _CONVERTER_END_V))
            for volts in (force_v, position_v)
            if max(volts.max(), -volts.min()) >= _CONVERTER_END_V  # quicker than to ask every sample
        )
    if sample_noise(window.force_mn) > 0:
        for end in (window.force_mn.max(), window.force_mn.min()):
            flat = np.flatnonzero(window.force_mn == end)
            if len(flat) < _FLAT_RUN:
                continue
            runs = np.split(flat, np.flatnonzero(np.diff(flat) > 1) + 1)
            if max(len(run) for run in runs) >= _FLAT_RUN:
                count = max(count, len(flat))
    text = f"{count} samples stand at the end of a range"
    return Check("saturation", float(count), 0.0, "samples", count > 0, text)


def motion_artefact(window: FitWindow, residual_mn: FloatArray) -> Check:
    """Look for the largest jump of the residual in the hold: the finger moved, or slipped."""
    length = max(2, round(_JUMP_WINDOW_S / window.step_s))
    skip = len(residual_mn) // 30
    rest = residual_mn[skip:]
    if len(rest) < 6 * length:
        return Check("motion_artefact", 0.0, np.inf, "mN", False, "the hold is too short to look for jumps")
    sums = np.concatenate([[0.0], np.cumsum(rest)])
    stride = max(1, length // 8)
    at = np.arange(length, len(rest) - length, stride)
    jumps = (sums[at + length] - 2.0 * sums[at] + sums[at - length]) / length
    usual = 1.4826 * float(np.median(np.abs(jumps)))
    largest = int(np.argmax(np.abs(jumps)))
    value = float(jumps[largest])
    limit = _JUMP_SIGMAS * usual
    time_s = (skip + int(at[largest])) * window.step_s
    text = f"the force jumps by {value:.3g} mN at {time_s:.3g} s of the hold (usual: {usual:.2g} mN)"
    return Check("motion_artefact", value, limit, "mN", abs(value) > limit > 0, text)


def ringing(window: FitWindow, residual_mn: FloatArray) -> Check:
    """Compare what is fast in the residual just after the ramp with what is fast later in the hold."""
    first = round(0.002 / window.step_s)
    length = round(_RING_S / window.step_s)
    if length < 20 or len(residual_mn) < 4 * length:
        return Check("ringing", 1.0, _RING_RATIO, "x", False, "the sampling is too slow to see ringing")
    early, late = _fast(residual_mn[first : first + length]), _fast(residual_mn[2 * length :])
    ratio = float(np.std(early) / max(float(np.std(late)), 1e-300))
    power = np.abs(np.fft.rfft(early * np.hanning(len(early)))) ** 2
    peak_hz = float(np.argmax(power[1:]) + 1) / (len(early) * window.step_s)
    text = f"after the ramp the residual is {ratio:.3g} times as restless as later, most at {peak_hz:.3g} Hz"
    return Check("ringing", ratio, _RING_RATIO, "x", ratio > _RING_RATIO, text)


def _fast(values: FloatArray) -> FloatArray:
    """What is left of values (n,) when a straight line over every sixteen of them is taken away."""
    rows = len(values) // 16
    if rows < 1:
        return np.asarray(values - values.mean(), dtype=float)
    blocks = values[: rows * 16].reshape(rows, 16)
    ramp = np.arange(16) - 7.5
    slopes = blocks @ ramp / float(ramp @ ramp)
    left: FloatArray = blocks - blocks.mean(axis=1, keepdims=True) - slopes[:, None] * ramp
    return np.asarray(left.ravel(), dtype=float)


def drift(trial: Trial, window: FitWindow, contact: Contact, elastic_mn: float) -> Check:
    """Compare the force before contact with the force at rest after contact is lost."""
    limit = _DRIFT_SHARE * abs(elastic_mn)
    clear = trial.phase("clear")
    nothing = Check("drift", 0.0, limit, "mN", False, "not recorded on both sides of the contact")
    if clear is None or not contact.seen:
        return nothing
    late = slice((clear.start + clear.stop) // 2, clear.stop)
    if clear.stop - clear.start < 40 or float(np.median(trial.position_mm[late])) > contact.position_mm:
        return nothing
    after_mn = float(np.mean(trial.force_mn[late]))
    value = after_mn - contact.force_before_mn
    minutes = (late.start - window.first_sample) / trial.sample_rate_hz
    text = f"the force at rest changed by {value:.3g} mN in {minutes:.3g} s"
    return Check("drift", value, limit, "mN", abs(value) > limit, text)


def depth_missed(trial: Trial, window: FitWindow) -> Check:
    """Compare the travel of the ramp with the depth that the protocol asked for."""
    asked_mm = trial.protocol.depth_mm
    if not asked_mm:
        return Check("depth_missed", 0.0, np.inf, "um", False, "the protocol names no depth")
    missed_um = 1e3 * (_travel_mm(window) - asked_mm)
    limit = 1e3 * _DEPTH_SHARE * asked_mm
    side = "beyond" if missed_um > 0 else "short of"
    text = f"the ramp ended {abs(missed_um):.3g} um {side} the protocol's depth"
    return Check("depth_missed", missed_um, limit, "um", abs(missed_um) > limit, text)
