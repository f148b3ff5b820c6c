"""Oscillations with a phase of their own in every trial: hum, pulse, breath, tremor.

Both quadratures are scored; the power at a frequency is judged against its neighbours on both sides, so that no
noise model decides what is much. The cube root makes a power nearly symmetric, as sign-flips want it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution

from analysis.mismatch.freed import Freed
from analysis.mismatch.joint import JointFit
from analysis.mismatch.noise import Whitener
from analysis.mismatch.shared import Addition, Hum
from analysis.mismatch.surface_motion import in_contact, surface_force
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

RESOLUTION_HZ = 0.11
SHORTEST_REACH = 0.25
HUM_HALF_WIDTH_HZ = 0.6
WANDERS_BY_HZ, FAR_HZ = (0.0, 0.4, 1.5), 1.5
SIDES_HZ = (2.5, 8.0)
"""Where the sides of a line that wanders far begin and end."""


@dataclass(frozen=True)
class Band:
    """Where an oscillation is looked for and what it does to the force."""

    mechanism: str
    lower_hz: float
    upper_hz: float

    def holds(self, frequency_hz: FloatArray) -> NDArray[np.bool_]:
        """Mask (F,) of the frequencies that lie in the band."""
        return (frequency_hz >= self.lower_hz) & (frequency_hz <= self.upper_hz)


def bands() -> list[Band]:
    """Return the bands of the library's oscillations of the specimen."""
    found = []
    for m in library().values():
        if m.form == "oscillation" and m.stage == "specimen":
            f = m.parameter("frequency_hz")
            found.append(Band(m.name, f.lower, f.upper))
    return found


@dataclass(frozen=True)
class Spectrum:
    """Power of both quadratures, (T, F), at frequencies (F,), in units of what noise is expected to have."""

    frequency_hz: FloatArray
    power: FloatArray


def line_gain(spectrum: Spectrum, band: Band) -> float:
    """Return what a line at each trial's own frequency in a band gains, in units of chi2.

    Less what the best of so many frequencies gains by chance.
    """
    inside = band.holds(spectrum.frequency_hz)
    best = 2.0 * spectrum.power[:, inside].max(axis=1) - 2.0 * np.log(inside.sum())
    return float(np.maximum(best, 0.0).sum())


def surface_spectrum(
    trials: Sequence[CellTrial],
    whiteners: Sequence[Whitener],
    freed: Sequence[Freed | None],
    fit: JointFit,
    frequency_hz: FloatArray,
) -> Spectrum:
    """Return how much of each trial's residual a movement of the surface at each frequency explains.

    A trial without contact has power 1 (no evidence).
    """
    power = np.ones((len(trials), len(frequency_hz)))
    for j, (trial, whitener, free) in enumerate(zip(trials, whiteners, freed, strict=True)):
        if free is None:
            continue
        phase = 2 * np.pi * frequency_hz[:, None] * trial.time_s
        rows = np.concatenate([np.cos(phase), np.sin(phase)])
        columns = whitener(
            surface_force(trial, fit.simulation.tissue, fit.own[j], rows, in_contact(trial, fit.own[j])).T
        )
        m = len(frequency_hz)
        cosine, sine = columns[:, :m], columns[:, m:]
        of_cosine, of_sine = free.basis.T @ cosine, free.basis.T @ sine
        cc = np.einsum("nf,nf->f", cosine, cosine) - np.einsum("pf,pf->f", of_cosine, of_cosine)
        ss = np.einsum("nf,nf->f", sine, sine) - np.einsum("pf,pf->f", of_sine, of_sine)
        cs = np.einsum("nf,nf->f", cosine, sine) - np.einsum("pf,pf->f", of_cosine, of_sine)
        bc, bs = cosine.T @ free.r, sine.T @ free.r
        determinant = np.maximum(cc * ss - cs**2, 1e-9 * (cc * ss) + 1e-30)
        power[j] = (ss * bc**2 - 2 * cs * bc * bs + cc * bs**2) / determinant / 2.0
    return Spectrum(frequency_hz, power)


def quick_spectrum(
    trials: Sequence[CellTrial], freed: Sequence[Freed | None], fit: JointFit, frequency_hz: FloatArray
) -> Spectrum:
    """Return the power of quick movements of the surface (above some 4 Hz), where the tissue is a mere spring.

    The residual in contact is correlated with each frequency's two quadratures.
    """
    power = np.ones((len(trials), len(frequency_hz)))
    for j, (trial, free) in enumerate(zip(trials, freed, strict=True)):
        inside = in_contact(trial, fit.own[j])[trial.fitted]
        if free is None or inside.sum() < 50:
            continue
        weight = np.sqrt(trial.counts[trial.fitted][inside])
        r = free.r[inside]
        r = (r - np.average(r, weights=weight)) * weight
        turning = np.exp(-2j * np.pi * frequency_hz[:, None] * trial.time_s[trial.fitted][inside])
        raw = np.abs(turning @ r) ** 2
        level = np.median(raw) / np.log(2.0)
        power[j] = raw / max(float(level), 1e-30)
    return Spectrum(frequency_hz, power)


def smoothed(spectrum: Spectrum, half_width_hz: float) -> Spectrum:
    """Return the spectrum averaged over a band about each frequency: for oscillations that wander."""
    f = spectrum.frequency_hz
    total = np.cumsum(np.hstack([np.zeros((len(spectrum.power), 1)), spectrum.power]), axis=1)
    low, high = np.searchsorted(f, f - half_width_hz), np.searchsorted(f, f + half_width_hz, side="right")
    return Spectrum(f, (total[:, high] - total[:, low]) / (high - low))


def oscillation_scores(spectrum: Spectrum) -> FloatArray:
    """Return scores (T, F): cube-rooted power less that of the neighbours on both sides (logarithmic)."""
    root = np.cbrt(spectrum.power)
    f = np.log(spectrum.frequency_hz)
    scores = np.zeros_like(root)
    for k in range(len(f)):
        away = f - f[k]
        apart = np.abs(spectrum.frequency_hz - spectrum.frequency_hz[k]) > RESOLUTION_HZ
        # the same reach on both sides, or a falling spectrum would put every edge above its neighbours
        reach = min(1.2, float(f[k] - f[0]), float(f[-1] - f[k]))
        if reach < SHORTEST_REACH:
            continue
        apart = np.abs(spectrum.frequency_hz - spectrum.frequency_hz[k]) > RESOLUTION_HZ
        below = (away < -0.10) & (away >= -reach) & apart
        above = (away > 0.10) & (away <= reach) & apart
        if below.any() and above.any():
            scores[:, k] = root[:, k] - 0.5 * (root[:, below].mean(axis=1) + root[:, above].mean(axis=1))
    return scores


def scan_frequencies() -> FloatArray:
    """Return the frequencies of the slow scan: logarithmic, from well below the breath to above the pulse."""
    return np.geomspace(0.035, 9.0, 150)


def quick_frequencies() -> FloatArray:
    """Return the frequencies of the quick scan: 2.4 to 28 Hz, as fine as a trial of ten seconds resolves."""
    return np.arange(2.4, 28.0, 0.06)


def stray_lines(
    residuals: Sequence[FloatArray], sample_rate_hz: float, above_hz: float
) -> list[tuple[float, float, float]]:
    """Return lines that stand out over all trials anywhere in the spectrum: (frequency Hz, rms, p-value).

    Power is summed over trials, line by line and over +-0.4 Hz for lines that wander, relative to the median of its
    neighbourhood; over +-1.5 Hz for lines that wander far, relative to the mean of both sides. The median of w powers
    is as unsure as a mean of 0.48 w (variance 1 / w against the square of its ln 2), so that either ratio is one of
    variances, with so many to compare with.
    """
    shortest = min(len(r) for r in residuals)
    if shortest < 1024:
        return []
    frequency = np.fft.rfftfreq(shortest, 1.0 / sample_rate_hz)
    powers = [np.abs(np.fft.rfft(r[:shortest] - np.mean(r[:shortest]))) ** 2 for r in residuals]
    absolute, n = np.sum(powers, axis=0), len(residuals)
    usable = (frequency > above_hz) & (frequency < 0.49 * sample_rate_hz)
    width = max(8, round(4.0 / frequency[1]))
    relative = np.sum([p / _level(p, width) for p in powers], axis=0)
    even = np.sum([p / p[usable].mean() for p in powers], axis=0)
    found = []
    for half_hz in WANDERS_BY_HZ:
        half = round(half_hz / frequency[1])
        kernel = np.ones(2 * half + 1)
        if half_hz < FAR_HZ:
            ratio = np.convolve(relative, kernel, mode="same") / (n * len(kernel))
            compared = 2.0 * np.log(2.0) ** 2 * width * n
        else:
            reach = round(SIDES_HZ[1] / frequency[1])
            away_hz = np.abs(np.arange(-reach, reach + 1)) * frequency[1]
            beside = (away_hz > SIDES_HZ[0]).astype(np.float64)
            mean = np.convolve(even, kernel, mode="same") / len(kernel)
            ratio = mean / (np.convolve(even, beside, mode="same") / beside.sum())
            compared = 2.0 * n * beside.sum()
        p = np.where(usable, f_distribution.sf(ratio, 2 * n * len(kernel), compared), 1.0)
        p = np.minimum(1.0, p * len(WANDERS_BY_HZ) * usable.sum() / len(kernel))
        k = int(np.argmin(p))
        around = slice(max(0, k - half), k + half + 1)
        beyond_noise = max(1.0 - 1.0 / float(ratio[k]), 0.0)
        rms = float(np.sqrt(2.0 * beyond_noise * absolute[around].sum() / n)) / shortest
        found.append((float(frequency[k]), rms, float(p[k])))
    return found


def _level(power: FloatArray, width: int) -> FloatArray:
    """Return the mean power (F,) of each neighbourhood, from medians of ``width`` bins, that leave lines out."""
    # the median of blocks, interpolated: a running median at a hundredth of the price
    blocks = power[1 : 1 + (len(power) - 1) // width * width].reshape(-1, width)
    level = np.median(blocks, axis=1) / np.log(2.0)
    centres = 1 + width * (np.arange(len(level)) + 0.5)
    return np.asarray(np.maximum(np.interp(np.arange(len(power)), centres, level), 1e-300))


def line_power(residual_mn: FloatArray, sample_rate_hz: float, grid_hz: FloatArray) -> FloatArray:
    """Return a residual's power (F,) at frequencies, relative to the median around each (exponential noise: 1)."""
    n = 2 ** int(np.ceil(np.log2(2 * len(residual_mn))))
    power = np.abs(np.fft.rfft(residual_mn - residual_mn.mean(), n)) ** 2
    frequency = np.fft.rfftfreq(n, 1.0 / sample_rate_hz)
    width = max(3, round(3.0 / (frequency[1] - frequency[0])))
    at = np.searchsorted(frequency, grid_hz).clip(0, len(frequency) - 1)
    out = np.empty(len(grid_hz))
    for k, i in enumerate(at):
        around = power[max(1, i - width) : i + width]
        out[k] = power[i] / (np.median(around) / np.log(2.0))
    return out


def mains_lines(sample_rate_hz: float) -> FloatArray:
    """Return the frequencies (F,) at which hum is looked for: 50 and 60 Hz and harmonics, and a little beside."""
    centres = sorted({base * h for base in (50.0, 60.0) for h in range(1, 9) if base * h <= 400.0})
    beside = np.linspace(-HUM_HALF_WIDTH_HZ, HUM_HALF_WIDTH_HZ, 25)
    grid = np.concatenate([c + beside * (c / 50.0) ** 0.5 for c in centres])
    return np.asarray(grid[grid < 0.45 * sample_rate_hz])


def line_p_value(power: FloatArray, grid_hz: FloatArray) -> FloatArray:
    """Return for each frequency of `mains_lines` the chance (F,) that n trials' summed power (T, F) is noise.

    Over all frequencies; half of the chance goes to the few at which the mains stands by its name.
    """
    by_name = np.isclose(np.minimum(grid_hz % 50.0, grid_hz % 60.0), 0.0, atol=1e-6)
    looks = 2.0 * np.where(by_name, by_name.sum(), (~by_name).sum())
    total = power.sum(axis=0)
    return np.asarray(np.minimum(1.0, looks * chi2_distribution.sf(2.0 * total, 2 * len(power))))


def hum_addition(
    mechanism: Mechanism,
    frequency_hz: float,
    trials: Sequence[CellTrial],
    residuals_mn: Sequence[FloatArray],
) -> tuple[Addition, FloatArray]:
    """Return hum at one frequency, each trial's phase and size taken from its full-rate residual, and the gain (T,).

    The gain is the drop of the residual's sum of squares in units of its mean square.
    """
    found, gain = {}, np.zeros(len(trials))
    for j, (trial, r) in enumerate(zip(trials, residuals_mn, strict=True)):
        first = int(trial.starts[np.argmax(trial.fitted)])
        time_s = (first + np.arange(len(r))) / trial.sample_rate_hz
        phase = 2 * np.pi * frequency_hz * time_s
        columns = np.column_stack([np.cos(phase), np.sin(phase)])
        around = r - np.mean(r)
        beta = np.linalg.solve(columns.T @ columns, columns.T @ around)
        found[trial.label] = (float(beta[0]), float(beta[1]))
        # the line stands on the noise of its neighbourhood, which the median of the line's own band tells
        level = float(np.sum(np.diff(around) ** 2)) / max(2.0 * (len(r) - 1), 1.0)
        gain[j] = float(beta @ (columns.T @ columns) @ beta) / max(level, 1e-30)
    size = float(np.mean([np.hypot(*b) for b in found.values()]))
    values = {"amplitude_mn": size, "frequency_hz": frequency_hz}
    return Addition(mechanism, values, hum=Hum(frequency_hz, found)), gain
