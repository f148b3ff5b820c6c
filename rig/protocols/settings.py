"""What a protocol file may say, one frozen model a kind of protocol."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rig.protocols.quantities import (
    ApproachSpeedMmS,
    Count,
    DepthMm,
    DurationS,
    Finite,
    NotNegative,
    Positive,
    Settings,
    SpeedMmS,
    Text,
    ThresholdMn,
    Whole,
)

Finger = Literal["thumb", "index", "middle", "ring", "little"]


class Contact(Settings):
    """How contact is found: so many samples of the last few above the threshold."""

    threshold_mn: ThresholdMn = 10.0
    approach_speed_mm_s: ApproachSpeedMmS = 1.0
    samples_above: Count = 4
    samples_looked_at: Count = 6
    chunk_samples: Annotated[int, Field(strict=True, ge=16, le=40)] = 24

    @model_validator(mode="after")
    def _n_of_m(self) -> Self:
        if self.samples_above > self.samples_looked_at:
            raise ValueError(
                f"samples_above ({self.samples_above}) must not exceed samples_looked_at ({self.samples_looked_at})"
            )
        return self


class Indentation(Settings):
    """How one indentation moves; the published trial where the file says nothing."""

    dwell_s: DurationS = 2.0
    ramp_speed_mm_s: SpeedMmS = 5.0
    hold_s: DurationS = 7.0
    retract_speed_mm_s: SpeedMmS = 5.0
    retract_at_most_mm: Annotated[float, Field(strict=True, gt=0, le=5.0, allow_inf_nan=False)] = 2.0
    clear_s: DurationS = 0.5


class Person(Settings):
    """Whose finger, and with which punch."""

    subject: Text = "unnamed"
    punch_diameter_mm: Positive = 0.5
    notes: str = ""


class _Protocol(Settings):
    format: Literal["indenter-protocol"]
    format_version: Literal[1]
    contact: Contact = Contact()
    specimen: Person = Person()


class SurfaceDetectionProtocol(_Protocol):
    """Find the skin, so many times, each time from the safe position."""

    kind: Literal["surface_detection"]
    finger: Finger = "index"
    approaches: Count = 1


class RampHoldRetractProtocol(_Protocol):
    """One indentation."""

    kind: Literal["ramp_hold_retract"]
    finger: Finger = "index"
    site: Text = "1"
    depth_mm: DepthMm
    indentation: Indentation = Indentation()


class RigidTargetProtocol(_Protocol):
    """Indentations of a stiff block in place of the skin: what bends is the rig itself."""

    kind: Literal["rigid_target"]
    depths_mm: Annotated[tuple[DepthMm, ...], Field(min_length=1)] = (0.01, 0.02, 0.03)
    repeats: Count = 2
    target_stiffness_mn_per_mm: Positive | None = None
    indentation: Indentation = Indentation()


class AirSweepProtocol(_Protocol):
    """There and back with nothing below the arm, one speed a trial."""

    kind: Literal["air_sweep"]
    speeds_mm_s: Annotated[tuple[SpeedMmS, ...], Field(min_length=1)] = (1.0, 2.0, 5.0, 10.0)
    repeats: Count = 2
    from_mm: NotNegative = 2.0
    to_mm: Positive = 8.0

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if self.to_mm <= self.from_mm:
            raise ValueError(f"to_mm ({self.to_mm:g}) must be greater than from_mm ({self.from_mm:g})")
        return self


class PositionCalibrationProtocol(_Protocol):
    """A block on a Z stage, found with the lever at steps of known height."""

    kind: Literal["position_calibration"]
    stop_um: Annotated[float, Field(strict=True, gt=0, le=5000.0, allow_inf_nan=False)] = 800.0
    step_um: Positive = 160.0
    threshold_v: Annotated[float, Field(strict=True, gt=0, le=3.0, allow_inf_nan=False)] = 0.3
    approaches: Count = 4
    approach_speed_mm_s: ApproachSpeedMmS = 0.2
    valid_days: Positive = 30.0

    @model_validator(mode="after")
    def _enough_steps(self) -> Self:
        if self.stop_um / self.step_um < 2 - 1e-9:
            raise ValueError(
                f"step_um ({self.step_um:g}) leaves fewer than 3 positions up to stop_um ({self.stop_um:g})"
            )
        return self


class ForceCalibrationProtocol(_Protocol):
    """Weights that hang from the inverted arm: W + m g / 2 = (V + V0) k."""

    kind: Literal["force_calibration"]
    masses_g: Annotated[tuple[NotNegative, ...], Field(min_length=3)] = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
    repeats: Count = 2
    settle_s: DurationS = 1.0
    record_s: Annotated[float, Field(strict=True, gt=0.05, le=60.0, allow_inf_nan=False)] = 1.0
    gravity_m_s2: Annotated[float, Field(strict=True, gt=9.7, lt=9.9, allow_inf_nan=False)] = 9.80665
    valid_days: Positive = 30.0

    @model_validator(mode="after")
    def _different_masses(self) -> Self:
        if len(set(self.masses_g)) < 3:
            raise ValueError("masses_g needs at least 3 different masses")
        if max(self.masses_g) > 50.0:
            raise ValueError(f"masses_g holds {max(self.masses_g):g} g: the lever bears 500 mN, that is 50 g")
        return self


class Rest(Settings):
    """How long the finger rests between two indentations, drawn evenly between the two."""

    at_least_s: DurationS = 120.0
    at_most_s: DurationS = 180.0

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.at_most_s < self.at_least_s:
            raise ValueError(f"at_most_s ({self.at_most_s:g}) must not be less than at_least_s ({self.at_least_s:g})")
        return self


class StudyProtocol(_Protocol):
    """Every combination of fingers, depths, speeds, holds and heights, repeated, each at a new site."""

    kind: Literal["study"]
    fingers: Annotated[tuple[Finger, ...], Field(min_length=1)] = ("thumb", "index", "middle", "ring", "little")
    depths_mm: Annotated[tuple[DepthMm, ...], Field(min_length=1)] = (0.2, 0.4, 0.6, 0.8)
    ramp_speeds_mm_s: tuple[SpeedMmS, ...] = ()
    holds_s: tuple[DurationS, ...] = ()
    heights_mm: Annotated[tuple[Finite, ...], Field(min_length=1)] = (0.0,)
    repeats: Count = 5
    order: Literal["fixed", "shuffled"] = "fixed"
    seed: Whole = 0
    rest: Rest = Rest()
    indentation: Indentation = Indentation()

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        for name in ("fingers", "depths_mm", "ramp_speeds_mm_s", "holds_s", "heights_mm"):
            values = getattr(self, name)
            if len(set(values)) != len(values):
                raise ValueError(f"{name} names a value twice: use repeats for more of the same")
        return self


Protocol = (
    SurfaceDetectionProtocol
    | RampHoldRetractProtocol
    | RigidTargetProtocol
    | AirSweepProtocol
    | PositionCalibrationProtocol
    | ForceCalibrationProtocol
    | StudyProtocol
)
