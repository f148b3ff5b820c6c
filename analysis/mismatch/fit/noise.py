"""The noise of a force channel, from stretches of residual at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len
from scipy.optimize import nnls
from scipy.signal import welch

from analysis.mismatch.levels import INEXACT

FloatArray = NDArray[np.float64]

CORRELATION_TIMES_S = (4e-4, 1.6e-3, 6.4e-3, 0.0256, 0.1024, 0.41)
SMOOTH_TIMES_S = tuple(4e-4 * 2.0**k for k in range(8))
"""Noise through two filters falls so steeply that its corner has to be met; the other's time is half as long."""
TIMES_A_SEGMENT = 2.0
FASTEST_SLOW_S = CORRELATION_TIMES_S[-1]
"""Parts from here on are no matter of a spectrum: a hold is too short for them, and a tissue takes them up."""
SLOW_S = 0.06
"""Parts from here on outlast what comes and goes in a ramp or a release."""
SEGMENT_S = 3.2
OF_BANDS = 0.2
"""Share of a spectrum above which what a window leaks of known bands would pass for another part."""


class Band(NamedTuple):
    """A tone that loses its phase, as of a building that sways: v exp(-|lag| / t) cos(2 pi f lag)."""

    variance: float
    frequency_hz: float
    lasts_s: float


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """White noise of ``white_mn`` rms a sample, plus parts that went through filters (variance mN^2, time s).

    ``parts`` went through one, as Ornstein-Uhlenbeck processes; ``smooth`` ones through two (variance, time, the time
    of the other, which is shorter), so that their spectrum falls as f^-4. ``bands`` are tones that lose their phase.
    """

    white_mn: float
    parts: tuple[tuple[float, float], ...] = ()
    smooth: tuple[tuple[float, float, float], ...] = ()
    bands: tuple[Band, ...] = ()

    def __add__(self, other: NoiseModel) -> NoiseModel:
        """Return the noise of both at once."""
        white_mn = float(np.hypot(self.white_mn, other.white_mn))
        others = (self.parts + other.parts, self.smooth + other.smooth, self.bands + other.bands)
        return NoiseModel(white_mn, *others)

    @property
    def exponentials(self) -> tuple[tuple[float, float], ...]:
        """What its covariance is a sum of beside the white noise: variances (mN^2) and times (s).

        Two filters of times t and u leave (t exp(-|lag| / t) - u exp(-|lag| / u)) / (t - u).
        """
        found: dict[float, float] = {}
        both = ((v / (t - u), t, u) for v, t, u in self.smooth)
        of_both = (x for v, t, u in both for x in ((v * t, t), (-v * u, u)))
        for v, t in (*self.parts, *of_both):
            found[t] = found.get(t, 0.0) + v
        return tuple((v, t) for t, v in found.items() if v)

    @property
    def rms_mn(self) -> float:
        """Rms of a single sample, mN."""
        correlated = sum(v for v, _ in self.exponentials) + sum(band.variance for band in self.bands)
        return float(np.sqrt(self.white_mn**2 + correlated))

    def quicker_than(self, time_s: float) -> NoiseModel:
        """Return the noise without its parts of such a time and slower ones."""
        parts, smooth = (p for p in self.parts if p[1] < time_s), (p for p in self.smooth if p[1] < time_s)
        return NoiseModel(self.white_mn, tuple(parts), tuple(smooth), self.bands)

    def slower_from(self, time_s: float) -> NoiseModel:
        """Return its parts of such a time and slower ones."""
        parts, smooth = (p for p in self.parts if p[1] >= time_s), (p for p in self.smooth if p[1] >= time_s)
        return NoiseModel(0.0, tuple(parts), tuple(smooth))

    def times(self, factor: float) -> NoiseModel:
        """Return noise of the same spectrum that is so much larger."""
        parts = tuple((factor**2 * v, t) for v, t in self.parts)
        smooth = tuple((factor**2 * v, t, u) for v, t, u in self.smooth)
        bands = tuple(band._replace(variance=factor**2 * band.variance) for band in self.bands)
        return NoiseModel(factor * self.white_mn, parts, smooth, bands)

    def power(self, frequency_hz: FloatArray, sample_rate_hz: float) -> FloatArray:
        """Return the one-sided power spectrum (F,) in mN^2/Hz."""
        white = np.full_like(frequency_hz, 2.0 * self.white_mn**2 / sample_rate_hz)
        swept = [(v, 0.0, t) for v, t in self.exponentials] + list(self.bands)
        return white + sum(
            2.0 * v * t / (1.0 + (2 * np.pi * (frequency_hz + side) * t) ** 2)
            for v, f, t in swept
            for side in (f, -f)
        )


def measure_noise(
    residuals: Sequence[FloatArray],
    sample_rate_hz: float,
    segment_s: float = SEGMENT_S,
    *,
    may_be_smooth: bool = False,
    bands: tuple[Band, ...] = (),
) -> NoiseModel:
    """Return the noise model that fits the power spectrum of quiet stretches of residual (each (n_i,), mN).

    The spectrum's median over logarithmic bands is fitted, so that single lines (hum, pulse) do not count as noise,
    and each stretch's median over segments, so that one step in it does not. Slow parts are fitted beside the others
    and left out: `slow_noise` finds them. Those through two filters are among them only if noise ``may_be_smooth``.
    ``bands`` are known, and taken off; where they are more than `OF_BANDS` of the spectrum nothing else is read.
    """
    shortest = max(16, min(len(r) for r in residuals))
    length = prev_fast_len(min(round(segment_s * sample_rate_hz), shortest), real=True)
    spectra = [
        # the stubs know the kind of detrending as "literal"
        welch(r, sample_rate_hz, nperseg=length, detrend="linear", average="median")[1]  # type: ignore[call-overload]
        for r in residuals
        if len(r) >= length
    ]
    frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / sample_rate_hz), dtype=np.float64)
    power = np.mean(spectra, axis=0)
    edges = np.unique(np.round(np.geomspace(1.0, len(frequency) - 1, 48)).astype(int))
    known = NoiseModel(0.0, bands=bands).power(frequency, sample_rate_hz)
    shows, power = known <= OF_BANDS * power, power - known
    within = [np.arange(a, b)[shows[a:b]] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    within = [at for at in within if len(at)]
    p = np.array([np.median(power[at]) for at in within])
    f = np.array([np.mean(frequency[at]) for at in within])
    p = np.maximum(p, 1e-12 * p.max())
    least_s, most_s = 2.0 / sample_rate_hz, segment_s / TIMES_A_SEGMENT
    shapes = [NoiseModel(0.0, ((1.0, t),)) for t in CORRELATION_TIMES_S if least_s < t <= most_s]
    smooth_s = [t for t in SMOOTH_TIMES_S if may_be_smooth and least_s < t <= most_s]
    shapes += [NoiseModel(0.0, (), ((1.0, t, 0.5 * t),)) for t in smooth_s]
    basis = np.column_stack([m.power(f, sample_rate_hz) for m in (NoiseModel(1.0), *shapes)])
    # a band is known by as many values as it holds, and no noise is exactly such a sum
    counts = np.array([len(at) for at in within]) * len(spectra)
    sure = 1.0 / np.sqrt(1.0 / counts + INEXACT**2)
    # what a tissue has taken out of a band is no sign of how quiet the others are
    weight = sure / np.maximum(p, np.median(p))
    share = np.zeros(basis.shape[1])
    for _ in range(6):
        weighed = basis * weight[:, None]
        # parts of very different size stall the search for their shares
        size = np.linalg.norm(weighed, axis=0)
        share = nnls(weighed / size, p * weight)[0] / size
        weight = sure / np.maximum(basis @ share, 0.7 * p)
    white = max(float(share[0]), 1e-3 * float(np.median(p)) * sample_rate_hz / 2.0)
    found = NoiseModel(float(np.sqrt(white)), bands=bands)
    for of_shape, shape in zip(share[1:], shapes, strict=True):
        if of_shape > 0.0:
            found += shape.times(float(np.sqrt(of_shape)))
    return found.quicker_than(FASTEST_SLOW_S)
