"""A protocol file as data: one trial, a calibration or a whole study, with units in the key names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.settings.rig_file import LEVER_TRAVEL_MM, Positive, Settings

Finger = Literal["thumb", "index", "middle", "ring", "little"]
Depth = Annotated[float, Field(gt=0, le=LEVER_TRAVEL_MM)]
Speed = Annotated[float, Field(gt=0, le=1000)]
LeverPosition = Annotated[float, Field(ge=0, le=LEVER_TRAVEL_MM)]
Duration = Annotated[float, Field(ge=0, le=86_400)]


class SurfaceDetection(Settings):
    """How the skin is found: a slow approach until N of M samples are above a force."""

    approach_speed_mm_s: Speed = 1.0
    contact_threshold_mn: Annotated[float, Field(gt=0, le=500)] = 10.0
    samples_above: Annotated[int, Field(ge=1, le=1000)] = 8
    samples_watched: Annotated[int, Field(ge=1, le=1000)] = 10
    samples_per_read: Annotated[int, Field(ge=16, le=40)] = 24
    start_mm: LeverPosition | None = None

    @model_validator(mode="after")
    def _n_of_m(self) -> SurfaceDetection:
        if self.samples_above > self.samples_watched:
            raise ValueError(
                f"samples_above = {self.samples_above} exceeds samples_watched = "
                f"{self.samples_watched}; lower it"
            )
        return self


class StudyIndentation(Settings):
    """Dwell at the surface, ramp, hold, retract until contact is lost, a while clear of the skin.

    The depths of a study stand in [study].
    """

    dwell_s: Duration = 2.0
    ramp_speed_mm_s: Speed = 5.0
    hold_s: Duration = 7.0
    retract_speed_mm_s: Speed = 5.0
    retract_max_mm: Depth = 2.0
    clear_s: Duration = 0.5


class Indentation(StudyIndentation):
    """One indentation, with its depth."""

    depth_mm: Depth


class SpecimenSettings(Settings):
    """Whose finger and where."""

    subject: str = ""
    finger: Finger | None = None
    site: str = ""
    repeat: Annotated[int, Field(ge=1)] | None = None
    notes: str = ""
    target_stiffness_mn_per_mm: Positive | None = None


class _WithoutMotion(Settings):
    """What every protocol can be asked, whatever its kind."""

    def speeds_mm_s(self) -> dict[str, float]:
        """Every speed the protocol asks for, by its dotted key, mm/s."""
        return {}

    def positions_mm(self) -> dict[str, float]:
        """Every lever position the protocol asks for, by its dotted key, mm."""
        return {}


class WithSurface(_WithoutMotion):
    """A protocol that finds a surface."""

    surface: SurfaceDetection = SurfaceDetection()

    def speeds_mm_s(self) -> dict[str, float]:
        """The speed of approach."""
        return {"surface.approach_speed_mm_s": self.surface.approach_speed_mm_s}

    def positions_mm(self) -> dict[str, float]:
        """The position the approach starts from, where the file says."""
        start_mm = self.surface.start_mm
        return {} if start_mm is None else {"surface.start_mm": start_mm}


class TrialProtocol(WithSurface):
    """One indentation, into skin (`ramp_hold_retract`) or a stiff block (`rigid_target`)."""

    kind: Literal["ramp_hold_retract", "rigid_target"]
    indentation: Indentation
    specimen: SpecimenSettings = SpecimenSettings()

    def speeds_mm_s(self) -> dict[str, float]:
        """Approach, ramp and retract."""
        return super().speeds_mm_s() | _speeds(self.indentation)

    def depths_mm(self) -> Sequence[float]:
        """The one depth, mm."""
        return (self.indentation.depth_mm,)


class SurfaceOnly(WithSurface):
    """Find the skin and leave it again."""

    kind: Literal["surface_detection"]
    specimen: SpecimenSettings = SpecimenSettings()


class AirSweep(_WithoutMotion):
    """There and back over the travel, touching nothing, one trial a speed."""

    kind: Literal["air_sweep"]
    sweep_speeds_mm_s: Annotated[tuple[Speed, ...], Field(min_length=1)] = (1.0, 5.0, 20.0)
    start_mm: LeverPosition = 1.0
    stop_mm: LeverPosition = 9.0
    rest_s: Duration = 0.0

    @model_validator(mode="after")
    def _somewhere_to_go(self) -> AirSweep:
        if self.start_mm >= self.stop_mm:
            raise ValueError(
                f"start_mm = {self.start_mm:g} is not below stop_mm = {self.stop_mm:g}; swap them"
            )
        return self

    def speeds_mm_s(self) -> dict[str, float]:
        """Every sweep's speed."""
        return {f"sweep_speeds_mm_s[{i}]": speed for i, speed in enumerate(self.sweep_speeds_mm_s)}

    def positions_mm(self) -> dict[str, float]:
        """Both ends of the sweep."""
        return {"start_mm": self.start_mm, "stop_mm": self.stop_mm}


class BlockDetection(SurfaceDetection):
    """How a stiff block is found: slowly, since 1 um more is 10 mN more."""

    approach_speed_mm_s: Speed = 0.2


class PositionCalibration(WithSurface):
    """A block on the Z stage is moved in steps; at each the surface is found with one threshold in volts."""

    kind: Literal["position_calibration"]
    surface: BlockDetection = BlockDetection()
    step_um: Annotated[float, Field(gt=0, le=5000)] = 160.0
    last_um: Annotated[float, Field(gt=0, le=10_000)] = 800.0
    threshold_v: Annotated[float, Field(gt=0, le=5)] = 0.3
    repeats: Annotated[int, Field(ge=1, le=100)] = 4
    valid_days: Positive = 30.0

    @model_validator(mode="after")
    def _enough_steps(self) -> PositionCalibration:
        if self.last_um < 2 * self.step_um:
            raise ValueError(
                f"last_um = {self.last_um:g} with step_um = {self.step_um:g} gives fewer than 3 points; "
                "take smaller steps"
            )
        return self


class ForceCalibration(_WithoutMotion):
    """Weights hang from the inverted arm: W + m g / 2 = (V + V0) k."""

    kind: Literal["force_calibration"]
    masses_g: Annotated[tuple[Annotated[float, Field(ge=0, le=60)], ...], Field(min_length=3)] = (
        0.0,
        5.0,
        10.0,
        15.0,
        20.0,
        25.0,
        30.0,
    )
    repeats: Annotated[int, Field(ge=1, le=100)] = 2
    gravity_m_s2: Annotated[float, Field(gt=9.7, lt=9.9)] = 9.80665
    level_within_deg: Annotated[float, Field(ge=0, le=20)] = 1.0
    average_s: Annotated[float, Field(gt=0, le=600)] = 1.0
    settle_s: Duration = 1.0
    valid_days: Positive = 30.0

    @model_validator(mode="after")
    def _different_masses(self) -> ForceCalibration:
        if len(set(self.masses_g)) < 3:
            raise ValueError("masses_g holds fewer than 3 different masses; a line and its error need 3")
        return self


class StudyPlan(Settings):
    """Fingers x surface positions x ramp speeds x holds x depths x repeats, each at a new site, after a rest.

    ``rest_s`` is one length, or the shortest and the longest between which each is drawn evenly. Air sweeps
    and indentations of a stiff block, where asked for, come before the first finger.
    """

    subject: str = ""
    fingers: Annotated[tuple[Finger, ...], Field(min_length=1)] = (
        "thumb",
        "index",
        "middle",
        "ring",
        "little",
    )
    depths_mm: Annotated[tuple[Depth, ...], Field(min_length=1)] = (0.2, 0.4, 0.6, 0.8)
    repeats: Annotated[int, Field(ge=1, le=1000)] = 5
    ramp_speeds_mm_s: Annotated[tuple[Speed, ...], Field(min_length=1)] | None = None
    holds_s: Annotated[tuple[Duration, ...], Field(min_length=1)] | None = None
    surface_positions_mm: Annotated[tuple[LeverPosition, ...], Field(min_length=1)] | None = None
    rest_s: Duration | tuple[Duration, Duration] = (120.0, 180.0)
    order: Literal["fixed", "shuffled"] = "fixed"
    seed: Annotated[int, Field(ge=0)] = 0
    air_sweep_speeds_mm_s: tuple[Speed, ...] = ()
    rigid_target: bool = False
    rigid_target_depths_mm: Annotated[tuple[Depth, ...], Field(min_length=1)] = (0.005, 0.01, 0.015)

    @model_validator(mode="after")
    def _rests_in_order(self) -> StudyPlan:
        if isinstance(self.rest_s, tuple) and self.rest_s[0] > self.rest_s[1]:
            raise ValueError(
                f"rest_s = [{self.rest_s[0]:g}, {self.rest_s[1]:g}] runs backwards; give the shortest first"
            )
        return self

    @model_validator(mode="after")
    def _each_once(self) -> StudyPlan:
        for name in ("fingers", "depths_mm", "ramp_speeds_mm_s", "holds_s", "surface_positions_mm"):
            values = getattr(self, name) or ()
            if len(set(values)) < len(values):
                raise ValueError(f"{name} names a value twice; for more of the same raise repeats")
        return self


class Study(WithSurface):
    """A whole study."""

    kind: Literal["study"]
    study: StudyPlan = StudyPlan()
    indentation: StudyIndentation = StudyIndentation()

    def speeds_mm_s(self) -> dict[str, float]:
        """Approach, every ramp, retract and every sweep."""
        more = {f"study.ramp_speeds_mm_s[{i}]": v for i, v in enumerate(self.study.ramp_speeds_mm_s or ())}
        more |= {
            f"study.air_sweep_speeds_mm_s[{i}]": v for i, v in enumerate(self.study.air_sweep_speeds_mm_s)
        }
        return super().speeds_mm_s() | _speeds(self.indentation) | more

    def positions_mm(self) -> dict[str, float]:
        """Where the skin is to be met, where the file says."""
        positions = self.study.surface_positions_mm or ()
        return super().positions_mm() | {
            f"study.surface_positions_mm[{i}]": x for i, x in enumerate(positions)
        }

    def depths_mm(self) -> Sequence[float]:
        """Every depth of the study, mm, those of the stiff block included."""
        block = self.study.rigid_target_depths_mm if self.study.rigid_target else ()
        return (*self.study.depths_mm, *block)


Protocol = Annotated[
    TrialProtocol | SurfaceOnly | AirSweep | PositionCalibration | ForceCalibration | Study,
    Field(discriminator="kind"),
]


def _speeds(indentation: Indentation | StudyIndentation) -> dict[str, float]:
    return {
        "indentation.ramp_speed_mm_s": indentation.ramp_speed_mm_s,
        "indentation.retract_speed_mm_s": indentation.retract_speed_mm_s,
    }
