"""A force that is late, by whatever filter: the lag is found, and nothing of it is left for another law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import bessel, butter, lfilter, lfilter_zi

from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library
from analysis.simulation.motion import estimate_motion
from analysis.simulation.reduction import reduce_trial
from sim_hardware.concealment.offline import study_plans

FloatArray = NDArray[np.float64]
LAG = library()["force_lag"]
RATE_HZ = 8000.0
LAG_MS = 2.0


def moving_average() -> tuple[FloatArray, FloatArray]:
    """Return an average over twice the lag, (b, a)."""
    n = round(2e-3 * LAG_MS * RATE_HZ)
    return np.full(n, 1.0 / n), np.ones(1)


def one_pole() -> tuple[FloatArray, FloatArray]:
    """Return the textbook's filter."""
    decay = float(np.exp(-1e3 / LAG_MS / RATE_HZ))
    return np.array([1.0 - decay]), np.array([1.0, -decay])


def bessel_of_two_poles() -> tuple[FloatArray, FloatArray]:
    """Return an amplifier's filter: its delay is one over its natural frequency."""
    b, a = bessel(2, 1e3 / LAG_MS, fs=2.0 * np.pi * RATE_HZ, norm="delay")
    return np.asarray(b), np.asarray(a)


def butterworth_of_two_poles() -> tuple[FloatArray, FloatArray]:
    """Return the flattest filter: it overshoots, and its delay is 1.41 over its natural frequency."""
    b, a = butter(2, np.sqrt(2.0) * 1e3 / LAG_MS, fs=2.0 * np.pi * RATE_HZ)
    return np.asarray(b), np.asarray(a)


@pytest.fixture(scope="module")
def pressed(record: Callable[..., list[Trial]]) -> tuple[CellTrial, FloatArray]:
    """A trial in cells, and the force (N,) of an elastic skin at every sample."""
    (trial,) = record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=1.0, dwell_s=0.5))
    motion = estimate_motion(trial)
    cells = reduce_trial(trial, motion)
    return cells, 200.0 * np.maximum(motion.position_mm - cells.z0_start_mm, 0.0)


@pytest.mark.parametrize("late", [one_pole, moving_average, bessel_of_two_poles, butterworth_of_two_poles])
def test_the_lag_of_a_filter_is_found(
    pressed: tuple[CellTrial, FloatArray], late: Callable[[], tuple[FloatArray, FloatArray]]
) -> None:
    cells, force_mn = pressed
    b, a = late()
    start = lfilter_zi(b, a) * force_mn[0]
    read, felt = (
        np.add.reduceat(f, cells.starts) / cells.counts
        for f in (lfilter(b, a, force_mn, zi=start)[0], force_mn)
    )
    weights = np.sqrt(cells.counts)

    def left_mn(x: FloatArray) -> FloatArray:
        values = dict(zip(("time_constant_ms", "shared", "damping"), x.tolist(), strict=True))
        return np.asarray((LAG.sensor_force_mn(cells, felt, values) - read) * weights)

    shared, damping = LAG.parameter("shared"), LAG.parameter("damping")
    bounds = [0.0, shared.lower, damping.lower], [50.0, shared.upper, damping.upper]
    found = least_squares(left_mn, [1.0, 0.1, 0.9], bounds=bounds)
    late_mn = np.linalg.norm((felt - read) * weights)
    # the textbook's single pole leaves 0.035 of the others
    assert np.linalg.norm(found.fun) < 0.015 * late_mn
    # half a sample is the time from a sample to its average
    assert found.x[0] == pytest.approx(LAG_MS, abs=0.02 * LAG_MS + 0.5e3 / RATE_HZ)
