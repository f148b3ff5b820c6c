"""The trials of the two calibrations; what they add up to is worked out in `calibration_lines`."""

from __future__ import annotations

from dataclasses import replace

from analysis.recordings.trial import ProtocolSummary, Specimen
from rig.protocols.indenting import AWAY_MM_S, NEAR_MM, clear_air, detection, place_block
from rig.protocols.steps import Approach, Ask, MoveStage, PlannedTrial, Preparation, Retract, Stay, WeighMass
from rig.protocols.sweeping import air_sweeps
from rig.settings.protocol_file import ForceCalibration, PositionCalibration, SurfaceDetection

_SWEEP_MM = (1.0, 9.0)
_SWEEP_SPEED_MM_S = 5.0
_FIRST_SPEED_MM_S = 0.5
_INVERT_S = 20.0


def stage_heights_um(calibration: PositionCalibration) -> tuple[float, ...]:
    """Return the heights of the stage, um, from 0 up to the last."""
    return tuple(i * calibration.step_um for i in range(number_of_heights(calibration)))


def number_of_heights(calibration: PositionCalibration) -> int:
    """Return how many heights of the stage a calibration takes."""
    return int(calibration.last_um / calibration.step_um + 1e-9) + 1


def position_trials(calibration: PositionCalibration, toml: str) -> tuple[PlannedTrial, ...]:
    """Return the trials of a position calibration.

    An air sweep relates command and position over the travel; the block is found once; then `repeats`
    approaches at every height of the stage, each beginning just short of the previous contact.
    """
    nobody = Specimen()
    surface = calibration.surface
    sweep = air_sweeps((_SWEEP_SPEED_MM_S,), *_SWEEP_MM, specimen=nobody, toml=toml)
    first = _towards(calibration, surface, speed_mm_s=_FIRST_SPEED_MM_S, short_of_previous_mm=None)
    found = detection("block_found", (MoveStage(0.0), place_block()), first, nobody, toml)
    trials = [*sweep, found]
    near_mm = NEAR_MM + calibration.step_um / 1e3
    towards = _towards(calibration, surface, surface.approach_speed_mm_s, near_mm)
    summary = ProtocolSummary(approach_speed_mm_s=towards.speed_mm_s, retract_speed_mm_s=AWAY_MM_S, toml=toml)
    for height_um in stage_heights_um(calibration):
        for repeat in range(1, calibration.repeats + 1):
            before = (MoveStage(height_um), place_block(first=False))
            trials.append(
                PlannedTrial(
                    f"stage_{height_um:04.0f}um_r{repeat}",
                    "position_calibration",
                    before,
                    (towards, Retract(AWAY_MM_S, 2 * near_mm), Stay("clear", 0.05)),
                    Specimen(repeat=repeat, site=f"{height_um:g} um"),
                    summary,
                )
            )
    return tuple(trials)


def _towards(
    calibration: PositionCalibration,
    surface: SurfaceDetection,
    speed_mm_s: float,
    short_of_previous_mm: float | None,
) -> Approach:
    return Approach(
        speed_mm_s=speed_mm_s,
        threshold_mn=surface.contact_threshold_mn,
        threshold_v=calibration.threshold_v,
        samples_above=surface.samples_above,
        samples_watched=surface.samples_watched,
        samples_per_read=surface.samples_per_read,
        start_mm=surface.start_mm,
        short_of_previous_mm=short_of_previous_mm,
    )


def force_trials(calibration: ForceCalibration, toml: str) -> tuple[PlannedTrial, ...]:
    """Return the trials of a force calibration: the free arm upright, then inverted with each weight."""
    summary = ProtocolSummary(toml=toml)
    rest = Stay("dwell", calibration.average_s)
    settle = Stay("approach", calibration.settle_s)
    upright = PlannedTrial(
        "upright", "force_calibration", (clear_air(),), (settle, rest), Specimen(), summary
    )
    invert = Ask("invert_arm", {"inverted": True}, _INVERT_S)
    trials = [upright]
    for repeat in range(1, calibration.repeats + 1):
        for mass_g in calibration.masses_g:
            before = (invert if len(trials) == 1 else replace(invert, expected_s=0.0), WeighMass(mass_g))
            name = f"weight_{len(trials):02d}_{mass_g:g}g_r{repeat}"
            specimen = Specimen(repeat=repeat, site=f"{mass_g:g} g")
            trials.append(PlannedTrial(name, "force_calibration", before, (settle, rest), specimen, summary))
    return tuple(trials)


def upright_again() -> tuple[Preparation, ...]:
    """Return what puts the bench back after a force calibration."""
    return (
        WeighMass(0.0),
        Ask("invert_arm", {"inverted": False}, _INVERT_S),
    )
