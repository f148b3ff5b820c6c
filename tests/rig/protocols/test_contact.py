"""Contact begins at N of M samples, is located below a sample's noise, is lost with force and distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.protocols.contact import ContactDetector, ReleaseDetector, locate_crossing


def n_of_m(force: np.ndarray, threshold: float, needed: int, watched: int) -> int | None:
    """The definition, sample by sample."""
    above = force > threshold
    for i in range(len(force)):
        if above[max(0, i - watched + 1) : i + 1].sum() >= needed:
            return i
    return None


@given(
    force=st.lists(st.sampled_from([0.0, 20.0]), max_size=60),
    needed=st.integers(1, 5),
    more=st.integers(0, 5),
    cut=st.integers(1, 17),
)
def test_detector_decides_as_defined_whatever_the_reads(
    force: list[float], needed: int, more: int, cut: int
) -> None:
    values = np.array(force)
    detector = ContactDetector(10.0, needed, needed + more)
    decided = None
    for start in range(0, len(values), cut):
        decided = detector.feed(values[start : start + cut])
        if decided is not None:
            break
    assert decided == n_of_m(values, 10.0, needed, needed + more)


def test_a_single_spike_is_no_contact() -> None:
    force = np.zeros(100)
    force[50] = 400.0
    assert ContactDetector(10.0, 8, 10).feed(force) is None


@pytest.mark.parametrize("stiffness_mn_per_mm", [120.0, 2e4])
def test_crossing_is_found_below_the_noise_of_a_sample(stiffness_mn_per_mm: float) -> None:
    random = np.random.default_rng(1)
    rate, speed, threshold = 8000.0, 0.2, 20.0
    errors_um = []
    for _ in range(50):
        contact_mm = 4.0 + random.uniform(0, 0.1)
        position = contact_mm - 0.2 + speed * np.arange(16000) / rate
        force = stiffness_mn_per_mm * np.clip(position - contact_mm, 0, None)
        position_read = position + random.normal(0, 2.5e-4, len(position))
        force_read = force + random.normal(0, 0.3, len(force))
        decided = n_of_m(force_read, threshold, 8, 10)
        assert decided is not None
        found = locate_crossing(position_read[: decided + 1], force_read[: decided + 1], threshold)
        errors_um.append(1e3 * (found.position - contact_mm - threshold / stiffness_mn_per_mm))
    # 0.25 um of position noise a sample, 0.3 mN of force noise: the mean of many samples is well below both
    assert np.sqrt(np.mean(np.square(errors_um))) < (0.15 if stiffness_mn_per_mm > 1e3 else 0.6)


def test_crossing_of_a_jump_is_the_last_sample() -> None:
    force = np.concatenate([np.zeros(100), [500.0, 500.0]])
    position = np.arange(102.0)
    assert locate_crossing(position, force, 10.0).position == pytest.approx(101.0)


def retract(release: ReleaseDetector, position_mm: np.ndarray, force_mn: np.ndarray) -> int | None:
    for start in range(0, len(position_mm), 80):
        if release.feed(position_mm[start : start + 80], force_mn[start : start + 80]):
            return start + 80
    return None


def test_release_waits_while_the_skin_clings_below_zero_force() -> None:
    position = np.linspace(5.4, 3.0, 4000)
    clings = position > 4.3
    force = np.where(clings, 60.0 * (position - 4.9), 0.0)
    lost = retract(ReleaseDetector(0.0, 5.0, 5.0), position, force)
    assert lost is not None
    assert position[lost - 81] < 4.3


def test_a_force_that_passes_zero_on_the_way_is_no_release() -> None:
    position = np.linspace(5.4, 4.0, 4000)
    force = 100.0 * (position - 4.6)
    assert retract(ReleaseDetector(0.0, 5.0, 5.0), position, force) is None


def test_release_is_judged_from_the_force_of_the_free_arm() -> None:
    position = np.linspace(5.4, 3.0, 4000)
    force = np.where(position > 5.0, 100.0 * (position - 5.0), 0.0) + 30.0
    assert retract(ReleaseDetector(30.0, 5.0, 5.0), position, force) is not None
    assert retract(ReleaseDetector(0.0, 5.0, 5.0), position, force) is None
