"""What the arm may do: a waveform is checked before it is sent, the samples while it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.errors import LimitHit, LimitRefusedError
from rig.settings.rig_file import LeverSettings

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STEP_TOLERANCE_MM = 0.005
"""A waveform may begin this far from where the arm is commanded to be: converters and noise, no jump."""

_TRAVEL_MARGIN_MM = 0.2
"""The recorded position may pass the travel by this: noise, overshoot, constants not yet calibrated."""

_NOISE_SAMPLES = 160
"""The noise of the force is judged over so many samples, 20 ms: at 1 mm/s a dead line is known within 20 um."""

_NOISE_KEPT = 0.5
"""A line that keeps less of the noise that it had in the air has lost more than half of its gain, and with it the
threshold its sense: what is left at most doubles the force at which the skin is found."""

_LEAD_MM = 0.03
_LEAD_S = (0.02, 0.03)
"""Of a motion towards something unknown the card holds 30 um, or 20 ms where that is more: 6 mN of skin."""

_PERSISTENT_SAMPLES = 4
"""A limit is hit when so many samples in a row pass it: half a millisecond, so that no single spike does."""


def refuse_beyond_limits(
    waveform_mm: FloatArray, limits: LeverSettings, *, rate_hz: float, from_mm: float | None
) -> None:
    """Raise LimitRefusedError where a waveform (n,), mm, is not for this lever.

    ``from_mm``: where the arm is commanded to be; None where it need not begin there.
    """
    if waveform_mm.ndim != 1 or len(waveform_mm) < 2:
        raise LimitRefusedError(
            f"a motion needs 2 samples or more in one row, not {waveform_mm.shape}; nothing was sent"
        )
    if not np.all(np.isfinite(waveform_mm)):
        where = int(np.argmin(np.isfinite(waveform_mm)))
        raise LimitRefusedError(f"sample {where} of the motion is no number; nothing was sent")
    low_mm, high_mm = float(waveform_mm.min()), float(waveform_mm.max())
    if low_mm < limits.travel_min_mm - 1e-9 or high_mm > limits.travel_max_mm + 1e-9:
        raise LimitRefusedError(
            f"the motion goes from {low_mm:.3f} to {high_mm:.3f} mm, beyond the travel of "
            f"{limits.travel_min_mm:g} to {limits.travel_max_mm:g} mm; nothing was sent; lower the depth, or "
            "move the finger nearer"
        )
    speed_mm_s = float(np.abs(np.diff(waveform_mm)).max()) * rate_hz
    if speed_mm_s > limits.speed_max_mm_s * (1 + 1e-6):
        raise LimitRefusedError(
            f"the motion reaches {speed_mm_s:.4g} mm/s, above lever.speed_max_mm_s = "
            f"{limits.speed_max_mm_s:g}; nothing was sent; lower its speed"
        )
    if from_mm is not None:
        jump_mm = abs(float(waveform_mm[0]) - from_mm)
        if jump_mm > limits.speed_max_mm_s / rate_hz + STEP_TOLERANCE_MM:
            raise LimitRefusedError(
                f"the motion begins at {waveform_mm[0]:.3f} mm while the arm is at {from_mm:.3f} mm; nothing "
                "was sent; begin where the arm is"
            )


def volts_within_limits(
    waveform_mm: FloatArray,
    limits: LeverSettings,
    calibration: Calibration,
    *,
    rate_hz: float,
    range_v: float,
    from_mm: float,
) -> FloatArray:
    """The waveform (n,), mm, as the card's output plays it, V; LimitRefusedError where it must not."""
    refuse_beyond_limits(waveform_mm, limits, rate_hz=rate_hz, from_mm=from_mm)
    volts: FloatArray = waveform_mm * calibration.command_volts_per_mm + calibration.command_zero_v
    needed_v = float(np.abs(volts).max())
    if needed_v > range_v:
        raise LimitRefusedError(
            f"the motion needs {needed_v:.2f} V of the card's {range_v:g} V; nothing was sent; lower "
            "lever.travel_max_mm in rig.toml"
        )
    return volts


def lead_s(speed_mm_s: float) -> float:
    """How far ahead of the samples looked at the output of an approach is written, s: the arm stops within it."""
    shortest_s, longest_s = _LEAD_S
    return min(max(_LEAD_MM / speed_mm_s, shortest_s), longest_s)


@dataclass
class _Streak:
    """How many samples in a row have passed a limit, carried from block to block."""

    length: int = 0

    def first_hit(self, beyond: BoolArray) -> int | None:
        """Index of the sample that makes the streak long enough, or None."""
        if not beyond.any():
            self.length = 0
            return None
        for i, is_beyond in enumerate(beyond):
            self.length = self.length + 1 if is_beyond else 0
            if self.length >= _PERSISTENT_SAMPLES:
                return i
        return None


def steady_noise_v(force_v: FloatArray) -> float:
    """The noise of a force signal (n,), V rms, where it is quietest: a jolt meanwhile adds nothing."""
    steps_v = np.diff(force_v)
    n = min(_NOISE_SAMPLES, len(steps_v))
    parts = steps_v[: len(steps_v) // n * n].reshape(-1, n)
    return float(np.sqrt((parts**2).mean(axis=1).min() / 2))


class _ForceNoise:
    """Tells a force line that has gone dead, or is cut off: every sensor has noise, a broken wire has none.

    The noise is that of the differences between neighbouring samples, so that a force that changes adds nothing.
    """

    def __init__(self, least_v: float) -> None:
        self._least_v = least_v
        self._before: float | None = None
        self._sum_v2 = 0.0
        self._n = 0
        self.last_v = float("nan")

    def dead_at(self, force_v: FloatArray) -> int | None:
        """Index of the sample by which the line is known to be dead, or None; blocks come in order."""
        steps_v = np.diff(force_v, prepend=force_v[0] if self._before is None else self._before)
        self._before = float(force_v[-1])
        done = 0
        while done < len(steps_v):
            part = steps_v[done : done + _NOISE_SAMPLES - self._n]
            done += len(part)
            self._sum_v2 += float(np.dot(part, part))
            self._n += len(part)
            if self._n == _NOISE_SAMPLES:
                self.last_v = (self._sum_v2 / self._n / 2) ** 0.5
                self._sum_v2, self._n = 0.0, 0
                if self.last_v < self._least_v:
                    return done - 1
        return None


class Watch:
    """Checks every block of samples against the limits, in order.

    ``usual_noise_v``: that of the force signal as this run has proven it, V rms; 0 before.
    """

    def __init__(
        self, limits: LeverSettings, calibration: Calibration, range_v: float, usual_noise_v: float = 0.0
    ) -> None:
        self._limits = limits
        self._calibration = calibration
        # the converter's last step at either end
        self._full_scale_v = range_v * (1 - 2.0**-14)
        self._streaks = {
            name: _Streak() for name in ("force", "travel", "depth", "following error", "saturation")
        }
        least_v = limits.force_noise_min_mn * abs(calibration.volts_per_mn)
        self._least_noise_v = max(least_v, _NOISE_KEPT * usual_noise_v)
        self._force_noise = _ForceNoise(self._least_noise_v)
        self.ceiling_mn: float | None = None
        """A force above which the motion under way reverses, mN; None: the rig's limit alone."""
        self.surface_mm: float | None = None
        """Where the surface was found, mm, once it has been."""

    @property
    def deepest_mm(self) -> float:
        """How far the arm may be sent, mm, once a surface was found; before, its travel is the limit."""
        return np.inf if self.surface_mm is None else self.surface_mm + self._limits.depth_max_mm

    def check(self, start: int, position_v: FloatArray, force_v: FloatArray, command_v: FloatArray) -> None:
        """Raise LimitHit where a limit is passed; ``start`` is the sample index of the block."""
        c, limits = self._calibration, self._limits
        position_mm = (position_v - c.position_zero_v) / c.volts_per_mm
        if not (np.isfinite(position_v).all() and np.isfinite(force_v).all()):
            where = int(np.argmin(np.isfinite(position_v) & np.isfinite(force_v)))
            raise LimitHit(
                "not a number",
                sample=start + where,
                value=float("nan"),
                unit="V",
                allowed=self._full_scale_v,
                position_mm=float(position_mm[where]),
            )
        force_mn = (force_v - c.force_zero_v) / c.volts_per_mn
        command_mm = (command_v - c.command_zero_v) / c.command_volts_per_mm
        middle_mm = (limits.travel_max_mm + limits.travel_min_mm) / 2
        reach_mm = (limits.travel_max_mm - limits.travel_min_mm) / 2 + _TRAVEL_MARGIN_MM
        allowed_mn = (
            limits.force_max_mn if self.ceiling_mn is None else min(self.ceiling_mn, limits.force_max_mn)
        )
        # a force below zero counts as well: skin that clings, or an arm that is held
        for limit, signal, about, allowed, unit in (
            ("force", force_mn, 0.0, allowed_mn, "mN"),
            # the position may lie as far beyond the depth as beyond the travel
            ("depth", position_mm, 0.0, self.deepest_mm + _TRAVEL_MARGIN_MM, "mm"),
            ("following error", command_mm - position_mm, 0.0, limits.following_error_max_mm, "mm"),
            ("travel", position_mm, middle_mm, reach_mm, "mm"),
            ("saturation", force_v, 0.0, self._full_scale_v, "V"),
        ):
            hit = self._streaks[limit].first_hit(np.abs(signal - about) > allowed)
            if hit is not None:
                raise LimitHit(
                    limit,
                    sample=start + hit,
                    value=float(signal[hit]),
                    unit=unit,
                    allowed=about + allowed,
                    position_mm=float(position_mm[hit]),
                )
        dead = self._force_noise.dead_at(force_v)
        if dead is not None:
            raise LimitHit(
                "force noise",
                sample=start + dead,
                value=self._force_noise.last_v / abs(c.volts_per_mn),
                unit="mN rms",
                allowed=self._least_noise_v / abs(c.volts_per_mn),
                position_mm=float(position_mm[dead]),
            )
