"""A trial condensed for fitting: means over blocks of samples that are short where something happens.

Seventy thousand samples of an exponential that lasts two seconds say no more than a few hundred means of
them, as long as the model is averaged over the very same samples (see `block_response`); so nothing is
biased by the length of a block, only resolution is given away, and the blocks grow so slowly (a tenth of the
time since the last kink) that what is given away is below a thousandth of the information.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.motion import corners, curved_stretches, positions_at, usable_command
from analysis.relaxation.windows import FitWindow

IntArray = NDArray[np.int64]

GROWTH = 0.1  # length of a block relative to the time since the last kink
CURVED_SAMPLES = 4  # length of the blocks in which the motion bends
CONTACT_SAMPLES = 16  # length at most where contact is made
CONTACT_LEAD_S = 0.03  # how far before the estimated contact these begin
RAMP_PARTS = 40  # a ramp has at least so many blocks


@dataclass(frozen=True, slots=True)
class StraightPieces:
    """The motion between knots: M pieces, and the samples that fall into each.

    ``time_s``, ``position_mm`` (M + 1,) of the knots; ``counts`` (M,) samples in a piece, the first of them
    ``first_s`` (M,) after its start, ``spacing_s`` (M,) apart; ``first_of_block`` (K,) the piece with which
    each block begins.
    """

    time_s: FloatArray
    position_mm: FloatArray
    counts: FloatArray
    first_s: FloatArray
    spacing_s: FloatArray
    first_of_block: IntArray


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means of force over blocks of samples, and the motion as straight pieces between them.

    Block b holds ``counts[b]`` samples, the first at ``knots_s[b]``, the others ``spacing_s[b]`` apart, all
    before ``knots_s[b + 1]``. ``force_mn`` (K,), ``counts`` (K,), ``spacing_s`` (K,); ``knots_s`` and
    ``position_mm`` (K + 1,). ``edges`` (K + 1,) are the knots as sample indices of the window.
    ``inner_s``, ``inner_mm`` (J,) are further knots of the motion, rising, within blocks.
    """

    knots_s: FloatArray
    position_mm: FloatArray
    counts: FloatArray
    spacing_s: FloatArray
    force_mn: FloatArray
    edges: IntArray
    inner_s: FloatArray = field(default_factory=lambda: np.empty(0))
    inner_mm: FloatArray = field(default_factory=lambda: np.empty(0))

    def pieces(self) -> StraightPieces:
        """Return the straight pieces between all knots, inner ones included."""
        n_blocks = len(self.counts)
        if not len(self.inner_s):
            return StraightPieces(
                self.knots_s,
                self.position_mm,
                self.counts,
                np.zeros(n_blocks),
                self.spacing_s,
                np.arange(n_blocks),
            )
        time_s = np.concatenate([self.knots_s, self.inner_s])
        order = np.argsort(time_s, kind="stable")
        time_s = time_s[order]
        outer = order[:-1] <= n_blocks
        owner = np.cumsum(outer) - 1
        since_s = time_s[:-1] - self.knots_s[owner]
        spacing_s = self.spacing_s[owner]
        passed = np.clip(np.ceil(since_s / spacing_s - 1e-9), 0.0, self.counts[owner])
        until = np.append(passed[1:], 0.0)
        last = np.append(owner[1:] != owner[:-1], True)
        until[last] = self.counts[owner[last]]
        counts = until - passed
        return StraightPieces(
            time_s,
            np.concatenate([self.position_mm, self.inner_mm])[order],
            counts,
            np.where(counts > 0, passed * spacing_s - since_s, 0.0),
            spacing_s,
            np.flatnonzero(outer),
        )

    def with_knots(self, time_s: FloatArray) -> Blocks:
        """Return the blocks with further knots at ``time_s`` (J,) on the motion as it is."""
        if not len(time_s):
            return self
        at = self.pieces()
        inner_s = np.unique(np.concatenate([self.inner_s, time_s]))
        inner_s = inner_s[~np.isin(inner_s, self.knots_s)]
        return replace(self, inner_s=inner_s, inner_mm=np.interp(inner_s, at.time_s, at.position_mm))

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
            self.inner_s[self.inner_s < self.knots_s[kept]],
            self.inner_mm[self.inner_s < self.knots_s[kept]],
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
    blocks = Blocks(
        knots_s=window.time_s[edges],
        position_mm=positions_at(window, edges, curved),
        counts=counts,
        spacing_s=np.full(len(counts), window.step_s),
        force_mn=np.add.reduceat(window.force_mn[: edges[-1]], edges[:-1]) / counts,
        edges=edges,
    )
    return blocks if usable_command(window) is not None else _with_corners(blocks, window)


def _singles(window: FitWindow) -> Blocks:
    blocks = Blocks(
        knots_s=window.time_s,
        position_mm=window.position_mm,
        counts=np.ones(len(window.time_s) - 1),
        spacing_s=np.diff(window.time_s),
        force_mn=window.force_mn[:-1],
        edges=np.arange(len(window.time_s)),
    )
    return _with_corners(blocks, window)


def _with_corners(blocks: Blocks, window: FitWindow) -> Blocks:
    """Return the blocks with the corners of the motion that lie between two samples of their own."""
    single = np.zeros(len(window.time_s), dtype=bool)
    single[blocks.edges[:-1][blocks.counts == 1.0]] = True
    if not single.any():
        return blocks
    at, instant_s, place_mm = corners(window.time_s, window.position_mm)
    kept = single[at]
    return replace(blocks, inner_s=instant_s[kept], inner_mm=place_mm[kept])


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
            cap: int | None = min(CURVED_SAMPLES, ramp_cap)
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
