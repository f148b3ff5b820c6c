"""What is proposed to be recorded next, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """The protocol to run next; ``predicted_separation`` in noise standard deviations by pair ("a | b").

    ``predicted_flip_statistic`` is what a test by sign-flips is expected to show (never above the root of the trials
    that tell), ``needed_flip_statistic`` what the recorded trials' own test would have called significant.
    """

    protocol: str
    adds: str
    separates: tuple[tuple[str, str], ...]
    reason: str
    predicted_separation: Mapping[str, float]
    predicted_flip_statistic: Mapping[str, float]
    needed_flip_statistic: float
