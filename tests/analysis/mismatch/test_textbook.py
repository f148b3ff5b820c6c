"""What a law gains nearly in its textbook's form: by so much it is itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import beside_textbook, brings_itself, near_textbook
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.settled import settled_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.model.effects import Law, Shared, simulate
from analysis.mismatch.name.options import law_options
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans

ARM = {"mass_g": 0.5, "rings_ms": 0.2, "damping": 0.5}
BELL = {"mass_g": 0.5, "rings_ms": 2.0, "damping": 0.05}
CELL = {"pull_off_mn": 2.0, "roundness": 1.3, "reach": 3.0}
SHAKES = {"shake_before": 0.678, "shake_after": 0.337}
BEARING = {"force_mn": 2.8, "longer": 1.0, "bend": 0.004, "held": 1.0, "creeping": 0.7, "creeping_mm_s": 0.6}


@pytest.mark.parametrize(
    ("name", "form", "itself"),
    [("arm_inertia", ARM, True), ("arm_inertia", BELL, False), ("adhesion", CELL, True)],
    ids=["arm", "bell", "cell"],
)
def test_a_law_gains_what_it_does_nearly_in_its_textbook_s_form(
    record: Callable[..., list[Trial]], name: str, form: dict[str, float], itself: bool
) -> None:
    """An arm that is struck where the motion turns; what rings at 80 Hz long after, which is no arm's mass; and a cell.

    It lets go little by little: in a snap's form its adhesion gains a fifth.
    """
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=3, hold_s=2.0, dwell_s=0.4)
    fit = fit_baseline(take_in_memory(record(63, plans=plans)).trials)
    mechanism = library()[name]
    law = Law(mechanism, {**mechanism.null, **form}, tuple(p.name for p in mechanism.parameters))
    shared = replace(fit.shared, laws=(law,))
    trials = tuple(
        replace(t, force_mn=t.force_mn + simulate(t, s, shared) - simulate(t, s, fit.shared))
        for t, s in zip(fit.trials, fit.states, strict=True)
    )
    assert brings_itself(Account(replace(fit, trials=trials, shared=shared)), name) is itself


def test_a_textbook_has_a_law_in_several_forms(record: Callable[..., list[Trial]]) -> None:
    """Of a bearing that holds at rest all it held in motion a sign function that lets go gained a thirteenth."""
    fit = fit_baseline(take_in_memory(record(51)[:1]).trials)
    forms = [t.as_law(1.0) for t in templates(fit.trials) if t.name == "coulomb_friction"]
    friction = library()["coulomb_friction"]
    law = Law(friction, {**friction.null, **BEARING}, tuple(p.name for p in friction.parameters))
    there = near_textbook(law, forms)
    assert there.free == ("force_mn",)
    assert (there.values["longer"], there.values["held"]) == (1.0, 1.0)
    # what no form has is as far from the nearest as was expected
    assert there.values["creeping"] == pytest.approx(0.3)
    lets_go = near_textbook(replace(law, values={**law.values, "longer": 0.2, "held": 0.5}), forms)
    assert lets_go.values["longer"] == 0.2


def test_a_textbook_s_form_is_looked_for_from_other_sizes(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where skin lets go is an event: a fit from a pull of two thirds crept, and ended at more than without any."""
    adhesion = library()["adhesion"]
    law = Law(adhesion, {**adhesion.null, **CELL, "reach": 8.0}, tuple(p.name for p in adhesion.parameters))
    fit = replace(fit_baseline(take_in_memory(record(51)[:1]).trials), shared=Shared((law,)))

    def creeping(at: StudyFit) -> SimpleNamespace:
        """Return a fit that ends where it begins, and is good at a pull of 2.8 mN only, as the textbook has it."""
        found = [
            x for x in at.shared.laws if x.parameters[1:] or np.isclose(x.values["pull_off_mn"], 8.0**0.5)
        ]
        return SimpleNamespace(cost=0.0 if found else 100.0)

    monkeypatch.setattr("analysis.mismatch.evidence.itself.fit_laws", creeping)
    assert brings_itself(Account(fit), "adhesion")
    monkeypatch.setattr("analysis.mismatch.evidence.itself.OTHER_SIZES", (0.5,))
    assert not brings_itself(Account(fit), "adhesion")


def test_inner_parameters_that_make_up_for_each_other_are_asked_of_the_textbook_s_own_form(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an arm's shakes of 0.68 and 0.34 the first alone drawn back left a quarter, and both at nothing all."""
    inertia = library()["arm_inertia"]
    law = Law(inertia, {**inertia.null, **ARM, **SHAKES}, tuple(p.name for p in inertia.parameters))
    fit = replace(fit_baseline(take_in_memory(record(51)[:1]).trials), shared=Shared((law,)))
    good = [tuple(SHAKES.values()), (0.0, 0.0)]

    def along_the_ridge(at: StudyFit) -> SimpleNamespace:
        """Return a fit that is good where the shakes make up for each other only."""
        found = [x for x in at.shared.laws if tuple(x.values[shake] for shake in SHAKES) in good]
        return SimpleNamespace(cost=0.0 if found else 100.0)

    monkeypatch.setattr("analysis.mismatch.evidence.itself.fit_laws", along_the_ridge)
    assert brings_itself(Account(fit), "arm_inertia")
    good.pop()
    assert not brings_itself(Account(fit), "arm_inertia")


def test_what_a_law_has_gone_from_its_textbook_for_shows_beside_that(
    record: Callable[..., list[Trial]],
) -> None:
    """A sensor that lags answers ahead of its lag by a half where an arm's mass is missing, and leaves little of it."""
    effects = "".join(
        f'[[effects]]\nname = "{name}"\n{size}\n'
        for name, size in (("force_lag", "time_constant_ms = 1.0"), ("arm_inertia", "mass_g = 0.5"))
    )
    start = Account(fit_baseline(take_in_memory(record(53, effects)).trials))
    of = {t.name: t for t in templates(start.fit.trials)}
    lagging = start.with_laws((of["force_lag"].as_law(1.0),)).settled()
    textbook = beside_textbook(lagging)
    assert lagging.fit.shared.laws[0].values["shared"] > 0.4
    assert textbook.fit.shared.laws[0].values["shared"] == 0.0
    assert textbook.fit.shared.laws[0].free == lagging.fit.shared.laws[0].free

    def shows(account: Account) -> float:
        arms = [of["arm_inertia"]]
        (arm,) = law_options(account, start, arms, settled_columns(account.fit, arms), beside_exact=True)
        return arm.nats

    assert shows(textbook) > 3.0 * shows(lagging.exact)
    # a law that is where the textbook has it stays there
    assert beside_textbook(textbook) is textbook
