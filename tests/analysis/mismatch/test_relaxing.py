"""Laws by which a tissue relaxes: one besides its two arms, rough in its times, another one at every site."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.law_fit import fit_laws, with_value
from analysis.mismatch.fit.study_fit import StudyFit, with_own_values
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.model.effects import Law, Shared, simulate
from analysis.mismatch.name.law_sizes import law_sizes
from analysis.mismatch.name.profile import AWAY, HeldAt, at_likeliest, likely, spread
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import Mechanism, library
from sim_hardware.concealment.offline import study_plans

RELAXING = {"third_relaxation", "power_law_relaxation", "poroelastic_drainage"}
THIRD = {"ratio_to_k0": 2.0, "time_constant_s": 0.3}
POWER = {"coefficient_mn_per_mm": 20.0, "exponent": 0.3, "begins_s": 1e-4}


@pytest.fixture(scope="module")
def nothing(record: Callable[..., list[Trial]]) -> StudyFit:
    """A study in which nothing is concealed, fitted."""
    return fit_baseline(take_in_memory(record(91)).trials)


def _law(name: str, values: dict[str, float]) -> Law:
    return Law(library()[name], values, tuple(values))


def _with(fit: StudyFit, law: Law) -> StudyFit:
    return replace(fit, shared=replace(fit.shared, laws=(law,)))


def _recorded(fit: StudyFit, force_mn: Callable[[int], np.ndarray]) -> StudyFit:
    """Return the fit to trials whose force has more than the fit simulates, (n,) mN each, and the noise it had."""
    trials = [
        replace(t, force_mn=t.force_mn + force_mn(j) - simulate(t, s, fit.shared))
        for j, (t, s) in enumerate(zip(fit.trials, fit.states, strict=True))
    ]
    return replace(fit, trials=tuple(trials))


@pytest.fixture(scope="module")
def relaxing(nothing: StudyFit) -> Account:
    """The account of a third arm of which a tenth acts at 2.2 times its time."""
    there, later = (
        _with(
            nothing, _law("third_relaxation", {**THIRD, "time_constant_s": times * THIRD["time_constant_s"]})
        )
        for times in (1.0, 2.2)
    )

    def force_mn(j: int) -> np.ndarray:
        trial, state = nothing.trials[j], nothing.states[j]
        return 0.9 * simulate(trial, state, there.shared) + 0.1 * simulate(trial, state, later.shared)

    recorded = with_own_values(_recorded(nothing, force_mn))
    return Account(recorded).with_laws(there.shared.laws)


def test_of_what_relaxes_one_is_looked_for(nothing: StudyFit) -> None:
    """Arms, a power and drainage are one spectrum: beside one of them another says how rough it is, no more."""
    assert {t.name for t in templates(nothing.trials)} >= RELAXING
    assert {t.name for t in templates(nothing.trials, ("adhesion", "transient"))} >= RELAXING
    for present in RELAXING:
        found = {t.name for t in templates(nothing.trials, (present,))}
        assert not found & RELAXING
        assert "parallel_dashpot" in found


def test_a_part_of_an_arm_at_another_time_is_foreseen(
    relaxing: Account, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreseen = relaxing.nats
    monkeypatch.setattr(Mechanism, "otherwise", lambda mechanism, p: ())
    assert foreseen > replace(relaxing).nats + ENOUGH_SHARED


def test_a_time_that_trials_keep_is_begun_from_others(relaxing: Account) -> None:
    """By one trial several times are likely: each fitted about a wrong one, they keep the law there."""
    (law,) = relaxing.fit.shared.laws
    found_s = law.values["time_constant_s"]
    p = next(p for p in law.parameters if p.name == "time_constant_s")
    elsewhere = with_value(relaxing.fit.shared, 0, p, p.to_fit(found_s) + np.log(4.0))
    kept = replace(relaxing, fit=replace(relaxing.fit, shared=elsewhere))
    again, errors = at_likeliest(kept)
    assert again.nats > kept.nats + ENOUGH_SHARED
    (there,) = again.fit.shared.laws
    assert there.free == law.free
    assert there.values["time_constant_s"] == pytest.approx(found_s, rel=0.05)
    assert 0.0 < errors["third_relaxation"]["time_constant_s"] < 0.3 * found_s
    # what does not relax stays as it is
    assert at_likeliest(account := Account(relaxing.without("third_relaxation").fit)) == (account, {})


def test_an_error_by_the_evidence_is_that_of_curvature_where_that_tells(
    bench_trials: Callable[..., list[Trial]],
) -> None:
    """Drainage in skin that differs by a tenth, which tissues can stand for: its time is found, and how well."""
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=4, hold_s=4.0, dwell_s=0.4)
    skin = "seed = 4\n[specimens]\npublished_tissue = false\nfinger_variation = 0.1\nsite_variation = 0.1\n"
    fit = fit_baseline(take_in_memory(bench_trials(skin, plans)).trials)
    law = _law("poroelastic_drainage", {"ratio_to_k0": 0.29, "time_constant_s": 0.85})
    sites = np.exp(0.1 * np.random.default_rng(4).standard_normal((len(fit.trials), 2)))
    trials = []
    for trial, state, of_site in zip(fit.trials, fit.states, sites, strict=True):
        own = replace(law, values={n: v * s for (n, v), s in zip(law.values.items(), of_site, strict=True)})
        drained_mn = simulate(trial, state, replace(fit.shared, laws=(own,)))
        drained_mn -= simulate(trial, state, fit.shared)
        full_mn = (trial.full_force_mn + trial.at_samples(drained_mn)).astype(np.float32)
        trials.append(replace(trial, force_mn=trial.force_mn + drained_mn, full_force_mn=full_mn))
    begun = with_own_values(_with(fit_baseline(trials), law))
    account, errors = at_likeliest(Account(begun).with_laws((law,)).settled())
    (there,) = account.fit.shared.laws
    for name, size in law_sizes(account, there).items():
        error = errors["poroelastic_drainage"][name]
        assert 0.5 < error / size.se < 2.0
        assert abs(there.values[name] - law.values[name]) < 2.0 * error


@given(
    st.lists(st.floats(-50.0, 0.0), min_size=len(AWAY), max_size=len(AWAY)),
    st.integers(0, len(AWAY) - 1),
)
def test_an_error_covers_all_that_is_likely(nats: list[float], at: int) -> None:
    """Of two values that are as likely each is an error's size from the other; what is far less likely counts not."""
    profile = [_held(away, n) for away, n in zip(AWAY, nats, strict=True)]
    weights = likely(profile)
    assert weights.sum() == pytest.approx(1.0)
    best = profile[at]
    error = spread(best, profile)["time_constant_s"]
    distances = np.abs(
        [h.law.values["time_constant_s"] - best.law.values["time_constant_s"] for h in profile]
    )
    assert error <= distances.max() + 1e-12
    assert error**2 == pytest.approx(float(weights @ distances**2))


def _held(away: float, nats: float) -> HeldAt:
    """Return a third arm held at so many times a second, of which only the evidence is known."""
    law = _law("third_relaxation", {"ratio_to_k0": 0.1, "time_constant_s": float(np.exp(away))})
    account = SimpleNamespace(fit=SimpleNamespace(shared=Shared((law,))), nats=nats)
    return HeldAt(cast(Account, account), 0, away)


def test_the_power_by_which_skin_relaxes_is_each_site_s_own(nothing: StudyFit) -> None:
    """Of one size everywhere, and a power of 0.3 that scatters by 8 %: it is found, trial by trial."""
    wanders = 0.08 * np.random.default_rng(4).standard_normal(len(nothing.trials))

    def force_mn(j: int) -> np.ndarray:
        own = {**POWER, "exponent": POWER["exponent"] * float(np.exp(wanders[j]))}
        return simulate(
            nothing.trials[j],
            nothing.states[j],
            _with(nothing, _law("power_law_relaxation", own)).shared,
        )

    fit = with_own_values(_with(_recorded(nothing, force_mn), _law("power_law_relaxation", POWER)))
    for _ in range(3):
        fit = fit_laws(fit).with_population(1)
    at = [s.shapes.law_values["power_law_relaxation", "exponent"] for s in fit.states]
    found = np.array([s.coefficients[k] for s, k in zip(fit.states, at, strict=True)])
    assert np.corrcoef(found, wanders)[0, 1] > 0.9
    assert fit.shared.laws[0].values["exponent"] == pytest.approx(POWER["exponent"], rel=0.1)
