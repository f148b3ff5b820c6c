"""The force of an event at its own time in each trial: the punch slips, the finger moves once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.shared import Addition
from analysis.mismatch.surface_motion import in_contact, pressed, surface_force
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Mechanism, Tissue

FloatArray = NDArray[np.float64]

RISE_S = 0.0015
FADING_S = (0.1, 0.6)
SAME_EVENT_S = 0.3


def after(trial: CellTrial, times_s: FloatArray) -> FloatArray:
    """Return a unit step (m, n) at each time (m,)."""
    return np.clip((trial.time_s - times_s[:, None]) / RISE_S + 0.5, 0.0, 1.0)


def event_rows(
    mechanism: Mechanism,
    trial: CellTrial,
    tissue: Tissue,
    own: PerTrial,
    times_s: FloatArray,
    shape: FloatArray | float = 1.0,
    inside: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Return the force (m, n) of a unit event at each time: 1 mN lost (slip) or 1 um of shift (artefact).

    ``shape`` (n,) multiplies the step; ``inside`` (n,): where the punch presses, if not as the
    trial's own contact point has it.
    """
    stepped = after(trial, times_s) * shape
    if mechanism.stage == "contact":
        touching = in_contact(trial, own)
        force_mn = trial.force_mn - own.offset_mn
        held_mn = float(force_mn[np.flatnonzero(touching)[-1]]) if touching.any() else 0.0
        # what let go carries nothing on the way out either: there the loss falls with the force
        leaving = trial.retracting * np.clip(force_mn / max(held_mn, 1e-9), 0.0, 1.0)
        return -stepped * np.where(touching, 1.0, leaving)
    return surface_force(
        trial, tissue, own, 1e-3 * stepped, pressed(trial, own) if inside is None else inside
    )


@dataclass(frozen=True)
class EventAt:
    """The columns of an event at its own time in each trial (s, by label).

    Each has three: what lasts, and what fades (skin that sticks again, a finger that swings to its new place or gives
    way by a little).
    """

    mechanism: Mechanism
    times_s: Mapping[str, float]

    def __call__(
        self, trial: CellTrial, tissue: Tissue, own: PerTrial, inside: NDArray[np.bool_] | None = None
    ) -> FloatArray:
        """Return the force (n, q) of unit events."""
        at = self.times_s.get(trial.label)
        if at is None:
            return np.zeros((len(trial.time_s), 0))
        when = np.array([at])
        return np.column_stack(
            [
                event_rows(self.mechanism, trial, tissue, own, when, shape, inside)[0]
                for shape in courses(trial, at)
            ]
        )

    def n_columns(self, trial: CellTrial) -> int:
        """Return 3, or 0 in a trial without the event."""
        return 1 + len(FADING_S) if trial.label in self.times_s else 0

    def surface_mm(self, trial: CellTrial, coefficients: FloatArray) -> FloatArray | None:
        """Return how the surface moves (n,) for coefficients (3,), um; None for an event of the contact."""
        at = self.times_s.get(trial.label)
        if self.mechanism.stage == "contact" or at is None:
            return None
        course: FloatArray = coefficients @ courses(trial, at)
        return np.asarray(1e-3 * after(trial, np.array([at]))[0] * course)


def courses(trial: CellTrial, at_s: float) -> FloatArray:
    """Return how an event goes on (3, n): what lasts, and what fades within a tenth of a second and some tenths."""
    since = np.maximum(trial.time_s - at_s, 0.0)
    return np.array([np.ones_like(since), *(np.exp(-since / tau) for tau in FADING_S)])


def event_addition(mechanism: Mechanism, times_s: Mapping[str, float]) -> Addition:
    """Return an event of free size at its own time in each trial named in ``times_s`` (by label)."""
    median = float(np.median(list(times_s.values())))
    return Addition(mechanism, {**mechanism.null, "time_s": median}, EventAt(mechanism, times_s))
