"""Whole diagnoses on the simulated bench: nothing where nothing is, and the right name where something is."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.mismatch.diagnosis import Diagnosis, diagnose
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.inexactness import (
    INEXACT_KIND,
    inexact_columns,
    inexact_names,
    inexact_precision,
    law_effects,
    sample_columns,
    with_inexactness,
)
from analysis.mismatch.evidence.shares import even_shares
from analysis.mismatch.fit.baseline import fit_baseline, noise_left
from analysis.mismatch.fit.noise import FASTEST_SLOW_S
from analysis.mismatch.fit.slow_noise import change_in_a_second
from analysis.mismatch.levels import ENOUGH_OWN, INEXACT
from analysis.mismatch.locate.remainder import unexpected
from analysis.mismatch.locate.windows import own_evidence
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.name.event_scan import at_rest, candidate_times, within
from analysis.mismatch.name.finding import weighed
from analysis.mismatch.name.rivals import Rival
from analysis.mismatch.report.contents import Report
from analysis.mismatch.report.verdict import kept_findings, make_report
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import PHASE_NAMES, Trial
from analysis.simulation.mechanism import library

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import rigid_plan, study_plans

LIVING = (
    "seed = {seed}\n[specimens]\npublished_tissue = false\nfinger_variation = 0.1\nsite_variation = 0.1\n"
)
SHORT = {"hold_s": 3.0, "dwell_s": 0.6}
RUBS = 'name = "coulomb_friction"\nforce_mn = 1.0'


def _study(
    effect: str = "", depths: tuple[float, ...] = (0.3, 0.5, 0.8), repeats: int = 4, seed: int = 8
) -> list[Trial]:
    body = f"[[effects]]\n{effect}\n" if effect else ""
    return bench_trials(
        LIVING.format(seed=seed) + body, study_plans(depths_mm=depths, repeats=repeats, **SHORT)
    )


def _diagnosed(effect: str) -> Diagnosis:
    return diagnose(take_in_memory(_study(effect)), seed=1)


_diagnose = cache(_diagnosed)
"""What several tests ask about one study costs half a minute once."""


def _report(found: Diagnosis) -> Report:
    return make_report(found, baseline="ramp", seed=1, tolerance_mn=0.3)


def test_nothing_is_named_on_living_skin_where_nothing_is_and_its_scatter_is_found() -> None:
    found = _diagnose("")
    report = _report(found)
    assert report.verdict == "no_mismatch"
    assert report.mechanisms == ()
    # sites scatter by 10 %; twelve of them know that to a fifth, far from 0 and from the weak prior
    scatter = np.sqrt(found.improved.fit.population.covariance[0, 0])
    assert 0.04 < scatter < 0.25
    assert report.heldout.noise_floor_mn == pytest.approx(0.3, rel=0.03)
    assert "lever_compliance" in {a.mechanism.name for a in found.absorbed}


@pytest.mark.parametrize(
    ("amplitude_um", "frequency_hz"), [(2.7, 19.0), pytest.param(2.0, 24.0, marks=pytest.mark.slow)]
)
def test_what_is_left_of_a_tone_is_unknown_and_somewhere(amplitude_um: float, frequency_hz: float) -> None:
    """A drive that hunts sways about its tone; no window of a trial tells that by itself, and all of them do."""
    hunting = f'name = "servo_hunting"\namplitude_um = {amplitude_um}\nfrequency_hz = {frequency_hz}'
    found = _diagnose(hunting)
    assert found.baseline.fit.noise.bands
    assert found.remainder.lasts
    report = _report(found)
    assert report.verdict == "unknown"
    assert report.mismatch


@pytest.mark.parametrize(("pull_off_mn", "named"), [(0.0, []), (4.0, ["adhesion"])])
@pytest.mark.parametrize("n", [1, 2])
def test_one_or_two_trials_are_weighed_by_the_noise_that_they_have_at_rest(
    n: int, pull_off_mn: float, named: list[str]
) -> None:
    """Noise that stays for 25 ms and wanders for seconds hides no pull that is over in ten, nor is it an effect."""
    noise = (
        "[noise]\nforce_mn_rms = 0.25\ncorrelated_share = 0.4\ncorrelation_ms = 25.0\n"
        "wander_mn_rms = 0.2\nwander_time_s = 2.0\n"
    )
    clings = f'[[effects]]\nname = "adhesion"\npull_off_mn = {pull_off_mn}\n'
    plans = study_plans(depths_mm=(0.3, 0.6), repeats=1, **SHORT)[:n]
    trials = bench_trials(LIVING.format(seed=12) + noise + clings * bool(named), plans)
    report = _report(diagnose(take_in_memory(trials), seed=1))
    assert report.verdict == ("named" if named else "no_mismatch")
    assert [m.name for m in report.mechanisms] == named
    for m in report.mechanisms:
        found = m.parameters["pull_off_mn"]
        assert abs(found.value - pull_off_mn) < 4.0 * found.se < 2.0


@pytest.mark.parametrize(
    ("effect", "name", "parameter", "value", "within"),
    [
        (RUBS, "coulomb_friction", "force_mn", 1.0, 0.2),
        ('name = "force_drift"\nrate_mn_per_s = 0.2', "force_drift", "rate_mn_per_s", 0.2, 0.15),
        # without it the tissue's second arm becomes a dashpot, and a third arm seems to be missing
        pytest.param(
            'name = "parallel_dashpot"\ncoefficient_mn_s_per_mm = 0.8',
            "parallel_dashpot",
            "coefficient_mn_s_per_mm",
            0.8,
            0.15,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_an_effect_is_named_and_measured_on_living_skin(
    effect: str, name: str, parameter: str, value: float, within: float
) -> None:
    report = _report(_diagnose(effect))
    assert report.verdict in ("named", "one_of")
    assert [m.name for m in report.mechanisms] == [name]
    assert report.mechanisms[0].parameters[parameter].value == pytest.approx(value, rel=within)
    first = report.mechanisms[0]
    # at one speed both frictions are alike, and so are a slip and a shift of a surface that is held
    assert first.probability >= max([0.5, *first.alternative_probabilities.values()])
    assert report.heldout.improved_rms_mn < report.heldout.baseline_rms_mn


@pytest.mark.slow
def test_a_slip_is_named_or_stands_beside_the_shift_that_it_looks_like() -> None:
    report = _report(_diagnose('name = "slip"\ndrop_mn = 3.0\ntime_s = 3.0'))
    (found,) = report.mechanisms
    assert "slip" in (found.name, *found.alternatives)
    assert {found.name, *found.alternatives} <= {"slip", "motion_artefact"}


@pytest.mark.xfail(
    strict=True, reason="a tissue that is free in every trial takes the ramp up; only its motion tells"
)
def test_the_step_of_the_textbook_is_undone_first() -> None:
    found = diagnose(take_in_memory(_study(), hold_only=True), baseline="step", seed=1)
    report = make_report(found, baseline="step", seed=1, tolerance_mn=0.3)
    assert [m.name for m in report.mechanisms] == ["finite_ramp"]
    step, ramp = report.baseline_parameters["k2_mn_per_mm"], report.improved_parameters["k2_mn_per_mm"]
    assert step.value < 0.9 * ramp.value  # the step takes what relaxed during the ramp for softer skin


def test_a_hum_is_a_line_that_is_taken_out_and_named() -> None:
    report = _report(_diagnose('name = "mains_hum"\namplitude_mn = 0.3\nfrequency_hz = 50.0'))
    assert [m.name for m in report.mechanisms] == ["mains_hum"]
    assert report.mechanisms[0].parameters["amplitude_mn"].value == pytest.approx(0.3, rel=0.15)


def test_a_servo_that_lags_less_than_the_rig_file_s_is_named() -> None:
    # no output that steps and no converter lags less than it should
    text = 'name = "servo_bandwidth"\nnatural_frequency_rad_s = 6300.0\ndamping_ratio = 1.06'
    report = _report(_diagnose(text))
    assert [m.name for m in report.mechanisms] == ["servo_bandwidth"]
    found = report.mechanisms[0].parameters["natural_frequency_rad_s"]
    assert abs(2.0 * report.mechanisms[0].parameters["damping_ratio"].value / found.value - 3.365e-4) < 4e-5


@pytest.fixture(scope="module")
def rubbing() -> Diagnosis:
    """A bench with a dry bearing."""
    return _diagnose(RUBS)


def test_a_law_that_acts_a_little_late_is_expected_to(rubbing: Diagnosis) -> None:
    fit = rubbing.improved.exact.fit
    trial, (effect, *_) = fit.trials[0], law_effects(fit, 0)
    late = np.interp(trial.time_s - 1e-4, trial.time_s, effect) - effect
    columns = sample_columns(trial, law_effects(fit, 0))
    of_it = np.linalg.lstsq(columns, late, rcond=None)[0]
    assert np.linalg.norm(late - columns @ of_it) < 0.2 * np.linalg.norm(late)
    assert np.all(np.abs(of_it) < 0.3e-3 * trial.sample_rate_hz)


@pytest.mark.parametrize("alike", [True, False], ids=["in all trials alike", "in every trial its own way"])
def test_what_a_law_may_leave_in_all_trials_alike_is_no_evidence(rubbing: Diagnosis, *, alike: bool) -> None:
    """A seventh more friction in the whole way back: what is left beside that is noise, if all trials agree on it."""
    account = rubbing.improved.exact
    trials = []
    for j, trial in enumerate(account.fit.trials):
        (effect,) = law_effects(account.fit, j)
        share = 0.15 if alike else 0.15 * (-1) ** j
        trials.append(replace(trial, force_mn=trial.force_mn + share * effect * trial.in_phase("retract")))
    off = replace(account, fit=replace(account.fit, trials=tuple(trials)))
    assert own_evidence(off.fit)[0] > ENOUGH_OWN
    assert (own_evidence(unexpected(off))[0] > ENOUGH_OWN) is not alike


def test_a_law_may_go_another_way_in_waves_by_a_third_of_what_it_is_off() -> None:
    """A tissue that stiffens as exp(d) is no 1 + b d: in the ramp its force waves by a few per cent about that."""
    fit = fit_baseline(take_in_memory(_study()).trials)
    trial = fit.trials[-1]
    ramp = trial.in_phase("ramp")
    d = np.clip((trial.position_mm - trial.position_mm[ramp][0]) / np.ptp(trial.position_mm[ramp]), 0.0, 1.0)
    effect = 60.0 * d**2
    waves = 0.03 * effect * np.cos(4.0 * np.pi * d) * ramp
    names = ["stiffening"]
    columns, precision = (
        inexact_columns(trial, [effect]),
        inexact_precision(even_shares(names, INEXACT), names),
    )
    H = columns.T @ (columns * trial.counts[:, None]) + 0.2**2 * np.diag(precision)
    of_it = np.linalg.solve(H, columns.T @ (trial.counts * waves))
    assert np.linalg.norm(waves - columns @ of_it) < 0.25 * np.linalg.norm(waves)
    assert np.all(np.abs(of_it) * np.sqrt(precision) < 2.0)


def test_what_a_trial_s_law_may_be_off_by_holds_no_more_than_itself(rubbing: Diagnosis) -> None:
    exact = rubbing.improved.exact.fit
    names = inexact_names(exact)
    fit = with_inexactness(exact, even_shares(names, INEXACT), names)
    own = [shape.shape for state in fit.states for shape in state.shapes if shape.kind == INEXACT_KIND]
    assert own
    assert all(shape.base is None for shape in own)


def test_what_a_law_leaves_over_is_no_slow_noise(rubbing: Diagnosis) -> None:
    """Of a bearing that is another one in every trial; the noise of the bench is white."""
    exact, random = rubbing.improved.exact, np.random.default_rng(5)
    trials = []
    for j, trial in enumerate(exact.fit.trials):
        off = 0.2 * random.normal() * law_effects(exact.fit, j)[0]
        at_s = np.arange(len(trial.full_force_mn)) / trial.sample_rate_hz
        full = trial.full_force_mn + np.interp(at_s, trial.time_s, off)
        trials.append(replace(trial, force_mn=trial.force_mn + off, full_force_mn=full.astype(np.float32)))
    account = Account(replace(exact.fit, trials=tuple(trials))).reweighed()
    assert account.inexact
    assert change_in_a_second(account.fit.noise.slower_from(FASTEST_SLOW_S)) < 0.02
    assert change_in_a_second(noise_left(account.exact.fit)) > 0.1


def test_steps_are_looked_for_at_rest_only(rubbing: Diagnosis) -> None:
    trial = rubbing.improved.fit.trials[0]
    times = within(at_rest(trial, ("dwell", "hold")), trial.time_s)
    phases = {PHASE_NAMES[code] for code in trial.phase[np.isin(trial.time_s, times)]}
    assert phases == {"dwell", "hold"}
    for phase in phases:
        every = trial.time_s[trial.in_phase(phase)]
        assert 0.02 < (every[-1] - times[times <= every[-1]][-1]) / (every[-1] - every[0]) < 0.05
    assert set(candidate_times(trial, ("dwell", "hold"))) <= set(times)


def test_a_law_of_no_size_is_nothing() -> None:
    law = next(t for t in templates(take_in_memory(_study()).trials) if t.name == "adhesion").as_law(1.0)
    assert not law.is_nothing
    assert replace(law, values=law.mechanism.null).is_nothing


def test_what_laws_are_expected_to_leave_over_is_hardly_a_name(rubbing: Diagnosis) -> None:
    mechanism = library()["arm_inertia"]
    said = [
        weighed(mechanism, [Rival("arm_inertia", 100.0, 5.0, rubbing.improved, left)], ())[0]
        for left in (0.0, 10.0, 100.0, 1000.0)
    ]
    assert said == sorted(said, reverse=True)
    assert said[0] > 0.999
    assert said[2] == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_names_that_explain_less_than_is_left_are_not_said(rubbing: Diagnosis) -> None:
    assert kept_findings(rubbing)
    much = replace(rubbing.remainder, common=1e3, share=0.9)
    beside = replace(rubbing, remainder=much)
    assert kept_findings(beside) == ()
    report = _report(beside)
    assert report.verdict == "unknown"
    assert report.mechanisms == ()
    assert report.improved_parameters == report.baseline_parameters
    assert any("friction, which would explain 10 % of it" in note for note in report.notes)
    # a law that is right to a third leaves a tenth: what leaves a fifth is the nearest law to something else
    fifth, twentieth = (replace(rubbing.remainder, common=1e3, share=s) for s in (0.2, 0.05))
    assert kept_findings(replace(rubbing, remainder=fifth)) == ()
    assert kept_findings(replace(rubbing, remainder=twentieth)) == rubbing.findings
    # nor does what was found without a name explain anything
    assert kept_findings(replace(rubbing, nameless=replace(rubbing.nameless, share=0.2))) == ()
    # right to a third: what the law gains by being granted to be off it does not explain
    assert kept_findings(replace(rubbing, remainder=replace(rubbing.remainder, inexact=0.2))) == ()
    pinned = replace(rubbing, findings=tuple(replace(f, at_bound=True) for f in rubbing.findings))
    assert _report(pinned).verdict == "unknown"
    assert any("limit of its range" in note for note in _report(pinned).notes)


def test_what_ended_at_a_bound_counts_as_what_has_no_name(
    rubbing: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    pinned = tuple(replace(f, at_bound=True) for f in rubbing.findings)
    # beside what is right, a little of it leaves the verdict, and much does not
    little, much = (replace(rubbing.nameless, share=0.01, rms_mn=mn) for mn in (0.05, 2.0))
    beside = replace(rubbing, findings=(*rubbing.findings, *pinned))
    assert _report(replace(beside, nameless=little)).verdict == "named"
    assert _report(replace(beside, nameless=much)).verdict == "unknown"
    # and it is all there is where nothing else was found
    monkeypatch.setattr("analysis.mismatch.diagnosis.findings", lambda *_: pinned)
    monkeypatch.setattr("analysis.mismatch.diagnosis.search", lambda _: rubbing.named)
    alone = _diagnosed(RUBS)
    assert alone.nameless.share == pytest.approx(1.0, abs=0.02)
    assert _report(alone).verdict == "unknown"
    assert any("limit of its range" in note for note in _report(alone).notes)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t: {"force_v": np.zeros_like(t.force_v)}, "same in every sample"),
        (lambda t: {"position_v": np.full_like(t.position_v, 1.0)}, "position never moves"),
        (lambda t: {"phases": tuple(p for p in t.phases if p.name != "hold")}, "phase hold missing"),
        (lambda t: {"kind": "force_calibration"}, "nothing to diagnose"),
    ],
)
def test_what_says_nothing_is_refused_in_one_sentence(spoil: Callable[[Trial], dict], words: str) -> None:
    trial = _study(depths=(0.4,), repeats=1)[0]
    with pytest.raises(BadInputError, match=words) as refused:
        take_in_memory([replace(trial, **spoil(trial))])
    assert "\n" not in str(refused.value)


def test_trials_of_two_rigs_are_refused() -> None:
    one, two = _study(depths=(0.4,), repeats=2)
    faster = replace(two, sample_rate_hz=10_000.0)
    with pytest.raises(BadInputError, match="different rigs"):
        take_in_memory([one, faster])


def test_a_lever_that_bends_is_named_where_a_block_of_unknown_stiffness_was_pressed() -> None:
    """In series its compliance and the block's add up; on the block the position's noise is a force."""
    plans = study_plans(depths_mm=(0.3, 0.6), **SHORT)
    blocks = [rigid_plan(depth_mm=0.01 + 3e-4 * i, ramp_speed_mm_s=5.0, **SHORT) for i in range(10)]
    bent = '[[effects]]\nname = "lever_compliance"\ncompliance_um_per_mn = 0.5\n'
    trials = bench_trials(LIVING.format(seed=8) + bent, [*blocks, *plans])
    unknown = [
        replace(t, specimen=replace(t.specimen, target_stiffness_mn_per_mm=None))
        if t.kind == "rigid_target"
        else t
        for t in trials
    ]
    report = _report(diagnose(take_in_memory(unknown), seed=1))
    assert report.verdict == "named"
    assert [m.name for m in report.mechanisms] == ["lever_compliance"]
    found = report.mechanisms[0].parameters["compliance_um_per_mn"]
    assert abs(found.value - 0.5) < 3.0 * found.se < 0.3
