"""The servo that a recording shows, of a drive as slow as a machine's axis or as quick as a lever."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.recordings import read_trial
from analysis.recordings.importing import import_recordings
from analysis.simulation.motion import FoundServo, estimate_motion, fit_servo
from analysis.simulation.servo import follow

RATE_HZ = 2000.0


@pytest.mark.parametrize(("wn", "zeta"), [(40.0, 0.8), (130.0, 0.4), (600.0, 1.0)])
def test_the_servo_of_a_drive_is_found_from_its_sweep(tmp_path: Path, wn: float, zeta: float) -> None:
    """A sweep without kinks: smooth strokes, whose lag shows all along and nowhere in particular."""
    random = np.random.default_rng(5)
    time_s = np.arange(int(6.0 * RATE_HZ)) / RATE_HZ
    moving_s = np.maximum(time_s - 0.5, 0.0)
    command_mm = 10.0 * (1.0 - np.cos(2.0 * np.pi * 0.7 * moving_s)) + 2.0 * (
        1.0 - np.cos(2.0 * np.pi * 3.0 * moving_s)
    )
    position_mm = follow(command_mm, RATE_HZ, wn, zeta).position_mm + random.normal(
        scale=2e-3, size=len(time_s)
    )
    table = np.column_stack([time_s, position_mm, random.normal(size=len(time_s)), command_mm])
    np.savetxt(
        tmp_path / "axis.csv",
        table,
        delimiter=",",
        header="time_s,position_mm,force_mn,command_mm",
        comments="",
    )
    (imported,), refused = import_recordings([tmp_path / "axis.csv"], tmp_path / "trials", "air_sweep")
    assert not refused
    found = fit_servo([read_trial(imported.path)])
    assert found.of_lines == pytest.approx((wn, zeta), rel=0.02)


def test_an_output_that_steps_is_not_taken_for_a_slower_servo(tmp_path: Path) -> None:
    """Half a sample of lag is the card's; ramps through a servo as quick as the lever's tell it from the servo's."""
    random = np.random.default_rng(6)
    rate_hz, wn, zeta = 8000.0, 3000.0, 0.8
    time_s = np.arange(int(1.0 * rate_hz)) / rate_hz
    corners_s = [0.0, 0.15, 0.2, 0.35, 0.4, 0.55, 0.6, 0.75, 0.8, 1.0]
    command_mm = np.interp(time_s, corners_s, [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0])
    position_mm = follow(command_mm, rate_hz, wn, zeta, held=True).position_mm
    for k in range(10):
        noisy_mm = position_mm + random.normal(scale=2.5e-4, size=len(time_s))
        table = np.column_stack([time_s, noisy_mm, random.normal(size=len(time_s)), command_mm])
        names = "time_s,position_mm,force_mn,command_mm"
        np.savetxt(tmp_path / f"ramps_{k}.csv", table, delimiter=",", header=names, comments="")
    files = [tmp_path / f"ramps_{k}.csv" for k in range(10)]
    imported, refused = import_recordings(files, tmp_path / "trials", "ramp_hold_retract")
    assert not refused
    found = fit_servo([read_trial(i.path) for i in imported])
    # seed fixed; standard errors of a hundredth, so that five of them are allowed
    assert found.steps_show
    assert found.of_steps == pytest.approx((wn, zeta), rel=0.05)
    assert found.of_lines[0] < 0.95 * wn


@pytest.mark.parametrize("late_samples", [0.0, 1.3])
def test_a_position_that_is_read_late_is_not_taken_for_a_slower_servo(
    tmp_path: Path, late_samples: float
) -> None:
    """A servo that lags as much has other corners: the path through it was half a micrometre off there."""
    random = np.random.default_rng(7)
    rate_hz, wn, zeta, fine = 8000.0, 5000.0, 1.0, 16
    time_s = np.arange(int(1.0 * rate_hz)) / rate_hz
    corners_s = [0.0, 0.15, 0.2, 0.35, 0.4, 0.55, 0.6, 0.75, 0.8, 1.0]
    tops = [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]
    often_s = np.arange(fine * len(time_s)) / (fine * rate_hz)
    answer_mm = follow(np.interp(often_s, corners_s, tops), fine * rate_hz, wn, zeta).position_mm
    read_mm = np.interp(time_s - late_samples / rate_hz, often_s, answer_mm)
    command_mm = np.interp(time_s, corners_s, tops)
    table = np.column_stack([time_s, read_mm, 100.0 * command_mm, command_mm])
    names = "time_s,position_mm,force_mn,command_mm"
    np.savetxt(tmp_path / "late.csv", table, delimiter=",", header=names, comments="")
    (imported,), _ = import_recordings([tmp_path / "late.csv"], tmp_path / "trials", "ramp_hold_retract")
    trial = read_trial(imported.path)
    noise_v = 1e-4 * trial.calibration.volts_per_mm * random.normal(size=(10, len(time_s)))
    trials = [replace(trial, position_v=trial.position_v + noise) for noise in noise_v]
    found = fit_servo(trials)
    # seed fixed; standard errors of 0.04 samples and a thirtieth, so that five of them are allowed
    assert found.late_s * rate_hz == pytest.approx(late_samples, abs=0.2)
    assert (found.of_late if found.late_s else found.of_lines) == pytest.approx((wn, zeta), rel=0.15)
    path_mm = estimate_motion(trials[0], found).position_mm
    assert np.abs(path_mm - read_mm).max() < 2e-4


def test_an_arm_is_shaken_before_and_after_its_output_steps(tmp_path: Path) -> None:
    rate_hz, wn, zeta, fine = 8000.0, 5000.0, 1.0, 64
    time_s = np.arange(4000) / rate_hz
    command_mm = np.interp(time_s, [0.0, 0.1, 0.2, 0.3, 0.4], [0.0, 0.0, 0.5, 0.5, 0.0])
    played = follow(np.repeat(command_mm, fine), fine * rate_hz, wn, zeta, held=True)
    table = np.column_stack([time_s, played.position_mm[::fine], 100.0 * command_mm, command_mm])
    names = "time_s,position_mm,force_mn,command_mm"
    np.savetxt(tmp_path / "ramp.csv", table, delimiter=",", header=names, comments="")
    imported, refused = import_recordings([tmp_path / "ramp.csv"], tmp_path / "trials", "ramp_hold_retract")
    assert not refused
    trial = read_trial(imported[0].path)
    for servo in (FoundServo((wn, zeta), (wn, zeta), True), FoundServo((4300.0, 1.0), (wn, zeta), False)):
        motion = estimate_motion(trial, servo)
        for moment in (0, 1):
            expected = played.acceleration_mm_s2[moment::fine]
            found = motion.acceleration_mm_s2 + motion.shake_mm_s2[:, moment]
            assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(expected)


@pytest.mark.parametrize("sent", [True, False], ids=["sent in steps", "recorded in steps"])
def test_position_tells_whose_converter_made_the_steps_of_a_command(tmp_path: Path, sent: bool) -> None:
    """Steps of 0.15 um that the arm follows shake what has mass; those of the recorder alone do not."""
    random = np.random.default_rng(9)
    rate_hz, wn, zeta, step_mm = 5000.0, 5000.0, 1.0, 1.5e-4
    time_s = np.arange(int(1.0 * rate_hz)) / rate_hz
    corners_s = [0.0, 0.15, 0.2, 0.35, 0.4, 0.55, 0.6, 0.75, 0.8, 1.0]
    imports, accelerations = [], []
    for k in range(12):
        top_mm = 0.4 + 0.013 * k
        smooth_mm = np.interp(time_s, corners_s, top_mm * np.array([0, 0, 1, 1, 0, 0, 1, 1, 0, 0]))
        command_mm = step_mm * np.round(smooth_mm / step_mm)
        driven = follow(command_mm if sent else smooth_mm, rate_hz, wn, zeta)
        noisy_mm = driven.position_mm + random.normal(scale=2e-4, size=len(time_s))
        table = np.column_stack([time_s, noisy_mm, 100.0 * command_mm, command_mm])
        names = "time_s,position_mm,force_mn,command_mm"
        np.savetxt(tmp_path / f"ramps_{k:02d}.csv", table, delimiter=",", header=names, comments="")
        imports.append(tmp_path / f"ramps_{k:02d}.csv")
        accelerations.append(driven.acceleration_mm_s2)
    imported, refused = import_recordings(imports, tmp_path / "trials", "ramp_hold_retract")
    assert not refused
    trials = [read_trial(i.path) for i in imported]
    found = fit_servo(trials)
    # by this seed 84 nats speak for steps that were sent and 61 against those that were not; 3 are asked
    assert found.rounding_shows == sent
    # while a line is driven the arm is shaken by the steps that were sent, and by nothing else
    steady = (time_s > 0.16) & (time_s < 0.19)
    off = estimate_motion(trials[0], found).acceleration_mm_s2 - accelerations[0]
    assert np.std(off[steady]) < 40.0
    assert (np.std(accelerations[0][steady]) > 400.0) == sent


@pytest.mark.parametrize(("rings_mm", "most_mm"), [(0.0, 5e-5), (5e-3, 2e-4)])
def test_near_a_kink_stays_what_the_servo_does_not_explain_and_no_noise(
    tmp_path: Path, rings_mm: float, most_mm: float
) -> None:
    """A ten thousandth of a millimetre is 20 uN in contact, the same in any filter of it that an effect may be."""
    random = np.random.default_rng(8)
    rate_hz, noise_mm = 8000.0, 4.5e-4
    time_s = np.arange(int(2.0 * rate_hz)) / rate_hz
    command_mm = np.interp(time_s, [0.0, 0.5, 0.6, 1.5, 1.6, 2.0], [0.0, 0.0, 0.5, 0.5, 0.0, 0.0])
    nominal = FoundServo()
    where_mm = follow(command_mm, rate_hz, *nominal.of_lines).position_mm
    for kink_s in (0.5, 0.6, 1.5, 1.6):
        after_s = np.maximum(time_s - kink_s, 0.0)
        where_mm = where_mm + rings_mm * np.exp(-after_s / 0.01) * np.sin(2.0 * np.pi * 60.0 * after_s)
    table = np.column_stack(
        [time_s, where_mm + noise_mm * random.normal(size=len(time_s)), 100.0 * command_mm, command_mm]
    )
    names = "time_s,position_mm,force_mn,command_mm"
    np.savetxt(tmp_path / "ramp.csv", table, delimiter=",", header=names, comments="")
    (imported,), _ = import_recordings([tmp_path / "ramp.csv"], tmp_path / "trials", "ramp_hold_retract")
    found = estimate_motion(read_trial(imported.path), nominal)
    near = np.any([np.abs(time_s - kink_s) < 0.02 for kink_s in (0.5, 0.6, 1.5, 1.6)], axis=0)
    assert np.std((found.position_mm - where_mm)[near]) < most_mm
