"""Effects that are large only against each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import one_shows_alone
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import with_own_values
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.effects import Law
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans

DASHPOT = ("parallel_dashpot", "coefficient_mn_s_per_mm", 0.6)
LAG = ("force_lag", "time_constant_ms", 2.0)
PULL = ("adhesion", "pull_off_mn", 3.0)
PLANS = study_plans(depths_mm=(0.3, 0.7), repeats=4, hold_s=2.0, dwell_s=0.4, ramp_speed_mm_s=4.0)


def _concealed(*effects: tuple[str, str, float]) -> str:
    return "".join(f'[[effects]]\nname = "{name}"\n{parameter} = {v}\n' for name, parameter, v in effects)


def _rippled(trial: Trial) -> Trial:
    """Return a trial whose position is read with a gear's ripple of 2.8 um every 72 um."""
    read_v, read_mm = trial.position_v, trial.position_mm
    volts_per_mm = (read_v[0] - read_v.max()) / (read_mm[0] - read_mm[np.argmax(read_v)])
    ripple_mm = 2.8e-3 * np.sin(2.0 * np.pi * read_mm / 0.072)
    return replace(trial, position_v=read_v + volts_per_mm * ripple_mm)


def _with(trials: Sequence[Trial], *effects: tuple[str, str, float]) -> tuple[Account, Account]:
    """Return the account of trials without effects, and that with some of them fitted."""
    nothing = Account(fit_baseline(take_in_memory(trials).trials))
    laws = tuple(
        Law(library()[name], {**library()[name].null, parameter: v}, (parameter,))
        for name, parameter, v in effects
    )
    fit = with_own_values(replace(nothing.fit, shared=replace(nothing.fit.shared, laws=laws)))
    return nothing, Account(fit).with_laws(laws)


def test_a_dashpot_and_a_lag_that_smooth_a_gear_s_ripple_only_cancel(
    record: Callable[..., list[Trial]],
) -> None:
    """A dashpot before a sensor that lags is one more arm, and takes out what a position has and a force has not."""
    nothing, both = _with([_rippled(t) for t in record(95, plans=PLANS)], DASHPOT, LAG)
    assert both.nats > nothing.nats + 100.0 * ENOUGH_SHARED
    assert not one_shows_alone(both, nothing)


@pytest.mark.parametrize("effects", [(DASHPOT, PULL), (DASHPOT, LAG), (PULL,)], ids=["two", "a lag", "one"])
def test_of_effects_that_are_there_one_shows_alone(
    effects: tuple[tuple[str, str, float], ...], record: Callable[..., list[Trial]]
) -> None:
    nothing, found = _with(record(95, _concealed(*effects), PLANS), *effects)
    assert one_shows_alone(found, nothing)
