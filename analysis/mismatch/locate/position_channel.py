"""The first residual channel: position given command. What is wrong here is the lever's doing, not the tissue's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.signflip import flip_test
from analysis.mismatch.levels import FEW_TRIALS
from analysis.mismatch.locate.windows import PLACES, window_columns
from analysis.simulation.cells import CellTrial
from analysis.simulation.motion import MOST_DELAY_SAMPLES

FloatArray = NDArray[np.float64]

SMALLEST_MM = 5e-4
POSITION_LEVEL = 0.008
WITHIN_TWO = 0.9545
FAR_OFF = 6.0
SERVO_SHOWS = 0.01
BLOCK_CELLS = 60
"""Cells of a block of a single trial, which are taken as independent."""
OUTSIDE = len(PLACES)
LAG = np.array([-1.0, 1.0])
"""How the logarithm of a lag follows those of natural frequency and damping ratio."""


@dataclass(frozen=True)
class PositionFinding:
    """What position given command says.

    ``p_value`` of the servo's signature; ``explained`` share of the repeatable position mismatch, where a servo shows,
    that another servo takes away; ``noise_mm`` rms of a sample; ``profile_mm`` (B,) mean residual by bin without a
    delay, ``bin_p`` its p-values; ``standard_errors`` of ln(natural frequency) and ln(damping ratio),
    ``lag_error`` of the logarithm of their lag, 2 zeta / wn, which is known far better than either. ``late_s`` is the
    delay that explains the position as well as another servo; 0 where one does better.
    """

    p_value: float
    explained: float
    noise_mm: float
    profile_mm: FloatArray
    bin_p: FloatArray
    standard_errors: tuple[float, float]
    lag_error: float
    strength: float
    late_s: float = 0.0

    @property
    def unknown_bins(self) -> NDArray[np.int64]:
        """Bins whose residual is significant and larger than half a micrometre."""
        return np.flatnonzero((np.abs(self.profile_mm) > SMALLEST_MM) & (self.bin_p < POSITION_LEVEL))


def _noise_mm(trial: CellTrial) -> float:
    """Return the rms noise of a sample from differences of neighbours, those far off left out.

    What is far off is judged by a quantile and not the median, half of which a converter's steps make too small.
    """
    jump = np.abs(np.diff(trial.full_servo_residual_mm.astype(np.float64)))
    usual = float(np.quantile(jump, WITHIN_TWO)) / 2.0
    return float(np.sqrt(np.mean(jump[jump <= FAR_OFF * max(usual, SMALLEST_MM * 1e-3)] ** 2) / 2.0))


def look_at_position(trials: Sequence[CellTrial], rng: np.random.Generator) -> PositionFinding | None:
    """Compare recorded position with the nominal servo's answer to the command; None without commands.

    Each trial may have its own offset and gain between command and position (calibration).
    """
    used = [t for t in trials if t.has_command]
    if not used:
        return None
    noise_mm = max(float(np.median([_noise_mm(t) for t in used])), 1e-6)
    lefts = [_beside_calibration(t, noise_mm) for t in used]
    gram = np.sum([left[:, 1:3].T @ left[:, 1:3] for left in lefts], axis=0)
    total = np.sum([left[:, 1:3].T @ left[:, 0] for left in lefts], axis=0)
    inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
    gain = float(total @ inverse @ total)
    squares = sum(float(left[:, 0] @ left[:, 0]) for left in lefts)
    # what another servo leaves as well tells how well a servo describes this drive at all
    misfit = max((squares - gain) / max(sum(map(len, lefts)), 1), 1.0)
    later_s, late = _later_s(lefts, min(t.sample_rate_hz for t in used), gain, misfit)
    scores, by_bin, means, counts, laid, shown = [], [], [], [], [], np.zeros(OUTSIDE)
    for t, left in zip(used, lefts, strict=True):
        r, G = left[:, 0], left[:, 1:3]
        unexplained = r + later_s * left[:, 3]
        bins = bins_of(t)
        blocks = max(1, len(r) // BLOCK_CELLS) if len(used) < FEW_TRIALS else 1
        for part in np.array_split(np.arange(len(r)), blocks):
            scores.append(G[part].T @ r[part])
            by_bin.append(np.bincount(bins[part], weights=unexplained[part], minlength=OUTSIDE + 1)[:OUTSIDE])
        cells = np.bincount(bins, minlength=OUTSIDE + 1)[:OUTSIDE]
        by_cell = np.bincount(bins, weights=r, minlength=OUTSIDE + 1)[:OUTSIDE]
        laid.append(by_cell / np.sqrt(np.maximum(cells, 1)))
        shown += np.bincount(bins, weights=(G**2).sum(axis=1), minlength=OUTSIDE + 1)[:OUTSIDE]
        mean_mm = unexplained * noise_mm * np.sqrt(t.counts)
        means.append(np.bincount(bins, weights=mean_mm, minlength=OUTSIDE + 1)[:OUTSIDE])
        counts.append(np.bincount(bins, weights=t.counts, minlength=OUTSIDE + 1)[:OUTSIDE])
    # both directions of the servo's two parameters, made orthogonal to each other
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-9 * max(float(values.max()), 1e-30)
    turned = np.array(scores) @ vectors[:, keep]
    flips = np.hstack([turned, np.array(by_bin)])
    p_values = flip_test(flips, np.zeros(flips.shape[1], dtype=bool), rng).p_value
    m = int(keep.sum())
    # what repeats, and where a servo shows: all that is beyond the noise would be the converters' steps at rest, and
    # what the noise is misjudged by
    repeats = repeatable_energy(np.array(laid), [t.condition for t in used])
    excess = max(float(repeats[shown > SERVO_SHOWS * shown.max()].sum()), gain, 1e-9)
    all_counts = np.maximum(np.sum(counts, axis=0), 1.0)
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0) * misfit)
    return PositionFinding(
        p_value=float(p_values[:m].min()) if m else 1.0,
        explained=gain / excess,
        noise_mm=noise_mm,
        profile_mm=np.sum(means, axis=0) / all_counts,
        bin_p=p_values[m:],
        standard_errors=(float(errors[0]), float(errors[1])),
        lag_error=float(np.sqrt(max(LAG @ inverse @ LAG, 0.0) * misfit)),
        strength=float(np.sqrt(max(gain, 0.0))),
        late_s=later_s if late else 0.0,
    )


def _beside_calibration(trial: CellTrial, noise_mm: float) -> FloatArray:
    """Return residual, servo's signatures and velocity (n, 4) in noise, beside what offset and gain take up."""
    weight = np.sqrt(trial.counts) / noise_mm
    x = trial.command_mm - trial.command_mm.mean()
    A, _ = np.linalg.qr(np.column_stack([np.ones_like(x), x]) * weight[:, None])
    listed = (trial.servo_residual_mm, trial.servo_signature_mm, trial.velocity_mm_s)
    stacked = np.column_stack(listed) * weight[:, None]
    return np.asarray(stacked - A @ (A.T @ stacked))


def _later_s(
    lefts: Sequence[FloatArray], rate_hz: float, by_servo: float, misfit: float
) -> tuple[float, bool]:
    """Return how much later than its servo the position comes (s), and whether that tells it from another servo.

    Two converters may be some samples apart, and a delay is one number where another servo, which gains ``by_servo``,
    has two: that must explain the position better by more than a nat (Akaike, IEEE Trans. Autom. Control 19:716, 1974).
    Else what comes later does so by no more than the half sample of an output that steps.
    """
    along = sum(float(left[:, 3] @ left[:, 3]) for left in lefts)
    later = -sum(float(left[:, 0] @ left[:, 3]) for left in lefts)
    later_s = float(np.clip(later / max(along, 1e-30), 0.0, MOST_DELAY_SAMPLES / rate_hz))
    by_delay = later_s * (2.0 * later - later_s * along)
    late = later_s > 0.0 and by_servo - by_delay < 2.0 * misfit
    return (later_s if late else min(later_s, 0.5 / rate_hz)), late


def bins_of(trial: CellTrial) -> NDArray[np.int64]:
    """Return the window (n,) that each cell lies in; the last index where it lies in none."""
    inside = window_columns(trial)
    return np.where(inside.any(axis=1), inside.argmax(axis=1), OUTSIDE)


def repeatable_energy(laid: FloatArray, conditions: Sequence[str]) -> FloatArray:
    """Return the energy (B,) of standardised bins (n, B) that repeats: the mean product of different trials, times n.

    Noise averages out of it. Of a condition that was run once all counts, less the noise's expectation.
    """
    found = np.zeros(laid.shape[1])
    labels = np.asarray(conditions)
    for label in np.unique(labels):
        part = laid[labels == label]
        n = len(part)
        if n > 1:
            found += (part.sum(axis=0) ** 2 - (part**2).sum(axis=0)) / (n - 1)
        else:
            found += part[0] ** 2 - 1.0
    return found
