from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.fingertip.viscoelastic import Prony, Relaxation, relaxation

ARMS = st.lists(st.tuples(st.floats(0.01, 100), st.floats(0.01, 100)), max_size=4).map(tuple)


def _chain() -> np.ndarray:
    """Two springs of unit stiffness in series between the punch and the bone, one a layer."""
    return np.array([[[1.0, -1.0], [-1.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]])


@given(ARMS, st.floats(0.1, 100))
@settings(max_examples=50, deadline=None)
def test_a_pad_of_one_material_relaxes_as_the_material(arms, relaxed):
    material = Prony(relaxed, arms)
    found = relaxation(_chain(), [material, material])
    time_s = np.geomspace(1e-3, 300, 50)
    np.testing.assert_allclose(found.after_step(time_s), material.at(time_s) / 2, rtol=1e-9)


@given(ARMS, ARMS)
@settings(max_examples=50, deadline=None)
def test_springs_in_series_at_once_and_in_the_end(first, second):
    above, below = Prony(3.0, first), Prony(1.0, second)
    found = relaxation(_chain(), [above, below])
    a, b = above.instantaneous_kpa, below.instantaneous_kpa
    assert found.after_step(np.array([0.0]))[0] == pytest.approx(a * b / (a + b), rel=1e-9)
    assert found.relaxed_mn_per_mm == pytest.approx(3 / 4, rel=1e-9)
    assert (found.arms_mn_per_mm >= 0).all()


def test_an_elastic_spring_before_a_maxwell_solid_has_the_textbook_time():
    # spring k in series with (spring e beside an arm a, tau): tau' = tau (k + e) / (k + e + a) is its creep;
    # what relaxes at held length has the time tau (k + e) / (k + e + a) as well
    k, e, a, tau = 2.0, 0.5, 1.5, 3.0
    found = relaxation(_chain(), [Prony(k), Prony(e, ((a, tau),))])
    assert found.times_s == pytest.approx([tau * (k + e + a) / (k + e)])


def test_a_ramp_is_the_sum_of_small_steps():
    solid = Relaxation(1.0, np.array([0.5, 0.3]), np.array([2.0, 0.1]))
    time_s = np.array([0.05, 0.2, 1.0, 5.0])
    steps = (np.arange(4000) + 0.5) / 4000 * 0.2
    summed = [np.mean((t > steps) * solid.after_step(np.maximum(t - steps, 0))) for t in time_s]
    np.testing.assert_allclose(solid.after_ramp(time_s, 0.2), summed, rtol=1e-3)
    fine_s = np.linspace(0, 5, 100_001)
    depth_mm = np.minimum(fine_s / 0.2, 1.0)
    np.testing.assert_allclose(
        solid.force_mn(depth_mm, fine_s[1])[[1000, 4000, 20000, 100_000]],
        solid.after_ramp(time_s, 0.2),
        rtol=1e-9,
    )


def test_the_published_series_of_g():
    material = Prony(60.0, ((25.0, 2.0), (15.0, 0.1)))
    g = 1 - sum(g * (1 - np.exp(-0.3 / tau)) for g, (_, tau) in zip(material.g, material.arms, strict=True))
    assert material.at(np.array([0.3]))[0] == pytest.approx(100 * g)


def test_few_arms_stand_for_many():
    times = np.geomspace(0.1, 3, 30)
    many = Relaxation(1.0, np.full(30, 0.02), times)
    few = many.thinned(1e-4)
    time_s = np.geomspace(1e-3, 30, 200)
    assert len(few.times_s) < 15
    assert np.abs(few.after_step(time_s) - many.after_step(time_s)).max() < 2e-4 * 1.6
