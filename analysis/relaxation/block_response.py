"""The solid's answer averaged over blocks of samples, with its derivatives, exact to rounding.

Between knots the motion is straight, so an arm's stretch is q(s) = (q_b - v tau) exp(-s / tau) + v tau,
and the mean over the block's evenly spaced samples is a geometric sum. The knot at which contact is made
is put in where it belongs, between samples; so the model is smooth in the contact point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.contact_law import FLAT, ContactLaw
from analysis.relaxation.response import interval_factors

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
class Pieces:
    """Straight pieces of the depth: the blocks, and the two parts of one in which contact changes."""

    lengths_s: FloatArray  # (S,)
    depth_mm: FloatArray  # (S + 1,) at the pieces' ends
    speed_mm_s: FloatArray  # (S,)
    counts: FloatArray  # (S,) samples in the piece
    first_s: FloatArray  # (S,) from the piece's start to its first sample
    ages_s: FloatArray  # (S,) sum over the samples of the time since the piece's start
    spacing_s: FloatArray  # (S,)
    inside: FloatArray  # (S,) 1 in contact
    entries: FloatArray  # (S,) +1 where contact is made at the piece's start, -1 where it is lost
    first_of_block: IntArray  # (K,)


def block_answer(blocks: Blocks, contact_mm: float, times_s: Sequence[float]) -> BlockAnswer:
    """Return the answer to the depth max(position - contact, 0) for arms of the given times."""
    pieces = depth_pieces(blocks, contact_mm)
    n = 1 + len(times_s)
    sums = np.empty((3 * n - 1, len(pieces.counts)))
    sums[0] = pieces.counts * pieces.depth_mm[:-1] + pieces.speed_mm_s * pieces.ages_s
    sums[n] = -pieces.counts * pieces.inside
    if n > 1:
        _fill_arms(pieces, np.array(times_s)[:, None], sums[1:n], sums[n + 1 : 2 * n], sums[2 * n :])
    means = np.add.reduceat(sums, pieces.first_of_block, axis=1) / blocks.counts
    return BlockAnswer(rows=means[:n], contact_slopes=means[n : 2 * n], tau_slopes=means[2 * n :])


def block_rows(
    blocks: Blocks,
    contact_mm: float,
    times_s: Sequence[float],
    level: Callable[[FloatArray], FloatArray] = FLAT.level,
) -> FloatArray:
    """Return the rows of `block_answer` (1 + n_arms, K) alone, without derivatives, for any ``level`` of a depth."""
    pieces = depth_pieces(blocks, contact_mm)
    tau_s = np.array(times_s)[:, None]
    decay, rise, _, _ = interval_factors(pieces.lengths_s, tau_s)
    level_mm = level(pieces.depth_mm)
    speed_mm_s = np.diff(level_mm) / pieces.lengths_s
    steady = speed_mm_s * tau_s
    sums = np.empty((1 + len(times_s), len(pieces.counts)))
    sums[0] = pieces.counts * level_mm[:-1] + speed_mm_s * pieces.ages_s
    sums[1:] = decaying_sums((rise * np.diff(level_mm))[None], decay)[0]
    one, many = -np.expm1(-pieces.spacing_s / tau_s), -np.expm1(-pieces.counts * pieces.spacing_s / tau_s)
    sums[1:] -= steady
    sums[1:] *= np.exp(-pieces.first_s / tau_s) * many / one
    sums[1:] += steady * pieces.counts
    return np.asarray(np.add.reduceat(sums, pieces.first_of_block, axis=1) / blocks.counts, dtype=float)


def depth_pieces(blocks: Blocks, contact_mm: float) -> Pieces:
    """Return the straight pieces of the depth; a piece in which contact changes is cut at that instant."""
    knots = blocks.pieces()
    above_mm = knots.position_mm - contact_mm
    inside = above_mm > 0.0
    cut = np.flatnonzero(inside[1:] != inside[:-1])
    lengths_s = np.diff(knots.time_s)
    share = above_mm[cut] / (above_mm[cut] - above_mm[cut + 1])
    before_s = share * lengths_s[cut]
    # samples of a cut piece before the instant; the one on it counts as after
    before = np.ceil((before_s - knots.first_s[cut]) / knots.spacing_s[cut])
    before = np.clip(before, 0.0, knots.counts[cut])
    # every cut piece stands twice, its second part beginning at the instant
    n_pieces = len(knots.counts)
    twice = np.sort(np.concatenate([np.arange(n_pieces), cut]))
    second = cut + 1 + np.arange(len(cut))
    counts, spacing_s, first_s = knots.counts[twice], knots.spacing_s[twice], knots.first_s[twice]
    counts[second] -= before
    counts[second - 1] = before
    first_s[second] = knots.first_s[cut] + before * knots.spacing_s[cut] - before_s
    first_s[counts == 0.0] = 0.0
    knots_s = np.append(knots.time_s[twice], knots.time_s[-1])
    knots_s[second] += before_s
    depth_mm = np.maximum(np.append(above_mm[twice], above_mm[-1]), 0.0)
    depth_mm[second] = 0.0
    piece_lengths_s = np.maximum(np.diff(knots_s), 1e-12)
    entries = np.zeros(len(twice))
    entries[second] = np.where(inside[cut + 1], 1.0, -1.0)
    first_of_block = knots.first_of_block + np.searchsorted(cut, knots.first_of_block, side="left")
    return Pieces(
        lengths_s=piece_lengths_s,
        depth_mm=depth_mm,
        speed_mm_s=np.diff(depth_mm) / piece_lengths_s,
        counts=counts,
        first_s=first_s,
        ages_s=counts * (first_s + 0.5 * (counts - 1.0) * spacing_s),
        spacing_s=spacing_s,
        inside=np.cumsum(entries) + float(inside[0]),
        entries=entries,
        first_of_block=first_of_block,
    )


def _fill_arms(
    pieces: Pieces, tau_s: FloatArray, stretch: FloatArray, by_contact: FloatArray, by_tau: FloatArray
) -> None:
    """Fill sums over each piece's samples, (n_arms, S) each: stretches, their slopes by contact and by tau.

    ``tau_s`` is (n_arms, 1).
    """
    decay, rise, decay_slope, rise_slope = interval_factors(pieces.lengths_s, tau_s)
    increments = np.diff(pieces.depth_mm)
    left = np.broadcast_to(-np.append(pieces.entries[1:], 0.0), rise.shape)
    start, shift = decaying_sums(np.stack([rise * increments, left]), decay)
    start_slope = decaying_sums((decay_slope * start + rise_slope * increments)[None], decay)[0]
    decays, decays_slope = sampled_decays(pieces, tau_s)
    steady = pieces.speed_mm_s * tau_s
    travel = pieces.speed_mm_s * pieces.counts
    start -= steady
    stretch[:] = start * decays + tau_s * travel
    by_contact[:] = shift * decays
    by_tau[:] = (start_slope - pieces.speed_mm_s) * decays + start * decays_slope + travel


def decaying_sums(driven: FloatArray, decay: FloatArray) -> FloatArray:
    """Return y (R, A, S) of y[s + 1] = decay[s] y[s] + driven[s], y[0] = 0; the last driven has no effect.

    ``driven`` (R, A, S), ``decay`` (A, S): all arms in one triangular system with one band.
    """
    from scipy.linalg.lapack import dtbtrs

    n_rows, n_arms, n_pieces = driven.shape
    band = np.ones((n_arms * n_pieces, 2))
    below = band[:, 1].reshape(n_arms, n_pieces)
    np.negative(decay, out=below)
    below[:, -1] = 0.0
    rows = np.zeros((n_rows, n_arms, n_pieces))
    rows[:, :, 1:] = driven[:, :, :-1]
    columns, fault = dtbtrs(band.T, rows.reshape(n_rows, -1).T, uplo="L", diag="U", overwrite_b=True)
    if fault:
        raise ValueError("the recursion of the arms can't be solved")
    return np.asarray(columns.T, dtype=float).reshape(rows.shape)


def sampled_decays(pieces: Pieces, tau_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sums of exp(-s / tau) over the samples of each piece, (n_arms, S), and derivatives by tau."""
    ratio = pieces.spacing_s / tau_s
    n = pieces.counts
    one = -np.expm1(-ratio)
    many = -np.expm1(-n * ratio)
    late = np.exp(-pieces.first_s / tau_s)
    by_ratio = (n * (1.0 - many) * one - many * (1.0 - one)) / np.square(one)
    total = late * many / one
    return total, (total * pieces.first_s / tau_s - late * by_ratio * ratio) / tau_s


def sampled_force(
    blocks: Blocks,
    contact_mm: float,
    stiffness_mn_per_mm: FloatArray,
    times_s: FloatArray,
    law: ContactLaw = FLAT,
) -> FloatArray:
    """Return the force (N,) mN at every sample of the blocks, never below zero.

    ``stiffness_mn_per_mm`` (1 + n_arms,), k0 first; ``times_s`` (n_arms,). The blocks have the knots that
    the law needs (`law_knots`).
    """
    pieces = depth_pieces(blocks, contact_mm)
    counts = pieces.counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    order = np.arange(int(counts.sum())) - np.repeat(starts, counts)
    tau_s = times_s[:, None]
    decay, rise, _, _ = interval_factors(pieces.lengths_s, tau_s)
    level_mm = law.level(pieces.depth_mm)
    speed_mm_s = np.diff(level_mm) / pieces.lengths_s
    stretch_mm = decaying_sums((rise * np.diff(level_mm))[None], decay)[0]
    stiffness, steady_mm = stiffness_mn_per_mm[1:, None], speed_mm_s * tau_s
    late_mn = stiffness * (stretch_mm - steady_mm) * np.exp(-pieces.first_s / tau_s)
    slope_mn_s = stiffness_mn_per_mm[0] * speed_mm_s
    start_mn = stiffness_mn_per_mm[0] * level_mm[:-1] + slope_mn_s * pieces.first_s
    start_mn += np.sum(stiffness * steady_mm, axis=0)
    force_mn = np.repeat(slope_mn_s * pieces.spacing_s, counts)
    force_mn *= order
    force_mn += np.repeat(start_mn, counts)
    # samples of a block are evenly spaced, and alike in all blocks that have more than one
    spacing_s = pieces.spacing_s[int(np.argmax(counts))]
    ages_s = np.arange(int(counts.max())) * spacing_s
    for by_piece, tau in zip(late_mn, times_s.tolist(), strict=True):
        fading_mn = np.exp(ages_s * (-1.0 / tau))[order]
        fading_mn *= np.repeat(by_piece, counts)
        force_mn += fading_mn
    return np.asarray(np.maximum(force_mn, 0.0, out=force_mn), dtype=float)
