"""Whitening against a dense Cholesky factor, and the noise found back from its own spectrum."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter, welch

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import beside_quick_noise, in_smooth_noise
from analysis.mismatch.fit import baseline
from analysis.mismatch.fit.baseline import fit_baseline, noise_left
from analysis.mismatch.fit.noise import FASTEST_SLOW_S, Band, NoiseModel, measure_noise
from analysis.mismatch.fit.slow_noise import (
    EXPONENTS,
    change_in_a_second,
    power_law,
    restricted_deviance,
    with_slow_noise,
)
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.levels import ENOUGH_OWN
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.response import Steps


def _cells(n: int = 300) -> SimpleNamespace:
    rng = np.random.default_rng(2)
    counts = rng.choice([1.0, 8.0, 64.0], n)
    time_s = (np.cumsum(counts) - counts / 2) / 8000.0
    return SimpleNamespace(
        fitted=np.ones(n, dtype=bool),
        time_s=time_s,
        counts=counts,
        widths_s=counts / 8000.0,
        fitted_widths_s=np.unique(counts / 8000.0, return_inverse=True),
        steps=Steps.between(time_s),
        by_position=(),
        louder=None,
    )


def _covariance(cells: SimpleNamespace, noise: NoiseModel) -> np.ndarray:
    """Covariance of cells' means, added up over 32 equal parts of every cell."""
    within = (np.arange(32) + 0.5) / 32 - 0.5
    width_s = cells.widths_s
    t = (cells.time_s[:, None] + within * width_s[:, None]).ravel()
    lag = np.abs(t[:, None] - t)
    every = sum(v * np.exp(-lag / tau) for v, tau in noise.exponentials)
    every += sum(v * np.exp(-lag / tau) * np.cos(2.0 * np.pi * f * lag) for v, f, tau in noise.bands)
    n = len(cells.time_s)
    return every.reshape(n, 32, n, 32).mean(axis=(1, 3)) + np.diag(noise.white_mn**2 / cells.counts)


@pytest.mark.parametrize(
    ("smoother", "bands"),
    [(0.0, ()), (0.04, ()), (0.0, (Band(0.05, 18.0, 0.3), Band(0.02, 150.0, 0.02)))],
    ids=["through one filter", "through two", "beside bands"],
)
def test_whitening_is_the_inverse_cholesky_factor(smoother: float, bands: tuple[Band, ...]) -> None:
    cells = _cells(60)
    # quicker than a cell, about as long, and longer
    parts = ((0.05, 0.4), (0.02, 0.1), (0.03, 0.006), (0.04, 0.0016))
    noise = NoiseModel(0.3, parts, ((smoother, 0.02, 0.008),), bands)
    columns = np.random.default_rng(3).normal(size=(len(cells.time_s), 4))
    dense = np.linalg.solve(np.linalg.cholesky(_covariance(cells, noise)), columns)
    whitener = Whitener(cells, noise)
    np.testing.assert_allclose(whitener(columns), dense, rtol=0.01, atol=0.01)
    # what is left of larger numbers is rounded as these are, and processors differ in that
    np.testing.assert_allclose(whitener(columns[:, 1]), whitener(columns)[:, 1], rtol=1e-12, atol=1e-14)


def test_white_noise_is_weighed_by_its_count() -> None:
    cells = _cells()
    y = np.random.default_rng(4).normal(size=len(cells.time_s))
    np.testing.assert_allclose(Whitener(cells, NoiseModel(0.3))(y), y * np.sqrt(cells.counts) / 0.3)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_spectrum_gives_the_noise_back(share: float) -> None:
    rng = np.random.default_rng(7)
    decay = np.exp(-1 / (8000.0 * 0.0256))
    residuals = []
    for _ in range(20):
        white = rng.normal(0, 0.3, 56_000)
        slow = lfilter([np.sqrt(1 - decay**2)], [1, -decay], rng.normal(0, 1, 56_000))
        residuals.append(white + share * 0.3 * slow)
    found = measure_noise(residuals, 8000.0)
    # a quick part is as good as white
    quick = sum(v for v, t in found.exponentials if t < 0.005)
    assert np.sqrt(found.white_mn**2 + quick) == pytest.approx(0.3, rel=0.03)
    slow_variance = sum(v for v, t in found.exponentials if t > 0.005)
    assert slow_variance == pytest.approx((share * 0.3) ** 2, rel=0.25, abs=2e-4)


@pytest.mark.parametrize("tau_s", [0.0015, 0.006, 0.012, 0.03])
def test_noise_through_two_filters_is_measured_as_smooth_as_it_is(tau_s: float) -> None:
    """As a sum of parts that fall as f^-2 it was half or twice of what it is, and a pulse explained the rest of it."""
    rng = np.random.default_rng(7)
    rate, white_mn, smooth_mn = 8000.0, 0.12, 0.2
    decay = float(np.exp(-1.0 / (rate * tau_s)))
    residuals = []
    for _ in range(20):
        twice = lfilter([1.0], [1.0, -2.0 * decay, decay**2], rng.normal(size=72_000))[16_000:]
        residuals.append(white_mn * rng.normal(size=56_000) + smooth_mn * twice / np.std(twice))
    found = measure_noise(residuals, rate, may_be_smooth=True)
    edges_hz = np.geomspace(0.9, 900.0, 16)
    frequency_hz, measured = welch(np.array(residuals), rate, nperseg=25_600, detrend="linear")
    for low, high in pairwise(edges_hz):
        band = (frequency_hz >= low) & (frequency_hz < high)
        of_noise = float(found.power(frequency_hz[band], rate).mean())
        assert of_noise == pytest.approx(float(measured[:, band].mean()), rel=0.35), low


def test_a_line_is_not_taken_for_noise() -> None:
    rng = np.random.default_rng(8)
    t = np.arange(56_000) / 8000.0
    residuals = [rng.normal(0, 0.3, len(t)) + 0.5 * np.sin(2 * np.pi * 9.0 * t + k) for k in range(10)]
    assert measure_noise(residuals, 8000.0).white_mn == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("share", [0.1, 0.2, 0.4, 0.8])
def test_noise_is_no_less_correlated_for_being_weakly_so(share: float) -> None:
    """A part that is there in one account and not in the next passes for evidence: 290 nats where this was measured.

    Its power below its corner is a share of that of the white noise.
    """
    rng = np.random.default_rng(8)
    rate, white_mn, tau_s = 8000.0, 0.1, 0.0064
    variance = share * white_mn**2 / (2.0 * rate * tau_s)
    decay = np.exp(-1.0 / (rate * tau_s))
    residuals = []
    for _ in range(12):
        innovations = rng.normal(scale=np.sqrt(variance * (1.0 - decay**2)), size=40000)
        residuals.append(rng.normal(scale=white_mn, size=40000) + lfilter([1.0], [1.0, -decay], innovations))
    noise = measure_noise(residuals, rate)
    at_hz = np.array([6.0, 12.0, 25.0])
    true = NoiseModel(white_mn, ((variance, tau_s),)).power(at_hz, rate)
    np.testing.assert_allclose(noise.power(at_hz, rate), true, rtol=0.08)


def test_noise_is_no_less_for_what_a_tissue_has_taken_out_of_it() -> None:
    """A band that is left with a hundredth of its power had drawn the white noise down to a thirtieth.

    Of 13 waves in 12 stretches of three seconds; the level has a standard error of 0.2 %.
    """
    rng = np.random.default_rng(11)
    slow = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, 24000), 12))[0]
    residuals = []
    for _ in range(12):
        noise = rng.normal(0.0, 0.25, 24000)
        residuals.append(noise - slow @ (slow.T @ noise))
    assert measure_noise(residuals, 8000.0).rms_mn == pytest.approx(0.25, rel=0.04)


@pytest.mark.parametrize("times", [0.7, 1.0, 1.4])
def test_of_noise_measured_anew_and_before_the_likelier_at_rest_stands(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch, times: float
) -> None:
    """Two sums of filtered parts that are as near to a spectrum were hundreds of nats apart."""
    fit = fit_baseline(take_in_memory(record(58)).trials)
    right = fit.noise.quicker_than(FASTEST_SLOW_S)
    other = NoiseModel(times * right.white_mn, (((0.1 * right.white_mn) ** 2, 0.0064),))
    other_stood = noise_left(fit.weighed_by(other)).quicker_than(FASTEST_SLOW_S)
    monkeypatch.setattr(baseline, "noise_of", lambda *_, **__: other)
    other_measured = noise_left(fit).quicker_than(FASTEST_SLOW_S)
    for found in (other_stood, other_measured):
        assert found.rms_mn == pytest.approx(right.rms_mn, rel=1e-3)
        assert [t_s for _, t_s in found.parts] == [t_s for _, t_s in right.parts]


def test_slow_noise_is_found_from_wherever_it_was_before(record: Callable[..., list[Trial]]) -> None:
    fit = fit_baseline(take_in_memory(record(58)).trials)
    fit = fit.weighed_by(fit.noise.quicker_than(FASTEST_SLOW_S))
    far = NoiseModel(fit.noise.white_mn, (((1e4 * fit.noise.white_mn) ** 2, 1.64),))
    found, from_nothing = (with_slow_noise(fit, near).noise for near in (far, fit.noise))
    wander_mn = [change_in_a_second(noise) for noise in (found, from_nothing)]
    assert wander_mn == pytest.approx([0.0, 0.0], abs=0.2 * fit.noise.white_mn)


@pytest.mark.parametrize("smooth", [False, True], ids=["through one filter", "through two"])
@pytest.mark.parametrize("exponent", [None, *EXPONENTS])
def test_slow_noise_is_the_likeliest_wherever_it_is_looked_for(
    record: Callable[..., list[Trial]], exponent: float | None, *, smooth: bool
) -> None:
    fit = _in_slow_noise(record, exponent, smooth=smooth)
    fit = fit.weighed_by(fast := fit.noise.quicker_than(FASTEST_SLOW_S))
    longest_s = max(float(t.time_s[-1]) for t in fit.trials)
    sizes_mn = np.geomspace(0.01, 1.0, 20)
    grid = [power_law(fast, size, e, longest_s, smooth=smooth) for size in sizes_mn for e in EXPONENTS]
    least = min(restricted_deviance(fit, noise) for noise in (fast, *grid))
    starts = [
        power_law(fast, size, e, longest_s, smooth=smooth) for size in (0.01, 0.2, 2.0) for e in EXPONENTS
    ]
    for near in (fast, *starts):
        found = with_slow_noise(fit, near, smooth=smooth).noise
        assert restricted_deviance(fit, found) < least + 2.0
        if exponent is None:
            assert found == fast
        else:
            changes_mn = change_in_a_second(found.slower_from(FASTEST_SLOW_S))
            assert changes_mn == pytest.approx(0.25, rel=0.25)


@pytest.mark.parametrize("smooth", [False, True], ids=["through one filter", "through two"])
def test_slow_noise_is_cut_off_where_it_is_likelier_so(
    record: Callable[..., list[Trial]], *, smooth: bool
) -> None:
    account = Account(_in_slow_noise(record, 0.5, smooth=smooth))
    assert change_in_a_second(account.fit.noise) > 0.1
    found = in_smooth_noise(account)
    assert bool(found.fit.noise.slower_from(FASTEST_SLOW_S).smooth) is smooth
    assert found.nats > account.nats + ENOUGH_OWN if smooth else found is account
    # an effect is weighed beside the quick part of it: the slow part may be the effect
    beside = beside_quick_noise(account, found).fit.noise
    assert beside.slower_from(FASTEST_SLOW_S) == account.fit.noise.slower_from(FASTEST_SLOW_S)


def _in_slow_noise(record: Callable[..., list[Trial]], exponent: float | None, *, smooth: bool) -> StudyFit:
    """Return the baseline of trials in which noise changes by 0.25 mN in a second, if at all."""
    quiet = take_in_memory(record(61)).trials
    slow = NoiseModel(1e-3)
    if exponent is not None:
        longest_s = max(float(t.time_s[-1]) for t in quiet)
        slow = power_law(slow, 0.25, exponent, longest_s, smooth=smooth)
    rng = np.random.default_rng(61)
    drawn = [Whitener(t, slow).drawn(rng) for t in quiet]
    return fit_baseline([replace(t, force_mn=t.force_mn + y) for t, y in zip(quiet, drawn, strict=True)])
