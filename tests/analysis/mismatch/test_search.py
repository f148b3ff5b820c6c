"""Which of several effects is taken first: the one that says most, unless its law is no longer itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.mismatch.evidence import account as evidence_account
from analysis.mismatch.evidence import left_over
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import explains_itself, frees, mends
from analysis.mismatch.evidence.left_over import LeftOver
from analysis.mismatch.evidence.shares import Shares, even_shares
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_OWN, ENOUGH_SHARED, INEXACT, ROUGH, SURE, UNFORESEEN
from analysis.mismatch.model.effects import TISSUE_SIZE, Law, Shared
from analysis.mismatch.model.population import Population
from analysis.mismatch.name import exchange, options, pruning, search, tries, weighing
from analysis.mismatch.name.events import EVENTS
from analysis.mismatch.name.options import Option, added, begun_again, own_options
from analysis.mismatch.name.pruning import pruned
from analysis.mismatch.name.rivals import Named, Rival, as_they_stand, best_first, instead
from analysis.mismatch.name.tries import worth_trying
from analysis.mismatch.name.weighing import considered, stands_for_shape
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import PHASE_NAMES, Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans

NOTHING_LEFT = LeftOver(np.zeros(1), np.zeros(1))
MUCH_LEFT = LeftOver(np.full(2, 10.0), np.full(2, 10.0))
WANDERING = "[noise]\nforce_mn_rms = 0.2\nwander_mn_rms = 0.6\nwander_time_s = 1.0\n"


def _rival(name: str, time_constant_s: float, of_trials: list[float]) -> Rival:
    """Return a rival without a fit, of which only the evidence of each trial is known."""
    law = Law(
        library()[name],
        {"ratio_to_k0": 0.3, "time_constant_s": time_constant_s},
        ("ratio_to_k0", "time_constant_s"),
    )
    account = Account(cast(StudyFit, SimpleNamespace(shared=Shared((law,)), states=())))
    account.__dict__["evidence"] = np.array(of_trials)
    return Rival(name, float(np.sum(of_trials)), 1.0, account)


@pytest.fixture(scope="module")
def wandering(record: Callable[..., list[Trial]]) -> Account:
    """The account of a study in which noise wanders and nothing is concealed."""
    return Account(fit_baseline(take_in_memory(record(57, WANDERING)).trials))


def _options(found_in: Account, nats: Mapping[str, float], enough: float) -> list[Option]:
    """Return effects that say so much in an account, and change nothing where they are added."""
    return [Option(name, said, enough, found_in, lambda same: same) for name, said in nats.items()]


def test_a_law_at_the_end_of_its_range_makes_way_for_one_within_it() -> None:
    ended = _rival("poroelastic_drainage", 300.0, [30.0, 32.0, 31.0])
    within = _rival("third_relaxation", 50.0, [31.0, 31.0, 29.0])
    assert best_first([ended, within]) == (within, ended)
    # but not for one that says less, nor does one within its range make way
    far_behind = _rival("third_relaxation", 50.0, [10.0, 11.0, 9.0])
    assert best_first([far_behind, ended]) == (ended, far_behind)
    better = _rival("poroelastic_drainage", 30.0, [30.0, 32.0, 31.0])
    assert best_first([within, better]) == (better, within)
    # nor is one that explains so much only where it is granted to be off by more than what is named may be
    off = replace(better, off=0.2)
    assert best_first([off, within]) == (within, off)
    # what no textbook has makes way like these, and keeps none of them from leading that says more
    nameless = replace(within, name="transient")
    assert best_first([nameless, better]) == (better, nameless)
    assert best_first([nameless, off]) == (off, nameless)
    assert best_first([nameless, ended]) == (ended, nameless)
    # where none is what a textbook says, what one gains by being granted to be off it does not explain
    granted = replace(off, account=replace(off.account, granted=3.0))
    granted.account.__dict__["evidence"] = off.account.evidence
    assert best_first([granted, nameless]) == (nameless, granted)


def test_what_is_added_beside_a_rhythm_is_compared_once_that_has_followed_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of three only the near ones are settled: what then says most leads, and of an account without rhythms none."""
    arm, drainage, dashpot = (
        _rival(name, 1.0, [gain, gain])
        for name, gain in (
            ("third_relaxation", 50.0),
            ("poroelastic_drainage", 40.0),
            ("parallel_dashpot", 10.0),
        )
    )
    asked: list[str] = []
    to: list[float] = []

    def settled(account: Account, least: float) -> Account:
        asked.append(account.names[0])
        to.append(least)
        there = replace(account)
        there.__dict__["evidence"] = account.evidence + (
            30.0 if "poroelastic_drainage" in account.names else 1.0
        )
        return there

    monkeypatch.setattr(Account, "settled", settled)
    monkeypatch.setattr(Account, "let_go", lambda account: account)
    before = _rival("coulomb_friction", 1.0, [0.0, 0.0]).account
    assert as_they_stand([arm, drainage, dashpot], before) == [arm, drainage, dashpot] and not asked
    rhythms = SimpleNamespace(rhythms=(1,))
    cast(SimpleNamespace, before.fit).states = (rhythms,)
    found = as_they_stand([arm, drainage, dashpot], before)
    assert asked == ["third_relaxation", "poroelastic_drainage"]
    assert [r.gain for r in found] == [102.0, 140.0, 20.0]
    assert [r.settled for r in found] == [True, True, False]
    assert to == [ENOUGH_SHARED, ENOUGH_SHARED]
    as_they_stand([replace(r, gain=30.0 * r.gain) for r in (arm, drainage)], before)
    assert to[2:] == pytest.approx([30.0, 24.0]), "a tenth of what rivals are told apart by"
    # what is worse than it was stays as it was
    monkeypatch.setattr(Account, "settled", lambda account, least: before)
    assert [r.gain for r in as_they_stand([arm, drainage], before)] == [100.0, 80.0]


def test_what_explains_as_much_beside_an_effect_is_no_alternative_to_it() -> None:
    dashpot = _rival("parallel_dashpot", 1.0, [900.0, 900.0, 800.0])
    arm, drainage = (
        _rival(n, 1.0, [600.0, 600.0, 600.0]) for n in ("third_relaxation", "poroelastic_drainage")
    )
    # beside the dashpot the arm says as much as before, drainage hardly anything any more
    arm_beside, drainage_beside = (
        _rival(n, 1.0, of)
        for n, of in (("third_relaxation", [590.0] * 3), ("poroelastic_drainage", [20.0] * 3))
    )
    step = (dashpot, arm, drainage)
    assert instead(step, (arm_beside, drainage_beside)) == (dashpot, drainage)
    # what was not considered again says nothing of it
    assert instead(step, ()) == step


def test_an_event_is_begun_again_beside_the_quick_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slow noise that the event itself had made would hide when it came."""
    looked_at: list[NoiseModel] = []

    def seen(account: Account, only: str = "") -> list[Option]:
        assert only == "slip"
        looked_at.append(account.fit.noise)
        return []

    monkeypatch.setattr(options, "own_options", seen)
    monkeypatch.setattr(options, "templates", lambda trials: [])
    noise = NoiseModel(0.2, ((0.1, 1.0),))
    fit = StudyFit((), (), noise, Shared(), (), Population.weak(np.zeros(TISSUE_SIZE), 10.0))
    account = Account(fit, steps={"slip": 0.0})
    assert begun_again(account, "slip", account) is account
    assert looked_at == [NoiseModel(0.2)]


def _account(of_trials: list[float], rough_of_trials: list[float]) -> Account:
    """Return an account of a law that is exact, of which only the evidence is known, and that where it may be off."""
    shared = _rival("force_lag", 1.0, of_trials).account.fit.shared
    fit = cast(StudyFit, SimpleNamespace(trials=of_trials, shared=shared, states=()))
    tenth = even_shares(["force_lag"], INEXACT)
    exact, rough = Account(fit), Account(fit, inexact=tenth)
    exact.__dict__.update(evidence=np.array(of_trials), rough=rough, shares=tenth, as_off=rough)
    rough.__dict__.update(
        evidence=np.array(rough_of_trials), explained_by_phase=np.ones((1, len(PHASE_NAMES)))
    )
    return exact


def _with_steps(account: Account, **steps: float) -> Account:
    """Return an account with events, of which as much is known."""
    other = replace(account, steps=steps)
    other.__dict__.update({**vars(account), "steps": steps})
    return other


def test_what_a_law_may_leave_by_being_off_names_no_other() -> None:
    before = _account([0.0] * 4, [90.0] * 4)
    # what it explains is explained without it, were the law off by a tenth
    companion = _account([100.0] * 4, [91.0] * 4)
    assert not explains_itself(companion, before, 400.0, 25.0)
    missing = _account([100.0] * 4, [180.0] * 4)
    assert explains_itself(missing, before, 400.0, 25.0)


def test_a_weak_law_need_not_be_granted_to_be_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arc that gains 28 nats lost 54 by being granted a tenth of itself in every trial and phase."""
    before, arc = _account([0.0] * 4, [-10.0] * 4), _account([7.0] * 4, [-23.5] * 4)
    of_arc = _rival("lever_arc", 1.0, [0.0]).account.fit.shared.laws
    shared = Shared((*arc.fit.shared.laws, *of_arc))
    arc.__dict__["fit"] = SimpleNamespace(**{**vars(arc.fit), "shared": shared})

    def inexact_to(account: Account, shares: Shares) -> Account:
        assert account.taken_as_exact <= {"lever_arc"}
        return _account([-3.0] * 4, []) if account.taken_as_exact else account

    monkeypatch.setattr(Account, "inexact_to", inexact_to)
    assert explains_itself(arc, before, 28.0, 10.0)
    assert not explains_itself(arc, before, 28.0, 30.0)


@pytest.mark.parametrize(("led_astray", "here", "kept"), [(-700.0, -40.0, -40.0), (60.0, 90.0, 60.0)])
def test_laws_granted_to_be_off_stay_where_they_stand_if_led_astray(
    monkeypatch: pytest.MonkeyPatch, led_astray: float, here: float, kept: float
) -> None:
    """Without slow noise what else is missing may bend them by thousands of nats."""
    exact, quick = (_account([0.0] * 4, [0.0] * 4) for _ in range(2))
    off = {id(quick): led_astray, id(exact): here}
    monkeypatch.setattr(Account, "quick", lambda self: quick)
    monkeypatch.setattr(Account, "_off_by", lambda self, shares: _account([off[id(self)] / 4] * 4, [0.0] * 4))
    assert exact.off_by(even_shares(["force_lag"], INEXACT)).nats == pytest.approx(kept)


def test_what_fell_behind_is_added_where_the_account_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside another effect that is missing a fit without slow noise may end where no effect is worth anything."""
    monkeypatch.setattr(Account, "weighed_anew", lambda self: self)
    monkeypatch.setattr(Account, "of_exact_laws", property(lambda self: self.nats))
    here, quick = _account([50.0] * 4, []), _account([40.0] * 4, [])
    led_astray, found = _account([20.0] * 4, []), _account([80.0] * 4, [])
    asked: list[Account] = []

    def option(from_quick: Account) -> Option:
        def refit(account: Account) -> Account:
            asked.append(account)
            return found if account is here else from_quick

        return Option("respiration", 900.0, 25.0, quick, refit)

    assert added([option(led_astray)], here) is found
    assert asked == [quick, here]
    asked.clear()
    # what predicts no worse, but for its price, is as good as it gets
    nothing = _account([47.0] * 4, [])
    assert added([option(nothing)], here) is nothing
    assert here not in asked
    # but says nothing of another place that fell behind
    assert added([option(led_astray), option(nothing)], here) is found
    # what was found where the account stands is not added there again
    asked.clear()

    def in_place(account: Account) -> Account:
        asked.append(account)
        return led_astray

    assert added([Option("respiration", 900.0, 25.0, here, in_place)], here) is led_astray
    assert asked == [here]


def test_what_the_noise_leaves_no_sign_of_is_not_tried(
    record: Callable[..., list[Trial]], wandering: Account
) -> None:
    """Noise that wanders looks like a rhythm where none is granted; a breath shows beside such noise, too."""

    def tried(account: Account) -> set[str]:
        return set(worth_trying(account, account, NOTHING_LEFT, None).options)

    seen = own_options(wandering.quick())[-1]
    assert seen.name not in {event.name for event in EVENTS}
    assert seen.nats > ENOUGH_OWN
    assert not tried(wandering)
    breath = '[[effects]]\nname = "respiration"\namplitude_um = 20.0\nfrequency_hz = 0.3\n'
    breathing = take_in_memory(record(57, WANDERING + breath)).trials
    assert "respiration" in tried(Account(fit_baseline(breathing)))


def test_half_of_what_is_enough_must_be_left_beside_the_noise(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """However much it is without slow noise: what promises nothing by the noise that there is, is not added."""
    assert wandering.quick() is not wandering

    def tried(left: float) -> bool:
        def breath(found_in: Account, only: str = "") -> list[Option]:
            nats = left if found_in is wandering else 900.0
            return [Option("respiration", nats, 25.0, found_in, lambda same: same)]

        monkeypatch.setattr(tries, "own_options", breath)
        return "respiration" in worth_trying(wandering, wandering, NOTHING_LEFT, None).options

    assert not tried(12.0)
    assert tried(13.0)


def test_what_shows_only_beside_laws_as_a_textbook_has_them_is_tried(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """However little of it a line tells where they stand: what they have gone from their textbook for is theirs."""
    textbook = replace(wandering)

    def laws(account: Account, *_: object, **__: object) -> list[Option]:
        arm = Option("arm_inertia", 900.0, 10.0, account, lambda same: same)
        lag = Option("force_lag", 500.0, 10.0, account, lambda same: same)
        return [arm, lag] if account is textbook else [lag]

    monkeypatch.setattr(tries, "beside_textbook", lambda _: textbook)
    monkeypatch.setattr(tries, "law_options", laws)
    monkeypatch.setattr(tries, "own_options", lambda *_: [])
    found = worth_trying(wandering, wandering, NOTHING_LEFT, None)
    assert {name: len(options) for name, options in found.options.items()} == {
        "arm_inertia": 1,
        "force_lag": 2,
    }
    assert "arm_inertia" in found.taken_up


def test_what_was_fitted_without_slow_noise_is_weighed_twice(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """What comes in each trial anew has taken some of it up there, and nowhere else."""
    beside = replace(wandering, steps={"slip": 5.0})
    measured: list[StudyFit] = []

    def noise_left(fit: StudyFit) -> NoiseModel:
        measured.append(fit)
        return beside.fit.noise

    monkeypatch.setattr(evidence_account, "noise_left", noise_left)
    beside.weighed_anew()
    assert len(measured) == 1
    beside.quick().weighed_anew()
    assert len(measured) == 3


def test_what_is_nothing_is_not_granted_to_be_off(
    monkeypatch: pytest.MonkeyPatch, record: Callable[..., list[Trial]]
) -> None:
    account = Account(fit_baseline(take_in_memory(record(57, "")).trials))
    breath = Option("respiration", 900.0, 25.0, account, lambda same: same)
    granted: list[Account] = []

    def granting(account: Account) -> Account:
        granted.append(account)
        return account

    monkeypatch.setattr(
        weighing, "worth_trying", lambda *_: tries.Tries({"respiration": [breath]}, {"respiration": 900.0})
    )
    monkeypatch.setattr(weighing, "added", lambda *_: replace(account, granted=-900.0))
    monkeypatch.setattr(Account, "granting", granting)
    for nothing in (True, False):
        monkeypatch.setattr(weighing, "is_nothing", lambda *_, found=nothing: found)
        assert not considered(account, account, {})
        assert bool(granted) is not nothing


def test_what_says_most_beside_the_noise_is_tried_too(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """Where no slow noise is granted a breath had taken all of it up, ten times what a slip explains."""
    quick = {"respiration": 40_000.0, "slip": 6_000.0}
    beside = {"slip": 4_000.0, "oscillation": 200.0}
    asked: list[str] = []

    def own(found_in: Account, only: str = "") -> list[Option]:
        asked.append(only)
        by_name = {only: 270.0} if only else beside if found_in is wandering else quick
        return _options(found_in, by_name, 25.0)

    monkeypatch.setattr(tries, "own_options", own)
    found = worth_trying(wandering, wandering, NOTHING_LEFT, None)
    assert set(found.options) == {"respiration", "slip"}
    assert found.largest["slip"] == 6_000.0
    # of rhythms beside the noise another says most: this one is asked for by name
    assert asked == ["", "", "respiration"]


def test_what_says_more_than_an_effect_that_shows_is_tried_beside_it(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """Of a reflex the noise had left a shift of the skin, which says less, but none of the twitch that it was."""
    quick = {"transient": 950.0, "motion_artefact": 900.0, "slip": 850.0}
    beside = {"transient": 0.0, "motion_artefact": 700.0, "slip": 0.0}

    def own(found_in: Account, only: str = "") -> list[Option]:
        by_name = beside if found_in is wandering else quick
        return _options(found_in, by_name, 25.0)

    monkeypatch.setattr(tries, "own_options", own)
    assert set(worth_trying(wandering, wandering, NOTHING_LEFT, None).options) == {
        "transient",
        "motion_artefact",
    }
    beside["motion_artefact"] = 0.0
    assert not worth_trying(wandering, wandering, NOTHING_LEFT, None).options


def test_a_law_that_says_more_than_one_that_shows_is_tried_beside_it(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """Of a power law the noise had left a third arm, which says less, but nothing of itself."""
    quick = {"power_law_relaxation": 8400.0, "third_relaxation": 7100.0, "parallel_dashpot": 6900.0}
    beside = {"power_law_relaxation": 0.0, "third_relaxation": 23.0, "parallel_dashpot": 0.0}

    def laws(found_in: Account, *_: object) -> list[Option]:
        by_name = beside if found_in is wandering else quick
        return _options(found_in, by_name, 10.0)

    monkeypatch.setattr(tries, "law_options", laws)
    monkeypatch.setattr(tries, "own_options", lambda *_: [])
    tried = worth_trying(wandering, wandering, NOTHING_LEFT, None).options
    assert set(tried) == {"power_law_relaxation", "third_relaxation"}
    # also where what shows says far less than the best do
    beside["third_relaxation"], beside["force_lag"], quick["force_lag"] = 0.0, 266.0, 70.0
    assert set(worth_trying(wandering, wandering, NOTHING_LEFT, None).options) == set(quick)
    beside["force_lag"] = 0.0
    assert not worth_trying(wandering, wandering, NOTHING_LEFT, None).options


def test_what_laws_are_granted_to_be_off_for_is_tried(
    monkeypatch: pytest.MonkeyPatch, wandering: Account
) -> None:
    """For want of an arc a dashpot was off by a quarter in the ramps. Beside that the arc says 8 nats; it gains 190."""
    account = replace(wandering, inexact=even_shares(["parallel_dashpot"], INEXACT))
    granted, exact = {"lever_arc": 3.0}, {"lever_arc": 3149.0, "coulomb_friction": 557.0}

    def laws(found_in: Account, *_: object, beside_exact: bool = False) -> list[Option]:
        assert beside_exact is not bool(found_in.inexact)
        return _options(found_in, exact if beside_exact else granted, 10.0)

    monkeypatch.setattr(tries, "law_options", laws)
    monkeypatch.setattr(tries, "own_options", lambda *_: [])
    assert set(worth_trying(account, wandering, MUCH_LEFT, None).options) == {"lever_arc"}
    exact["lever_arc"] = exact["coulomb_friction"] = 15.0
    assert not worth_trying(account, wandering, MUCH_LEFT, None).options


def test_what_laws_were_off_for_want_of_frees_them() -> None:
    exact = _account([0.0] * 4, [0.0] * 4)
    off, hardly_off = replace(exact, granted=80.0), replace(exact, granted=6.0)
    assert frees(exact, off)
    assert frees(hardly_off, off)
    # they are as far off with it, or were exact before
    assert not frees(off, off)
    assert not frees(exact, exact)


def test_each_form_that_a_law_may_take_has_its_price(record: Callable[..., list[Trial]]) -> None:
    """A law of no size takes any of its forms without a trace, so that nothing held out tells against the best."""
    account = Account(fit_baseline(take_in_memory(record(52)).trials))
    friction = library()["coulomb_friction"]
    values = {**friction.null, "force_mn": 1e-9}
    inner = [p.name for p in friction.parameters if p.inner]

    def nats(free: tuple[str, ...]) -> float:
        shared = replace(account.fit.shared, laws=(Law(friction, values, free),))
        return replace(account, fit=replace(account.fit, shared=shared)).nats

    assert nats(("force_mn",)) - nats(("force_mn", *inner)) == pytest.approx(len(inner), abs=0.1)


def _acting(*of_phase: float) -> Callable[..., np.ndarray]:
    """Return what stands for `acting` where every effect shows as much in the phases, and shares of it squared."""

    def acting(account: Account, names: Sequence[str], shares: np.ndarray | None = None) -> np.ndarray:
        squares = np.ones((len(names), 1)) if shares is None else shares**2
        return squares * np.array(of_phase)

    return acting


def test_what_effects_leave_over_is_what_is_not_foreseen_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    of_phase = np.array([0.0, 0.0, 6.0, 1.0, 5.0, 0.0, 0.0])
    monkeypatch.setattr(left_over, "acting", _acting(*of_phase))
    law = _account([0.0] * 4, [0.0] * 4)
    unforeseen = (UNFORESEEN * INEXACT) ** 2 * 9000.0 * of_phase / 12.0
    # what comes in each trial anew is granted to be off as a law is
    for account in (law, _with_steps(law, slip=5.0)):
        left = left_over.left_over(account, 9000.0, {})
        np.testing.assert_allclose(left.to_laws, unforeseen)
        np.testing.assert_allclose(left.to_others, unforeseen)
    # off by a third where it was foreseen, it is so where it was not
    by_phase = np.where(np.array(PHASE_NAMES) == "ramp", ROUGH, INEXACT)
    rough = replace(law, inexact=Shares({"force_lag": by_phase}))
    rougher = unforeseen * (by_phase / INEXACT) ** 2
    np.testing.assert_allclose(left_over.left_over(rough, 9000.0, {}).to_laws, rougher)
    # but exact where it was foreseen, it need not be so where it was not
    exact = replace(law, inexact=Shares({"force_lag": 0.001 * by_phase}))
    np.testing.assert_allclose(left_over.left_over(exact, 9000.0, {}).to_laws, unforeseen)


def test_a_rhythm_leaves_more_than_what_is_granted_to_be_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(left_over, "acting", _acting(0, 1, 1, 1, 1, 0, 0))
    law = _account([0.0] * 4, [0.0] * 4)
    breath = SimpleNamespace(rhythms=(SimpleNamespace(effect="respiration"),), shapes=())
    object.__setattr__(law.fit, "states", (breath,) * 4)
    of_law, of_breath = (UNFORESEEN * INEXACT) ** 2 * 6000.0, INEXACT**2 * 3000.0
    # in four trials it leaves four things, and a law is the same in all
    left = left_over.left_over(law, 9000.0, {"respiration": 3000.0})
    assert left.to_laws.sum() == pytest.approx(of_law + of_breath / 4)
    assert left.to_others.sum() == pytest.approx(of_law + of_breath)
    # what is not known of it may be all
    left = left_over.left_over(law, 9000.0, {})
    assert left.to_laws.sum() == pytest.approx(INEXACT**2 * 9000.0 / 4)
    assert left.to_others.sum() == pytest.approx(INEXACT**2 * 9000.0)


@pytest.mark.parametrize(
    ("gained", "may_be"),
    [
        ((100.0, 0.0), 0.0),
        ((0.0, 20.0), 20.0),
        ((100.0, 200.0), 10.0 * SURE),
        ((-5.0, 20.0), 20.0),
    ],
    ids=[
        "elsewhere",
        "in the ramp, where much is left",
        "more than may be left",
        "at the cost of another phase",
    ],
)
def test_what_is_left_in_a_phase_is_no_gain_in_another(
    gained: tuple[float, float], may_be: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A strong inertia leaves much in the ramp, and nothing in the hold for which a breath could be mistaken."""
    account = _account([0.0] * 4, [0.0] * 4)
    left = LeftOver(np.array([0.0, 10.0]), np.array([0.0, 10.0]))
    monkeypatch.setattr(left_over, "gained_where", lambda after, before: np.array(gained))
    assert left.of(account, account, anew=False) == pytest.approx((may_be, sum(gained) - may_be))
    nothing = LeftOver(np.zeros(2), np.zeros(2))
    assert nothing.of(account, account, anew=True) == (0.0, np.inf)


def test_an_effect_is_seen_where_it_acts(record: Callable[..., list[Trial]]) -> None:
    """Skin clings on the way back: there it is seen, and there less is left with it."""
    clinging = '[[effects]]\nname = "adhesion"\npull_off_mn = 4.0\n'
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=3, hold_s=2.0, dwell_s=1.0)
    nothing = Account(fit_baseline(take_in_memory(record(52, clinging, plans)).trials))
    account = considered(nothing, nothing, {}, ["adhesion"])[0].settled_account()
    back = PHASE_NAMES.index("retract")
    acts = left_over.acting(account, account.names)
    assert acts.shape == (1, len(PHASE_NAMES))
    assert acts[0, back] > 0.6 * acts.sum()
    # half of an effect has a quarter of its squares, in the phases in which it is half
    half = np.where(np.arange(len(PHASE_NAMES)) == back, 0.5, 0.0)[None]
    assert 0.2 < left_over.acting(account, account.names, half).sum() / acts.sum() < 0.3
    gained = left_over.gained_where(account, nothing)
    assert gained[back] > 0.6 * gained.sum() > 100.0
    # a file may have samples of no phase
    dwell = PHASE_NAMES.index("dwell")
    gaps = tuple(replace(t, phase=np.where(t.phase == dwell, -1, t.phase)) for t in account.fit.trials)
    with_gaps = replace(account, fit=replace(account.fit, trials=gaps))
    assert acts[0, dwell] > 0.0 == left_over.acting(with_gaps, account.names)[0, dwell]
    assert left_over.gained_where(with_gaps, nothing)[back] == pytest.approx(gained[back])


@pytest.mark.parametrize(
    ("granted", "then", "gain", "goes_on"),
    [
        (90.0, 90.0, 50.0, True),
        (400.0, 399.0, 50.0, False),
        (400.0, 380.0, 50.0, True),
        (400.0, 450.0, 50.0, False),
        (400.0, 450.0, 500.0, True),
    ],
    ids=["off by little", "as they are", "mended", "off by more", "more than they are off by"],
)
def test_beside_laws_too_far_off_to_be_named_only_what_mends_them_is_added(
    granted: float, then: float, gain: float, goes_on: bool
) -> None:
    """Of softening skin a friction explained but for a third; a drift, a crosstalk and a dashpot followed."""
    before = SimpleNamespace(granted=granted, gain_over=lambda _: (1000.0, 1.0))
    account = SimpleNamespace(granted=then)
    assert mends(cast(Account, account), cast(Account, before), cast(Account, None), gain) == goes_on


@dataclass(frozen=True)
class _Evidence:
    """What is known of accounts of some effects: the evidence of each set of them."""

    names: tuple[str, ...]
    of: dict[tuple[str, ...], float]
    steps: tuple[str, ...] = ()
    fit: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(trials=(), shared=Shared(), states=())
    )

    @property
    def nats(self) -> float:
        return self.of[self.names]

    def without(self, name: str) -> _Evidence:
        names, steps = (tuple(n for n in some if n != name) for some in (self.names, self.steps))
        return replace(self, names=names, steps=steps)

    stripped = without

    def settled(self) -> _Evidence:
        return self

    reweighed = quick = settled

    def gain_over(self, other: _Evidence) -> tuple[float, float]:
        return self.nats - other.nats, 0.0


NOTHING = cast(Account, _Evidence((), {(): 0.0}))


@pytest.mark.parametrize(
    ("alone", "beside", "kept"), [(900.0, 899.0, ("drift",)), (400.0, 900.0, ("drift", "lag"))]
)
def test_what_only_led_to_a_better_account_is_taken_out_again(
    alone: float, beside: float, kept: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The newest may be needless where the others were led to by it."""
    monkeypatch.setattr(pruning, "begun_again", lambda account, name, nothing: account)
    account = _Evidence(("drift", "lag"), {("drift",): alone, ("lag",): 100.0, ("drift", "lag"): beside})
    newest = Rival("lag", 500.0, 1.0, cast(Account, account))
    found, adds = pruned(cast(Account, account), newest, NOTHING)
    assert found.names == kept
    assert adds == ({"drift": 800.0, "lag": 500.0} if "lag" in kept else {})


@pytest.mark.parametrize("common", [0.0, 900.0], ids=["its own", "what all share"])
def test_what_is_missing_leads_others_no_further_than_to_nothing(
    common: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the slips that it was added beside a stiffening lost nine tenths of what no effect at all explains."""
    asked = []

    def shape(account: Account) -> SimpleNamespace:
        asked.append(account)
        return SimpleNamespace(gain=common if account is NOTHING else 0.0)

    monkeypatch.setattr(pruning, "begun_again", lambda account, name, nothing: account)
    monkeypatch.setattr(pruning, "own_options", lambda account, name: [])
    monkeypatch.setattr(weighing, "shape_left", shape)
    monkeypatch.setattr(pruning, "is_nothing", lambda account, name: False)
    of = {(): 0.0, ("slip",): 900.0, ("stiffening",): -9000.0, ("slip", "stiffening"): 1000.0}
    account = cast(Account, _Evidence(("slip", "stiffening"), of, ("slip",)))
    found, adds = pruned(account, Rival("stiffening", 100.0, 1.0, account), NOTHING)
    # it is asked of what is left without both, where the others went astray, and where one is, what is left with them
    assert asked == [NOTHING, *([account] if common else [])]
    assert (found, adds) == ((NOTHING, {}) if common else (account, {"slip": 1000.0, "stiffening": 100.0}))


def _take_as_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a search take every account as it was found: nothing begun again, pruned, exchanged or weighed anew."""
    monkeypatch.setattr(search, "begun_again", lambda account, name, nothing: account)
    monkeypatch.setattr(search, "pruned", lambda account, *_: (account, {}))
    monkeypatch.setattr(search, "told_apart", lambda account, rivals: account)
    monkeypatch.setattr(search, "in_smooth_noise", lambda account: account)


def test_a_step_that_ends_worse_than_it_began_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    of = {(): 0.0, ("slip",): 900.0, ("slip", "stiffening"): 1000.0, ("stiffening",): -9000.0}
    slip, both, worse = (
        cast(Account, _Evidence(names, of)) for names in (("slip",), ("slip", "stiffening"), ("stiffening",))
    )
    first = (Rival("slip", 900.0, 1.0, slip), Rival("motion_artefact", 850.0, 1.0, slip))
    # beside the slip a shift explains as much as in its place: it was there by chance
    second = (Rival("stiffening", 1000.0, 1.0, both), Rival("motion_artefact", 800.0, 1.0, both))
    steps = [first, second]
    monkeypatch.setattr(search, "weighed", lambda *_: steps.pop(0))
    _take_as_found(monkeypatch)
    monkeypatch.setattr(search, "pruned", lambda account, *_: (worse if account is both else account, {}))
    named = search.search(NOTHING)
    assert named.account is slip
    assert [r.name for r in named.rivals["slip"]] == ["slip"]
    assert not steps


@pytest.mark.parametrize(
    ("second", "taken"), [("swell", False), ("slip", True)], ids=["nameless, too", "one with a name"]
)
def test_a_second_shape_without_a_name_is_not_looked_for(
    second: str, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a sensor that slews no name was found: three shapes were fitted in every trial, for a quarter of an hour."""
    of = {(): 0.0, ("zero_step",): 900.0, ("zero_step", second): 4000.0}
    zero, both = (cast(Account, _Evidence(names, of)) for names in list(of)[1:])
    steps = [[Rival("zero_step", 900.0, 1.0, zero)], [Rival(second, 3100.0, 1.0, both)], []]
    monkeypatch.setattr(search, "next_step", lambda *_: (tuple(steps.pop(0)), None))
    _take_as_found(monkeypatch)
    monkeypatch.setattr(search, "named_for_nameless", lambda named, *_: named)
    assert search.search(NOTHING).account is (both if taken else zero)


@pytest.mark.parametrize("itself", [True, False], ids=["two that explain themselves", "one that does not"])
def test_what_is_bent_by_another_that_is_missing_leads_to_it(
    itself: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stiffening beside a dashpot and crosstalk was five sixths what it was granted to be off by."""
    of = {
        (): 0.0,
        ("stiffening",): 32e3,
        ("parallel_dashpot",): 10e3,
        ("parallel_dashpot", "stiffening"): 46e3,
    }
    dashpot, stiffening, both = (
        cast(Account, _Evidence(names, of)) for names in (*list(of)[2:0:-1], list(of)[3])
    )
    steps = {
        (): [
            Rival("parallel_dashpot", 10e3, 1.0, dashpot, itself=False),
            Rival("stiffening", 32e3, 1.0, stiffening, itself=False),
        ],
        ("stiffening",): [Rival("parallel_dashpot", 14e3, 1.0, both)],
        ("parallel_dashpot", "stiffening"): [],
    }

    def beside(name: str, refitted: Account, account: Account, *_: object) -> list[Rival]:
        assert (name, refitted, account.names) == ("stiffening", both, ("parallel_dashpot",))
        return [Rival(name, 36e3, 1.0, refitted, itself=itself)]

    monkeypatch.setattr(search, "weighed", lambda account, *_: steps[account.names])
    monkeypatch.setattr(weighing, "left_over", lambda *_: NOTHING_LEFT)
    monkeypatch.setattr(weighing, "as_rival", beside)
    _take_as_found(monkeypatch)
    named = search.search(NOTHING)
    assert named.account is (both if itself else NOTHING)
    assert set(named.rivals) == set(both.names if itself else ())


@pytest.mark.parametrize(
    ("noise", "beside_it", "named"),
    [(870.0, 900.0, True), (880.0, 900.0, False), (880.0, 910.0, True)],
    ids=["more than noise", "no more than noise", "more beside its quick part"],
)
def test_what_slow_noise_of_a_band_explains_is_not_named(
    monkeypatch: pytest.MonkeyPatch, noise: float, beside_it: float, named: bool
) -> None:
    """What comes in each trial anew is to gain 25 nats over nothing in the likelier noise, beside its quick part.

    A drainage of 560 nats beside quick noise of two filters was none: nothing beside that was likelier than it beside
    noise of one.
    """
    slip = cast(Account, _Evidence(("slip",), {("slip",): 900.0}, steps=("slip",)))
    slip_beside = cast(Account, _Evidence(("slip",), {("slip",): beside_it}, steps=("slip",)))
    smooth = cast(Account, _Evidence((), {(): noise}))
    steps = {(): [Rival("slip", 900.0, 1.0, slip)], ("slip",): []}
    monkeypatch.setattr(search, "weighed", lambda account, *_: steps[account.names])
    _take_as_found(monkeypatch)
    monkeypatch.setattr(search, "in_smooth_noise", lambda account: account if account.names else smooth)
    monkeypatch.setattr(search, "beside_quick_noise", lambda *_: slip_beside)
    assert search.search(NOTHING).account is (slip if named else smooth)


@pytest.mark.parametrize(("steps", "named"), [((), True), (("slip",), False)], ids=["a law", "anew"])
def test_for_what_all_trials_share_no_noise_stands(
    monkeypatch: pytest.MonkeyPatch, steps: tuple[str, ...], named: bool
) -> None:
    """A third arm of 318 nats beside a friction was none: nothing beside that in noise of a band gained 593."""
    alone = cast(Account, _Evidence(("slip",), {("slip",): 900.0}, steps=steps))
    in_noise = cast(Account, _Evidence(("slip",), {("slip",): 1170.0}, steps=steps))
    nothing_in_noise = cast(Account, _Evidence((), {(): 980.0}))
    monkeypatch.setattr(search, "in_smooth_noise", lambda a: in_noise if a.names else nothing_in_noise)
    monkeypatch.setattr(search, "beside_quick_noise", lambda account, of: account)
    assert search.is_more_than_noise(alone, NOTHING) is named
    assert not search.is_more_than_noise(replace(alone, steps=("slip",)), NOTHING)


@pytest.mark.parametrize(("pair", "named"), [(1500.0, True), (1000.0, False)], ids=["more", "no more"])
def test_what_is_no_more_than_noise_by_itself_may_be_so_with_one_beside_it(
    monkeypatch: pytest.MonkeyPatch, pair: float, named: bool
) -> None:
    """Noise of a band stood for the breath that was missing beside a crosstalk, and said more than that did."""
    crosstalk, breath = ("position_crosstalk",), ("position_crosstalk", "respiration")
    alone, both = (
        cast(Account, _Evidence(names, {crosstalk: 500.0, breath: pair}, steps=("respiration",)))
        for names in (crosstalk, breath)
    )
    smooth = cast(Account, _Evidence((), {(): 990.0}))
    steps = {
        (): [Rival("position_crosstalk", 500.0, 1.0, alone)],
        crosstalk: [Rival("respiration", 900.0, 1.0, both)],
        breath: [],
    }
    monkeypatch.setattr(search, "weighed", lambda account, *_: steps[account.names])
    _take_as_found(monkeypatch)
    monkeypatch.setattr(search, "in_smooth_noise", lambda account: account if account.names else smooth)
    monkeypatch.setattr(search, "beside_quick_noise", lambda account, of: account)
    assert search.search(NOTHING).account is (both if named else smooth)


def test_laws_are_begun_again_beside_what_was_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the newest was missing they stood for a part of it, and may not find back to what they are."""
    found = {("drift",): 100.0, ("lag",): 100.0, ("drift", "lag"): 900.0}
    account = cast(Account, _Evidence(("drift", "lag"), found))
    itself = cast(Account, _Evidence(("drift", "lag"), {**found, ("drift", "lag"): 950.0}))
    begun = []

    def again(account: Account, name: str, nothing: Account) -> Account:
        begun.append((name, nothing))
        return itself

    monkeypatch.setattr(pruning, "begun_again", again)
    best, adds = pruned(account, Rival("lag", 500.0, 1.0, account), NOTHING)
    assert best is itself
    assert begun == [("drift", NOTHING)]
    assert adds == {"drift": 850.0, "lag": 850.0}


@pytest.mark.parametrize("alike", [True, False], ids=["alike in all trials", "at a moment of its own"])
def test_what_comes_in_each_trial_anew_does_not_stand_for_a_shape_that_all_share(
    record: Callable[..., list[Trial]], alike: bool
) -> None:
    """A pulse is anywhere in its cycle, a slip at any time; what is there in every trial alike is another thing."""
    plans = study_plans(depths_mm=(0.5,), repeats=5, hold_s=2.0)
    fit = fit_baseline(take_in_memory(record(49, plans=plans)).trials)
    random = np.random.default_rng(49)
    trials = []
    for trial in fit.trials:
        start_s, stop_s = trial.span_s(np.flatnonzero(trial.in_phase("retract")))
        # smooth, as what tissue does is: nothing about it begins where a window does
        u = np.clip((trial.time_s - start_s) / (stop_s - start_s), 0.0, 1.0)
        bump = 20.0 * np.sin(np.pi * u) ** 2
        own = np.sin(4.0 * np.pi * trial.time_s + random.uniform(0.0, 2.0 * np.pi))
        trials.append(replace(trial, force_mn=trial.force_mn + (bump if alike else own)))
    account = Account(replace(fit, trials=tuple(trials)).with_states())
    gain = 0.5 * account.fit.cost
    assert stands_for_shape(Account(fit), account, gain) == alike
    # what leaves a shape where it was explains something else
    assert not stands_for_shape(account, account, gain)


def test_a_law_may_leave_more_than_there_was(record: Callable[..., list[Trial]]) -> None:
    """Beside an adhesion that was missing the tissue took a drift of 2 mN up; it gives it back when that is there."""
    effects = "".join(
        f'[[effects]]\nname = "{n}"\n{size}\n'
        for n, size in (("adhesion", "pull_off_mn = 3.0"), ("force_drift", "rate_mn_per_s = 0.2"))
    )
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=4, hold_s=5.0, dwell_s=1.0)
    account = Account(fit_baseline(take_in_memory(record(52, effects, plans)).trials))
    first = considered(account, account, {})[0]
    assert first.name == "adhesion"
    assert first.account.fit.left_mn > 1.1 * account.fit.left_mn


@pytest.mark.parametrize(
    ("of_slip", "newest", "names"),
    [
        (990.0, "parallel_dashpot", ("parallel_dashpot", "slip")),
        (800.0, "parallel_dashpot", ("parallel_dashpot", "zero_step")),
        (990.0, "zero_step", ("parallel_dashpot", "zero_step")),
    ],
    ids=["as good", "worse", "just added"],
)
def test_a_name_stands_in_place_of_what_has_none(
    monkeypatch: pytest.MonkeyPatch, of_slip: float, newest: str, names: tuple[str, ...]
) -> None:
    """A zero that steps explained more than a slip did while a dashpot was missing, and less beside that."""
    dashpot, zero, instead = (
        ("parallel_dashpot",),
        ("parallel_dashpot", "zero_step"),
        ("parallel_dashpot", "slip"),
    )
    of = {dashpot: 300.0, zero: 1000.0, instead: of_slip}
    account, slip = (cast(Account, _Evidence(effects, of)) for effects in (zero, instead))
    asked = []

    def found(others: _Evidence, start: Account, adds: object, among: Sequence[str]) -> tuple[Rival, ...]:
        asked.append((others.names, *among))
        return (Rival("slip", of_slip - 300.0, 1.0, slip),)

    monkeypatch.setattr(exchange, "considered", found)
    monkeypatch.setattr(Rival, "is_another", False)
    rivals = {"zero_step": (Rival("zero_step", 500.0, 1.0, account), Rival("slip", 400.0, 1.0, slip))}
    there = exchange.named_for_nameless(Named(account, rivals, {}), newest, NOTHING)
    assert asked == ([(dashpot, "slip")] if newest != "zero_step" else [])
    assert there.account.names == names
    assert ("slip" in there.rivals) == ("slip" in names)


def test_without_an_event_others_are_looked_for_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside pulses that stood for half of the shifts these were found where the pulses were not."""
    shift, both = ("motion_artefact",), ("motion_artefact", "transient")
    of = {shift: 300.0, both: 1000.0, ("transient",): 100.0}
    account, anew = (
        cast(Account, _Evidence(names, {**of, shift: nats}, steps=names))
        for names, nats in ((both, 300.0), (shift, 1100.0))
    )

    def again(account: Account, name: str, nothing: Account) -> Account:
        return anew if (account.names, name) == (shift, "motion_artefact") else account

    monkeypatch.setattr(pruning, "begun_again", again)
    monkeypatch.setattr(pruning, "own_options", lambda account, name: [])
    monkeypatch.setattr(pruning, "stands_for_shape", lambda *_: False)
    monkeypatch.setattr(pruning, "is_nothing", lambda account, name: False)
    found, adds = pruned(account, Rival("motion_artefact", 400.0, 1.0, account), NOTHING)
    assert (found, adds) == (anew, {})


@pytest.mark.parametrize(("gain", "named"), [(13.0, False), (57.0, True)])
def test_what_is_gained_beside_what_is_foreseen_may_be_what_is_not(
    monkeypatch: pytest.MonkeyPatch, gain: float, named: bool
) -> None:
    """A friction gained 370 nats beside a dashpot that is exact, 13 beside one that may be off, and as much may be left
    over; a drainage beside a stiffening gains 57.
    """

    def account(granted: float, over_nothing: float) -> Account:
        return cast(
            Account,
            SimpleNamespace(
                granted=granted,
                steps={},
                fit=SimpleNamespace(states=(), shared=Shared()),
                gain_over=lambda other: (over_nothing if other is None else gain, 1.0),
                gain_by_itself=lambda other: (gain, 1.0),
                granted_share=lambda nothing: 0.0,
                let_go=lambda: None,
            ),
        )

    monkeypatch.setattr(weighing, "brings_itself", lambda *_: True)
    monkeypatch.setattr(weighing, "explains_itself", lambda *_: True)
    left = cast(LeftOver, SimpleNamespace(of=lambda *_, anew: (13.3, 356.0)))
    refitted, before = account(694.0, 15_820.0), account(901.0, 15_807.0)
    found = weighing.as_rival("coulomb_friction", refitted, before, cast(Account, None), ENOUGH_SHARED, left)
    assert bool(found) == named
