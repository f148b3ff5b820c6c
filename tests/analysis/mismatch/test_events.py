"""Steps of the skin: how they rise is no straight ramp, and is left open; and how large they are said to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.levels import ENOUGH_OWN
from analysis.mismatch.model.effects import Law, OwnShape, simulate
from analysis.mismatch.name.event_scan import scan_events
from analysis.mismatch.name.events import (
    EVENTS,
    SETTLES_S,
    SHIFTS_S,
    bent_shapes,
    event_shape,
    step_shape,
    with_events,
)
from analysis.mismatch.name.options import own_options
from analysis.mismatch.name.oscillations import OscillationScan, with_oscillation
from analysis.mismatch.name.own_sizes import own_sizes
from analysis.mismatch.name.weighing import considered
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans


@pytest.mark.parametrize("lasts_s", [0.02, 0.05, 0.1, 0.2, 0.35])
def test_a_smooth_step_is_one_of_the_forms_bent(record: Callable[..., list[Trial]], lasts_s: float) -> None:
    """What is S-shaped leaves less than a fiftieth of itself about its time, and nothing before or after."""
    trial = take_in_memory(record(47, plans=study_plans(depths_mm=(0.5,), repeats=1))).trials[0]
    at_s = 0.5 * (trial.time_s[trial.in_phase("hold")][0] + trial.time_s[trial.in_phase("hold")][-1])
    # a logistic step, three quarters of it within a quarter of the time it lasts about its middle
    fine = np.linspace(-0.5, 0.5, 9)
    since_s = trial.time_s - at_s + np.multiply.outer(fine, trial.counts / trial.sample_rate_hz)
    surface = (1.0 / (1.0 + np.exp(-np.clip(9.0 * since_s / lasts_s, -60.0, 60.0)))).mean(axis=0)
    shift = next(e for e in EVENTS if e.name == "motion_artefact")
    left = []
    for rise_s in SHIFTS_S:
        bent = bent_shapes(shift, trial, at_s, rise_s)
        columns = np.vstack([step_shape(trial, at_s, rise_s), bent]).T
        left.append(np.abs(surface - columns @ np.linalg.lstsq(columns, surface)[0]).max())
        assert not np.any(bent[:, np.abs(trial.time_s - at_s) > 1.5 * rise_s + 0.02])
    assert min(left) < 0.02


@pytest.mark.parametrize("lasts_s", [0.05, 0.1, 0.2, 0.4, 0.9])
@pytest.mark.parametrize(
    "pulse",
    [
        lambda u: np.exp(-4.0 * (u - 1.0) ** 2),
        lambda u: np.where((u > 0.0) & (u < 2.0), np.sin(0.5 * np.pi * np.clip(u, 0.0, 2.0)) ** 2, 0.0),
        lambda u: 4.0 * (np.exp(-1.5 * np.clip(u, 0.0, None)) - np.exp(-3.0 * np.clip(u, 0.0, None))),
        lambda u: 0.5 * (np.tanh(6.0 * (u - 0.5)) - np.tanh(4.0 * (u - 1.7))),
    ],
    ids=["as quick to rise as to fall", "over in a moment", "slow to die away", "held for a while"],
)
def test_what_moves_and_returns_is_a_sum_of_pulses(
    record: Callable[..., list[Trial]], pulse: Callable[[np.ndarray], np.ndarray], lasts_s: float
) -> None:
    """None of these is one of the pulses; each leaves less than a tenth of itself."""
    trial = take_in_memory(record(47, plans=study_plans(depths_mm=(0.5,), repeats=1))).trials[0]
    at_s = float(np.median(trial.time_s[trial.in_phase("hold")]))
    fine = np.linspace(-0.5, 0.5, 9)
    since_s = trial.time_s - at_s + np.multiply.outer(fine, trial.counts / trial.sample_rate_hz)
    surface = pulse(2.0 * since_s / lasts_s).mean(axis=0)
    event = next(e for e in EVENTS if e.returns)
    left = []
    for rise_s in event.rises_s:
        for peak_s in at_s + lasts_s * np.linspace(0.0, 1.0, 11):
            bent = bent_shapes(event, trial, peak_s, rise_s)
            columns = np.vstack([event_shape(event, trial, peak_s, rise_s), bent]).T
            left.append(np.abs(surface - columns @ np.linalg.lstsq(columns, surface)[0]).max())
            assert not np.any(columns[trial.time_s < peak_s - rise_s - 0.02])
    assert min(left) < 0.1 * surface.max()


@pytest.mark.parametrize("before_ramp_s", [-0.03, 0.0, 0.03])
def test_what_goes_on_while_the_punch_moves_is_no_step_of_skin_at_rest(
    record: Callable[..., list[Trial]], before_ramp_s: float
) -> None:
    """A slow shift whose middle lies in the dwell would otherwise stand for whatever bends the ramp after it."""
    trials = record(51, plans=study_plans(depths_mm=(0.3, 0.7), repeats=2, hold_s=1.0))
    fit = fit_baseline(take_in_memory(trials).trials)
    shift = next(e for e in EVENTS if e.name == "motion_artefact")
    bent = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        at_s = trial.time_s[trial.in_phase("ramp")][0] - before_ramp_s
        moved_mn = simulate(trial, state, fit.shared, {"surface": 0.03 * step_shape(trial, at_s, 0.24)})
        bent.append(replace(trial, force_mn=moved_mn))
    (found,) = scan_events(replace(fit, trials=tuple(bent)).with_states(), [shift])
    for j, trial in enumerate(fit.trials):
        rise_s = shift.rises_s[int(found.forms[j])]
        begins_s, ends_s = found.times_s[j] - 0.5 * rise_s, found.times_s[j] + 0.5 * rise_s
        spans = [trial.time_s[trial.in_phase(phase)][[0, -1]] for phase in shift.phases]
        assert any(first <= begins_s and ends_s <= last for first, last in spans)


@pytest.mark.parametrize(
    ("shifts_um", "said_um"),
    [((-12.0, -13.0, -12.5), -12.5), ((-12.0, -13.0, 0.5), -12.5), ((12.0, -13.0, 12.5), 12.5)],
    ids=["all to one side", "and what another effect left over", "to either side"],
)
def test_shifts_to_one_side_are_said_with_their_sign(
    record: Callable[..., list[Trial]], shifts_um: tuple[float, ...], said_um: float
) -> None:
    trials = record(47, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0))
    fit = fit_baseline(take_in_memory(trials).trials)
    states = []
    for trial, state, shift_um in zip(fit.trials, fit.states, shifts_um, strict=True):
        at_s = float(np.median(trial.time_s[trial.in_phase("hold")]))
        shape = OwnShape("motion_artefact", "surface", step_shape(trial, at_s, 0.05), 1e-4, at_s)
        states.append(state.with_shapes([shape], 1e-3 * shift_um))
    found = own_sizes(Account(replace(fit, states=tuple(states))), library()["motion_artefact"])
    assert found["shift_um"].value == pytest.approx(said_um, rel=0.06)


def test_a_shift_that_took_the_skin_off_a_dwelling_punch_is_found(record: Callable[..., list[Trial]]) -> None:
    """Where the skin is since then the punch no longer touches it, and a little nearer it would not either."""
    plans = study_plans(depths_mm=(0.5,), repeats=4, dwell_s=1.0, hold_s=1.0)
    fit = fit_baseline(take_in_memory(record(47, plans=plans)).trials)
    shift = next(e for e in EVENTS if e.name == "motion_artefact")
    trials = list(fit.trials)
    trial, state = trials[0], fit.states[0]
    dwell = trial.in_phase("dwell")
    at_s = float(np.median(trial.time_s[dwell]))
    shape = OwnShape(shift.name, "surface", step_shape(trial, at_s, 0.03), 1e-4, at_s)
    pressed = replace(state, z0_mm=float(trial.position_mm[dwell].max()) - 0.012)
    shifted = pressed.with_shapes([shape], -0.030)
    changed_mn = simulate(trial, shifted, fit.shared) - simulate(trial, state, fit.shared)
    trials[0] = replace(
        trial,
        force_mn=trial.force_mn + changed_mn,
        full_force_mn=trial.full_force_mn + np.interp(trial.full_time_s, trial.time_s, changed_mn),
        z0_start_mm=pressed.z0_mm + 0.030,
    )
    quick = Account(fit_baseline(trials)).quick().fit
    scan = scan_events(quick, [shift])[0]
    assert list(scan.probability > 0.5) == [True, False, False, False]
    assert scan.times_s[0] == pytest.approx(at_s, abs=0.03)
    found = with_events(quick, scan).with_states().states[0]
    # the step, and what of it came by and by; how far it swung at first is not its size
    size, _, *creeps = found.coefficients[: 1 + len(SETTLES_S)]
    assert size + sum(creeps) == pytest.approx(-0.030, rel=0.05)
    assert found.z0_mm == pytest.approx(pressed.z0_mm, abs=1e-3)


def test_how_far_a_shift_swings_at_first_is_not_its_size(record: Callable[..., list[Trial]]) -> None:
    """Skin is soft: it goes an eighth too far, and comes back within a tenth of a second."""
    fit = fit_baseline(take_in_memory(record(53, plans=study_plans(depths_mm=(0.6,), repeats=3))).trials)
    swung = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        u = (trial.time_s - float(np.median(trial.time_s[trial.in_phase("hold")]))) / 0.015
        surface_mm = 0.016 * (0.5 * (1.0 + np.tanh(u / 2.0)) + 0.125 * np.exp(-0.5 * ((u - 4.0) / 2.0) ** 2))
        changed_mn = simulate(trial, state, fit.shared, {"surface": surface_mm})
        changed_mn -= simulate(trial, state, fit.shared, {})
        swung.append(replace(trial, force_mn=trial.force_mn + changed_mn))
    bent = replace(fit, trials=tuple(swung)).with_population()
    (scan,) = scan_events(bent, [next(e for e in EVENTS if e.name == "motion_artefact")])
    there = with_events(bent, scan).with_population()
    assert [s.coefficients[0] for s in there.states] == pytest.approx([0.016] * 3, rel=0.08)


@pytest.mark.slow
def test_a_slip_that_is_off_as_it_ends_is_no_friction(record: Callable[..., list[Trial]]) -> None:
    """Of a drop that is larger as the punch lifts off, by a half and in waves; H0: no law explains what that leaves."""
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=4, hold_s=3.0, dwell_s=0.4)
    fit = fit_baseline(take_in_memory(record(55, plans=plans)).trials)
    random = np.random.default_rng(55)
    slipped = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        hold_s, end_s = trial.time_s[trial.in_phase("hold")][[0, -1]]
        step = step_shape(trial, random.uniform(hold_s + 0.5, end_s - 0.5), 0.004)
        contact_mn = simulate(trial, replace(state, offset_mn=0.0), fit.shared)
        held_mn = float(np.median(contact_mn[trial.in_phase("hold")]))
        u = np.clip((trial.time_s - end_s) / 0.15, 0.0, 1.0)
        lost_mn = 4.0 * step * contact_mn / held_mn * (1.0 + 0.5 * np.sin(3.0 * np.pi * u))
        slipped.append(_with_course(trial, -lost_mn))
    nothing = Account(replace(fit, trials=tuple(slipped)).with_population()).reweighed()
    (step, *_) = considered(nothing, nothing, {})
    assert step.name == "slip"
    account = step.account.settled()
    assert account.granted > 0.0
    assert not considered(account, nothing, {})


def test_a_shift_is_found_beside_a_breath_where_skin_clings(record: Callable[..., list[Trial]]) -> None:
    """Contact ends within half a micron: how that moves with the surface is told by less than that."""
    plans = study_plans(depths_mm=(0.5,), repeats=3, dwell_s=0.4, hold_s=6.0)
    fit = fit_baseline(take_in_memory(record(48, plans=plans)).trials)
    clings = library()["adhesion"]
    law = Law(clings, {**clings.null, "pull_off_mn": 4.0, "peel": 5e-4}, ("pull_off_mn",))
    fit = replace(fit, shared=replace(fit.shared, laws=(law,)))
    shift = next(e for e in EVENTS if e.name == "motion_artefact")
    shifted = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        step = step_shape(trial, float(np.median(trial.time_s[trial.in_phase("hold")])), 0.015)
        clung_mn = simulate(trial, state, fit.shared, {"surface": 0.022 * step})
        noise_mn = trial.force_mn - simulate(trial, state, replace(fit.shared, laws=()))
        shifted.append(replace(trial, force_mn=clung_mn + noise_mn))
    breath = OscillationScan(100.0, 0.35, 0.01, "respiration", np.zeros(0))
    bent = with_oscillation(replace(fit, trials=tuple(shifted)), breath).with_states()
    (found,) = scan_events(bent, [shift])
    np.testing.assert_allclose(found.coefficients, 0.022, rtol=0.15)


def test_what_comes_once_and_dies_away_is_no_shift(record: Callable[..., list[Trial]]) -> None:
    """A twitch that peaks in the hold, a tenth of a second after the ramp, and is over within a second has no name."""
    plans = study_plans(depths_mm=(0.4, 0.8), repeats=3, dwell_s=0.5, hold_s=6.0)
    random = np.random.default_rng(50)
    trials = []
    for trial in take_in_memory(record(50, plans=plans)).trials:
        begins_s = trial.time_s[trial.in_phase("ramp")][0] + random.uniform(0.1, 0.15)
        rise_s, size_mn = 0.15 * random.uniform(0.8, 1.2), 4.0 * random.uniform(3.0, 9.0)
        force_mn, full_mn = (
            had_mn + size_mn * (np.exp(-1.5 * u) - np.exp(-3.0 * u))
            for had_mn, time_s in ((trial.force_mn, trial.time_s), (trial.full_force_mn, trial.full_time_s))
            for u in [np.maximum(time_s - begins_s, 0.0) / rise_s]
        )
        trials.append(replace(trial, force_mn=force_mn, full_force_mn=full_mn.astype(np.float32)))
    quick = Account(fit_baseline(trials)).quick()
    twitch, shift = (
        own_options(quick, name)[0].refit().weighed_anew() for name in ("transient", "motion_artefact")
    )
    assert twitch.nats > shift.nats + ENOUGH_OWN


def _with_force(trial: CellTrial, added_mn: Callable[[np.ndarray], np.ndarray]) -> CellTrial:
    """Return a trial to whose force something was added, (n,) mN at times (n,) s."""
    full_mn = trial.full_force_mn + added_mn(trial.full_time_s)
    force_mn = trial.force_mn + added_mn(trial.time_s)
    return replace(trial, force_mn=force_mn, full_force_mn=full_mn.astype(np.float32))


def _with_course(trial: CellTrial, added_mn: np.ndarray) -> CellTrial:
    """Return a trial to whose force a course was added that is known at its cells, (n,) mN."""
    return _with_force(trial, lambda t: np.interp(t, trial.time_s, added_mn))


@pytest.mark.parametrize(
    ("sign", "first"), [(-1.0, "slip"), (None, "jump"), (1.0, "jump")], ids=["down", "both", "up"]
)
def test_a_gain_that_jumps_either_way_is_no_slip(
    record: Callable[..., list[Trial]], sign: float | None, first: str
) -> None:
    """Punches slip one way only: what is lost by a slip is all that a gain loses; up, or both ways, it has no name."""
    trials = record(59, plans=study_plans(depths_mm=(0.4, 0.7), repeats=3, hold_s=4.0, dwell_s=0.4))
    fit = fit_baseline(take_in_memory(trials).trials)
    random = np.random.default_rng(60)
    jumped = []
    for k, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        begins_s, ends_s = trial.time_s[trial.in_phase("hold")][[0, -1]]
        jumps_s = random.uniform(begins_s + 0.5, ends_s - 0.5)
        size = (sign or (-1.0) ** k) * random.uniform(0.03, 0.06)
        lost = -size * step_shape(trial, jumps_s, 0.001)
        jump_mn = simulate(trial, state, fit.shared, {"share": lost}) - simulate(trial, state, fit.shared)
        jumped.append(_with_course(trial, jump_mn))
    nothing = Account(fit_baseline(jumped))
    (best, *_) = considered(nothing, nothing, {})
    assert best.name == first


def test_what_is_lost_by_and_by_is_no_slip(record: Callable[..., list[Trial]]) -> None:
    """Fluid that drains as the root of time until none is left: a small drop, and much that goes on after it."""
    trials = record(61, plans=study_plans(depths_mm=(0.4, 0.7), repeats=4, hold_s=6.0, dwell_s=0.4))
    fit = fit_baseline(take_in_memory(trials).trials)
    random = np.random.default_rng(62)
    drained = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        since_s = np.maximum(trial.time_s - trial.time_s[trial.in_phase("hold")][0], 0.0)
        lasts_s = 1.8 * np.exp(0.1 * random.normal())
        lost = 0.08 * np.sqrt(np.minimum(since_s / lasts_s, 1.0))
        drained_mn = simulate(trial, state, fit.shared, {"share": lost}) - simulate(trial, state, fit.shared)
        drained.append(_with_course(trial, drained_mn))
    nothing = Account(fit_baseline(drained))
    assert not considered(nothing, nothing, {}, among={"slip"})


@pytest.mark.parametrize(
    ("stays", "first"),
    [(True, "zero_step"), pytest.param(False, "swell", marks=pytest.mark.slow)],
    ids=["stays", "comes and goes"],
)
def test_what_changes_slowly_once_or_twice_in_a_trial_is_no_breath(
    record: Callable[..., list[Trial]], stays: bool, first: str
) -> None:
    """Of a trial of one cycle or two a breath's shapes are any smooth course, and a quick shift stands for its edge.

    What is read stays where it went after contact, too: it is the zero.
    """
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=3, hold_s=5.0, dwell_s=0.4)
    fit = fit_baseline(take_in_memory(record(62, plans=plans)).trials)
    random = np.random.default_rng(63)
    warmed = []
    for k, trial in enumerate(fit.trials):
        begins_s = trial.time_s[trial.in_phase("hold")][0] + random.uniform(0.4, 2.2)
        steps = [(begins_s, 1.0)] if stays else [(begins_s, 1.0), (begins_s + random.uniform(1.2, 1.8), -1.0)]
        force_mn = sum(
            5.0 * (-1.0) ** k * sign * -np.expm1(-np.maximum(trial.time_s - at_s, 0.0) / 0.4)
            for at_s, sign in steps
        )
        warmed.append(_with_course(trial, np.asarray(force_mn)))
    nothing = Account(fit_baseline(warmed))
    (best, *_) = considered(nothing, nothing, {})
    assert best.name == first


def test_what_bends_at_a_time_of_its_own_goes_on(record: Callable[..., list[Trial]]) -> None:
    """A film pulls ever more from a moment of the hold on: no course that is over before rest ends says as much."""
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=4, hold_s=7.0, dwell_s=0.6)
    random = np.random.default_rng(65)
    fit = fit_baseline(take_in_memory(record(64, plans=plans)).trials)
    bent = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        hold_mm = trial.position_mm[trial.in_phase("hold")].mean()
        from_s = trial.time_s[trial.in_phase("hold")][0] + random.uniform(0.5, 4.5)
        held = np.clip((trial.position_mm - state.z0_mm) / (hold_mm - state.z0_mm), 0.0, 1.0)
        pull_mn = -1.6 * held * np.maximum(trial.time_s - from_s, 0.0)
        bent.append(_with_course(trial, pull_mn))
    swell = next(e for e in EVENTS if e.name == "swell")
    over = replace(swell, name="over", rises_s=(0.5, 1.0), goes_on=False)
    goes_on, ends = scan_events(Account(fit_baseline(bent)).quick().fit, [swell, over])
    assert goes_on.evidence > ends.evidence + ENOUGH_OWN


@pytest.mark.parametrize(("after_s", "is_shift"), [(0.0, False), (0.5, True)], ids=["as it ends", "later"])
def test_what_comes_as_a_motion_ends_is_no_shift_of_the_skin(
    record: Callable[..., list[Trial]], after_s: float, is_shift: bool
) -> None:
    """A film pulls from first contact on, as the punch comes to rest: in every trial as early as may be."""
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=3, hold_s=4.0, dwell_s=0.6)
    fit = fit_baseline(take_in_memory(record(69, plans=plans)).trials)
    random = np.random.default_rng(70)
    shifted = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        begins_s = float(trial.time_s[trial.in_phase("hold")][0])
        at_s = begins_s + after_s * (1.0 if after_s < 0.1 else random.uniform(1.0, 4.0))
        shape = {"surface": 0.02 * step_shape(trial, at_s, 0.06)}
        changed_mn = simulate(trial, state, fit.shared, shape) - simulate(trial, state, fit.shared, {})
        shifted.append(_with_course(trial, changed_mn))
    names = [option.name for option in own_options(Account(fit_baseline(shifted)).quick())]
    assert ("motion_artefact" in names) is is_shift


def test_a_zero_that_jumps_before_there_is_contact_is_seen(record: Callable[..., list[Trial]]) -> None:
    """A cable that snags in the air, each time elsewhere, pulls for a sixth of a second and lets go at once."""
    random = np.random.default_rng(67)
    snagged, lets_go_s = [], []
    for trial in take_in_memory(record(66)).trials:
        begins_s, ends_s = trial.time_s[trial.in_phase("approach")][[0, -1]]
        lets_go_s.append(begins_s + random.uniform(0.4, 0.8) * (ends_s - begins_s))

        def snags(t: np.ndarray, at_s: float = lets_go_s[-1]) -> np.ndarray:
            return np.where(t < at_s, 3.0 * np.clip(1.0 - (at_s - t) / 0.16, 0.0, 1.0), 0.0)

        snagged.append(_with_force(trial, snags))
    nothing = Account(fit_baseline(snagged))
    (best, *_) = considered(nothing, nothing, {})
    assert best.name == "zero_step"
    (found,) = scan_events(nothing.fit, [e for e in EVENTS if e.name == best.name])
    np.testing.assert_allclose(found.times_s, lets_go_s, atol=0.01)


def test_the_edge_of_a_slip_is_found_in_noise_that_slips_themselves_have_made(
    record: Callable[..., list[Trial]],
) -> None:
    """Noise is measured from trials that all slip; most of their slips lay between the seventy times of a hold."""
    trials = record(52, plans=study_plans(depths_mm=(0.4, 0.7), repeats=3, hold_s=5.0, dwell_s=0.4))
    fit = fit_baseline(take_in_memory(trials).trials)
    random = np.random.default_rng(53)
    slipped, slips_s = [], []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        begins_s, ends_s = trial.time_s[trial.in_phase("hold")][[0, -1]]
        slips_s.append(begins_s + random.uniform(0.1, 0.9) * (ends_s - begins_s))
        lost = 0.06 * step_shape(trial, slips_s[-1], 0.006)
        drop_mn = simulate(trial, state, fit.shared, {"share": lost}) - simulate(trial, state, fit.shared)
        slipped.append(replace(trial, force_mn=trial.force_mn + drop_mn, full_force_mn=np.zeros(0)))
    bent = replace(fit, trials=tuple(slipped)).with_population()
    noise = NoiseModel(fit.noise.white_mn, ((0.6, 0.4), (1.3, 1.6), (2.6, 6.6)))
    slip = next(e for e in EVENTS if e.name == "slip")
    (found,) = scan_events(bent.weighed_by(noise).with_population(), [slip])
    assert np.all(found.probability > 0.99)
    np.testing.assert_allclose(found.times_s, slips_s, atol=0.003)


@pytest.mark.parametrize("goes", ["with the depth", "halfway", "nowhere", "with the surface"])
def test_what_becomes_of_a_drop_as_the_punch_lifts_off_bends_no_tissue(
    record: Callable[..., list[Trial]], goes: str
) -> None:
    """The library says when a slip's drop comes, not how it ends; the contact is lost where the punch is still deep."""
    trials = record(54, plans=study_plans(depths_mm=(0.7,), repeats=3, hold_s=3.0, dwell_s=0.4))
    fit = fit_baseline(take_in_memory(trials).trials)
    before = [np.exp(s.log_tissue) for s in fit.states]
    slipped = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        step = step_shape(trial, float(np.median(trial.time_s[trial.in_phase("hold")])), 0.004)
        bare = replace(state, offset_mn=0.0)
        contact_mn = simulate(trial, bare, fit.shared)
        deep = np.clip(trial.position_mm - state.z0_mm, 0.0, None)
        left = {"with the depth": deep / deep.max(), "halfway": 0.5 + 0.5 * deep / deep.max()}.get(goes, 1.0)
        lower_mn = np.maximum(contact_mn - 8.0 * step * left, 0.0)
        if goes == "with the surface":
            gives_mm = -8.0 * step / np.exp(state.log_tissue[[0, 1, 3]]).sum()
            lower_mn = simulate(trial, bare, fit.shared, {"surface": gives_mm})
        slipped.append(replace(trial, force_mn=trial.force_mn + lower_mn - contact_mn))
    bent = replace(fit, trials=tuple(slipped)).with_population()
    slip = next(e for e in EVENTS if e.name == "slip")
    (scan,) = scan_events(bent, [slip])
    there = with_events(bent, scan).with_population()
    for state, tissue in zip(there.states, before, strict=True):
        np.testing.assert_allclose(np.exp(state.log_tissue), tissue, rtol=0.04)
        assert state.coefficients[0] == pytest.approx(8.0, rel=0.06)
