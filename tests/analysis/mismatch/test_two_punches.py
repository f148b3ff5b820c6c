"""A study with two flat punches: what tells drainage from a third arm, and what one of them leaves alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit, with_own_values
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.effects import Law, simulate
from analysis.mismatch.name.finding import weighed
from analysis.mismatch.name.rivals import Rival
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Tissue, library

LARGER = 2.0
"""Diameter of every other trial's punch, over that of the rest."""
TISSUE = Tissue(120.0, 44.5, 2.279, 35.3, 0.149)
DRAINING = "poroelastic_drainage"
DRAINS = {"ratio_to_k0": 0.3, "time_constant_s": 0.4}


@pytest.fixture(scope="module")
def nothing(record: Callable[..., list[Trial]]) -> StudyFit:
    """A study in which nothing is concealed, fitted."""
    return fit_baseline(take_in_memory(record(93)).trials)


def _recorded(fit: StudyFit, law: str, ratio: float) -> StudyFit:
    """Return the baseline of trials with a law's force added to what each has, every other under another punch."""
    under = replace(fit.shared, laws=(Law(library()[law], DRAINS, tuple(DRAINS)),))
    made = []
    for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        own = replace(trial, punch_ratio=ratio if j % 2 else 1.0)
        more = simulate(own, state, under) - simulate(trial, state, fit.shared)
        made.append(replace(own, force_mn=trial.force_mn + more))
    return fit_baseline(made)


def _rival(fit: StudyFit, name: str) -> Rival:
    """Return a law refitted from where a search would begin it."""
    mechanism = library()[name]
    law = Law(mechanism, {**mechanism.typical, **DRAINS}, tuple(DRAINS))
    account = Account(with_own_values(replace(fit, shared=replace(fit.shared, laws=(law,))))).with_laws(
        (law,)
    )
    return Rival(name, *account.gain_over(Account(fit)), account)


@pytest.mark.parametrize(
    ("law", "other"),
    [("poroelastic_drainage", "third_relaxation"), ("third_relaxation", "poroelastic_drainage")],
)
def test_a_second_punch_tells_drainage_from_a_third_arm(nothing: StudyFit, law: str, other: str) -> None:
    told, of_one, of_two = {}, *(_recorded(nothing, law, ratio) for ratio in (1.0, LARGER))
    for fit in (of_one, of_two):
        right, wrong = (_rival(fit, name) for name in (law, other))
        told[fit] = right.gain - wrong.gain, weighed(library()[law], (right, wrong), ())
    (by_one, (_, listed)), (by_two, (probability, alone)) = told[of_one], told[of_two]
    assert by_two > by_one + ENOUGH_SHARED
    assert other in listed
    assert not alone
    assert probability > 0.95


def _with_punch(trial: Trial, diameter_mm: float | None) -> Trial:
    return replace(trial, specimen=replace(trial.specimen, punch_diameter_mm=diameter_mm))


def test_trials_know_their_punch_by_the_commonest(record: Callable[..., list[Trial]]) -> None:
    trials = [_with_punch(t, 1.0 if j in (0, 5) else 0.5) for j, t in enumerate(record(93))]
    taken = take_in_memory(trials)
    assert taken.punch_diameter_mm == 0.5
    assert [t.punch_ratio for t in taken.trials] == [2.0 if j in (0, 5) else 1.0 for j in range(len(trials))]
    assert taken.trials[0].condition not in {t.condition for t in taken.trials if t.punch_ratio == 1.0}
    assert any("0.5 and 1 mm" in note for note in taken.notes)
    one = take_in_memory([_with_punch(t, 0.5) for t in trials])
    assert {t.punch_ratio for t in one.trials} == {1.0}
    assert not one.notes


def test_one_of_two_punches_has_to_be_stated(record: Callable[..., list[Trial]]) -> None:
    stated = [None, 0.5, 1.0]
    trials = [_with_punch(t, d) for t, d in zip(record(93), stated, strict=False)]
    with pytest.raises(BadInputError, match="no punch_diameter_mm in /specimen, and the others say"):
        take_in_memory(trials)


def test_on_one_skin_force_grows_with_the_punch_and_drainage_slows_with_its_square(
    nothing: StudyFit,
) -> None:
    trial = nothing.trials[0]
    larger, own, law = (
        replace(trial, punch_ratio=LARGER),
        PerTrial(trial.z0_start_mm, 0.0),
        library()[DRAINING],
    )
    slower = {**DRAINS, "time_constant_s": LARGER**2 * DRAINS["time_constant_s"]}
    np.testing.assert_allclose(
        simulate_force(larger, TISSUE, own, [(law, DRAINS)]),
        LARGER * simulate_force(trial, TISSUE, own, [(law, slower)]),
        rtol=1e-12,
    )
