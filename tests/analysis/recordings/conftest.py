from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from analysis.recordings import TrialHeader
from analysis.recordings.trial import (
    Calibration,
    Event,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)

SHARED = Path(__file__).parents[3].parent / "shared" / "recordings"

CALIBRATION = Calibration(
    2.05, -10.1, 0.0151, 0.02, 2.04, -10.05, "2026-01-31T12:00:00+01:00", {"volts_per_mm": 1e-4}
)


def _trial(n_samples: int = 400, **changes: Any) -> Trial:
    rng = np.random.default_rng(n_samples)
    trial = Trial(
        trial_id="11111111-2222-3333-4444-555555555555",
        started="2026-01-31T12:00:00+01:00",
        kind="ramp_hold_retract",
        source="simulated",
        status="complete",
        software="indenter",
        software_version="0.1",
        sample_rate_hz=8000.0,
        position_v=rng.normal(size=n_samples),
        force_v=rng.normal(size=n_samples),
        command_v=rng.normal(size=n_samples),
        calibration=CALIBRATION,
        phases=(Phase("approach", 0, n_samples // 4), Phase("hold", n_samples // 4, n_samples)),
        surface=Surface(5.1, 20, 3.5, 10.0),
        protocol=ProtocolSummary(depth_mm=0.4, hold_s=7.0, toml='name = "a"\n'),
        specimen=Specimen("s1", "index", "pad", 2, 0.5, 130.0, "né"),
        events=(Event(3, "limit", "über 500 mN"),),
        log=("made", "for a test"),
    )
    return replace(trial, **changes)


def _header(**changes: Any) -> TrialHeader:
    header = TrialHeader("ramp_hold_retract", "simulated", 8000.0, CALIBRATION)
    return replace(header, **changes)


def _assert_same(read: Trial, written: Trial) -> None:
    arrays = ("position_v", "force_v", "command_v")
    for name in arrays:
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    if written.native is None:
        assert read.native is None
    else:
        assert read.native is not None
        for name in ("time_s", "position_mm", "force_mn"):
            np.testing.assert_array_equal(getattr(read.native, name), getattr(written.native, name))
    assert read.other_channels.keys() == written.other_channels.keys()
    for name, values in written.other_channels.items():
        np.testing.assert_array_equal(read.other_channels[name], values)
    plain = {"native": None, "path": "", "other_channels": {}} | dict.fromkeys(arrays)
    assert replace(read, **plain) == replace(written, **plain)


@pytest.fixture
def foreign_file(tmp_path: Path) -> Callable[..., Path]:
    """A trial file as another program might write it, by h5py alone; `change` spoils it."""

    def make(change: Callable[[Any], None] = lambda file: None, name: str = "foreign.h5") -> Path:
        path = tmp_path / name
        with h5py.File(path, "w") as file:
            file.attrs["format"] = np.bytes_(b"indenter-trial")
            file.attrs["format_version"] = np.int32(1)
            file.attrs["trial_id"] = "a"
            file.attrs["started"] = "2026-01-31T12:00:00+01:00"
            file.attrs["software"] = np.array(["other"], dtype=h5py.string_dtype())
            file.attrs["software_version"] = b"2"
            file.attrs["status"] = "complete"
            file.attrs["kind"] = "ramp_hold_retract"
            file.attrs["source"] = "nidaqmx"
            file.attrs["colour"] = "green"
            signals = file.create_group("signals")
            signals.attrs["sample_rate_hz"] = 8000
            signals["position_v"] = np.linspace(0, 1, 100, dtype="f4")
            signals.create_dataset("force_v", data=np.arange(100), chunks=(32,), compression="gzip")
            signals["temperature_v"] = np.zeros(100)
            calibration = file.create_group("calibration")
            for constant in ("volts_per_mm", "volts_per_mn"):
                calibration.attrs[constant] = np.float32(2.0)
            for constant in ("position_zero_v", "force_zero_v"):
                calibration.attrs[constant] = 0
            phases = np.array(
                [(b"approach", 0, 10), ("dwell", 10, 10), ("ramp", 10, 40), ("hold", 40, 100)],
                dtype=[("stop_", "S8"), ("start", "i4"), ("stop", "i8")],
            )
            phases.dtype.names = ("name", "start", "stop")
            file["phases"] = phases
            change(file)
        return path

    return make


@pytest.fixture(scope="session")
def shared() -> Path:
    if not SHARED.is_dir():
        pytest.skip("the real recordings (../shared/recordings) are not here")
    return SHARED


@pytest.fixture(scope="session")
def a_trial() -> Callable[..., Trial]:
    """Function (n_samples, changed fields) -> a trial with something in every field."""
    return _trial


@pytest.fixture(scope="session")
def a_header() -> Callable[..., TrialHeader]:
    """Function (changed fields) -> the header of a trial that is to be written."""
    return _header


@pytest.fixture(scope="session")
def assert_same_trial() -> Callable[[Trial, Trial], None]:
    """Function that compares a trial read with the one written, arrays to the bit."""
    return _assert_same
