"""Where simulation and recordings differ: significant bins of the residual, merged into windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.conditions import CLEAR, conditions_in_words
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import LEVEL
from analysis.mismatch.position_channel import PositionFinding
from analysis.mismatch.problem import Problem
from analysis.mismatch.profiles import BIN_NAMES, OUTSIDE, Profiles, profile, repeatable_energy
from analysis.mismatch.report import Window
from analysis.mismatch.signflip import FLIPS
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

MOST_WINDOWS = 10
SMALLEST_SHARE = 0.01
EFFECT_SHARE = 0.03
EFFECT_LEVEL = 0.1
FAR_OUT = 8.0


@dataclass(frozen=True)
class Residual:
    """A fit's residual by bin: profiles, and the energy (B,) that repeats, in units of white-noise chi2."""

    profiles: Profiles
    energy: FloatArray
    white_mn: float

    @property
    def total(self) -> float:
        """Repeatable energy over all bins; what noise scatters about zero averages out."""
        return max(float(self.energy.sum()), 0.0)


def residual_of(problem: Problem, fit: JointFit) -> Residual:
    """Return the residual of a fit by bin."""
    found = profile(problem.trials, problem.residuals(fit), [o.z0_mm for o in fit.own])
    energy = repeatable_energy(found.standardised(problem.white_mn), found.conditions)[:OUTSIDE]
    return Residual(found, energy, problem.white_mn)


def repeats_p_value(residual: Residual, rng: np.random.Generator) -> float:
    """Return the chance that as much energy repeats by chance, by sign-flips of whole trials.

    The statistic is the sum of `repeatable_energy`: of products of different trials, which flips turn about.
    """
    u = residual.profiles.standardised(residual.white_mn)[:, :OUTSIDE]
    labels = np.asarray(residual.profiles.conditions)
    same = labels[:, None] == labels[None, :]
    alone = same.sum(axis=1) < 2
    same |= alone[:, None] & alone[None, :]
    np.fill_diagonal(same, False)
    products = np.where(same, u @ u.T, 0.0) / np.maximum(same.sum(axis=1), 1)[:, None]
    signs = rng.integers(0, 2, size=(FLIPS, len(labels))) * 2.0 - 1.0
    flipped = np.einsum("fi,fi->f", signs @ products, signs)
    return float((1 + np.sum(flipped >= products.sum() - 1e-12)) / (FLIPS + 1))


def force_windows(
    trials: Sequence[CellTrial],
    residual: Residual,
    bin_p: FloatArray,
    total: float,
    *,
    whole_p: float,
    all_of_them: bool = False,
) -> tuple[Window, ...]:
    """Return the windows of significant force residual, largest first.

    ``bin_p`` (2, B): p-values of the bins, plain and with depth, all tested together; ``total`` the energy
    that shares refer to. ``whole_p``: p-value of the residual as a whole. Where it is significant, bins whose
    repeatable energy stands far out of their scatter count too, with this p-value: an effect that lies in
    other bins in every condition (contact is lost at another depth) is unanimous in none. Windows of less
    than a hundredth are left out (but for the largest), unless ``all_of_them``: then the bins that hold half of the
    energy are where it lies, if none stands out by itself.
    """
    found = []
    significant = np.asarray(np.min(bin_p, axis=0) <= LEVEL)
    if whole_p <= LEVEL:
        significant |= standing_out(residual, total)
        if all_of_them and not significant.any():
            significant = _half_of(residual.energy)
    for bins in _merged(significant, residual.profiles.count.sum(axis=0)[:OUTSIDE] > 0):
        energy = max(float(residual.energy[bins].sum()), 0.0)
        samples = float(residual.profiles.count[:, bins].sum())
        mean = float((residual.profiles.mean * residual.profiles.count)[:, bins].sum()) / samples
        start, stop = _times(residual.profiles, bins, residual.white_mn)
        smallest = float(bin_p[:, bins].min())
        found.append(
            Window(
                signal="force",
                phase=BIN_NAMES[bins[0]][0],
                start_s=start,
                stop_s=stop,
                mean_residual_mn=mean,
                p_value=smallest if smallest <= LEVEL else whole_p,
                share_of_mismatch=min(1.0, energy / max(total, 1e-12)),
                conditions=conditions_in_words(
                    trials, residual.profiles, residual.white_mn, bins, bool(bin_p[1, bins].min() <= LEVEL)
                ),
                rms_mn=float(np.sqrt(energy * residual.white_mn**2 / samples)),
            )
        )
    found.sort(key=lambda w: -w.share_of_mismatch)
    if all_of_them:
        return tuple(found)
    kept = [w for w in found if w.share_of_mismatch >= SMALLEST_SHARE] or found[:1]
    return tuple(kept[:MOST_WINDOWS])


def _half_of(energy: FloatArray) -> NDArray[np.bool_]:
    """Return the fewest bins (B,) that hold half of the energy."""
    order = np.argsort(-energy)
    held = np.cumsum(energy[order])
    chosen = np.zeros(len(energy), dtype=bool)
    chosen[order[: 1 + int(np.searchsorted(held, 0.5 * max(float(energy.sum()), 0.0)))]] = True
    return chosen


def _merged(significant: NDArray[np.bool_], present: NDArray[np.bool_]) -> list[list[int]]:
    """Join significant bins of one phase that are neighbours, or have a single bin between them."""
    groups: list[list[int]] = []
    for b in np.flatnonzero(significant & present):
        near = groups and BIN_NAMES[groups[-1][-1]][0] == BIN_NAMES[b][0] and b - groups[-1][-1] <= 2
        if near:
            groups[-1].append(int(b))
        else:
            groups.append([int(b)])
    return [[b for b in range(g[0], g[-1] + 1) if present[b]] for g in groups]


def standing_out(residual: Residual, total: float) -> NDArray[np.bool_]:
    """Return the bins (B,) that hold a part of the repeatable energy, far outside their own scatter."""
    u = residual.profiles.standardised(residual.white_mn)[:, :OUTSIDE]
    labels = np.asarray(residual.profiles.conditions)
    scatter, spare, pairs = np.zeros(OUTSIDE), 0, 0.0
    for label in np.unique(labels):
        part = u[labels == label]
        if len(part) > 1:
            scatter += ((part - part.mean(axis=0)) ** 2).sum(axis=0)
            spare += len(part) - 1
            pairs += 2.0 * len(part) / (len(part) - 1)
    variance = np.maximum(scatter / spare, 1.0) if spare else np.ones(OUTSIDE)
    # energy of noise: mean 0, variance 2 n / (n - 1) a condition of n repeats, in units of scatter squared
    noise = variance * np.sqrt(max(pairs, 4.0))
    return np.asarray((residual.energy > FAR_OUT * noise) & (residual.energy > SMALLEST_SHARE * total))


def _times(profiles: Profiles, bins: Sequence[int], noise: float | None = None) -> tuple[float, float]:
    """Return where bins lie, median over trials; with ``noise``, only those that are clear in each trial."""
    start, stop = profiles.start_s[:, bins].copy(), profiles.stop_s[:, bins].copy()
    if noise is not None:
        size = np.abs(profiles.standardised(noise)[:, bins])
        quiet = (size <= CLEAR) & (size.max(axis=1, keepdims=True) > CLEAR)
        start[quiet], stop[quiet] = np.nan, np.nan
    here = ~np.all(np.isnan(start), axis=1)
    return (
        float(np.median(np.nanmin(start[here], axis=1))),
        float(np.median(np.nanmax(stop[here], axis=1))),
    )


def effect_windows(
    problem: Problem,
    fit: JointFit,
    effects: Sequence[FloatArray],
    *,
    p_value: float,
    total: float,
    words: str,
    share: float = EFFECT_SHARE,
) -> tuple[Window, ...]:
    """Return the phases in which an effect (n_j,) mN of each trial has its energy, largest first.

    For effects whose residual has no mean over trials. ``total`` is the energy that shares refer to; phases
    with less than ``share`` of the effect's own energy are left out.
    """
    energy, samples, total_residual = (
        np.zeros(len(PHASE_NAMES)),
        np.zeros(len(PHASE_NAMES)),
        np.zeros(len(PHASE_NAMES)),
    )
    spans: dict[int, list[tuple[float, float]]] = {}
    for j, (trial, effect) in enumerate(zip(problem.trials, effects, strict=True)):
        largest = float(np.max(np.abs(effect))) if len(effect) else 0.0
        if largest == 0.0:
            continue
        residual = problem.residual(fit, j)
        for code in np.unique(trial.phase[trial.fitted]):
            if code < 0:
                continue
            shown = (trial.phase == code) & trial.fitted & (np.abs(effect) > EFFECT_LEVEL * largest)
            if not shown.any():
                continue
            a, b = np.flatnonzero(shown)[[0, -1]]
            span = slice(a, b + 1)
            weight = trial.counts[span]
            energy[code] += float(weight @ effect[span] ** 2)
            total_residual[code] += float(weight @ residual[span])
            samples[code] += float(weight.sum())
            half = 0.5 * trial.counts / trial.sample_rate_hz
            spans.setdefault(int(code), []).append(
                (float(trial.time_s[a] - half[a]), float(trial.time_s[b] + half[b]))
            )
    if energy.sum() <= 0:
        return ()
    found = []
    for code, times in spans.items():
        if energy[code] < share * energy.sum():
            continue
        found.append(
            Window(
                signal="force",
                phase=PHASE_NAMES[code],
                start_s=float(np.median([t[0] for t in times])),
                stop_s=float(np.median([t[1] for t in times])),
                mean_residual_mn=float(total_residual[code] / samples[code]),
                p_value=p_value,
                share_of_mismatch=min(1.0, float(energy[code]) / problem.white_mn**2 / max(total, 1e-12)),
                conditions=words,
                rms_mn=float(np.sqrt(energy[code] / samples[code])),
            )
        )
    return tuple(sorted(found, key=lambda w: -w.share_of_mismatch))


def position_windows(
    trials: Sequence[CellTrial], finding: PositionFinding, bins: NDArray[np.int64]
) -> tuple[Window, ...]:
    """Return the windows of the position channel that lie in ``bins``, largest first."""
    used = [replace(t, fitted=np.ones(len(t.time_s), dtype=bool)) for t in trials if t.has_command]
    if not used or not len(bins):
        return ()
    laid = profile(used, [t.servo_residual_mm for t in used], [t.z0_start_mm for t in used])
    counts = laid.count.sum(axis=0)[:OUTSIDE]
    energy = finding.profile_mm**2 * counts
    mask = np.zeros(OUTSIDE, dtype=bool)
    mask[bins] = True
    found = []
    for group in _merged(mask, counts > 0):
        start, stop = _times(laid, group)
        mean_mm = float(finding.profile_mm[group] @ counts[group] / counts[group].sum())
        found.append(
            Window(
                signal="position",
                phase=BIN_NAMES[group[0]][0],
                start_s=start,
                stop_s=stop,
                mean_residual_mn=None,
                p_value=float(finding.bin_p[group].min()),
                share_of_mismatch=float(energy[group].sum() / max(energy.sum(), 1e-30)),
                conditions="every trial",
                mean_residual_um=1e3 * mean_mm,
            )
        )
    return tuple(sorted(found, key=lambda w: -w.share_of_mismatch))[:MOST_WINDOWS]
