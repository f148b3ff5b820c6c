"""Whole diagnoses on the simulated bench: nothing where nothing is, and the right name where something is."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.mismatch.diagnosis import Diagnosis, diagnose
from analysis.mismatch.intake import take_in_memory
from analysis.mismatch.verdict import make_report
from analysis.recordings.trial import Trial

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans

PLAIN = "seed = 8\n[specimens]\npublished_tissue = true\n"


def _study(effect: str = "", depths: tuple[float, ...] = (0.2, 0.5, 0.8), repeats: int = 4) -> list[Trial]:
    body = f"[[effects]]\n{effect}\n" if effect else ""
    return bench_trials(PLAIN + body, study_plans(depths_mm=depths, repeats=repeats))


def _diagnose(effect: str = "", **options: object) -> Diagnosis:
    return diagnose(take_in_memory(_study(effect)), seed=1, **options)  # type: ignore[arg-type]


def _names(found: Diagnosis) -> list[str]:
    return [c.mechanism.name for c in found.named.chosen]


def test_nothing_is_named_where_nothing_is_and_the_tissue_is_found() -> None:
    found = _diagnose()
    assert _names(found) == []
    assert found.strays == ()
    tissue, spread = found.baseline.simulation.tissue, np.sqrt(np.diag(found.baseline.covariance))
    truth = np.log([120.0, 0.371 * 120.0, 2.279, 0.294 * 120.0, 0.149])
    fitted = np.log([tissue.k0, tissue.k1, tissue.tau1, tissue.k2, tissue.tau2])
    # the converters' offsets and the calibration leave some 1e-4 beside the noise
    assert np.all(np.abs(fitted - truth) < 6 * spread + 3e-4)
    assert "lever_compliance" in {a.mechanism.name for a in found.absorbed}


@pytest.mark.parametrize(
    ("effect", "name", "parameter", "value", "within"),
    [
        ('name = "adhesion"\npull_off_mn = 5.0', "adhesion", "pull_off_mn", 5.0, 0.15),
        ('name = "coulomb_friction"\nforce_mn = 1.0', "coulomb_friction", "force_mn", 1.0, 0.1),
        ('name = "stiffening"\ncoefficient_per_mm = 0.2', "stiffening", "coefficient_per_mm", 0.2, 0.15),
        ('name = "force_lag"\ntime_constant_ms = 3.0', "force_lag", "time_constant_ms", 3.0, 0.1),
    ],
)
def test_a_law_is_named_and_measured(
    effect: str, name: str, parameter: str, value: float, within: float
) -> None:
    found = _diagnose(effect)
    assert _names(found)[0] == name
    addition = next(a for a in found.improved.simulation.additions if a.mechanism.name == name)
    assert addition.values[parameter] == pytest.approx(value, rel=within)
    assert found.confirmed.improved_ms.mean() < found.confirmed.baseline_ms.mean()
    assert np.sqrt(found.confirmed.improved_ms.mean()) == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize(
    ("effect", "names"), [("", []), ('name = "adhesion"\npull_off_mn = 4.0', ["adhesion"])]
)
def test_a_gain_of_its_own_in_every_trial_is_no_mismatch_and_hides_none(
    effect: str, names: list[str]
) -> None:
    noise = "seed = 8\n[specimens]\nsite_variation = 0.0\n[noise]\ngain_jitter = 0.01\n"
    body = f"[[effects]]\n{effect}\n" if effect else ""
    trials = bench_trials(noise + body, study_plans(depths_mm=(0.2, 0.5, 0.8), repeats=4))
    found = diagnose(take_in_memory(trials), seed=1)
    report = make_report(found, baseline="ramp", seed=1, tolerance_mn=0.3)
    assert _names(found) == names
    assert report.verdict == ("named" if names else "no_mismatch")
    assert any("differ from each other" in note for note in report.notes)


@pytest.mark.parametrize(
    ("effect", "name"),
    [
        ('name = "mains_hum"\namplitude_mn = 0.1\nfrequency_hz = 50.0', "mains_hum"),
        ('name = "heartbeat"\namplitude_um = 2.0\nfrequency_hz = 1.2', "heartbeat"),
        ('name = "slip"\ndrop_mn = 1.0', "slip"),
        ('name = "motion_artefact"\nshift_um = 2.0', "motion_artefact"),
    ],
)
def test_what_has_its_own_phase_or_time_is_named(effect: str, name: str) -> None:
    assert _names(_diagnose(effect))[0] == name


@pytest.mark.parametrize(
    ("effect", "name", "parameter", "value"),
    [
        ('name = "motion_artefact"\nshift_um = 30.0\nshare = 0.5', "motion_artefact", "shift_um", 30.0),
        (
            'name = "respiration"\namplitude_um = 30.0\nfrequency_hz = 0.3',
            "respiration",
            "amplitude_um",
            30.0,
        ),
    ],
)
def test_tens_of_micrometres_of_motion_are_named_and_measured(
    effect: str, name: str, parameter: str, value: float
) -> None:
    report = make_report(_diagnose(effect), baseline="ramp", seed=1, tolerance_mn=0.3)
    assert report.verdict in ("named", "one_of")
    assert report.mechanisms[0].name == name
    # the bench's sizes differ by a tenth to a third from trial to trial
    assert report.mechanisms[0].parameters[parameter].value == pytest.approx(value, rel=0.2)


def test_an_effect_beside_a_far_larger_one_is_named_too() -> None:
    both = 'name = "slip"\ndrop_mn = 3.0\n[[effects]]\nname = "adhesion"\npull_off_mn = 3.0'
    assert set(_names(_diagnose(both))) == {"slip", "adhesion"}


def test_the_step_of_the_textbook_is_undone_first() -> None:
    found = diagnose(take_in_memory(_study(), hold_only=True), baseline="step", seed=1)
    assert _names(found) == ["finite_ramp"]
    step, ramp = found.baseline.simulation.tissue, found.improved.simulation.tissue
    assert step.k2 < 0.9 * ramp.k2  # the step takes what relaxed during the ramp for softer skin
    assert ramp.k2 == pytest.approx(0.294 * 120.0, rel=0.02)


@pytest.mark.parametrize(
    ("drops", "words"), [("", "single samples"), ("bit = 10\nshare = 1e-6", "a single sample")]
)
def test_samples_far_off_are_strays(drops: str, words: str) -> None:
    found = _diagnose(f'name = "dropped_bit"\n{drops}')
    assert [s.signal for s in found.strays] == ["force"]
    assert words in found.strays[0].words


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ('name = "gain_step"\nchange = 0.005', "larger or smaller by a share"),
        ('name = "switching_beat"\namplitude_mn = 0.2', "a tone that wanders"),
        ('name = "servo_hunting"\namplitude_um = 0.01\nfrequency_hz = 23.0', "a line at"),
    ],
)
def test_what_is_outside_the_library_is_said_in_words_and_never_the_whole_story(
    effect: str, words: str
) -> None:
    _assert_unknown(_diagnose(effect), words)


@pytest.mark.parametrize(
    ("effect", "verdict"),
    [
        ('name = "cable_drag"\ndrag_mn = 1.0', "unknown"),
        ('name = "coulomb_friction"\nforce_mn = 1.0\nrough = 0.8', "named"),
    ],
)
def test_a_law_that_leaves_a_quarter_of_the_mismatch_is_not_the_whole_story(
    effect: str, verdict: str
) -> None:
    report = make_report(_diagnose(effect), baseline="ramp", seed=1, tolerance_mn=0.3)
    assert report.verdict == verdict
    assert [m.name for m in report.mechanisms] == ["coulomb_friction"]


def test_a_trend_over_the_trials_is_seen_where_order_and_depth_are_not_the_same() -> None:
    in_order = study_plans(depths_mm=(0.2, 0.5, 0.8), repeats=4)
    plans = [in_order[4 * (i % 3) + i // 3] for i in range(12)]
    trials = bench_trials(PLAIN + '[[effects]]\nname = "warming_tissue"\nsoftening = 0.03\n', plans)
    _assert_unknown(diagnose(take_in_memory(trials), seed=1), "order of the trials")


def _assert_unknown(found: Diagnosis, words: str) -> None:
    assert any(words in s.words for s in found.strays)
    report = make_report(found, baseline="ramp", seed=1, tolerance_mn=0.3)
    assert report.verdict == "unknown"
    assert any(words in w.conditions for w in report.mismatch)


def test_another_servo_is_named_by_the_recorded_position() -> None:
    found = _diagnose('name = "servo_bandwidth"\nnatural_frequency_rad_s = 4600.0')
    report = make_report(found, baseline="ramp", seed=1, tolerance_mn=0.3)
    assert report.verdict == "named"
    assert [m.name for m in report.mechanisms] == ["servo_bandwidth"]
    frequency = report.mechanisms[0].parameters["natural_frequency_rad_s"]
    assert frequency.value == pytest.approx(4600.0, abs=4 * frequency.se)


def test_noise_that_wanders_is_no_event() -> None:
    wandering = "[noise]\nwander_mn_rms = 0.15\nwander_time_s = 4.0\n"
    trials = bench_trials(PLAIN + wandering, study_plans(depths_mm=(0.3, 0.6), repeats=4))
    found = diagnose(take_in_memory(trials), seed=1)
    assert _names(found) == []
    assert found.strays == ()


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
    from dataclasses import replace

    trial = _study(depths=(0.4,), repeats=1)[0]
    with pytest.raises(BadInputError, match=words) as refused:
        take_in_memory([replace(trial, **spoil(trial))])
    assert "\n" not in str(refused.value)


def test_trials_of_two_rigs_are_refused() -> None:
    from dataclasses import replace

    one, two = _study(depths=(0.4,), repeats=2)
    faster = replace(two, sample_rate_hz=10_000.0)
    with pytest.raises(BadInputError, match="different rigs"):
        take_in_memory([one, faster])


def test_a_law_at_the_end_of_its_range_is_not_the_right_one() -> None:
    found = _diagnose('name = "force_lag"\ntime_constant_ms = 3.0')
    assert make_report(found, baseline="ramp", seed=1, tolerance_mn=0.3).verdict == "named"
    # at a limit a fit knows no uncertainty
    pinned = replace(found.improved, covariance=np.zeros_like(found.improved.covariance))
    named = replace(found.named, fits=(*found.named.fits[:-1], pinned))
    report = make_report(replace(found, named=named), baseline="ramp", seed=1, tolerance_mn=0.3)
    assert report.verdict == "unknown"
    assert any("Force lag ended at the limit of its range" in note for note in report.notes)
