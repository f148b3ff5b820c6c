"""A small motion in the air that every signal must show as what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.hardware import proof
from rig.hardware.limits import steady_noise_v
from rig.hardware.playback import Chunk, Playback
from rig.hardware.retreat import straight_mm

if TYPE_CHECKING:
    from rig.hardware.lever import Lever

_READ = 80


def probe(lever: Lever) -> float:
    """Move the arm by 0.05 mm from the safe position and back, away from the finger where there is room.

    Returns the noise of the free arm's force signal, V rms.

    Raises ArmNotProvenError where a signal does not say so, or where the force is not that of a free arm.
    """
    c, limits, rate_hz = lever.calibration, lever.limits, lever.sample_rate_hz
    safe_mm = limits.safe_position_mm
    room = safe_mm - proof.PROBE_MM >= limits.travel_min_mm
    far_mm = safe_mm + (-proof.PROBE_MM if room else proof.PROBE_MM)
    there = straight_mm(lever.commanded_mm, far_mm, speed_mm_s=proof.PROBE_SPEED_MM_S, rate_hz=rate_hz)
    stay = np.full(round(proof.PROBE_STAY_S * rate_hz), far_mm)
    lever.start_recording()
    before = _samples(lever.read(round(proof.LOOK_S * rate_hz)))
    proof.prove_free(before[1], c, limits)
    playback = lever.play(np.concatenate([there, stay, there[::-1]]))
    chunks = []
    while not playback.done:
        chunks.append(lever.read(_READ))
    lever.stop_recording()
    at_far_end = _begin(playback) + len(there) + len(stay) // 3 - chunks[0].start
    way = np.concatenate([_samples(chunk) for chunk in chunks], axis=1)
    during = way[:, at_far_end : at_far_end + len(stay) // 3]
    proof.prove_probe(before, during, far_mm - safe_mm, c, loopback_wired=lever.loopback_wired)
    return steady_noise_v(before[1])


def _begin(playback: Playback) -> int:
    started = playback.started_sample
    return playback.expected_sample if started is None else started


def _samples(chunk: Chunk) -> proof.FloatArray:
    """A chunk's samples as they came, (3, n), V; the last is the loop-back where it is wired."""
    return np.array([chunk.position_v, chunk.force_v, chunk.command_v])
