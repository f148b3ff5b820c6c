"""Rhythms of the body: their covariance against a dense one, what is found of them, and what is left open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.shares import even_shares
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.contacts import contacts_begun_anew
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.rhythms import followed, with_rhythm
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.fit.whitener import Whitener, surprise_of
from analysis.mismatch.model.effects import simulate, tissue_force, touches
from analysis.mismatch.model.rhythm import Rhythm, overtones, waves
from analysis.mismatch.name import oscillations
from analysis.mismatch.name.events import step_shape
from analysis.mismatch.name.options import own_options
from analysis.mismatch.name.oscillations import (
    LOWEST_HZ,
    WANDERS,
    OscillationScan,
    hat_waves,
    name_of,
    scan_oscillations,
    tuned_hz,
    with_oscillation,
)
from analysis.mismatch.name.own_sizes import WouldDo, own_sizes, would_do
from analysis.mismatch.name.weighing import is_nothing
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from analysis.simulation.response import Steps
from sim_hardware.concealment.offline import study_plans

NOISE = NoiseModel(0.3, ((0.02, 0.1),))
BREATH = '[[effects]]\nname = "respiration"\namplitude_um = 20.0\nfrequency_hz = 0.25\n'


def _cells(n: int, seed: int = 2) -> SimpleNamespace:
    rng = np.random.default_rng(seed)
    counts = rng.choice([8.0, 64.0], n)
    time_s = (np.cumsum(counts) - counts / 2) / 8000.0
    used = np.ones(n, dtype=bool)
    used[: n // 10] = False
    return SimpleNamespace(
        by_position=(),
        louder=None,
        fitted=used,
        time_s=time_s,
        counts=counts,
        widths_s=counts / 8000.0,
        fitted_widths_s=np.unique(counts[used] / 8000.0, return_inverse=True),
        steps=Steps.between(time_s),
    )


def _rhythm(cells: SimpleNamespace, hz: float, coherent_s: float) -> Rhythm:
    touching = cells.time_s > 0.3 * cells.time_s[-1]
    return Rhythm("tremor", hz, 0.003, coherent_s, 0.5 * waves(cells, hz) * touching[:, None])


def _dense(cells: SimpleNamespace, rhythm: Rhythm, row: int | None = None) -> np.ndarray:
    """Covariance of a rhythm's force between cells, or of the amplitudes of one wave with it."""
    apart_s = np.abs(cells.time_s[:, None] - cells.time_s)
    f, tau_s = rhythm.force_mn.T, rhythm.waves_coherent_s
    if row is not None:
        return np.exp(-apart_s / tau_s[row]) * f[row]
    return sum(np.exp(-apart_s / tau) * np.outer(w, w) for w, tau in zip(f, tau_s, strict=True))


def test_a_rhythm_is_weighed_and_found_as_by_dense_matrices() -> None:
    cells = _cells(80)
    rhythms = [_rhythm(cells, 9.0, 0.15), _rhythm(cells, 1.2, 3.0)]
    whitener, used = Whitener(cells, NOISE, rhythms), cells.fitted
    columns = np.random.default_rng(3).normal(size=(80, 3))
    # the whitener without rhythms tells what the noise alone makes: K = W^-1 W^-T
    alone = np.linalg.inv(Whitener(cells, NOISE)(np.eye(80))[:, used])
    K = alone @ alone.T + sum(_dense(cells, r) for r in rhythms)[np.ix_(used, used)]
    white = whitener(columns)
    np.testing.assert_allclose(
        white.T @ white, columns[used].T @ np.linalg.solve(K, columns[used]), rtol=1e-8
    )
    assert whitener.log_determinant == pytest.approx(np.linalg.slogdet(K)[1], rel=1e-10)
    found = whitener.amplitudes(columns[:, 0])
    for rhythm, of_it in zip(rhythms, found, strict=True):
        for wave in range(of_it.shape[1]):
            expected = _dense(cells, rhythm, wave)[:, used] @ np.linalg.solve(K, columns[used, 0])
            np.testing.assert_allclose(of_it[:, wave], expected, atol=1e-10)
    apart_s = np.abs(cells.time_s[:, None] - cells.time_s)
    for rhythm in (replace(r, amplitudes=a) for r, a in zip(rhythms, found, strict=True)):
        each = zip(rhythm.amplitudes.T, rhythm.waves_coherent_s, strict=True)
        expected = sum(a @ np.linalg.solve(np.exp(-apart_s / tau_s), a) for a, tau_s in each)
        assert surprise_of(cells, rhythm) == pytest.approx(expected, rel=1e-8)


def test_overtones_of_what_is_a_little_off_are_off_by_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pulses 3 % quicker than looked for are likelier so than where all waves forget themselves alike."""
    cells = _cells(1500, seed=7)
    random = np.random.default_rng(8)
    force_mn = _rhythm(cells, 1.2 * 1.03, 1.0).force_mn
    recorded = 5.0 * force_mn @ random.standard_normal(force_mn.shape[1])
    recorded[cells.fitted] += Whitener(cells, NOISE).drawn(random)

    def deviance(coherent_s: float) -> float:
        rhythm = _rhythm(cells, 1.2, coherent_s)
        whitener = Whitener(cells, NOISE, [replace(rhythm, force_mn=5.0 * rhythm.force_mn)])
        left = whitener(recorded)
        return float(left @ left) + whitener.log_determinant

    times_s = np.geomspace(1.0, 100.0, 15)
    sooner = min(map(deviance, times_s))
    alike = property(lambda rhythm: np.full(2 * len(overtones(rhythm.frequency_hz)), rhythm.coherent_s))
    monkeypatch.setattr(Rhythm, "waves_coherent_s", alike)
    assert sooner < min(map(deviance, times_s)) - 30.0


def test_a_rhythm_is_looked_for_by_name_in_its_own_band(record: Callable[..., list[Trial]]) -> None:
    """A tremor that says more hides no breath, and a frequency costs what it costs where all are looked at."""
    tremor = '[[effects]]\nname = "tremor"\namplitude_um = 15.0\nfrequency_hz = 9.0\n'
    plans = study_plans(depths_mm=(0.5,), repeats=4, hold_s=6.0, dwell_s=0.4)
    fit = Account(fit_baseline(take_in_memory(record(58, BREATH + tremor, plans)).trials)).quick().fit
    most = scan_oscillations(fit)
    found = scan_oscillations(fit, "respiration")
    assert {most.name, found.name} == {"tremor", "respiration"}
    assert 0.15 < found.frequency_hz < 0.35
    np.testing.assert_array_equal(found.grid_hz, most.grid_hz)
    named = scan_oscillations(fit, most.name)
    assert named.frequency_hz == most.frequency_hz
    none = scan_oscillations(fit, "slip")
    assert none.evidence == -np.inf


def test_a_rhythm_is_named_by_where_it_is_and_not_by_where_it_was_looked_for(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Places lie a seventh apart at 1 Hz, and a pulse of 1.0 Hz was found from the one at 0.93, which is no pulse's."""
    monkeypatch.setattr(oscillations, "frequency_grid", lambda *_: np.array([0.78, 0.93]))
    pulse = '[[effects]]\nname = "heartbeat"\namplitude_um = 12.0\nfrequency_hz = 1.0\n'
    plans = study_plans(depths_mm=(0.5,), repeats=4, hold_s=6.0, dwell_s=0.4)
    quick = Account(fit_baseline(take_in_memory(record(68, pulse, plans)).trials)).quick()
    found = scan_oscillations(quick.fit)
    assert (found.name, found.frequency_hz) == ("heartbeat", 0.93)


def test_a_rhythm_is_tuned_no_lower_than_one_is_looked_for(record: Callable[..., list[Trial]]) -> None:
    """What drifts draws the slowest wave that is tried to where it is none: a breath of 0.19 Hz was beyond its band."""
    slower = '[[effects]]\nname = "respiration"\namplitude_um = 15.0\nfrequency_hz = 0.085\n'
    plans = study_plans(depths_mm=(0.5,), repeats=4, hold_s=6.0, dwell_s=0.4)
    fit = fit_baseline(take_in_memory(record(69, slower, plans)).trials)
    tuned = tuned_hz(fit, OscillationScan(100.0, LOWEST_HZ, 0.01, "", np.zeros(0)))
    assert min(tuned.values()) == pytest.approx(LOWEST_HZ * (1.0 - WANDERS))
    assert {name_of(hz) for hz in tuned.values()} == {"respiration"}


def test_what_is_left_open_is_as_large_as_what_is_not_found() -> None:
    """Drawn rhythms in drawn noise are missed by as much as the draws of what is left open say.

    Each of both means of 200 draws is right to 5 %: a ratio beyond 1.3 comes by chance in fewer than one of 10^5.
    """
    cells = _cells(400, seed=5)
    rhythm = _rhythm(cells, 9.0, 0.15)
    whitener = Whitener(cells, NOISE, [rhythm])
    random = np.random.default_rng(6)
    L = np.linalg.cholesky(_dense(cells, rhythm) + 1e-12 * np.eye(400))
    missed, said = [], []
    for _ in range(200):
        force = L @ random.standard_normal(400)
        recorded = force.copy()
        recorded[cells.fitted] += Whitener(cells, NOISE).drawn(random)
        found = np.sum(rhythm.force_mn * whitener.amplitudes(recorded)[0], axis=1)
        missed.append(np.mean((force - found) ** 2))
        said.append(np.mean(np.sum(rhythm.force_mn * whitener.left_open(random)[0], axis=1) ** 2))
    assert 1 / 1.3 < np.mean(said) / np.mean(missed) < 1.3


def test_a_surface_is_followed_through_touch_and_release(record: Callable[..., list[Trial]]) -> None:
    """A band of tremor much larger than skin has is found back from a force in which it is no line."""
    fit = fit_baseline(take_in_memory(record(48)).trials)
    trial, state = fit.trials[0], fit.states[0]
    random = np.random.default_rng(49)
    hz = 9.0 * random.uniform(0.97, 1.03, 10)
    phases = 2 * np.pi * (np.multiply.outer(trial.time_s, hz) + random.uniform(size=10))
    surface_mm = 0.03 / np.sqrt(10) * np.cos(phases).sum(axis=1)
    force_mn = simulate(trial, state, fit.shared, {"surface": surface_mm})
    moved = replace(
        trial, force_mn=force_mn + 0.2 * random.standard_normal(len(force_mn)) / np.sqrt(trial.counts)
    )
    there = with_rhythm(moved, state, fit.shared, Rhythm("tremor", 9.0, 0.02, 0.5))
    whitener = Whitener(moved, fit.noise, there.rhythms)
    found, weighed = followed(moved, there, fit.shared, whitener)
    touching = touches(moved, found, fit.shared)
    off = (found.rhythms[0].found_mm - surface_mm)[touching]
    assert np.std(off) < 0.05 * np.std(surface_mm[touching])
    # as what is left, and no more, is noise
    left = weighed(moved.force_mn - simulate(moved, found, fit.shared))
    assert float(left @ left) < 1.2 * len(left)
    first = whitener(moved.force_mn - simulate(moved, there, fit.shared))
    assert float(left @ left) < float(first @ first)
    # and nothing of it is the tissue's
    alone = tissue_force(moved, state, fit.shared)
    np.testing.assert_array_equal(tissue_force(moved, found, fit.shared), alone)


def test_a_rhythm_stiffens_no_tissue(record: Callable[..., list[Trial]]) -> None:
    """A tremor of known size on tissues that are known: their stiffness comes out within 1 %, pass after pass.

    Where the simulation follows the surface that was found, a stiffer tissue explains a part of the rhythm: half as
    stiff again it becomes so within these passes.
    """
    fit = fit_baseline(take_in_memory(record(48)).trials)
    random = np.random.default_rng(50)
    rhythm = Rhythm("tremor", 9.0, 0.01, 0.4)
    trials, states = [], []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        forget = np.exp(-np.diff(trial.time_s) / rhythm.coherent_s)
        amplitudes = [random.standard_normal(2)]
        for keep in forget:
            amplitudes.append(keep * amplitudes[-1] + np.sqrt(1.0 - keep**2) * random.standard_normal(2))
        waves_mm = rhythm.size_mm * waves(trial, rhythm.frequency_hz)[:, :2]
        surface_mm = np.sum(waves_mm * amplitudes, axis=1)
        force_mn = simulate(trial, state, fit.shared, {"surface": surface_mm})
        force_mn = force_mn + 0.2 * random.standard_normal(len(force_mn)) / np.sqrt(trial.counts)
        trials.append(replace(trial, force_mn=force_mn))
        states.append(with_rhythm(trials[-1], state, fit.shared, rhythm))
    there = replace(fit, trials=tuple(trials), states=tuple(states)).weighed_by(NoiseModel(0.2))
    for _ in range(6):
        there = there.with_population(1)
    stiffness = [[np.exp(s.log_tissue[[0, 1, 3]]).sum() for s in fitted.states] for fitted in (fit, there)]
    assert np.all(np.abs(np.log(stiffness[1]) - np.log(stiffness[0])) < 0.01)


@pytest.mark.parametrize(
    ("middle_hz", "half"),
    [(1.2, 0.03), (7.0, 0.05), (11.0, 0.05)],
)
def test_a_rhythm_of_a_narrow_band_is_found_where_it_is_looked_for(
    record: Callable[..., list[Trial]], middle_hz: float, half: float
) -> None:
    """Twenty sines within 5 % of a tremor, 3 % of a pulse."""
    trials = record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=6.0, dwell_s=0.4))
    trial = take_in_memory(trials).trials[0]
    random = np.random.default_rng(46)
    hz = middle_hz * random.uniform(1 - half, 1 + half, 20)
    phases = 2 * np.pi * (np.multiply.outer(trial.time_s, hz) + random.uniform(size=20))
    blur = np.sinc(np.multiply.outer(trial.counts / trial.sample_rate_hz, hz))
    surface_mm = (np.cos(phases) * blur).sum(axis=1)
    columns = hat_waves(trial, middle_hz)
    left = surface_mm - columns @ np.linalg.lstsq(columns, surface_mm)[0]
    assert np.std(left) < 0.1 * np.std(surface_mm)


def _oscillating(
    record: Callable[..., list[Trial]], name: str, hz: float, repeats: int, hold_s: float, effects: str = ""
) -> StudyFit:
    """Trials of a skin that rests, fitted as if a scan had found a rhythm of this frequency."""
    plans = study_plans(depths_mm=(0.5,), repeats=repeats, hold_s=hold_s, dwell_s=0.4)
    trials = record(45, effects, plans)
    return _as_scanned(fit_baseline(take_in_memory(trials).trials), name, hz)


def _as_scanned(fit: StudyFit, name: str, hz: float, size_mm: float = 0.01) -> StudyFit:
    scan = OscillationScan(100.0, hz, size_mm, name, np.zeros(0))
    return with_oscillation(fit, scan)


@pytest.mark.parametrize(("hz", "is_band"), [(0.3, False), (1.2, True), (8.0, True)])
def test_what_goes_round_often_in_a_trial_is_a_band(
    record: Callable[..., list[Trial]], hz: float, is_band: bool
) -> None:
    """A pulse is known by its cycles, ten in a trial; a breath has a few shapes of its own in each."""
    there = _oscillating(record, "oscillation", hz, repeats=3, hold_s=6.0)
    assert all(bool(s.rhythms) is is_band for s in there.states)
    assert all(bool(len(s.shapes)) is not is_band for s in there.states)


def test_a_slip_does_not_draw_the_breath_of_its_trial_away(record: Callable[..., list[Trial]]) -> None:
    """A cycle or two a trial say little of their rate; where skin slips, which is still unknown, it is no other."""
    plans = study_plans(depths_mm=(0.5,), repeats=8, hold_s=6.0, dwell_s=0.4)
    trials = list(take_in_memory(record(45, BREATH, plans)).trials)
    for j in (1, 6):
        held_s = trials[j].time_s[trials[j].in_phase("hold")]
        lost_mn = 5.0 * step_shape(trials[j], float(np.median(held_s)), 0.006) * ~trials[j].retracting
        trials[j] = replace(trials[j], force_mn=trials[j].force_mn - lost_mn)
    there = _as_scanned(Account(fit_baseline(trials)).quick().fit, "respiration", 0.22)
    found_hz = [s.shapes[s.shapes.of("respiration")[0]].at for s in there.states]
    np.testing.assert_allclose(found_hz, 0.25, rtol=2.0 * WANDERS)
    np.testing.assert_allclose(found_hz, np.median(found_hz), rtol=WANDERS)


def test_a_rhythm_that_shows_no_more_than_is_unsure_is_nothing(record: Callable[..., list[Trial]]) -> None:
    """Its shapes may gain evidence elsewhere; no size of it can be told."""
    there = _oscillating(record, "respiration", 0.3, repeats=3, hold_s=6.0)
    breathing = Account(there, steps={"respiration": 0.0})
    assert is_nothing(breathing, "respiration")
    states = (replace(s, coefficients=np.full(len(s.coefficients), 0.01)) for s in there.states)
    assert not is_nothing(replace(breathing, fit=replace(there, states=tuple(states))), "respiration")


def test_a_breath_of_one_cycle_wanders_within_its_trial(record: Callable[..., list[Trial]]) -> None:
    """It is 4 % quicker than where it was found, and swells by a tenth, or slows down by 6 %: its shapes follow."""
    there = _oscillating(record, "respiration", 0.25, repeats=3, hold_s=3.0)
    for trial, state in zip(there.trials, there.states, strict=True):
        touching = touches(trial, state, there.shared)
        mine = [s for s in state.shapes if s.kind != "harmonic"]
        t = trial.time_s[touching]
        swelling = 1.0 + 0.1 * (t - t[0]) / (t[-1] - t[0])
        surface_mm = swelling * np.cos(2 * np.pi * 1.04 * mine[0].at * t + 1.0)
        columns = np.array([s.shape for s in mine])[:, touching].T
        left = surface_mm - columns @ np.linalg.lstsq(columns, surface_mm)[0]
        assert np.std(left) < 0.01 * np.std(surface_mm)
        u = (t - t[0]) / (t[-1] - t[0])
        slowing_mm = np.cos(2 * np.pi * mine[0].at * (t[-1] - t[0]) * (1.06 * u - 0.06 * u**2) + 1.0)
        left = slowing_mm - columns @ np.linalg.lstsq(columns, slowing_mm)[0]
        assert np.std(left) < 0.02 * np.std(slowing_mm)


def test_a_breath_is_as_large_as_it_is_wherever_it_was_looked_for(record: Callable[..., list[Trial]]) -> None:
    """Sizes are looked for in steps of more than two, and what it is granted to be off by spares it its own size."""
    plans = study_plans(depths_mm=(0.5,), repeats=8, hold_s=6.0, dwell_s=0.4)
    resting = fit_baseline(take_in_memory(record(45, BREATH, plans)).trials)
    breath, found_um = library()["respiration"], []
    for size_mm in (0.005, 0.014, 0.04):
        there = _as_scanned(resting, "respiration", 0.25, size_mm).with_population(3)
        breathing = Account(there, steps={"respiration": 0.0})
        granted = breathing.inexact_to(even_shares(["respiration"], 0.1))
        granted = replace(granted, fit=granted.fit.with_states())
        found_um += [own_sizes(a, breath)["amplitude_um"].value for a in (breathing, granted)]
    assert np.ptp(found_um) < 0.02 * np.mean(found_um)


@pytest.mark.parametrize("hz", [1.0, 1.7, 2.2])
def test_a_pulse_has_its_overtones(record: Callable[..., list[Trial]], hz: float) -> None:
    """A beat rises within an eighth of its cycle and falls by halves: what overtones leave of it is no tremor."""
    trials = record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=5.0, dwell_s=0.4))
    trial = take_in_memory(trials).trials[0]
    turn = (np.arange(400) + 0.5) / 400
    beat = np.where(turn < 0.125, np.sin(np.pi * turn / 0.25), 0.5 ** ((turn - 0.125) / 0.25))
    surface = np.interp(np.mod(hz * trial.time_s, 1.0), turn, beat - beat.mean(), period=1.0)
    columns = waves(trial, hz)
    left = surface - columns @ np.linalg.lstsq(columns, surface)[0]
    assert np.std(left) < 0.1 * np.std(surface)


@pytest.mark.parametrize(("name", "hz"), [("respiration", 0.3), ("heartbeat", 1.2)], ids=["shapes", "a band"])
@pytest.mark.parametrize("locked", [True, False])
def test_what_begins_alike_in_all_trials_is_no_rhythm_of_a_body(
    record: Callable[..., list[Trial]], locked: bool, name: str, hz: float
) -> None:
    """A sensor that warms while skin is touched leaves a slow wave in all trials alike; a breath knows of no trial.

    Phases that are as much alike by chance come once in 3000 studies; these are drawn once, by a fixed seed.
    """
    there = _oscillating(record, name, hz, repeats=12, hold_s=4.0)
    random = np.random.default_rng(48)
    states = []
    for trial, state in zip(there.trials, there.states, strict=True):
        begins_s = trial.time_s[trial.in_phase("hold")][0]
        phase = 0.4 * random.standard_normal() if locked else random.uniform(0.0, 2 * np.pi)
        shapes = np.array([s.shape for s in state.shapes])
        wave_mm = 0.02 * np.cos(2 * np.pi * hz * (trial.time_s - begins_s) + phase)
        found = np.linalg.lstsq(shapes.T, wave_mm)[0] if len(shapes) else np.zeros(0)
        bands = tuple(replace(r, found_mm=wave_mm, frequency_hz=hz) for r in state.rhythms)
        assert bool(bands) is not bool(len(shapes))
        states.append(replace(state, coefficients=found, rhythms=bands))
    moving = Account(replace(there, states=tuple(states)), steps={name: 0.0})
    assert is_nothing(moving, name) is locked


@pytest.mark.parametrize("at_rest", [0.0, 0.4, 0.7, 1.0])
def test_what_comes_with_motion_is_no_rhythm_of_a_body(
    record: Callable[..., list[Trial]], at_rest: float
) -> None:
    """A gear's ripple is there while the punch moves; a tremor, drawn in each trial anew, does not know of that."""
    there = _oscillating(record, "tremor", 12.0, repeats=8, hold_s=2.0)
    random = np.random.default_rng(50)
    states = []
    for trial, state in zip(there.trials, there.states, strict=True):
        size_mm = np.where(trial.in_phase("hold"), at_rest, 1.0) * 0.002
        wave_mm = size_mm * np.cos(2 * np.pi * 12.0 * trial.time_s + random.uniform(0.0, 2 * np.pi))
        states.append(replace(state, rhythms=tuple(replace(r, found_mm=wave_mm) for r in state.rhythms)))
    moving = Account(replace(there, states=tuple(states)), steps={"tremor": 0.0})
    assert is_nothing(moving, "tremor") is (at_rest < 0.5)


def test_a_breath_of_a_cycle_says_little_of_its_frequency(record: Callable[..., list[Trial]]) -> None:
    """Tissue takes up the slow part of a wave of 0.25 Hz that is there for 4 s; of three waves it takes little."""
    unsure = []
    for hold_s in (3.5, 11.5):
        there = _oscillating(record, "respiration", 0.25, repeats=6, hold_s=hold_s, effects=BREATH)
        breathing = Account(there.with_population(), steps={"respiration": 0.0})
        anywhere = would_do(breathing, library()["respiration"])
        assert anywhere is not None
        sd_hz = anywhere.se_hz
        found = own_sizes(breathing, library()["respiration"], sd_hz)["frequency_hz"]
        assert abs(found.value - 0.25) < 3.0 * found.se
        assert found.se >= sd_hz
        unsure.append(sd_hz)
    assert unsure[0] > 1.5 * unsure[1] > 0.0
    # nor is one half as quick, among whose overtones this one is
    assert anywhere.lowest_hz > 0.75 * 0.25
    # a band has cycles enough
    assert would_do(breathing, library()["heartbeat"]) is None


@pytest.mark.parametrize(("found_hz", "is_tremor"), [((9.0, 13.0, 16.0), True), ((15.8, 16.2, 16.5), False)])
def test_what_rings_faster_than_a_hand_trembles_is_no_tremor(
    found_hz: tuple[float, ...], is_tremor: bool
) -> None:
    """Steps on the floor ring at 16 Hz: a band is looked for up to 15 Hz, and tuned further than that."""
    trials = [
        SimpleNamespace(rhythms=(SimpleNamespace(effect="tremor", frequency_hz=hz),)) for hz in found_hz
    ]
    account = cast(Account, SimpleNamespace(fit=SimpleNamespace(states=trials)))
    anywhere = would_do(account, library()["tremor"])
    assert anywhere is not None
    assert anywhere.is_likely(library()["tremor"]) is is_tremor


@pytest.mark.parametrize(
    ("hz", "is_breath"), [((0.09, 0.18), False), ((0.12, 0.2), True), ((0.6, 0.9), False)]
)
def test_what_may_as_well_be_outside_a_band_is_not_in_it(hz: tuple[float, float], is_breath: bool) -> None:
    """What pulls ever more is explained by a wave as well as by half as quick a one: one is as likely as another."""
    assert WouldDo(*hz).is_likely(library()["respiration"]) is is_breath


def test_what_turns_slower_than_a_breath_is_none(record: Callable[..., list[Trial]]) -> None:
    """It is looked for from the slowest breath upwards, and found there; over a cycle it shows to be slower."""
    breath = library()["respiration"]
    for hz, is_breath in ((0.085, False), (0.16, True)):
        effects = BREATH.replace("0.25", str(hz))
        there = _oscillating(record, "respiration", 0.15, repeats=6, hold_s=12.0, effects=effects)
        anywhere = would_do(Account(there.with_population(), steps={"respiration": 0.0}), breath)
        assert anywhere is not None
        assert anywhere.is_likely(breath) is is_breath


def _on_a_pulse(
    record: Callable[..., list[Trial]],
    amplitude_um: float,
    seed: int,
    hold_s: float = 3.0,
    dwell_s: float = 1.0,
) -> StudyFit:
    """Return the baseline of a study with a pulse under a punch that dwells 40 to 140 um deep."""
    pulse = f'[[effects]]\nname = "heartbeat"\namplitude_um = {amplitude_um}\nfrequency_hz = 1.2\n'
    plans = study_plans(depths_mm=(0.5,), repeats=4, hold_s=hold_s, dwell_s=dwell_s)
    return fit_baseline(take_in_memory(record(seed, pulse, plans)).trials)


def _with_a_pulse(
    record: Callable[..., list[Trial]], amplitude_um: float, hold_s: float = 3.0, dwell_s: float = 1.0
) -> Account:
    """Return a study with such a pulse, each trial fitted."""
    start = Account(_on_a_pulse(record, amplitude_um, 66, hold_s, dwell_s))
    return own_options(start.quick(), "heartbeat")[0].refit()


def test_what_nothing_stands_for_yet_takes_no_punch_off_the_skin(record: Callable[..., list[Trial]]) -> None:
    """Columns from elsewhere gain with each step, and led a trial to 0.6 mm below where its arm ever was."""
    fit = _on_a_pulse(record, 90.0, 61)
    for trial, state in zip(fit.trials, fit.states, strict=True):
        assert state.z0_mm < trial.position_mm.max() - 0.3


def test_a_contact_that_small_steps_leave_too_low_is_begun_anew(
    record: Callable[..., list[Trial]],
) -> None:
    """Skin goes to and fro by more than the punch is in it: 65 um too deep, no step finds back to where it touches."""
    pulse = _with_a_pulse(record, 90.0, hold_s=6.0, dwell_s=3.0)
    # each trial where it touches: what a last digit leads astray in one of them hides what is stuck in another
    pulse = replace(pulse, fit=contacts_begun_anew(pulse.fit))
    first, *others = pulse.fit.states
    away = replace(first, z0_mm=first.z0_mm + 0.065)
    fit = replace(pulse.fit, states=(away, *others))
    for _ in range(8):
        fit = fit.following().with_states()
    there = replace(pulse, fit=contacts_begun_anew(fit))
    assert there.nats > replace(pulse, fit=fit).nats + 300.0
    assert abs(there.fit.states[0].z0_mm - first.z0_mm) < 0.02 < fit.states[0].z0_mm - first.z0_mm


def test_contacts_of_skin_that_stays_on_the_punch_are_left_alone(record: Callable[..., list[Trial]]) -> None:
    fit = _with_a_pulse(record, 15.0).fit
    assert contacts_begun_anew(fit) is fit
