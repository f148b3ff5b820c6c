"""A trial condensed for fitting: means over blocks of samples that are short where something happens.

Seventy thousand samples of an exponential that lasts two seconds say no more than a few hundred means of
them, as long as the model is averaged over the very same samples (see `block_response`); so nothing is
biased by the length of a block, only resolution is given away, and the blocks grow so slowly (a tenth of the
time since the last kink) that what is given away is below a thousandth of the information.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.motion import curved_stretches, positions_at
from analysis.relaxation.windows import FitWindow

IntArray = NDArray[np.int64]

GROWTH = 0.1  # length of a block relative to the time since the last kink
CURVED_SAMPLES = 4  # length of the blocks in which the motion bends
CONTACT_SAMPLES = 16  # length at most where contact is made
CONTACT_LEAD_S = 0.03  # how far before the estimated contact these begin
RAMP_PARTS = 40  # a ramp has at least so many blocks


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means of force over blocks of samples, and the motion as straight pieces between them.

    Block b holds ``counts[b]`` samples, the first at ``knots_s[b]``, the others ``spacing_s[b]`` apart, all
    before ``knots_s[b + 1]``. ``force_mn`` (K,), ``counts`` (K,), ``spacing_s`` (K,); ``knots_s`` and
    ``position_mm`` (K + 1,). ``edges`` (K + 1,) are the knots as sample indices of the window.
    """

    knots_s: FloatArray
    position_mm: FloatArray
    counts: FloatArray
    spacing_s: FloatArray
    force_mn: FloatArray
    edges: IntArray

    def until(self, stop: int) -> Blocks:
        """Return the blocks that end at or before sample ``stop`` of the window."""
        kept = int(np.searchsorted(self.edges, stop, side="right")) - 1
        return Blocks(
            self.knots_s[: kept + 1],
            self.position_mm[: kept + 1],
            self.counts[:kept],
            self.spacing_s[:kept],
            self.force_mn[:kept],
            self.edges[: kept + 1],
        )


def condense(window: FitWindow, contact: int) -> Blocks:
    """Return the blocks of a window whose contact is made near sample ``contact``.

    Unevenly spaced samples stay single.
    """
    if not window.even or len(window.time_s) < 2000:
        return _singles(window)
    curved = curved_stretches(window)
    edges = _edges(window, contact, curved)
    counts = np.diff(edges).astype(float)
    return Blocks(
        knots_s=window.time_s[edges],
        position_mm=positions_at(window, edges, curved),
        counts=counts,
        spacing_s=np.full(len(counts), window.step_s),
        force_mn=np.add.reduceat(window.force_mn[: edges[-1]], edges[:-1]) / counts,
        edges=edges,
    )


def _singles(window: FitWindow) -> Blocks:
    return Blocks(
        knots_s=window.time_s,
        position_mm=window.position_mm,
        counts=np.ones(len(window.time_s) - 1),
        spacing_s=np.diff(window.time_s),
        force_mn=window.force_mn[:-1],
        edges=np.arange(len(window.time_s)),
    )


def _edges(window: FitWindow, contact: int, curved: IntArray) -> IntArray:
    """Return the block edges (K + 1,): fine where the motion bends and contact is made, growing elsewhere."""
    last = len(window.time_s) - 1
    lead = max(0, contact - round(CONTACT_LEAD_S / window.step_s))
    marks = {0, last, lead, window.approach_stop, window.ramp_start, window.hold_start}
    marks.update(int(edge) for edge in curved.ravel())
    bounds = sorted(mark for mark in marks if 0 <= mark <= last)
    ramp_cap = max(1, (window.hold_start - window.ramp_start) // RAMP_PARTS)
    pieces: list[IntArray] = []
    for start, stop in pairwise(bounds):
        if np.any((curved[:, 0] <= start) & (stop <= curved[:, 1])):
            cap: int | None = CURVED_SAMPLES
        elif lead <= start < window.approach_stop:
            cap = CONTACT_SAMPLES
        elif window.ramp_start <= start < window.hold_start:
            cap = ramp_cap
        else:
            cap = None
        pieces.append(growing_edges(start, stop) if cap is None else np.arange(start, stop, cap))
    return np.unique(np.concatenate([*pieces, [last]]))


def growing_edges(start: int, stop: int) -> IntArray:
    """Return edges from ``start`` (included) to ``stop`` (not), four samples apart, then ever further."""
    length = stop - start
    linear = min(length, round(4 / GROWTH))
    edges = [np.arange(0, linear, 4)]
    if length > linear:
        steps = int(np.log(length / linear) / GROWTH) + 1
        edges.append(np.round(linear * np.exp(GROWTH * np.arange(steps))).astype(np.int64))
    merged = np.unique(np.concatenate(edges))
    # a last block shorter than half of its neighbour joins it
    merged = merged[merged < length]
    if len(merged) > 2 and length - merged[-1] < (merged[-1] - merged[-2]) / 2:
        merged = merged[:-1]
    return merged + start
