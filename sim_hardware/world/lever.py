"""The lever's motor: a second-order servo, integrated exactly for a command of lines or of steps."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import expm

from sim_hardware.parts import FloatArray, Parts


@njit(cache=True)
def servo_steps(
    exact: FloatArray, state: FloatArray, command: FloatArray, substeps: int, stepwise: bool
) -> FloatArray:
    """Step the servo through a block; return position, velocity, acceleration, (3, n * m).

    Between two samples the command moves in a line, or, ``stepwise``, stays where it was.

    ``state`` holds delayed command, position, velocity and command. The first three after a fine step are
    exact[:3] @ (the three before, command before, command now); the acceleration is
    exact[3] @ (the three now, command now, 0).
    """
    motion = np.empty((3, command.shape[0] * substeps))
    w, x, v, old = state[0], state[1], state[2], state[3]
    j = 0
    for i in range(command.shape[0]):
        before = old
        slope = 0.0 if stepwise else (command[i] - before) / substeps
        for s in range(substeps):
            new = command[i] if s == substeps - 1 and not stepwise else before + slope * (s + 1)
            w1 = exact[0, 0] * w + exact[0, 3] * old + exact[0, 4] * new
            x1 = exact[1, 0] * w + exact[1, 1] * x + exact[1, 2] * v + exact[1, 3] * old + exact[1, 4] * new
            v1 = exact[2, 0] * w + exact[2, 1] * x + exact[2, 2] * v + exact[2, 3] * old + exact[2, 4] * new
            w, x, v, old = w1, x1, v1, new
            motion[0, j] = x
            motion[1, j] = v
            motion[2, j] = exact[3, 0] * w + exact[3, 1] * x + exact[3, 2] * v + exact[3, 3] * new
            j += 1
        old = command[i]
    state[0], state[1], state[2], state[3] = w, x, v, old
    return motion


class Servo:
    """The servo's exact fine step and its state.

    With the delayed command w (w = u where there is no lag): x'' = wn^2 (w - x) - 2 zeta wn x'.
    """

    def __init__(
        self, parts: Parts, step_s: float, substeps: int, start_mm: float, *, stepwise: bool = False
    ) -> None:
        self._step_s = step_s
        self._substeps = substeps
        self._stepwise = stepwise
        self._state = np.array([start_mm, start_mm, 0.0, start_mm])
        self.fit(parts)

    def fit(self, parts: Parts) -> None:
        """Work out the fine step for these parts."""
        wn, zeta, lag = parts.natural_frequency_rad_s, parts.damping_ratio, parts.command_lag_s
        self.settling_s = 50 / (wn * min(zeta, 1 / zeta)) + 25 * lag
        """After so long at one command less than 1e-10 of any motion is left."""
        system = np.zeros((5, 5))  # w, x, v, u, du/dt
        system[1, 2] = system[3, 4] = 1.0
        system[2, 1], system[2, 2] = -(wn**2), -2 * zeta * wn
        if lag > 0:
            system[0, 0], system[0, 3] = -1 / lag, 1 / lag
            system[2, 0] = wn**2
        else:
            system[2, 3] = wn**2
        step = expm(system * self._step_s)
        self._exact = np.zeros((4, 5))
        self._exact[:3, :3] = step[:3, :3]
        self._exact[:3, 4] = step[:3, 4] / self._step_s
        self._exact[:3, 3] = step[:3, 3] - self._exact[:3, 4]
        self._exact[3, :4] = system[2, :4]

    def advance(self, command_mm: FloatArray) -> FloatArray:
        """Return position (mm), velocity (mm/s), acceleration (mm/s2) at every fine step, (3, n * m)."""
        motion: FloatArray = servo_steps(self._exact, self._state, command_mm, self._substeps, self._stepwise)
        return motion

    def settle(self) -> None:
        """Come to rest exactly at the command."""
        self._state[:] = [self._state[3], self._state[3], 0.0, self._state[3]]

    @property
    def position_mm(self) -> float:
        """Where the motor is, mm."""
        return float(self._state[1])
