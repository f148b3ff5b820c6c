"""How time passes for the card: by the host's clock, or only as far as somebody waits for it."""

import time
from typing import Protocol

from sim_hardware.card.plant import SAMPLE_RATE_HZ


class SampleClock(Protocol):
    """Pace of the card."""

    virtual: bool

    def n_due(self) -> int:
        """Samples that must have been taken by now, counted from the start of the bench."""

    def seconds_until(self, n_samples: int) -> float:
        """Time until that many samples have been taken; 0 or less once they have."""


class RealClock:
    """8000 samples a second of the host's monotonic clock."""

    virtual = False

    def __init__(self, n_taken: int = 0) -> None:
        self._start_s = time.monotonic() - n_taken / SAMPLE_RATE_HZ

    def n_due(self) -> int:
        """Samples that must have been taken by now."""
        return int((time.monotonic() - self._start_s) * SAMPLE_RATE_HZ)

    def seconds_until(self, n_samples: int) -> float:
        """Time until that many samples have been taken."""
        return self._start_s + n_samples / SAMPLE_RATE_HZ - time.monotonic()


class VirtualClock:
    """Nothing is ever due: the card advances as far as a call waits for, and no further."""

    virtual = True

    def n_due(self) -> int:
        """Nothing happens by itself."""
        return 0

    def seconds_until(self, n_samples: int) -> float:
        """Waiting costs no time."""
        return 0.0
