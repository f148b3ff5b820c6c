"""Where an arm was, by what of its recorded position is taken for noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from analysis.simulation.smoothing import (
    beyond_noise,
    share_that_stays,
    smoothed,
    smoothed_as_it_bears,
    steady_velocity,
    width_for_acceleration,
    width_for_rest,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NEAR_KINK_S = 0.025
FAST_SMOOTHING_S = 0.0008
SLOW_SMOOTHING_S = 0.005
RATE_SMOOTHING_S = 0.04
VELOCITY_WINDOW_S = 0.002


@dataclass(frozen=True, slots=True)
class ArmPath:
    """Where the arm was at full rate, each (N,) but ``noise_mm``.

    ``position_error_mm`` is the standard error that smoothing leaves of a position with noise ``noise_mm``.
    ``beside_servo_mm`` is what of the position no servo explains, and no noise; zero where none is known.
    """

    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    position_error_mm: FloatArray
    noise_mm: float
    beside_servo_mm: FloatArray

    def beside(self, position_mm: FloatArray, velocity_mm_s: FloatArray, acceleration: FloatArray) -> ArmPath:
        """Return the path of an arm that goes so, each (N,), and besides as this one."""
        return ArmPath(
            position_mm + self.position_mm,
            velocity_mm_s + self.velocity_mm_s,
            acceleration + self.acceleration_mm_s2,
            self.position_error_mm,
            self.noise_mm,
            self.beside_servo_mm,
        )


def near_kinks(kinks: IntArray, n: int, rate_hz: float) -> FloatArray:
    """Return how much each of n samples lies near a kink, from 0 to 1."""
    near = np.zeros(n)
    half = max(1, round(NEAR_KINK_S * rate_hz))
    for k in kinks:
        near[max(0, k - half) : k + half] = 1.0
    return np.asarray(gaussian_filter1d(near, max(1.0, half / 4)))


def beside_servo(rest_mm: FloatArray, noise_mm: float, near: FloatArray, rate_hz: float) -> ArmPath:
    """Return the path that a servo's answer leaves of a recorded one (N,)."""
    of_fast = width_for_rest(rest_mm, noise_mm, near, max(0.3, FAST_SMOOTHING_S * rate_hz))
    of_slow = width_for_rest(rest_mm, noise_mm, 1.0 - near, max(0.3, SLOW_SMOOTHING_S * rate_hz))
    position = near * smoothed(rest_mm, of_fast) + (1.0 - near) * smoothed(rest_mm, of_slow)
    error = noise_mm * (near * share_that_stays(of_fast) + (1.0 - near) * share_that_stays(of_slow))
    velocity = steady_velocity(rest_mm, noise_mm, max(0.3, RATE_SMOOTHING_S * rate_hz)) * rate_hz
    acceleration, shown = np.gradient(velocity) * rate_hz, _shown(position, error, noise_mm)
    return ArmPath(position, velocity, acceleration, error, noise_mm, shown)


def _shown(rest_mm: FloatArray, error_mm: FloatArray, noise_mm: float) -> FloatArray:
    """Return what of a position beside the servo's answer (N,) is no noise; nothing, if less than that of a sample."""
    shown_mm = np.where(beyond_noise(rest_mm, error_mm), rest_mm, 0.0)
    return shown_mm if float(np.abs(shown_mm).max()) > noise_mm else np.zeros_like(rest_mm)


def of_unknown_drive(recorded_mm: FloatArray, noise_mm: float, rate_hz: float) -> ArmPath:
    """Return the path (N,) of what moves all along, not as its command says."""
    width = width_for_acceleration(recorded_mm, noise_mm)
    position = smoothed(recorded_mm, width)
    velocity = np.gradient(position) * rate_hz
    error = np.full(len(position), noise_mm * share_that_stays(width))
    return ArmPath(
        position, velocity, np.gradient(velocity) * rate_hz, error, noise_mm, np.zeros_like(position)
    )


def without_command(recorded_mm: FloatArray, noise_mm: float, near: FloatArray, rate_hz: float) -> ArmPath:
    """Return the path (N,) of an arm of which only the position is known.

    What throws a mass is to be smooth near kinks, too: its acceleration is not that of the velocity.
    """
    quick = np.gradient(smoothed(recorded_mm, max(0.5, VELOCITY_WINDOW_S * rate_hz))) * rate_hz
    steady = steady_velocity(recorded_mm, noise_mm, max(0.3, RATE_SMOOTHING_S * rate_hz)) * rate_hz
    position, per_sample, error = smoothed_as_it_bears(recorded_mm, noise_mm, RATE_SMOOTHING_S * rate_hz)
    acceleration = np.gradient(near * quick + (1.0 - near) * steady) * rate_hz
    return ArmPath(position, per_sample * rate_hz, acceleration, error, noise_mm, np.zeros_like(position))
