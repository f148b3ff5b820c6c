"""A law that is as large in each trial as the day has it is that law, and another where it differs in form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, lfilter_zi

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.levels import SMALL_SHARE
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans

LAG_MS, SCATTER = 2.5, 0.15


def _late(trial: Trial, lag_ms: float) -> Trial:
    """Return a trial whose force is read through one pole."""
    decay = float(np.exp(-1e3 / lag_ms / trial.sample_rate_hz))
    b, a = [1.0 - decay], [1.0, -decay]
    return replace(trial, force_v=lfilter(b, a, trial.force_v, zi=lfilter_zi(b, a) * trial.force_v[0])[0])


@pytest.fixture(scope="module")
def lags_ms() -> np.ndarray:
    """How late the force is in each trial."""
    return LAG_MS * (1.0 + SCATTER * np.random.default_rng(61).normal(size=10))


@pytest.fixture(scope="module")
def late(record: Callable[..., list[Trial]], lags_ms: np.ndarray) -> Account:
    """The account, laws exact, of a lag whose time differs from trial to trial."""
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=5, hold_s=1.0, dwell_s=0.4)
    trials = [_late(t, float(lag)) for t, lag in zip(record(62, "", plans), lags_ms, strict=True)]
    fit = fit_baseline(take_in_memory(trials).trials)
    (template, *_) = (t for t in templates(fit.trials) if t.name == "force_lag")
    return Account(fit).with_laws((template.as_law(LAG_MS),)).weighed_anew()


def test_a_law_whose_size_differs_from_trial_to_trial_is_found_to_do_so(
    late: Account, lags_ms: np.ndarray
) -> None:
    """Its size in every trial follows the truth, and the scatter is told."""
    sized = late.sized
    assert sized.nats > late.nats + 100.0
    assert sized.inexact.sizes["force_lag"] == pytest.approx(np.std(lags_ms) / LAG_MS, rel=0.5)
    larger = [s.coefficients[-1] for s in sized.fit.states]
    assert np.corrcoef(larger, lags_ms)[0, 1] > 0.95


def test_by_that_it_is_not_off_in_form(late: Account) -> None:
    """Before sizes were its own, an eighth of such evidence came of granting a lag to be off, and it had no name."""
    reweighed = late.granting()
    nothing = Account(late.fit).stripped("force_lag").with_laws(())
    assert reweighed.inexact.sizes
    assert reweighed.granted < 0.2 * SMALL_SHARE * reweighed.gain_over(nothing)[0]
    # the mean is told as well as so many trials can
    assert reweighed.fit.shared.laws[0].values["time_constant_ms"] == pytest.approx(LAG_MS, rel=0.12)
