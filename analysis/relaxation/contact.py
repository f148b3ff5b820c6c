"""Where the approach met the skin: the starting value of the contact point, found, never asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.windows import FitWindow

_MOST_BLOCKS = 250
_CANDIDATES = 40
_LEAST_APPROACH = 0.05  # of all travel; an approach that is shorter is none
_LEAST_GAIN = 30.0  # in squared noise: a hinge must beat the straight line by this


@dataclass(frozen=True, slots=True)
class Contact:
    """The hinge of force over position: ``position_mm``, ``sample`` of the window, force before it.

    ``seen`` is False where the recording begins in contact, so that no contact point can be estimated.
    """

    position_mm: float
    sample: int
    force_before_mn: float
    seen: bool


def find_contact(window: FitWindow, exponent: float = 1.0) -> Contact:
    """Return the contact point from force = offset + slope max(position - contact, 0)^exponent on loading.

    It is looked for in the approach, and where that ends in the air in the ramp as well. Where no hinge
    shows, contact is where the recording says that the skin was found, if it began short of it.
    """
    stop = window.approach_stop
    travel_mm = float(np.ptp(window.position_mm))
    if stop <= 8 or float(np.ptp(window.position_mm[:stop])) < _LEAST_APPROACH * travel_mm:
        stop = window.hold_start  # no approach of its own: contact is made in the ramp
    found = _hinge(window, stop, exponent)
    if found is None and stop < window.hold_start and _ends_in_air(window, stop):
        found = _hinge(window, window.hold_start, exponent)
    return found or _stated(window, travel_mm)


def _stated(window: FitWindow, travel_mm: float) -> Contact:
    """Return the contact that the recording states, or that none was seen."""
    start_mm = float(window.position_mm[0])
    if window.surface_mm is not None and window.surface_mm - start_mm > _LEAST_APPROACH * travel_mm:
        beyond = np.flatnonzero(window.position_mm[: window.hold_start] > window.surface_mm)
        if beyond.size:
            before_mn = float(np.median(window.force_mn[: beyond[0] + 1]))
            return Contact(window.surface_mm, int(beyond[0]), before_mn, seen=True)
    return Contact(start_mm, 0, float(window.force_mn[0]), seen=False)


def _ends_in_air(window: FitWindow, stop: int) -> bool:
    """Ask whether the force changed next to nothing until sample ``stop``."""
    quarter = max(1, stop // 4)
    change_mn = float(np.mean(window.force_mn[stop - quarter : stop]) - np.mean(window.force_mn[:quarter]))
    return abs(change_mn) < _LEAST_APPROACH * float(np.ptp(window.force_mn))


def _hinge(window: FitWindow, stop: int, exponent: float) -> Contact | None:
    """Return the contact at the hinge of the samples up to ``stop``, None where none shows."""
    if stop < 8:
        return None
    step = max(1, stop // _MOST_BLOCKS)
    edges = np.arange(0, stop - step + 1, step)
    position_mm = np.add.reduceat(window.position_mm[: edges[-1] + step], edges) / step
    force_mn = np.add.reduceat(window.force_mn[: edges[-1] + step], edges) / step
    low, high = float(position_mm.min()), float(position_mm.max())
    if high - low <= 0.0:
        return None
    candidates = np.linspace(low, high, _CANDIDATES, endpoint=False)
    squares, _, _ = _hinges(position_mm, force_mn, candidates, exponent)
    line, best = float(squares[0]), int(np.argmin(squares))
    pitch = candidates[1] - candidates[0]
    finer = np.linspace(candidates[best] - pitch, candidates[best] + pitch, 21)
    finer_squares, finer_slopes, finer_offsets = _hinges(position_mm, force_mn, finer, exponent)
    chosen = int(np.argmin(finer_squares))
    squares_left, contact_mm = float(finer_squares[chosen]), float(finer[chosen])
    noise = max(squares_left / max(len(edges) - 3, 1), 1e-30)
    before = int(np.sum(position_mm < contact_mm))
    if (line - squares_left) / noise < _LEAST_GAIN or finer_slopes[chosen] <= 0.0 or before < 3:
        return None
    inside = np.flatnonzero(window.position_mm[:stop] > contact_mm)
    sample = int(inside[0]) if inside.size else stop - 1
    return Contact(contact_mm, sample, float(finer_offsets[chosen]), seen=True)


def _hinges(
    position_mm: FloatArray, force_mn: FloatArray, candidates: FloatArray, exponent: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residual squares, slopes and offsets (M,) of the hinge fits at candidate contacts (M,)."""
    depth = np.maximum(position_mm - candidates[:, None], 0.0)
    if exponent != 1.0:
        depth = np.power(depth / max(float(depth.max()), 1e-300), exponent)
    centred = depth - depth.mean(axis=1, keepdims=True)
    spread = np.maximum(np.sum(centred**2, axis=1), 1e-300)
    rise = force_mn - force_mn.mean()
    slopes = centred @ rise / spread
    squares = np.sum((rise - slopes[:, None] * centred) ** 2, axis=1)
    return squares, slopes, force_mn.mean() - slopes * depth.mean(axis=1)
