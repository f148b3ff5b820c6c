"""Noises of the bench: as large as said, and of the kind that is said."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import welch
from scipy.stats import kurtosis

from sim_hardware.settings import BenchSettings, NoiseSettings
from sim_hardware.world import World
from sim_hardware.world.noise import SensorNoise

RATE_HZ = 8000.0


def test_heavy_tails_have_the_variance_that_is_said() -> None:
    """Student's t of 5: kurtosis 6 in the long run; of a Gaussian 0, known to 0.01 from 400,000 samples."""
    noise = SensorNoise(NoiseSettings(force_mn_rms=0.2, tail_degrees_of_freedom=5.0), seed=2).force_mn(
        400_000
    )
    assert np.std(noise) == pytest.approx(0.2, rel=0.02)
    assert kurtosis(noise) > 2.0
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.01


def test_one_over_f_falls_as_its_name_says() -> None:
    settings = NoiseSettings(force_mn_rms=0.0, one_over_f_mn_rms=0.25)
    noise = SensorNoise(settings, seed=2).force_mn(4_000_000)
    frequency, power = welch(noise, RATE_HZ, nperseg=2**18)
    band = (frequency > 0.3) & (frequency < 100)
    edges = np.geomspace(0.3, 100, 12)
    means = [np.mean(power[band & (frequency >= low) & (frequency < high)]) for low, high in pairwise(edges)]
    slope = np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), np.log(means), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.15)
    assert np.std(noise) == pytest.approx(0.25, rel=0.25)  # its slowest parts are hardly averaged


def test_one_over_f_goes_on_through_blocks_and_rests() -> None:
    settings = NoiseSettings(force_mn_rms=0.0, one_over_f_mn_rms=0.25)
    whole, pieces = SensorNoise(settings, seed=4), SensorNoise(settings, seed=4)
    parts = np.concatenate([pieces.force_mn(n) for n in (1, 700, 299)])
    assert np.array_equal(whole.force_mn(1000), parts)
    whole.rest(1e4)
    assert abs(whole.force_mn(1)[0] - parts[-1]) > 1e-3


def test_tails_without_a_variance_are_refused() -> None:
    with pytest.raises(ValueError, match="above 2"):
        BenchSettings.from_toml("[noise]\ntail_degrees_of_freedom = 1.5")


def test_a_stepwise_output_comes_half_a_sample_later(bench, quiet) -> None:  # type: ignore[no-untyped-def]
    """Held until the next sample, a ramp of 5 mm/s is on the mean half a sample behind the line."""
    behind = []
    for more in ("", "stepwise_output = true"):
        text = f"[noise]\nforce_mn_rms = 0.0\nposition_um_rms = 0.0\n[converters]\nbits = 0\n{more}"
        world = World(BenchSettings.from_toml(text))
        start = world.arm().position_mm
        ramp = bench.line(start, start + 1.0, 5.0)
        played = bench.play(world, [("ramp", ramp), ("hold", bench.hold(start + 1.0, 0.1))])
        behind.append(ramp[200:] - played.position("ramp")[200:])
        assert played.position("hold")[-1] == pytest.approx(start + 1.0, abs=1e-9)
    assert np.mean(behind[1] - behind[0]) == pytest.approx(5.0 * 0.5 / RATE_HZ, rel=0.02)
