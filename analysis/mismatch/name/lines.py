"""Lines too quick for cells: hum of the mains and other tones, found at full rate and taken out of the recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import gamma

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.noise import Band
from analysis.mismatch.fit.study_fit import StudyFit, sampled_alike
from analysis.mismatch.levels import ENOUGH_ONCE, FEWEST_HELD_OUT, KEPT, LINE_LEVEL
from analysis.mismatch.locate.quiet import heard_out_of_contact
from analysis.mismatch.name.sways import LOWEST_BAND_HZ, sways
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

FloatArray = NDArray[np.float64]

ROUNDING = float(np.finfo(np.float32).eps)
LOWEST_HZ = 16.0
BACKGROUND = 61
MOST_LINES = 6
NEAR_BINS, FAR_BINS = 12, 100
"""Bins within which a tone is one, and to which its skirts are followed."""
KNOT_S = 1.0
SHORTEST_S = 0.5
MAINS_HZ = (50.0, 60.0)
MAINS_WITHIN = 0.01


@dataclass(frozen=True)
class Line:
    """A tone that every trial has, its phase new in each: frequency (Hz), amplitude (mN) with error, chance of it.

    ``of_position_mn`` is its amplitude in the force that the recorded motion makes: a tone of the position's sensor.
    """

    frequency_hz: float
    amplitude_mn: float
    amplitude_se_mn: float
    p_value: float
    of_position_mn: float = 0.0

    @property
    def rms_mn(self) -> float:
        """Rms force, mN."""
        return self.amplitude_mn / float(np.sqrt(2.0))

    @property
    def name(self) -> str:
        """The mechanism's name where it is the mains or a harmonic, and most of it the force's own; empty otherwise."""
        m = library()["mains_hum"]
        p = m.parameter("frequency_hz")
        harmonic = any(
            abs(self.frequency_hz - n * f) <= MAINS_WITHIN * self.frequency_hz
            for f in MAINS_HZ
            for n in range(1, 9)
        )
        of_force = self.of_position_mn**2 <= (1.0 - KEPT) * self.amplitude_mn**2
        return m.name if harmonic and of_force and p.lower <= self.frequency_hz <= p.upper else ""


@dataclass(frozen=True)
class Tones:
    """Lines, and tones that lose their phase, which are noise of a band."""

    lines: tuple[Line, ...] = ()
    bands: tuple[Band, ...] = ()


def find_tones(fit: StudyFit) -> Tones:
    """Return the tones in the trials' full-rate residuals at rest.

    H0: at every frequency the periodogram of each trial is exponential about its neighbours' median, so that the mean
    over trials, less the largest, is no more than a gamma variable; p-values are multiplied by the frequencies looked
    at.
    """
    at_rest, n = _at_rest_together(fit)
    if not at_rest:
        return Tones()
    rate = fit.trials[0].sample_rate_hz
    powers, made = _powers(fit, at_rest, n), np.zeros((0, 0))
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    rounding = ROUNDING * max(float(np.abs(t.full_force_mn).max()) for t in fit.trials)
    local = np.array([median_filter(s, BACKGROUND, mode="nearest") for s in powers]) / np.log(2.0)
    # no tone is finer than the numbers that hold it: what an interpolation leaves is smoother than they are
    local += rounding**2
    ratios = np.sort(powers / np.maximum(local, 1e-300), axis=0)
    # a tone is in every trial: it must stand without the one that shows most of it
    m = len(powers) - (len(powers) >= FEWEST_HELD_OUT)
    ratio = ratios[:m].mean(axis=0)
    looked = (frequency >= LOWEST_BAND_HZ) & (frequency < 0.47 * rate)
    p = np.where(looked, gamma.sf(ratio * m, m), 1.0) * int(looked.sum())
    found: list[Line] = []
    bands: list[Band] = []
    seen: list[int] = []
    for k in np.argsort(-ratio * looked):
        if p[k] > LINE_LEVEL or len(found) + len(bands) == MOST_LINES:
            break
        near = slice(max(0, k - 2), k + 3)
        if any(abs(k - other) < NEAR_BINS for other in seen):
            continue
        seen.append(int(k))
        excess = np.maximum((powers - local)[:, near].sum(axis=1), 0.0)
        centre = float(
            (frequency[near] * powers[:, near].mean(axis=0)).sum() / powers[:, near].mean(axis=0).sum()
        )
        # a Hann window leaves all of a line's power A^2 N / 4 in its neighbourhood
        size = np.sqrt(4.0 * excess / n)
        if not made.size:
            # what the motion makes of a force is asked where there is a line only
            of_motion = [fit.trials[j].at_samples(fit.force_mn(j))[s][:n] for j, s in at_rest.items()]
            made = spectra(of_motion)
        smooth = np.median(made[:, max(0, k - BACKGROUND // 2) : k + BACKGROUND // 2], axis=1)
        of_position = np.sqrt(4.0 * np.maximum((made[:, near] - smooth[:, None]).sum(axis=1), 0.0) / n)
        error = (
            float(np.std(size) / np.sqrt(len(size)))
            if len(size) > 1
            else float(np.sqrt(4.0 * local[:, k].mean() / n))
        )
        amplitude_mn, of_position_mn = (float(np.sqrt(np.mean(a**2))) for a in (size, of_position))
        line = Line(centre, amplitude_mn, error, float(min(p[k], 1.0)), of_position_mn)
        about = np.arange(max(k - BACKGROUND // 2, 1), min(k + BACKGROUND // 2, len(frequency)))
        band = None if line.name else sways(powers, local, int(k), about, rate)
        if band is not None:
            bands.append(band)
        elif centre >= LOWEST_HZ:
            found.append(line)
    return Tones(tuple(found), tuple(bands))


def beside_tones(fit: StudyFit, *, ideal_step: bool = False) -> tuple[StudyFit, tuple[Line, ...]]:
    """Return the baseline beside the tones that its trials have, and the lines among them, which were taken out.

    Skin trembles, an instrument sways whether it touches or not: what cells are short enough for is an effect's, unless
    it is heard out of contact.
    """
    tones = find_tones(fit)
    if not tones.lines and not tones.bands:
        return fit, ()
    trials = without_lines(fit, tones.lines)
    beside = fit_baseline(trials, ideal_step=ideal_step, bands=tones.bands)
    if tones.bands:
        # their skirts passed for background until what else there is was known
        beside = fit_baseline(trials, ideal_step=ideal_step, bands=_with_skirts(beside))
    quick = tuple(band for band in beside.noise.bands if band.frequency_hz >= LOWEST_HZ)
    without = replace(beside.noise, bands=quick)
    if without != beside.noise and heard_out_of_contact(beside, without) < ENOUGH_ONCE:
        beside = fit_baseline(trials, ideal_step=ideal_step, bands=quick)
    return beside, tones.lines


def _with_skirts(fit: StudyFit) -> tuple[Band, ...]:
    """Return the bands of a fit's noise anew, by up to an octave to either side and what else its noise is."""
    at_rest, n = _at_rest_together(fit)
    rate, noise = fit.trials[0].sample_rate_hz, fit.noise
    powers = _powers(fit, at_rest, n)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
    found = []
    for band in noise.bands:
        others = replace(noise, bands=tuple(other for other in noise.bands if other != band))
        background = np.tile(0.5 * rate * others.power(frequency, rate), (len(powers), 1))
        at = int(np.abs(frequency - band.frequency_hz).argmin())
        about = np.arange(max(at - FAR_BINS, at // 2), min(at + FAR_BINS, 2 * at, len(frequency)))
        found.append(sways(powers, background, at, about, rate) or band)
    return tuple(found)


def _at_rest_together(fit: StudyFit) -> tuple[dict[int, slice], int]:
    """Return where trials rest, by number, and samples that all of them do; none where no spectrum would say much."""
    at_rest = {j: s for j, trial in enumerate(fit.trials) if (s := _at_rest(trial, len(fit.trials)))}
    rate, n = fit.trials[0].sample_rate_hz, min((s.stop - s.start for s in at_rest.values()), default=0)
    if not sampled_alike(fit.trials) or n < SHORTEST_S * rate or rate < 4.0 * LOWEST_HZ:
        return {}, 0
    return at_rest, n


def _powers(fit: StudyFit, at_rest: Mapping[int, slice], n: int) -> FloatArray:
    """Return the periodograms (S, F) of what is left of trials at rest, n samples of each."""
    return spectra([fit.full_residual_mn(j)[s][:n] for j, s in at_rest.items()])


def spectra(stretches: Sequence[FloatArray]) -> FloatArray:
    """Return the periodograms (S, F) of stretches of one length, through a Hann window."""
    signals = np.array(stretches)
    n = signals.shape[1]
    window = np.hanning(n)
    window *= np.sqrt(n / float(window @ window))
    centred = signals - signals.mean(axis=1, keepdims=True)
    return np.asarray(np.abs(np.fft.rfft(centred * window)) ** 2 / n)


def _at_rest(trial: CellTrial, n_trials: int) -> slice | None:
    """Return where a trial rests; in the air moves too, if there are more: one may have lines of its own."""
    for name in ("hold", "sweep", "dwell") if n_trials >= FEWEST_HELD_OUT else ("hold", "dwell"):
        cells = np.flatnonzero(trial.in_phase(name))
        if len(cells) > 4:
            a, b = int(trial.starts[cells[0]]), int(trial.starts[cells[-1]])
            a += round(0.1 * trial.sample_rate_hz)
            if b - a >= SHORTEST_S * trial.sample_rate_hz:
                return slice(a, b)
    return None


def without_lines(fit: StudyFit, lines: Sequence[Line]) -> tuple[CellTrial, ...]:
    """Return the trials with every line taken out of their force, its amplitude free to wander over a second."""
    trials = []
    for j, trial in enumerate(fit.trials):
        residual = fit.full_residual_mn(j)
        time_s = np.arange(len(residual)) / trial.sample_rate_hz
        count = max(1, round(time_s[-1] / KNOT_S))
        at = np.linspace(0.0, time_s[-1], count + 1)
        taken = np.zeros(len(residual))
        for line in lines:
            turn = np.exp(2j * np.pi * line.frequency_hz * time_s)
            hats = [np.maximum(0.0, 1.0 - np.abs(time_s - a) * count / time_s[-1]) for a in at]
            # hats overlap little: each knot's amplitude is the mean about it
            size = [2.0 * complex((h * residual) @ turn.conj()) / float(h.sum()) for h in hats]
            smooth = np.interp(time_s, at, np.real(size)) + 1j * np.interp(time_s, at, np.imag(size))
            taken += np.real(smooth * turn)
        force = trial.full_force_mn - taken
        # a force with a line in it went over the levels of a converter
        bare = replace(trial, levels=None, full_force_mn=force.astype(np.float32))
        trials.append(replace(bare, force_mn=bare.cell_means(force.astype(np.float64))))
    return tuple(trials)
