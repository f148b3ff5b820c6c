"""Corrupted and random trial files: every one gives a fit, a flagged row, or one clear line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import write_trial
from analysis.recordings.trial import PHASE_NAMES, Phase, Trial
from analysis.relaxation.batch import fit_files
from analysis.relaxation.result import Model


def corrupted(whole: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of a good file, cut, overwritten or swapped somewhere."""
    data = bytearray(whole)
    kind = rng.integers(4)
    if kind == 0:
        return bytes(data[: rng.integers(0, len(data))])
    start = int(rng.integers(0, len(data) if kind == 1 else 8000))
    length = int(rng.integers(1, 400 if kind == 1 else 24))
    data[start : start + length] = rng.integers(
        0, 256, len(data[start : start + length]), dtype=np.uint8
    ).tobytes()
    if kind == 3:
        at = int(rng.integers(0, len(data) - 4096))
        data[at : at + 4096] = bytes(4096)
    return bytes(data)


def random_signal(rng: np.random.Generator, n: int) -> np.ndarray:
    kind = rng.integers(8)
    ramp = np.linspace(0, 1, n)
    signals = (
        lambda: np.zeros(n),
        lambda: np.full(n, rng.normal() * 10.0 ** rng.integers(-300, 300)),
        lambda: rng.normal(size=n) * 10.0 ** rng.integers(-12, 6),
        lambda: np.cumsum(rng.normal(size=n)),
        lambda: ramp * rng.normal(),
        lambda: np.clip(5 * (ramp - 0.3), 0, 1) * rng.normal() + rng.normal(size=n) * 1e-3,
        lambda: np.sign(np.sin(40 * ramp)),
        lambda: np.exp(-5 * ramp) + np.clip(50 * (ramp - 0.2), 0, 1),
    )
    return signals[kind]()


def random_trial(trial: Trial, rng: np.random.Generator) -> Trial:
    """A trial that keeps the layout and nothing else; about half of them keep one good signal."""
    n = int(rng.choice([1, 2, 21, 50, 400, 4000, 20000]))
    if rng.random() < 0.3:
        n = trial.n_samples
    position = trial.position_v[:n] if rng.random() < 0.4 else random_signal(rng, n)
    force = trial.force_v[:n] if rng.random() < 0.4 else random_signal(rng, n)
    n = min(len(position), len(force))
    names = [name for name in PHASE_NAMES if rng.random() < 0.7 or name == "hold"]
    cuts = np.sort(rng.integers(0, n + 1, 2 * len(names)))
    phases = tuple(
        Phase(name, int(a), int(b)) for name, a, b in zip(names, cuts[::2], cuts[1::2], strict=True) if b > a
    )
    if n == trial.n_samples and rng.random() < 0.6:
        phases = trial.phases
    command = None if rng.random() < 0.5 else random_signal(rng, n)
    calibration = replace(
        trial.calibration,
        volts_per_mn=float(rng.choice([0.015, -0.015, 1e-12, 1e12])),
        volts_per_mm=float(rng.choice([2.042, -2.042, 1e-9, 1e9])),
    )
    return replace(
        trial,
        position_v=position[:n],
        force_v=force[:n],
        command_v=command,
        phases=phases,
        calibration=calibration if rng.random() < 0.5 else trial.calibration,
        sample_rate_hz=float(rng.choice([8000.0, 1e-3, 1e6])) if rng.random() < 0.3 else trial.sample_rate_hz,
    )


def fuzz(folder: Path, trial: Trial, count: int, seed: int) -> Counter[str]:
    good = folder / "good.h5"
    write_trial(good, trial)
    whole = good.read_bytes()
    rng = np.random.default_rng(seed)
    outcomes: Counter[str] = Counter()
    for number in range(count):
        path = folder / f"{number}.h5"
        try:
            if number % 2:
                path.write_bytes(corrupted(whole, rng))
            else:
                write_trial(path, random_trial(trial, rng))
        except BadInputError as refused:
            assert "\n" not in str(refused)
            outcomes["refused when written"] += 1
            continue
        model: Model = "ramp" if rng.random() < 0.6 else "step"
        (row,) = fit_files([path], model, intervals=model == "ramp" and number % 4 == 0)
        assert "\n" not in row.flags
        if row.fitted:
            assert np.all(np.isfinite([x for e in row.estimates.values() for x in (e.value, e.se)]))
            outcomes["fitted, flagged" if row.flags else "fitted"] += 1
        else:
            assert 10 < len(row.failure) < 600
            assert row.flags
            outcomes["unreadable" if row.failure.startswith("can't be read") else "refused"] += 1
        path.unlink()
    return outcomes


@pytest.fixture
def short_trial(simulate: Callable[..., Trial]) -> Trial:
    return simulate(0.4, hold_s=1.5, dwell_s=0.3)


def test_forty_bad_files(tmp_path: Path, short_trial: Trial):
    assert sum(fuzz(tmp_path, short_trial, 40, seed=1).values()) == 40


@pytest.mark.slow
def test_five_hundred_bad_files(tmp_path: Path, short_trial: Trial):
    outcomes = fuzz(tmp_path, short_trial, 500, seed=2)
    print(f"\n500 corrupted or random files: {dict(outcomes)}")
    assert sum(outcomes.values()) == 500
