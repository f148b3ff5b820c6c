"""The solid's answer averaged over blocks of samples, with its derivatives, exact to rounding.

Between knots the motion is straight, so an arm's stretch is q(s) = (q_b - v tau) exp(-s / tau) + v tau,
and the mean over the block's evenly spaced samples is a geometric sum. The knot at which contact is made
is put in where it belongs, between samples; so the model is smooth in the contact point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.response import decaying_sum, interval_factors

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class BlockAnswer:
    """Means over blocks: unit-stiffness forces and their derivatives.

    ``rows`` (1 + n_arms, K) mm: depth, then each arm's stretch. ``tau_slopes`` (n_arms, K) mm/s: of each
    arm's row by its own time. ``contact_slopes`` (1 + n_arms, K): of every row by the contact point,
    dimensionless.
    """

    rows: FloatArray
    tau_slopes: FloatArray
    contact_slopes: FloatArray


@dataclass(frozen=True, slots=True)
class _Pieces:
    """Straight pieces of the depth: the blocks, and the two parts of one in which contact changes."""

    lengths_s: FloatArray  # (S,)
    depth_mm: FloatArray  # (S + 1,) at the pieces' ends
    speed_mm_s: FloatArray  # (S,)
    counts: FloatArray  # (S,) samples in the piece
    first_s: FloatArray  # (S,) from the piece's start to its first sample
    spacing_s: FloatArray  # (S,)
    inside: FloatArray  # (S,) 1 in contact
    entries: FloatArray  # (S,) +1 where contact is made at the piece's start, -1 where it is lost
    first_of_block: IntArray  # (K,)


def block_answer(blocks: Blocks, contact_mm: float, times_s: Sequence[float]) -> BlockAnswer:
    """Return the answer to the depth max(position - contact, 0) for arms of the given times."""
    pieces = _depth_pieces(blocks, contact_mm)
    mean_age_s = pieces.first_s + 0.5 * (pieces.counts - 1.0) * pieces.spacing_s
    depth_sum = pieces.counts * (pieces.depth_mm[:-1] + pieces.speed_mm_s * mean_age_s)
    arms = [_arm_sums(pieces, tau_s) for tau_s in times_s]
    stacked = np.stack(
        [
            depth_sum,
            *(arm[0] for arm in arms),
            -pieces.counts * pieces.inside,
            *(arm[1] for arm in arms),
            *(arm[2] for arm in arms),
        ]
    )
    means = np.add.reduceat(stacked, pieces.first_of_block, axis=1) / blocks.counts
    n = 1 + len(arms)
    return BlockAnswer(rows=means[:n], contact_slopes=means[n : 2 * n], tau_slopes=means[2 * n :])


def _depth_pieces(blocks: Blocks, contact_mm: float) -> _Pieces:
    """Return the straight pieces of the depth; a block in which contact changes is cut at that instant."""
    above_mm = blocks.position_mm - contact_mm
    inside = above_mm > 0.0
    cut = np.flatnonzero(inside[1:] != inside[:-1])
    lengths_s = np.diff(blocks.knots_s)
    share = above_mm[cut] / (above_mm[cut] - above_mm[cut + 1])
    before_s = share * lengths_s[cut]
    # samples of a cut block before the instant; the one on it counts as after
    before = np.minimum(np.ceil(before_s / blocks.spacing_s[cut]), blocks.counts[cut])
    at = cut + 1
    knots_s = np.insert(blocks.knots_s, at, blocks.knots_s[cut] + before_s)
    depth_mm = np.maximum(np.insert(above_mm, at, 0.0), 0.0)
    counts = np.insert(blocks.counts, at, blocks.counts[cut] - before)
    first_s = np.zeros_like(counts)
    second = at + np.arange(len(cut))  # the second parts of cut blocks, in the new numbering
    counts[second - 1] = before
    first_s[second] = before * blocks.spacing_s[cut] - before_s
    piece_lengths_s = np.maximum(np.diff(knots_s), 1e-12)
    entries = np.zeros_like(counts)
    entries[second] = np.where(inside[at], 1.0, -1.0)
    started = np.cumsum(entries) + float(inside[0])
    return _Pieces(
        lengths_s=piece_lengths_s,
        depth_mm=depth_mm,
        speed_mm_s=np.diff(depth_mm) / piece_lengths_s,
        counts=counts,
        first_s=first_s,
        spacing_s=np.insert(blocks.spacing_s, at, blocks.spacing_s[cut]),
        inside=started,
        entries=entries,
        first_of_block=np.arange(len(blocks.counts)) + np.searchsorted(cut, np.arange(len(blocks.counts))),
    )


def _arm_sums(pieces: _Pieces, tau_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return sums over each piece's samples, (S,) each: stretch, its slope by contact, its slope by tau."""
    _, rise, decay_slope, rise_slope = interval_factors(pieces.lengths_s, tau_s)
    increments = np.diff(pieces.depth_mm)
    driven = np.stack([(rise * increments)[:-1], -pieces.entries[1:]])
    start, shift = decaying_sum(driven, pieces.lengths_s[:-1], tau_s, 0.0)
    start_slope = decaying_sum(
        (decay_slope * start + rise_slope * increments)[:-1], pieces.lengths_s[:-1], tau_s, 0.0
    )
    decays, decays_slope = _sampled_decay(pieces, tau_s)
    steady = pieces.speed_mm_s * tau_s
    total = (start - steady) * decays + steady * pieces.counts
    total_slope = (
        (start_slope - pieces.speed_mm_s) * decays
        + (start - steady) * decays_slope
        + pieces.speed_mm_s * pieces.counts
    )
    return total, shift * decays, total_slope


def _sampled_decay(pieces: _Pieces, tau_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the sum of exp(-s / tau) over the samples of each piece, (S,), and its derivative by tau."""
    ratio = pieces.spacing_s / tau_s
    n = pieces.counts
    one = -np.expm1(-ratio)
    many = -np.expm1(-n * ratio)
    late = np.exp(-pieces.first_s / tau_s)
    series = many / one
    by_ratio = (n * (1.0 - many) * one - many * (1.0 - one)) / one**2
    total = late * series
    slope = total * pieces.first_s / tau_s**2 - late * by_ratio * ratio / tau_s
    return total, slope


def sampled_force(
    blocks: Blocks, contact_mm: float, stiffness_mn_per_mm: FloatArray, times_s: FloatArray
) -> FloatArray:
    """Return the force (N,) mN at every sample of the blocks, never below zero.

    ``stiffness_mn_per_mm`` (1 + n_arms,), k0 first; ``times_s`` (n_arms,).
    """
    pieces = _depth_pieces(blocks, contact_mm)
    counts = pieces.counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    order = np.arange(int(counts.sum())) - np.repeat(starts, counts)
    age_s = np.repeat(pieces.first_s, counts) + order * np.repeat(pieces.spacing_s, counts)
    steady_mn = np.zeros_like(pieces.speed_mm_s)
    for stiffness, tau_s in zip(stiffness_mn_per_mm[1:], times_s, strict=True):
        steady_mn += stiffness * pieces.speed_mm_s * tau_s
    start_mn = stiffness_mn_per_mm[0] * pieces.depth_mm[:-1] + steady_mn
    force_mn = np.repeat(start_mn, counts)
    force_mn += np.repeat(stiffness_mn_per_mm[0] * pieces.speed_mm_s, counts) * age_s
    for stiffness, tau_s in zip(stiffness_mn_per_mm[1:], times_s, strict=True):
        _, rise, _, _ = interval_factors(pieces.lengths_s, float(tau_s))
        driven = (rise * np.diff(pieces.depth_mm))[:-1]
        stretch_mm = decaying_sum(driven, pieces.lengths_s[:-1], float(tau_s), 0.0)
        late = np.exp(age_s * (-1.0 / tau_s))
        late *= np.repeat(stiffness * (stretch_mm - pieces.speed_mm_s * tau_s), counts)
        force_mn += late
    return np.asarray(np.maximum(force_mn, 0.0), dtype=float)
