"""Is the arm what the rig file says it is? Judged from samples, before it moves and after it moved a little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.errors import ArmNotProvenError
from rig.settings.constants import constants_problem
from rig.settings.rig_file import LeverSettings

FloatArray = NDArray[np.float64]

LOOK_S = 0.05
"""How long the inputs are looked at: 400 samples give the noise of a signal to 4 %."""

PROBE_MM = 0.05
PROBE_SPEED_MM_S = 5.0
PROBE_STAY_S = 0.03

_MARGIN_MM = 0.5
"""A position at rest may lie so far outside the travel: a fresh lever's constants are not known better."""

_OFFSET_MAX_MN = 50.0
"""The free arm's force, at most: its weight and the zero of the sensor."""

_NOISE_MAX_MN = 5.0
"""Ten times the lever's noise: a line that picks up everything, or a gain that is wrong by ten."""

_PROBE_TOLERANCE = 0.20
_PROBE_FORCE_MN = 5.0
"""More force than that under a probe in the air is no air."""


def prove_at_rest(seen: FloatArray, c: Calibration, lever: LeverSettings, *, loopback_wired: bool) -> None:
    """Raise ArmNotProvenError where samples (n_channels, n), V, of an arm at rest contradict the rig file.

    The channels are position, force and, where it is wired, the loop-back of the command.
    """
    problem = constants_problem(c, lever)
    if problem is not None:
        raise _refusal(f"the constants are not those of this lever: {problem}", "calibrate again")
    if not np.isfinite(seen).all():
        raise _refusal("an input reads no numbers", "check the card")
    position_mm = (float(seen[0].mean()) - c.position_zero_v) / c.volts_per_mm
    if loopback_wired:
        commanded_mm = (float(seen[2].mean()) - c.command_zero_v) / c.command_volts_per_mm
        if not abs(commanded_mm - position_mm) <= lever.following_error_max_mm:
            raise _refusal(
                f"the position signal says {position_mm:.2f} mm, the loop-back of the command "
                f"{commanded_mm:.2f} mm",
                "check power and wires of the lever, card.loopback_channel, and the signs and zeros of its constants",
            )
    elif not abs(position_mm - lever.safe_position_mm) <= _MARGIN_MM:
        raise _refusal(
            f"the position signal says {position_mm:.2f} mm instead of the safe {lever.safe_position_mm:g} mm, and "
            "no loop-back says what the arm is commanded to",
            "check that nothing is below the arm, then run `indenter safe`",
        )
    if not lever.travel_min_mm - _MARGIN_MM <= position_mm <= lever.travel_max_mm + _MARGIN_MM:
        raise _refusal(
            f"the position signal says {position_mm:.2f} mm, outside the travel",
            "check its wire and constants",
        )
    prove_force(seen[1], c, lever)


def prove_force(force_v: FloatArray, c: Calibration, lever: LeverSettings) -> None:
    """Raise ArmNotProvenError where a force signal (n,), V, of an arm at rest is dead or deafened."""
    noise_mn = float(np.std(np.diff(force_v))) / 2**0.5 / abs(c.volts_per_mn)
    if noise_mn < lever.force_noise_min_mn:
        raise _refusal(
            f"the force signal has a noise of {noise_mn:.2g} mN rms, less than lever.force_noise_min_mn = "
            f"{lever.force_noise_min_mn:g}: its line is dead, or its gain wrong",
            "check the force output and its wire",
        )
    if noise_mn > _NOISE_MAX_MN:
        raise _refusal(
            f"the force signal has a noise of {noise_mn:.2g} mN rms, more than {_NOISE_MAX_MN:g}: its line is "
            "open, or its gain wrong",
            "check the force output and its wire",
        )


def prove_free(force_v: FloatArray, c: Calibration, lever: LeverSettings) -> None:
    """Raise ArmNotProvenError where the force (n,), V, at the safe position is not that of a free arm."""
    prove_force(force_v, c, lever)
    force_mn = (float(force_v.mean()) - c.force_zero_v) / c.volts_per_mn
    if abs(force_mn) > _OFFSET_MAX_MN:
        raise _refusal(
            f"the force at the safe position is {force_mn:.0f} mN, more than {_OFFSET_MAX_MN:g}",
            "clear the arm, then check the zero of the force signal",
        )


def prove_probe(
    before: FloatArray, during: FloatArray, sent_mm: float, c: Calibration, *, loopback_wired: bool
) -> None:
    """Raise ArmNotProvenError unless a motion in the air by ``sent_mm`` shows as what it is in every signal.

    ``before`` and ``during`` are samples (n_channels, n), V, at rest before it and at its far end.
    """
    step_v = during.mean(axis=1) - before.mean(axis=1)
    moved_mm = float(step_v[0]) / c.volts_per_mm
    if not abs(moved_mm - sent_mm) <= _PROBE_TOLERANCE * abs(sent_mm):
        raise _refusal(
            f"sent by {sent_mm:+.3f} mm the arm moved by {moved_mm:+.4f} mm, says the position signal",
            "check power, wires and constants of the lever",
        )
    if loopback_wired:
        commanded_mm = float(step_v[2]) / c.command_volts_per_mm
        if not abs(commanded_mm - sent_mm) <= _PROBE_TOLERANCE * abs(sent_mm):
            raise _refusal(
                f"sent by {sent_mm:+.3f} mm the loop-back of the command moved by {commanded_mm:+.4f} mm",
                "wire the output to card.loopback_channel, or take the key out of rig.toml",
            )
    felt_mn = float(step_v[1]) / c.volts_per_mn
    if not abs(felt_mn) <= _PROBE_FORCE_MN:
        raise _refusal(
            f"a motion of {sent_mm:+.3f} mm at the safe position changed the force by {felt_mn:.1f} mN",
            "clear the arm",
        )


def _refusal(what: str, todo: str) -> ArmNotProvenError:
    return ArmNotProvenError(f"the arm is not moved: {what}; {todo}, then run again")
