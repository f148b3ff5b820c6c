"""The end of contact within a sample: a card may average over it, and a punch that leaves quickly shows that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.mismatch.evidence import account
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import with_own_values
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.effects import Law
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Phase, Trial
from analysis.simulation.forward import _lifted
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans

SAMPLES = 8
"""So many samples of the rig are one of a card that averages."""


def _averaged(trial: Trial) -> Trial:
    n = trial.n_samples // SAMPLES

    def means(signal_v: np.ndarray) -> np.ndarray:
        return signal_v[: n * SAMPLES].reshape(n, SAMPLES).mean(axis=1)

    assert trial.surface is not None
    assert trial.command_v is not None
    return replace(
        trial,
        sample_rate_hz=trial.sample_rate_hz / SAMPLES,
        position_v=means(trial.position_v),
        force_v=means(trial.force_v),
        command_v=means(trial.command_v),
        phases=tuple(Phase(p.name, p.start // SAMPLES, p.stop // SAMPLES) for p in trial.phases),
        surface=replace(trial.surface, sample=trial.surface.sample // SAMPLES),
    )


def test_the_end_of_contact_averaged_over_a_sample_is_no_adhesion(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    plans = study_plans(depths_mm=(0.4, 0.7), repeats=5, hold_s=2.0, dwell_s=0.4, retract_speed_mm_s=25.0)
    fit = fit_baseline(take_in_memory([_averaged(t) for t in record(92, plans=plans)]).trials)
    law = Law(library()["adhesion"], {**library()["adhesion"].typical, "pull_off_mn": 0.3}, ("pull_off_mn",))
    clinging = with_own_values(replace(fit, shared=replace(fit.shared, laws=(law,))))

    def gained() -> float:
        return Account(clinging).with_laws((law,)).gain_over(Account(fit))[0]

    assert gained() < 0.0
    foreseen = account.foreseen_columns

    def but_that(*given: object) -> np.ndarray:
        columns = foreseen(*given)
        return np.column_stack([0.0 * columns[:, 0], columns[:, 1:]])

    monkeypatch.setattr(account, "foreseen_columns", but_that)
    assert gained() > ENOUGH_SHARED


@given(at=st.floats(-0.7, 0.7), slope=st.floats(0.1, 50.0), away=st.sampled_from((-1.0, 1.0)))
def test_a_line_that_ends_in_a_cell_is_averaged_over_it(at: float, slope: float, away: float) -> None:
    time_s = np.arange(7.0)
    free = away * slope * (time_s - 3.0 - at)
    found = _lifted(free[None], time_s, np.ones(7))[0]
    finely = away * slope * (time_s[:, None] + np.linspace(-0.5, 0.5, 20001) - 3.0 - at)
    np.testing.assert_allclose(found, np.maximum(finely, 0.0).mean(axis=1), atol=1e-4 * slope)
