"""The rig file as data: the card, its wiring, the lever's limits, nominal constants, devices beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from analysis.recordings.trial import Calibration
from rig.settings.constants import constants_problem


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("must not be 0")
    return value


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
NotZero = Annotated[float, AfterValidator(_not_zero)]
"""A wire may turn a signal's sign, but not take it away."""
PhysicalChannel = Annotated[str, Field(pattern=r"^(ai|ao)\d+$")]

_THIS_COMPUTER = frozenset({"127.0.0.1", "localhost", "::1"})

LEVER_TRAVEL_MM = 10.0
"""Full travel of the 300B lever; no rig file may ask for more."""


class Settings(BaseModel):
    """A frozen table of settings: unknown keys, NaN and infinities are refused, text is no number."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class TlsSettings(Settings):
    """Files (PEM) that prove to each other who a card's server and this computer are."""

    authority: Annotated[str, Field(min_length=1)]
    certificate: Annotated[str, Field(min_length=1)]
    key: Annotated[str, Field(min_length=1)]


class CardSettings(Settings):
    """The card and its wiring."""

    address: str = ""
    tls: TlsSettings | None = None
    open_line: bool = False
    device: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")] = "Dev1"
    position_channel: PhysicalChannel = "ai0"
    force_channel: PhysicalChannel = "ai1"
    loopback_channel: PhysicalChannel | None = None
    command_channel: PhysicalChannel = "ao0"
    sample_rate_hz: Annotated[float, Field(ge=100, le=100_000)] = 8000.0
    range_v: Annotated[float, Field(gt=0, le=10)] = 10.0
    input_buffer_s: Annotated[float, Field(ge=1, le=60)] = 20.0
    read_interval_s: Annotated[float, Field(ge=0.001, le=0.5)] = 0.01

    @model_validator(mode="after")
    def _line_is_proven_or_said_to_be_open(self) -> CardSettings:
        host = self.address.rpartition(":")[0].strip("[]")
        near = not self.address or self.address.startswith("companion:") or host in _THIS_COMPUTER
        if self.tls is not None and self.open_line:
            raise ValueError("open_line = true beside [card.tls]: the line is either; take one out")
        if not near and self.tls is None and not self.open_line:
            raise ValueError(
                f"address = {self.address!r} is another computer: say in [card.tls] where the certificates are, or "
                "open_line = true where everybody in that network may drive the arm"
            )
        return self

    @model_validator(mode="after")
    def _wiring_is_possible(self) -> CardSettings:
        inputs = [self.position_channel, self.force_channel]
        inputs += [self.loopback_channel] if self.loopback_channel else []
        if len(set(inputs)) < len(inputs):
            raise ValueError(
                f"the input channels {', '.join(inputs)} are not all different; wire each to its own"
            )
        if not all(name.startswith("ai") for name in inputs):
            raise ValueError(
                "position_channel, force_channel and loopback_channel are inputs; name them ai0, ai1, ..."
            )
        if not self.command_channel.startswith("ao"):
            raise ValueError("command_channel is an output; name it ao0 or ao1")
        return self


class LeverSettings(Settings):
    """What the arm may do, and where it is safe."""

    travel_min_mm: Annotated[float, Field(ge=0, le=LEVER_TRAVEL_MM)] = 0.0
    travel_max_mm: Annotated[float, Field(gt=0, le=LEVER_TRAVEL_MM)] = 9.5
    speed_max_mm_s: Annotated[float, Field(gt=0, le=1000)] = 100.0
    approach_speed_max_mm_s: Annotated[float, Field(gt=0, le=10)] = 2.0
    depth_max_mm: Annotated[float, Field(gt=0, le=LEVER_TRAVEL_MM)] = 1.5
    overshoot_max_um: Annotated[float, Field(gt=0, le=1000)] = 60.0
    force_max_mn: Annotated[float, Field(gt=0, le=500)] = 400.0
    force_noise_min_mn: NotNegative = 0.05
    nominal_volts_per_mm: NotZero = 2.042
    nominal_volts_per_mn: NotZero = 0.015
    following_error_max_mm: Positive = 1.0
    safe_position_mm: Annotated[float, Field(ge=0, le=LEVER_TRAVEL_MM)] = 0.5
    retreat_speed_mm_s: Positive = 40.0
    servo_natural_frequency_rad_s: Positive = 5.0e3

    @model_validator(mode="after")
    def _limits_agree(self) -> LeverSettings:
        if self.travel_min_mm >= self.travel_max_mm:
            raise ValueError(
                f"travel_min_mm = {self.travel_min_mm:g} is not below "
                f"travel_max_mm = {self.travel_max_mm:g}; swap them"
            )
        if not self.travel_min_mm <= self.safe_position_mm <= self.travel_max_mm:
            raise ValueError(
                f"safe_position_mm = {self.safe_position_mm:g} lies outside the travel of "
                f"{self.travel_min_mm:g} to {self.travel_max_mm:g} mm; choose a position inside"
            )
        if self.retreat_speed_mm_s > self.speed_max_mm_s:
            raise ValueError(
                f"retreat_speed_mm_s = {self.retreat_speed_mm_s:g} is above speed_max_mm_s = "
                f"{self.speed_max_mm_s:g}; lower it"
            )
        return self


class CalibrationSettings(Settings):
    """Nominal constants, used until `indenter calibrate` has measured this bench's own."""

    volts_per_mm: NotZero = 2.042
    position_zero_v: float = -10.0
    volts_per_mn: NotZero = 0.015
    force_zero_v: float = 0.0
    command_volts_per_mm: NotZero = 2.042
    command_zero_v: float = -10.0
    calibrated: str = ""
    folder: str | None = None

    def nominal(self) -> Calibration:
        """The constants of the rig file itself."""
        return Calibration(**self.model_dump(exclude={"folder"}))


class PunchSettings(Settings):
    """The punch at the arm's end."""

    diameter_mm: Annotated[float, Field(gt=0, le=20)] = 0.5


class CompanionSettings(Settings):
    """A program started with the rig, which prints the addresses that "companion:..." stands for."""

    command: Annotated[tuple[str, ...], Field(min_length=1)]
    settings: Mapping[str, Any] = Field(default_factory=dict)
    start_timeout_s: Positive = 30.0


class StageSettings(Settings):
    """A motorised Z stage (Zaber ASCII)."""

    port: Annotated[str, Field(min_length=1)]
    device_number: Annotated[int, Field(ge=1, le=99)] = 1
    microstep_um: Positive = 0.047625
    baud_rate: Literal[9600, 19200, 38400, 57600, 115200] = 115200


class BalanceSettings(Settings):
    """A balance (MT-SICS)."""

    port: Annotated[str, Field(min_length=1)]
    baud_rate: Literal[1200, 2400, 4800, 9600, 19200, 38400] = 9600


class ServiceSettings(Settings):
    """An XML-RPC control service in the operator's or the clock's place."""

    address: Annotated[str, Field(pattern=r"^(companion:[a-z]+|https?://\S+)$")]


class GuardSettings(Settings):
    """The process that moves the arm away when the program dies."""

    enabled: bool = True
    heartbeat_timeout_s: Annotated[float, Field(ge=0.5, le=60)] = 0.8
    log_file: str | None = None


class RigFile(Settings):
    """rig.toml, checked."""

    name: str = ""
    card: CardSettings = CardSettings()
    lever: LeverSettings = LeverSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    punch: PunchSettings = PunchSettings()
    guard: GuardSettings = GuardSettings()
    companion: CompanionSettings | None = None
    stage: StageSettings | None = None
    balance: BalanceSettings | None = None
    operator: ServiceSettings | None = None
    clock: ServiceSettings | None = None

    @model_validator(mode="after")
    def _companion_is_named(self) -> RigFile:
        if self.companion is None:
            for key, address in self.addresses().items():
                if address.startswith("companion:"):
                    raise ValueError(
                        f"{key} = {address!r} but there is no [companion] table; "
                        "add its command, or a real address"
                    )
        return self

    @model_validator(mode="after")
    def _constants_are_the_levers(self) -> RigFile:
        problem = constants_problem(self.calibration.nominal(), self.lever)
        if problem is not None:
            raise ValueError(f"calibration.{problem}; mend it, or state another lever's constants there")
        return self

    @model_validator(mode="after")
    def _travel_fits_the_card(self) -> RigFile:
        nominal, lever = self.calibration, self.lever
        for key, position_mm in (
            ("travel_min_mm", lever.travel_min_mm),
            ("travel_max_mm", lever.travel_max_mm),
        ):
            volts = position_mm * nominal.command_volts_per_mm + nominal.command_zero_v
            if abs(volts) > self.card.range_v * (1 + 1e-9):
                raise ValueError(
                    f"lever.{key} = {position_mm:g} would need {volts:.2f} V, beyond the card's "
                    f"+-{self.card.range_v:g} V; narrow the travel or mend [calibration]"
                )
        return self

    def addresses(self) -> dict[str, str]:
        """Every address in the file, by its dotted key."""
        found = {"card.address": self.card.address}
        for key, table in (("stage", self.stage), ("balance", self.balance)):
            if table is not None:
                found[f"{key}.port"] = table.port
        for key, service in (("operator", self.operator), ("clock", self.clock)):
            if service is not None:
                found[f"{key}.address"] = service.address
        return found
