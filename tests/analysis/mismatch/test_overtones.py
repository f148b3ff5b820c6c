"""A pulse near an overtone of a breath is found where it is, and as large as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.name import overtones
from analysis.mismatch.name.options import added, own_options
from analysis.mismatch.name.overtones import plainer
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans


@pytest.mark.parametrize(
    ("breath_hz", "pulse_hz"), [(0.55, 1.12), (0.40, 1.21)], ids=["its second", "its third"]
)
def test_a_pulse_near_an_overtone_of_a_breath_is_found(
    breath_hz: float, pulse_hz: float, record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The overtones took the pulse up, or left its third to be found as a pulse of a thirtieth of its size."""
    both = "".join(
        f'[[effects]]\nname = "{name}"\namplitude_um = {amplitude_um}\nfrequency_hz = {hz}\nrough = 0.6\n'
        for name, amplitude_um, hz in (("respiration", 20.0, breath_hz), ("heartbeat", 3.0, pulse_hz))
    )
    plans = study_plans(depths_mm=(0.5, 0.7), repeats=3, hold_s=6.0, dwell_s=1.0)
    start = Account(fit_baseline(take_in_memory(record(71, both, plans)).trials))
    assert not list(plainer(start))
    breath = own_options(start, "respiration")[0].refit()
    counts = [len(account.fit.states[0].shapes) for account in (breath, *plainer(breath))]
    assert counts == sorted(set(counts), reverse=True)
    assert len(counts) == 3

    there = added(own_options(breath, "heartbeat"), breath)
    found_hz = [r.frequency_hz for state in there.fit.states for r in state.rhythms]
    assert np.median(found_hz) == pytest.approx(pulse_hz, abs=0.03)
    monkeypatch.setattr(overtones, "PLAINER", ())
    beside_all = added(own_options(breath, "heartbeat"), breath)
    assert there.gain_over(beside_all)[0] > 100.0
