"""The answer of a solid whose force grows as a power of depth, averaged over blocks, with derivatives.

Between knots the level d^p is taken as straight; knots are put so close where the depth grows that this
misses nothing a recording could show: with 1/96 of the depth a piece, p (p - 1) / 8 / 96^2 of the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.block_response import Pieces, decaying_sums, depth_pieces, sampled_decays
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.contact_law import ContactLaw
from analysis.relaxation.response import interval_factors

_PARTS = 96  # of the depth, by which it changes at most from knot to knot
_SLACK = 0.1  # of the depth, by which the contact may move in a search


@dataclass(frozen=True, slots=True)
class ConvexAnswer:
    """Means over blocks as in `BlockAnswer`, and ``exponent_slopes`` (1 + n_arms, K) mm of every row."""

    rows: FloatArray
    tau_slopes: FloatArray
    contact_slopes: FloatArray
    exponent_slopes: FloatArray


def law_knots(blocks: Blocks, contact_mm: float, reference_mm: float) -> Blocks:
    """Return the blocks with knots so close that d^p is straight between them, for contact near here."""
    at = blocks.pieces()
    above_mm = at.position_mm - contact_mm + _SLACK * reference_mm
    moved = np.abs(np.diff(np.maximum(above_mm, 0.0)))
    parts = np.clip(np.ceil(moved * _PARTS / reference_mm), 1, 4 * _PARTS).astype(np.int64)
    cut = np.flatnonzero(parts > 1)
    if not len(cut):
        return blocks
    shares = np.concatenate([np.arange(1, n) / n for n in parts[cut].tolist()])
    owner = np.repeat(cut, parts[cut] - 1)
    return blocks.with_knots(at.time_s[owner] + shares * np.diff(at.time_s)[owner])


def convex_answer(
    blocks: Blocks, contact_mm: float, times_s: Sequence[float], law: ContactLaw
) -> ConvexAnswer:
    """Return the answer to the level of max(position - contact, 0) for arms of the given times."""
    pieces = depth_pieces(blocks, contact_mm)
    n = 1 + len(times_s)
    starts, ends = _inputs(pieces, law)
    speeds = (ends - starts) / pieces.lengths_s
    sums = np.empty((3, n, len(pieces.counts)))
    sums[:, 0] = pieces.counts * starts + speeds * pieces.ages_s
    by_tau = np.empty((n - 1, len(pieces.counts)))
    if n > 1:
        tau_s = np.array(times_s)[:, None]
        decay, rise, decay_slope, rise_slope = interval_factors(pieces.lengths_s, tau_s)
        jumps = np.zeros_like(starts)
        jumps[:, :-1] = starts[:, 1:] - ends[:, :-1]
        increments = ends - starts
        begun = decaying_sums(rise * increments[:, None] + jumps[:, None], decay)
        begun_slope = decaying_sums((decay_slope * begun[0] + rise_slope * increments[0])[None], decay)[0]
        decays, decays_slope = sampled_decays(pieces, tau_s)
        travel = speeds * pieces.counts
        begun -= speeds[:, None] * tau_s
        sums[:, 1:] = begun * decays + tau_s * travel[:, None]
        by_tau[:] = (begun_slope - speeds[0]) * decays + begun[0] * decays_slope + travel[0]
    means = np.add.reduceat(sums.reshape(3 * n, -1), pieces.first_of_block, axis=1) / blocks.counts
    tau_slopes = np.add.reduceat(by_tau, pieces.first_of_block, axis=1) / blocks.counts
    return ConvexAnswer(means[:n], tau_slopes, means[n : 2 * n], means[2 * n :])


def _inputs(pieces: Pieces, law: ContactLaw) -> tuple[FloatArray, FloatArray]:
    """Return level, its slope by contact and by exponent at each piece's start and end, (3, S) each."""
    depth_mm = pieces.depth_mm
    level_mm, by_exponent = law.level(depth_mm), law.exponent_slope(depth_mm)
    by_contact = -law.slope(depth_mm)
    start, end = by_contact[:-1].copy(), by_contact[1:].copy()
    # where contact is made between knots, the straight piece begins with the level over the depth
    made, lost = (depth_mm[:-1] == 0.0) & (depth_mm[1:] > 0.0), (depth_mm[:-1] > 0.0) & (depth_mm[1:] == 0.0)
    start[made] = -level_mm[1:][made] / depth_mm[1:][made]
    end[lost] = -level_mm[:-1][lost] / depth_mm[:-1][lost]
    air = pieces.inside == 0.0
    start[air], end[air] = 0.0, 0.0
    return np.stack([level_mm[:-1], start, by_exponent[:-1]]), np.stack([level_mm[1:], end, by_exponent[1:]])
