"""Three arms are a set: which of them a law adds to the tissue's two is told by their strength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.arms import weakest_apart
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.start import longest_s
from analysis.mismatch.model.effects import Law, Shared, simulate
from analysis.mismatch.model.population import Population
from analysis.mismatch.name.weighing import considered
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import Tissue, library
from sim_hardware.concealment.offline import study_plans

THIRD = library()["third_relaxation"]
FREE = ("ratio_to_k0", "time_constant_s")
stiffness, time_s = st.floats(1.0, 300.0), st.floats(1e-3, 100.0)


@given(
    st.sampled_from([16.0, 128.0]),
    st.lists(st.tuples(stiffness, time_s), min_size=3, max_size=3),
    st.sampled_from([1, 2]),
)
def test_the_same_solid_whichever_arm_is_the_laws(
    k0: float, arms: list[tuple[float, float]], arm: int
) -> None:
    (k1, tau1), (k2, tau2), (k3, tau3) = arms
    tissue, third = Tissue(k0, k1, tau1, k2, tau2), {"ratio_to_k0": k3 / k0, "time_constant_s": tau3}
    exchanged = THIRD.exchanged(tissue, third, arm)
    assert exchanged is not None
    other, values = exchanged
    assert other.k0 == k0
    assert other.tau1 >= other.tau2
    there = [
        (other.k1, other.tau1),
        (other.k2, other.tau2),
        (values["ratio_to_k0"] * k0, values["time_constant_s"]),
    ]
    # a k0 that is a power of two divides without rounding
    assert sorted(there) == sorted(arms)
    assert (values["time_constant_s"], values["ratio_to_k0"] * k0) == pytest.approx(arms[arm - 1][::-1])


def test_the_weakest_arm_is_the_third_and_explains_as_much(record: Callable[..., list[Trial]]) -> None:
    recorded = record(49, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0))
    fit = fit_baseline(take_in_memory(recorded).trials)
    shared = Shared((Law(THIRD, {"ratio_to_k0": 0.5, "time_constant_s": 0.6}, FREE),))
    weak = Tissue(120.0, 15.0, 2.3, 35.0, 0.05)
    states = tuple(replace(s, log_tissue=weak.logarithms, offset_mn=0.0) for s in fit.states)
    trials = tuple(
        replace(t, force_mn=simulate(t, s, shared)) for t, s in zip(fit.trials, states, strict=True)
    )
    # one piece of skin: of three arms at it any may be the law's
    start = Population.weak(weak.logarithms, longest_s(trials))
    fit = replace(fit, trials=trials, states=states, shared=shared, population=start).with_population()
    exchanged = weakest_apart(fit, shared.laws[0])
    assert exchanged is not None
    law, tissue = exchanged.shared.laws[0], Tissue(*np.exp(exchanged.population.mean))
    assert law.values["ratio_to_k0"] == pytest.approx(15.0 / 120.0, rel=0.01)
    assert law.values["time_constant_s"] == pytest.approx(2.3, rel=0.01)
    assert (tissue.k1, tissue.tau1) == pytest.approx((60.0, 0.6), rel=0.01)
    assert exchanged.left_mn < 1e-3 * np.ptp(trials[0].force_mn)
    # there it stays
    assert weakest_apart(exchanged, law) is None


@pytest.mark.slow
def test_a_third_arm_differs_between_sites_and_leaves_no_breath(record: Callable[..., list[Trial]]) -> None:
    """As the other two do, by a tenth in strength and time; H0: nothing is found beside it."""
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=6, hold_s=6.0, dwell_s=0.4)
    quiet = "[noise]\nforce_mn_rms = 0.08\n"
    fit = fit_baseline(take_in_memory(record(51, quiet, plans)).trials)
    random = np.random.default_rng(51)
    drawn = np.array([0.15, 0.8]) * np.exp(0.1 * random.normal(size=(len(fit.trials), 2)))
    trials = []
    for trial, state, of_site in zip(fit.trials, fit.states, drawn, strict=True):
        arm = Law(THIRD, dict(zip(THIRD.of_site, map(float, of_site), strict=True)), FREE)
        bare = replace(state, offset_mn=0.0)
        added_mn = simulate(trial, bare, Shared((arm,))) - simulate(trial, bare, Shared())
        full_mn = trial.full_force_mn + trial.at_samples(added_mn)
        trials.append(
            replace(trial, force_mn=trial.force_mn + added_mn, full_force_mn=full_mn.astype(np.float32))
        )
    nothing = Account(replace(fit, trials=tuple(trials)).with_population()).reweighed()
    (third, *_) = considered(nothing, nothing, {})
    assert third.name == "third_relaxation"
    account = third.account.settled()
    (law,) = account.fit.shared.laws
    assert law.values == pytest.approx({"ratio_to_k0": 0.15, "time_constant_s": 0.8}, rel=0.15)
    for which, parameter in enumerate(THIRD.of_site):
        found = [s.coefficients[s.shapes.law_values[THIRD.name, parameter]] for s in account.fit.states]
        assert np.corrcoef(found, np.log(drawn)[:, which])[0, 1] > 0.8
        assert 0.03 < np.std(found) < 0.3
    assert not considered(account, nothing, {})
