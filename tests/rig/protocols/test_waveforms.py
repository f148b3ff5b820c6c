"""Waveforms begin next to where the arm is, end where they should, and never exceed their speed."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rig.protocols.waveforms import ramp_mm, there_and_back_mm

positions = st.floats(0, 10)


@given(start=positions, stop=positions, speed=st.floats(0.05, 100), rate=st.sampled_from([1000.0, 8000.0]))
def test_ramp(start: float, stop: float, speed: float, rate: float) -> None:
    waveform = ramp_mm(start, stop, speed, rate)
    steps = np.diff(np.concatenate([[start], waveform]))
    if abs(stop - start) < 1e-9 * speed / rate:
        assert len(waveform) <= 1
        return
    assert waveform[-1] == stop
    assert np.all(np.abs(steps) <= speed / rate * (1 + 1e-6))
    assert np.all(steps * np.sign(stop - start) >= -1e-12)
    # no longer than needed: one sample fewer would be too fast
    assert abs(stop - start) > (len(waveform) - 1) * speed / rate * (1 - 1e-6)


@given(start=positions, speed=st.floats(0.05, 100))
def test_there_and_back_returns(start: float, speed: float) -> None:
    waveform = there_and_back_mm(start, start + 1, speed, 8000.0)
    assert waveform[-1] == start
    assert np.max(waveform) == start + 1
