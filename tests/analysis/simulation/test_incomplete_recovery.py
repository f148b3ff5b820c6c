"""Skin that has not recovered lies lower, and nothing presses it there."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.study.intake import take_in_memory
from analysis.simulation.mechanism import Tissue
from analysis.simulation.mechanisms.incomplete_recovery import sinking

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans


@given(
    k0=st.floats(10.0, 1e3),
    k1=st.floats(1.0, 1e3),
    k2=st.floats(1.0, 1e3),
    tau1=st.floats(0.5, 10.0),
    tau2=st.floats(0.02, 0.4),
    T=st.floats(0.7, 500.0),
)
@settings(max_examples=50, deadline=None)
def test_spring_and_quick_arms_bear_the_load_of_the_slow_one(
    k0: float, k1: float, k2: float, tau1: float, tau2: float, T: float
) -> None:
    tissue = Tissue(k0, k1, tau1, k2, tau2)
    time_s = np.linspace(0.0, 3.0, 6001)
    d = sinking(tissue, time_s, T)
    force = k0 * d
    for k, tau in ((k1, tau1), (k2, tau2)):
        # a Maxwell arm that begins unloaded: exact for a depth that is straight within each step
        keep, load = np.exp(-(time_s[1] - time_s[0]) / tau), k * d[0]
        loads = [load]
        for move in np.diff(d):
            load = keep * load + k * tau / (time_s[1] - time_s[0]) * (1.0 - keep) * move
            loads.append(load)
        force += np.array(loads)
    np.testing.assert_allclose(force, np.exp(-time_s / T), rtol=2e-4)


def test_what_was_pressed_before_adds_up_over_the_rests_between() -> None:
    plans = study_plans(depths_mm=(0.3, 0.5), repeats=2)
    recorded = bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)
    trials = take_in_memory(recorded).trials
    assert trials[0].pressed_before == ()
    for n, (trial, head) in enumerate(zip(trials[1:], recorded[1:], strict=True), start=1):
        depths = [d for d, _ in trial.pressed_before]
        assert depths == pytest.approx([t.depth_mm for t in reversed(trials[:n])])
        ago_s = [ago for _, ago in trial.pressed_before]
        rest_s = head.specimen.rest_s
        assert rest_s is not None and ago_s[0] == pytest.approx(rest_s)
        before = trials[n - 1]
        # the others ended a rest and a trial earlier than they had for the trial before
        earlier = [ago + float(before.time_s[-1]) + rest_s for _, ago in before.pressed_before]
        assert ago_s[1:] == pytest.approx(earlier)
