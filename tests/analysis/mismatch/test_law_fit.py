"""Steps of the laws' fit: what meets a bound is held there, and the others go where they should beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import Bounds, minimize

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.law_fit import (
    LARGEST_TISSUE_STEP,
    STEP,
    bounded_step,
    law_columns,
    law_prior,
    parameter_scale,
    vector,
    with_room,
    with_value,
)
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.own import solved
from analysis.mismatch.model.effects import TISSUE_SIZE, Law, OwnShape, Shared, simulate
from analysis.mismatch.name.law_sizes import law_sizes, size_is_told
from analysis.mismatch.name.own_sizes import SIZE_INEXACT
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import Mechanism, library

CELLS = 60


@given(st.integers(0, 10**6))
def test_a_step_is_the_best_that_keeps_within_all_bounds(seed: int) -> None:
    """Against a general minimiser within the same bounds."""
    random = np.random.default_rng(seed)
    inertia, friction = library()["arm_inertia"], library()["viscous_friction"]
    laws = (
        Law(inertia, {**inertia.null, "mass_g": 0.05}, ("mass_g",)),
        Law(friction, {**friction.null, friction.amplitude: 0.05}, (friction.amplitude,)),
    )
    shared = Shared(laws)
    now = vector(shared)
    X = random.normal(size=(CELLS, TISSUE_SIZE + len(now)))
    X[:, -2] += 0.9 * X[:, -1]  # what is correlated must follow what is stopped
    wanted = np.concatenate([random.uniform(-0.7, 0.7, TISSUE_SIZE), random.normal(scale=(0.2, 0.2, 4.0))])
    y = X @ wanted
    scale = np.sqrt(np.sum(X**2, axis=0))
    room = np.append(np.full(TISSUE_SIZE - 1, -np.inf), -random.uniform(0.0, LARGEST_TISSUE_STEP))
    step = bounded_step(shared, (X.T @ X) / np.outer(scale, scale), (X.T @ y) / scale, scale, room)
    tissue = np.full(TISSUE_SIZE, LARGEST_TISSUE_STEP)
    lower = np.concatenate([np.maximum(-tissue, room), -now[:2], [shared.delay_ends[0]]])
    upper = np.concatenate([tissue, [np.inf, np.inf], [shared.delay_ends[1]]])
    best = minimize(
        lambda x: 0.5 * float(np.sum((X @ x - y) ** 2)),
        np.zeros(len(wanted)),
        jac=lambda x: X.T @ (X @ x - y),
        method="L-BFGS-B",
        bounds=Bounds(lower, upper),
        options={"ftol": 1e-15, "gtol": 1e-10},
    )
    assert np.all(step >= lower - 1e-9)
    assert np.all(step <= upper + 1e-9)
    assert 0.5 * float(np.sum((X @ step - y) ** 2)) <= best.fun * (1.0 + 1e-6) + 1e-9


@given(st.integers(0, 10**6), st.floats(1e-6, 1e6))
def test_what_a_trial_shows_nothing_of_stays_where_it_is(seed: int, scale: float) -> None:
    """The others are solved for as if it were not there, in whatever units they are."""
    random = np.random.default_rng(seed)
    J = random.normal(size=(20, 4)) * [1.0, scale, 0.0, 1.0]
    y, shown = random.normal(size=20), [0, 1, 3]
    found = solved(J.T @ J, J.T @ y)
    assert found[2] == 0.0
    inverse = solved(J.T @ J, np.eye(4))
    assert not np.any(inverse[2])
    assert not np.any(inverse[:, 2])
    np.testing.assert_allclose(found[shown], np.linalg.lstsq(J[:, shown], y)[0], rtol=1e-6)


def test_the_column_of_a_delay_is_its_difference(record: Callable[..., list[Trial]]) -> None:
    """By half a sample to either side; what is added to the force comes when it comes."""
    fit = fit_baseline(take_in_memory(record(47)).trials)
    trial, state = fit.trials[0], fit.states[0]
    added_mn = np.sin(40.0 * trial.time_s)
    state = state.with_shapes([OwnShape("block", "force", added_mn, 1.0)], 0.5)
    friction = library()["coulomb_friction"]
    laws = (Law(friction, {**friction.null, friction.amplitude: 2.0}, (friction.amplitude,)),)
    late, here, early = (replace(fit.shared, laws=laws, delay_samples=d) for d in (1.4, 0.9, 0.4))
    changed_mn = simulate(trial, state, late) - simulate(trial, state, early)
    np.testing.assert_allclose(law_columns(trial, state, here)[:, -1], changed_mn, atol=1e-9)


@pytest.mark.parametrize("name", ["power_law_relaxation", "third_relaxation", "poroelastic_drainage"])
def test_what_tissue_leaves_of_a_column_is_a_derivative(
    record: Callable[..., list[Trial]], name: str
) -> None:
    """Beside tissue, size and form of a relaxation trade: what tells them is a thousandth of what each changes."""
    fit = fit_baseline(take_in_memory(record(47)).trials)
    law = library()[name]
    values = {**law.null, **law.typical}
    shared = replace(fit.shared, laws=(Law(law, values, tuple(p.name for p in law.parameters)),))
    columns = law_columns(fit.trials[0], fit.states[0], shared)
    for k, p in enumerate(law.parameters):
        h = 1e-4 * parameter_scale(p, values[p.name], values[p.name])
        there, here = (
            simulate(fit.trials[0], fit.states[0], with_value(shared, 0, p, p.to_fit(values[p.name]) + step))
            for step in (h, -h)
        )
        both = fit.projectors[0](np.column_stack([columns[:, k], (there - here) / (2.0 * h)]))
        assert np.linalg.norm(both[:, 0] - both[:, 1]) < 5e-5 * np.linalg.norm(both[:, 1]), p.name


@pytest.mark.parametrize("law", [m for m in library().values() if m.form == "law"], ids=lambda m: m.name)
def test_a_parameter_is_moved_by_enough_to_be_seen_where_the_textbook_has_it(law: Mechanism) -> None:
    """Some are nothing there, and typically; a difference as small as a rounding error says nothing of them."""
    for p in law.parameters:
        null = law.null[p.name]
        scale = parameter_scale(p, null, law.typical.get(p.name, null))
        at = min(abs(p.to_fit(null)), 1.0)
        assert STEP * scale > 1e-6 * at
        assert scale > 1e-6


def test_what_ended_at_a_bound_takes_up_nothing(record: Callable[..., list[Trial]]) -> None:
    """It can't go where the trials would have it, and what it would so explain is left for others to explain."""
    fit = fit_baseline(take_in_memory(record(47)).trials)
    inertia = library()["arm_inertia"]
    names = tuple(p.name for p in inertia.parameters)
    ended = next(p for p in inertia.parameters if p.inner)
    inside = Law(inertia, {**inertia.null, inertia.amplitude: 0.3}, names)
    at_end = replace(inside, values={**inside.values, ended.name: ended.lower})
    place = names.index(ended.name)
    for law, free in ((inside, 1.0), (at_end, 0.0)):
        shared = replace(fit.shared, laws=(law,))
        expected = np.ones(len(names) + 1)
        expected[place] = free
        np.testing.assert_array_equal(with_room(shared), expected)
        column = Account(replace(fit, shared=shared)).columns(0)[:, place]
        assert bool(np.any(column)) == bool(free)


def test_a_law_s_size_and_time_are_known_to_its_tenth(record: Callable[..., list[Trial]]) -> None:
    """However little noise there is: no arm of any skin is right to a hundredth."""
    arm = library()["third_relaxation"]
    law = Law(arm, {"ratio_to_k0": 0.2, "time_constant_s": 0.7}, ("ratio_to_k0", "time_constant_s"))
    # of the force or of the position, which is a force in contact
    trials = [replace(t, position_error_mm=None) for t in take_in_memory(record(49)).trials]
    fit = fit_baseline(trials)
    quiet = replace(fit, shared=Shared((law,))).weighed_by(NoiseModel(1e-3))
    found = law_sizes(Account(quiet), law)
    for name, value in law.values.items():
        assert SIZE_INEXACT * value <= found[name].se < 2.0 * SIZE_INEXACT * value


def test_whatever_tells_a_law_s_size_is_known_to_a_tenth_of_it(record: Callable[..., list[Trial]]) -> None:
    """A level to a tenth of what it cuts off, a power to a tenth of what it bends: never to a tenth of themselves."""
    fit = fit_baseline(take_in_memory(record(53)).trials).weighed_by(NoiseModel(1e-3))
    cut_mn = 10.0
    level_mn = max(float(t.force_mn.max()) for t in fit.trials) - cut_mn
    saturation, stiffening = library()["force_saturation"], library()["stiffening"]
    for law, name, whole in (
        (Law(saturation, {**saturation.null, "level_mn": level_mn}, ("level_mn",)), "level_mn", cut_mn),
        (Law(stiffening, {**stiffening.null, "exponent": 1.2}, ("exponent",)), "exponent", 0.2),
    ):
        se = law_sizes(Account(replace(fit, shared=Shared((law,)))), law)[name].se
        assert 0.3 * SIZE_INEXACT * whole < se < 2.0 * SIZE_INEXACT * whole, (name, se)


def test_a_power_is_known_beforehand_and_a_size_is_not() -> None:
    """Four ramps of muscle tell little of one: the fit ran to the end of its range, 16."""
    stiffening, power_law = library()["stiffening"], library()["power_law_relaxation"]
    for mechanism, size, power in (
        (stiffening, "coefficient_per_mm", "exponent"),
        (power_law, "coefficient_mn_per_mm", "exponent"),
    ):
        law = Law(mechanism, dict(mechanism.null), (size, power))
        precision, centre = law_prior([law])
        (p,) = (p for p in law.parameters if p.name == power)
        assert precision[:2] == pytest.approx([0.0, (0.3 * (p.upper - p.lower)) ** -2])
        assert centre[1] == mechanism.null[power]


def test_a_size_within_two_errors_of_nothing_is_not_told(record: Callable[..., list[Trial]]) -> None:
    fit = fit_baseline(take_in_memory(record(51)).trials)
    arm = library()["third_relaxation"]
    law = Law(arm, {"ratio_to_k0": 0.1, "time_constant_s": 0.7}, ("ratio_to_k0", "time_constant_s"))

    def told(ratio: float) -> bool:
        sized = replace(law, values={**law.values, "ratio_to_k0": ratio})
        account = Account(replace(fit, shared=Shared((sized,))))
        size = law_sizes(account, sized)["ratio_to_k0"]
        assert size_is_told(account, sized) == (size.value > 2.0 * size.se)
        return size_is_told(account, sized)

    assert not told(1e-3)
    assert told(0.5)
    # one or two trials are no population
    sized = replace(law, values={**law.values, "ratio_to_k0": 1e-3})
    two = fit_baseline(take_in_memory(record(51)[:2]).trials)
    assert size_is_told(Account(replace(two, shared=Shared((sized,)))), sized)


def test_what_a_kinder_noise_brings_is_no_gain_of_an_effect(record: Callable[..., list[Trial]]) -> None:
    fit = fit_baseline(take_in_memory(record(52)).trials)
    harsh = Account(fit.weighed_by(NoiseModel(2.0 * fit.noise.white_mn)).with_population(1))
    kinder = harsh.at_noise(fit.noise)
    assert kinder.gain_over(harsh)[0] > 100.0
    assert abs(kinder.gain_by_itself(harsh)[0]) < 1.0
