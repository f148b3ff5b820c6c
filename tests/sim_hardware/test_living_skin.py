"""Living skin: no two sites alike, scattered as published; and gels, where a bench says so."""

from __future__ import annotations

import numpy as np
import pytest

from sim_hardware.settings import BenchSettings
from sim_hardware.world.specimens import FINGERS, tissue

PUBLISHED = {"A1/A0": (0.371, 0.082), "A2/A0": (0.294, 0.059), "t1": (2.279, 0.233), "t2": (0.149, 0.022)}
"""Mean and standard deviation over 86 curves, Kumar et al. 2015."""


def drawn(more: str, fingers: tuple[str, ...], benches: int, sites: int) -> np.ndarray:
    """Return k0, both ratios, both times, (benches, fingers, sites, 5)."""
    found = []
    for seed in range(benches):
        bench = BenchSettings.from_toml(f"seed = {seed}\n{more}")
        for finger in fingers:
            for site in range(sites):
                solid = tissue(bench, finger, str(site))
                k0, (slow, fast) = solid["k0_mn_per_mm"], solid["arms"]
                ratios = slow.stiffness_mn_per_mm / k0, fast.stiffness_mn_per_mm / k0
                found.append([k0, *ratios, slow.time_s, fast.time_s])
    return np.array(found).reshape(benches, len(fingers), sites, 5)


def test_a_bench_scatters_as_the_published_curves_do() -> None:
    """8000 sites of 400 fingers: the mean of each is known to 1 %, the deviation to 4 %; five of those are allowed."""
    all_of_them = drawn("", FINGERS, 80, 20).reshape(-1, 5)
    for i, (mean, deviation) in enumerate(PUBLISHED.values(), start=1):
        assert np.mean(all_of_them[:, i]) == pytest.approx(mean, rel=0.03)
        assert np.std(all_of_them[:, i]) == pytest.approx(deviation, rel=0.15)


def test_fingers_differ_and_so_do_the_sites_of_one() -> None:
    of_sites = drawn("", FINGERS, 40, 20)
    k0 = np.log(of_sites[..., 0])
    assert np.std(k0.mean(axis=2)) == pytest.approx(np.hypot(0.10, 0.10 / np.sqrt(20)), rel=0.25)
    assert np.std(k0 - k0.mean(axis=2, keepdims=True)) == pytest.approx(0.10, rel=0.1)


def test_one_number_scatters_everything_alike() -> None:
    found = drawn("[specimens]\nfinger_variation = 0.0\nsite_variation = 0.08", ("index",), 1, 3000)
    relative = np.std(found, axis=(0, 1, 2)) / np.mean(found, axis=(0, 1, 2))
    assert relative == pytest.approx(np.full(5, 0.08), rel=0.08)


@pytest.mark.parametrize(
    "more", ["published_tissue = true", "finger_variation = 0.0\nsite_variation = 0.0"], ids=["gel", "none"]
)
def test_a_gel_is_the_same_everywhere(more: str) -> None:
    found = drawn(f"[specimens]\n{more}", FINGERS, 2, 4)
    assert np.allclose(found, [120.0, 0.371, 0.294, 2.279, 0.149])


def test_the_same_site_is_found_again() -> None:
    assert np.array_equal(drawn("", ("ring",), 2, 3), drawn("", ("ring",), 2, 3))


@pytest.mark.parametrize("wrong", ['"wild"', "0.9", "-0.1", "true"])
def test_a_scatter_that_is_none_is_one_line(wrong: str) -> None:
    with pytest.raises(ValueError, match="site_variation") as caught:
        BenchSettings.from_toml(f"[specimens]\nsite_variation = {wrong}")
    assert "\n" not in str(caught.value)
    print(caught.value)
