"""One trial's own parameters: what is held where it must stay, and a contact no higher than where the trial begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from analysis.errors import BadInputError
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit import study_fit
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.law_fit import centred, fit_laws
from analysis.mismatch.fit.own import force_columns
from analysis.mismatch.fit.start import start_tissue
from analysis.mismatch.fit.study_fit import with_own_values
from analysis.mismatch.fit.trial_fit import bounded, fit_trial
from analysis.mismatch.model.effects import Law, Shared, simulate
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans


@given(st.integers(0, 10**6), st.integers(0, 4), st.floats(-2.0, 2.0))
def test_beside_what_is_held_the_others_are_best(seed: int, at: int, lowest: float) -> None:
    """Against bounded least squares, one component bounded below."""
    random = np.random.default_rng(seed)
    X, y = random.normal(size=(30, 5)), random.normal(size=30)
    room = np.full(5, -np.inf)
    room[at] = lowest
    found = bounded(X.T @ X, X.T @ y, room)
    np.testing.assert_allclose(found, lsq_linear(X, y, (room, np.inf)).x, atol=1e-6)


@pytest.mark.parametrize("above_mm", [-0.1, 0.1])
def test_contact_lies_no_higher_than_the_approach_begins(
    record: Callable[..., list[Trial]], above_mm: float
) -> None:
    trials = record(41, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    # a skin that would lie above or below where the arm set out
    wanted_mm = [t.begins_mm - above_mm for t in fit.trials]
    forces = [
        simulate(t, replace(s, z0_mm=z), fit.shared)
        for t, s, z in zip(fit.trials, fit.states, wanted_mm, strict=True)
    ]
    pressed = tuple(replace(t, force_mn=f) for t, f in zip(fit.trials, forces, strict=True))
    begun = tuple(replace(s, z0_mm=t.begins_mm + 0.02) for t, s in zip(fit.trials, fit.states, strict=True))
    found = replace(fit, trials=pressed, states=begun).with_states()
    for trial, state, z in zip(found.trials, found.states, wanted_mm, strict=True):
        if above_mm > 0.0:
            assert state.z0_mm == pytest.approx(trial.begins_mm, abs=1e-9)
        else:
            assert state.z0_mm == pytest.approx(z, abs=0.01)


def test_a_step_to_where_no_force_is_a_number_is_refused(record: Callable[..., list[Trial]]) -> None:
    trials = record(41, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    trial, whitener, state, own = fit.trials[0], fit.whiteners[0], fit.states[0], fit.own[0]
    beyond = replace(state, log_tissue=state.log_tissue + 400.0)
    found, cost = fit_trial(trial, whitener, beyond, fit.shared, fit.population, own, near=True)
    assert found is beyond
    assert cost == np.inf


def test_an_offset_moves_no_reading_that_is_cut(record: Callable[..., list[Trial]]) -> None:
    trials = record(41, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    trial, state, saturation = fit.trials[0], fit.states[0], library()["force_saturation"]
    level_mn = 0.9 * float(trial.force_mn.max())
    law = Law(saturation, {**saturation.null, "level_mn": level_mn, "knee": 1e-3}, ("level_mn",))
    by_offset = force_columns(trial, state, Shared((law,))).columns_mn[:, 1]
    cut = simulate(trial, state, Shared()) > 1.02 * level_mn
    below = simulate(trial, state, Shared()) < 0.98 * level_mn
    assert cut.any()
    np.testing.assert_allclose(by_offset[cut], 0.0, atol=1e-6)
    np.testing.assert_allclose(by_offset[below], 1.0, atol=1e-6)


@pytest.mark.parametrize("with_offset", [0.0, 1.0])
def test_trials_of_other_offsets_share_one_level(
    record: Callable[..., list[Trial]], with_offset: float
) -> None:
    """Of the transducer's force or of what is read, wherever the offset comes from."""
    trials = record(41, plans=study_plans(depths_mm=(0.5,), repeats=5, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    states = tuple(replace(s, offset_mn=2.0 * j) for j, s in enumerate(fit.states))
    saturation = library()["force_saturation"]
    level_mn = 0.9 * float(fit.trials[0].force_mn.max())
    cut = {**saturation.null, "level_mn": level_mn, "with_offset": with_offset}
    free = ("level_mn", "with_offset")
    read = Shared((Law(saturation, cut, free),))
    forces = [simulate(t, s, read) for t, s in zip(fit.trials, states, strict=True)]
    begun = Law(saturation, {**cut, "level_mn": level_mn + 3.0, "with_offset": 1.0}, free)
    pressed = tuple(replace(t, force_mn=f) for t, f in zip(fit.trials, forces, strict=True))
    found = fit_laws(replace(fit, trials=pressed, states=states, shared=Shared((begun,))))
    assert found.shared.laws[0].values["with_offset"] == pytest.approx(with_offset, abs=0.05)
    assert found.shared.laws[0].values["level_mn"] == pytest.approx(level_mn, abs=0.1)


def test_of_all_fits_only_the_latest_hold_their_columns(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = record(41, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    first = fit_baseline(take_in_memory(trials).trials)
    before = first.projectors[0].residual
    second, third = replace(first), replace(first)
    # there is room for two, and the third takes the place of the first
    monkeypatch.setattr(study_fit, "MOST_HELD_BYTES", 2 * first.bytes_held)
    for later in (second, third):
        assert later.projectors
        later.held.take(later)
    assert [fit.bytes_held > 0 for fit in (first, second, third)] == [False, True, True]
    np.testing.assert_array_equal(first.projectors[0].residual, before)


def test_every_site_has_its_own_adhesion(record: Callable[..., list[Trial]]) -> None:
    trials = record(43, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    adhesion = library()["adhesion"]
    pulls_mn = (4.4, 5.0, 5.8)
    forces = [
        simulate(t, s, replace(fit.shared, laws=(Law(adhesion, {**adhesion.null, "pull_off_mn": pull}, ()),)))
        for t, s, pull in zip(fit.trials, fit.states, pulls_mn, strict=True)
    ]
    clinging = tuple(replace(t, force_mn=f) for t, f in zip(fit.trials, forces, strict=True))
    law = Law(adhesion, {**adhesion.null, "pull_off_mn": 5.0}, ("pull_off_mn",))
    found = replace(fit, trials=clinging, shared=replace(fit.shared, laws=(law,)))
    found = with_own_values(found).with_states()
    sizes = [float(s.coefficients[s.shapes.law_values["adhesion", "pull_off_mn"]]) for s in found.states]
    assert 5.0 * np.exp(sizes) == pytest.approx(pulls_mn, rel=0.01)
    assert with_own_values(found).states == found.states


@pytest.mark.parametrize("differs", [0.0, 0.12])
def test_a_size_that_is_the_same_in_all_trials_costs_none_of_them_anything(
    record: Callable[..., list[Trial]], differs: float
) -> None:
    """Trials that know their size to a percent pay for not knowing it: two nats each, where all have the same."""
    fit = fit_baseline(take_in_memory(record(45)).trials)
    dashpot = library()["parallel_dashpot"]
    law = Law(dashpot, {dashpot.amplitude: 2.0}, (dashpot.amplitude,))
    own = differs * np.array([1.0, -1.0, 0.7, -1.3, 1.2, -0.6, 0.4, -0.4])
    laws = [replace(law, values={dashpot.amplitude: 2.0 * float(np.exp(size))}) for size in own]
    dragging = [
        replace(
            t,
            force_mn=t.force_mn
            + simulate(t, s, replace(fit.shared, laws=(with_size,)))
            - simulate(t, s, fit.shared),
        )
        for t, s, with_size in zip(fit.trials, fit.states, laws, strict=True)
    ]
    begun = replace(fit, trials=tuple(dragging), shared=replace(fit.shared, laws=(law,)))
    free = Account(with_own_values(begun).with_states())
    found = Account(free.fit.with_population(1))
    # the dashpot's is the only value that is a trial's own
    (known,) = {s.shapes[0].prior for s in found.fit.states}
    of_own = np.array([s.coefficients[0] for s in found.fit.states])
    if differs:
        assert np.sqrt(known) == pytest.approx(differs, rel=0.4)
        np.testing.assert_allclose(of_own - np.mean(of_own), own - np.mean(own), atol=0.03)
    else:
        assert np.sqrt(known) < 0.015
        assert found.nats > free.nats + len(fit.trials)


def test_what_sizes_of_all_sites_have_in_common_is_the_laws(record: Callable[..., list[Trial]]) -> None:
    trials = record(44, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    dashpot = library()["parallel_dashpot"]
    law = Law(dashpot, {**dashpot.null, dashpot.amplitude: 0.5}, (dashpot.amplitude,))
    fit = with_own_values(replace(fit, shared=replace(fit.shared, laws=(law,))))
    states = [
        replace(s, coefficients=np.array([c])) for s, c in zip(fit.states, (0.1, 0.3, 0.2), strict=True)
    ]
    off = replace(fit, states=tuple(states))
    found = centred(off)
    assert found.shared.laws[0].values[dashpot.amplitude] == pytest.approx(0.5 * np.exp(0.2))
    assert [float(s.coefficients[0]) for s in found.states] == pytest.approx([-0.1, 0.1, 0.0])
    for j in range(3):
        np.testing.assert_allclose(found.force_mn(j), off.force_mn(j), atol=1e-9)
    assert found.cost < off.cost


def test_a_size_far_from_that_of_its_site_is_approached_step_by_step(
    record: Callable[..., list[Trial]],
) -> None:
    trials = record(43, plans=study_plans(depths_mm=(0.5,), repeats=3, hold_s=1.0, dwell_s=0.2))
    fit = fit_baseline(take_in_memory(trials).trials)
    dashpot = library()["parallel_dashpot"]

    def beside(coefficient: float) -> Shared:
        return replace(
            fit.shared, laws=(Law(dashpot, {dashpot.amplitude: coefficient}, (dashpot.amplitude,)),)
        )

    forces = [simulate(t, s, beside(100.0)) for t, s in zip(fit.trials, fit.states, strict=True)]
    dragging = tuple(replace(t, force_mn=f) for t, f in zip(fit.trials, forces, strict=True))
    begun = with_own_values(replace(fit, trials=dragging, shared=beside(0.1)))
    found = begun.with_states()
    assert found.left_mn < begun.left_mn
    for state in found.states:
        # the line alone would multiply the size by more than a number can hold
        assert 0.0 < state.coefficients[0] < np.log(100.0 / 0.1)


def test_no_tissue_begins_where_no_trial_comes(record: Callable[..., list[Trial]]) -> None:
    """Beside other laws contacts may be sent anywhere: that is said, and no arithmetic fails."""
    trials = take_in_memory(record(47)).trials
    beyond_mm = [float(t.position_mm.max()) + 1.0 for t in trials]
    with pytest.raises(BadInputError, match="nothing to compare"):
        start_tissue(trials, beyond_mm, [t.force_mn for t in trials])
