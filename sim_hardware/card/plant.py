"""What is wired to the card: the card knows no more of the world than these calls."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

SAMPLE_RATE_HZ = 8000.0


class Readings(Protocol):
    """Volts on the two sensor lines, one value a sample of the command."""

    @property
    def position_v(self) -> FloatArray:
        """Position sensor, shape (n,)."""

    @property
    def force_v(self) -> FloatArray:
        """Force sensor, shape (n,)."""


class Plant(Protocol):
    """A bench behind the card's terminals."""

    @property
    def time_s(self) -> float:
        """Time of the bench since it was set up."""

    def advance(self, command_v: FloatArray) -> Readings:
        """Let len(command_v) samples pass at 8000 Hz under this command; what the sensors say meanwhile."""

    def rest(self, duration_s: float) -> None:
        """Let time pass with the command held and nobody looking."""
