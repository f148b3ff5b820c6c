"""The constants in three languages, and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.relaxation.constants import Solid, StepAnswer, ramp_bias

POSITIVE = st.floats(1e-3, 1e3)
ARMS = st.lists(st.tuples(POSITIVE, POSITIVE), min_size=0, max_size=4).map(
    lambda arms: tuple(sorted(arms, key=lambda arm: -arm[1]))
)


@given(POSITIVE, ARMS, st.floats(0.01, 2.0))
def test_every_way_leads_back(k0: float, arms: tuple[tuple[float, float], ...], depth_mm: float):
    solid = Solid(k0, arms)
    answer = solid.step_answer(depth_mm)
    flat = np.ravel
    np.testing.assert_allclose(flat(answer.solid(depth_mm).arms), flat(arms), rtol=1e-12)
    instantaneous = answer.a0_mn + sum(a for a, _ in answer.terms)
    back = StepAnswer.from_prony(instantaneous, answer.prony)
    np.testing.assert_allclose(flat(back.terms), flat(answer.terms), rtol=1e-9)
    assert back.a0_mn == pytest.approx(answer.a0_mn, rel=1e-6, abs=1e-9 * instantaneous)
    springs = tuple(stiffness for stiffness, _ in arms)
    again = Solid.from_dashpots(k0, springs, solid.dashpots_mn_s_per_mm)
    np.testing.assert_allclose(sorted(flat(again.arms)), sorted(flat(arms)), rtol=1e-12)


def test_published_equations():
    answer = Solid(120.0, ((44.52, 2.279), (35.28, 0.149))).step_answer(0.4)
    assert answer.force_mn(np.array([0.0]))[0] == pytest.approx(0.4 * (120 + 44.52 + 35.28))
    t = np.array([0.1, 1.0, 5.0])
    want = 48 + 17.808 * np.exp(-t / 2.279) + 14.112 * np.exp(-t / 0.149)
    np.testing.assert_allclose(answer.force_mn(t), want)
    g = dict(zip((2.279, 0.149), (share for share, _ in answer.prony), strict=True))
    relaxed = 79.92 * (1 - sum(share * (1 - np.exp(-t / tau)) for tau, share in g.items()))
    np.testing.assert_allclose(relaxed, want)


@pytest.mark.parametrize(("depth_mm", "kept"), [(0.2, 0.877), (0.4, 0.774), (0.6, 0.687), (0.8, 0.613)])
def test_ramp_bias_is_the_published_one(depth_mm: float, kept: float):
    assert ramp_bias(depth_mm / 5.0, 0.149) == pytest.approx(kept, abs=6e-4)


def test_no_ramp_no_bias_and_no_depth_no_solid():
    assert ramp_bias(0.0, 0.149) == 1.0
    with pytest.raises(ValueError, match="depth"):
        StepAnswer(1.0).solid(0.0)
