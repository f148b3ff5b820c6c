"""What is left, and what was found but has no name: how much of everything it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.levels import ENOUGH_OWN
from analysis.mismatch.locate.remainder import Nameless, is_small, nameless_of, remainder_of
from analysis.mismatch.locate.windows import PLACES, course_columns, own_evidence
from analysis.mismatch.model.effects import OwnShape
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans


@pytest.mark.parametrize("size_mn", [0.2, 2.0])
@pytest.mark.parametrize(
    ("hz", "least", "most"), [(0.0, 0.5, 1.0), (10.0, 0.9, 1.1)], ids=["slow", "too quick for any tissue"]
)
def test_what_has_no_name_is_told_by_its_share_and_its_force(
    record: Callable[..., list[Trial]], size_mn: float, hz: float, least: float, most: float
) -> None:
    """Of what is slow, tissue that is fitted without it takes a part up."""
    fit = fit_baseline(
        take_in_memory(record(48, plans=study_plans(depths_mm=(0.5,), repeats=4, hold_s=1.0))).trials
    )
    trials, states = [], []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        held_s = trial.time_s - trial.hold_window_s[0] - 0.23
        twitch = np.exp(-0.5 * (held_s / 0.05) ** 2) * np.cos(2.0 * np.pi * hz * held_s)
        trials.append(replace(trial, force_mn=trial.force_mn + size_mn * twitch))
        states.append(state.with_shapes([OwnShape("transient", "force", twitch, 1.0)], size_mn))
    twitching = replace(fit, trials=tuple(trials))
    nothing = Account(twitching.with_states())
    account = Account(replace(twitching, states=tuple(states)).with_states(), steps={"transient": 0.0})
    found = nameless_of(account, nothing, [])
    assert found.share == pytest.approx(1.0, abs=0.05)
    # rms of a Gaussian of 0.05 s, and of a wave beneath it, over a hold of 1 s
    rms_mn = size_mn * np.sqrt((0.5 if hz else 1.0) * np.sqrt(np.pi) * 0.05)
    assert least * rms_mn < found.rms_mn < most * rms_mn
    assert not is_small(found.share, found.rms_mn, 10.0)
    # with a name it is none of this
    assert nameless_of(account, nothing, ["transient"]) == Nameless(0.0, 0.0, account)


def test_little_without_a_name_is_what_laws_leave_over() -> None:
    assert is_small(0.02, 0.1, 0.3)
    assert not is_small(0.02, 0.4, 0.3)
    assert not is_small(0.2, 0.1, 0.3)


@pytest.mark.parametrize("phase", ["ramp", "hold", "retract"])
def test_what_changes_smoothly_within_a_phase_is_a_shape(
    record: Callable[..., list[Trial]], phase: str
) -> None:
    """Skin that softens on the way back makes no steps: heights that change at edges only leave 16 to 39 % of it."""
    trial = take_in_memory(record(50, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=1.0))).trials[0]
    start_s, stop_s = trial.span_s(np.flatnonzero(trial.in_phase(phase)))
    smooth = np.sin(np.pi * np.clip((trial.time_s - start_s) / (stop_s - start_s), 0.0, 1.0))
    columns = course_columns(trial)
    left = smooth - columns @ np.linalg.lstsq(columns, smooth, rcond=None)[0]
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(smooth)


@pytest.mark.parametrize("size_mn", [0.0, 3.0])
def test_what_goes_to_and_fro_in_a_motion_is_no_noise(
    record: Callable[..., list[Trial]], size_mn: float
) -> None:
    """A screw that rattles as the arm goes back, begun anew in each trial: no window has a height of it.

    H0: at rest the noise is as loud. In a window of 500 cells a size larger by a third comes by chance once in 10^17.
    """
    random = np.random.default_rng(61)
    trials = []
    for trial in take_in_memory(record(61)).trials:
        phase = random.uniform(0.0, 2.0 * np.pi)
        rattles = [
            size_mn * np.sin(2.0 * np.pi * 75.0 * time_s + phase) * np.interp(time_s, trial.time_s, back)
            for back in [trial.in_phase("retract").astype(float)]
            for time_s in (trial.time_s, trial.full_time_s)
        ]
        full_mn = (trial.full_force_mn + rattles[1]).astype(np.float32)
        trials.append(replace(trial, force_mn=trial.force_mn + rattles[0], full_force_mn=full_mn))
    nothing = Account(fit_baseline(trials))
    left = remainder_of(nothing, nothing)
    assert left.significant is (size_mn > 0.0)
    if size_mn:
        odds = own_evidence(nothing.fit)[1]
        assert PLACES[int(np.argmax(odds))].phase == "retract"


@pytest.mark.parametrize("everywhere", [False, True])
def test_what_wanders_in_contact_alone_counts_from_a_tenth_of_the_tolerance(
    record: Callable[..., list[Trial]], everywhere: bool
) -> None:
    """Skin that moves by itself is no noise of the sensor, which is heard before and after contact too."""
    random = np.random.default_rng(11)
    trials = []
    for trial in take_in_memory(
        record(49, plans=study_plans(depths_mm=(0.5,), repeats=6, hold_s=4.0))
    ).trials:
        lasts = np.exp(-1.0 / (0.1 * trial.sample_rate_hz))
        anew = 0.2 * np.sqrt(1.0 - lasts**2) * random.standard_normal(len(trial.full_force_mn))
        touched = np.any([trial.in_phase(name) for name in ("dwell", "ramp", "hold")], axis=0)
        wander_mn = lfilter([1.0], [1.0, -lasts], anew) * (
            everywhere or np.repeat(touched, trial.counts.astype(int))
        )
        force_mn = trial.force_mn + trial.cell_means(wander_mn)
        full_mn = (trial.full_force_mn + wander_mn).astype(np.float32)
        trials.append(replace(trial, force_mn=force_mn, full_force_mn=full_mn))
    account = Account(fit_baseline(trials))
    remainder = remainder_of(account, account)
    if everywhere:
        assert remainder.wander.nats < ENOUGH_OWN
        return
    assert remainder.wander.nats > ENOUGH_OWN
    assert remainder.wander.rms_mn == pytest.approx(0.2, rel=0.25)
    assert remainder.beyond(1.0).own == remainder.wander.nats
    assert remainder.beyond(3.0) is remainder
