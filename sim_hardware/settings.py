"""Settings of the simulated bench, validated, with units in the names."""

from __future__ import annotations

import tomllib
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim_hardware.effects import make_effect

_UNITS = {
    "_mn_per_mm": "mN/mm",
    "_volts_per_mm": "V/mm",
    "_volts_per_mn": "V/mN",
    "_rad_s": "rad/s",
    "_um_rms": "um",
    "_mn_rms": "mN",
    "_deg": "degrees",
    "_hz": "Hz",
    "_mm": "mm",
    "_um": "um",
    "_mn": "mN",
    "_mv": "mV",
    "_ms": "ms",
    "_g": "g",
    "_v": "V",
    "_s": "s",
}


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class ArmSettings(_Frozen):
    """A Maxwell arm of the tissue."""

    stiffness_mn_per_mm: float = Field(gt=0, le=1e5)
    time_s: float = Field(gt=0, le=1e4)


class TissueSettings(_Frozen):
    """Constants of the finger pad; the published ones by default, with k1 and k2 in proportion to k0.

    ``arms``, any number of them, stand in place of both published arms: the relaxation of a calibrated
    finite-element pad.
    """

    k0_mn_per_mm: float = Field(default=120.0, gt=0, le=1e5)
    k1_mn_per_mm: float | None = Field(default=None, ge=0, le=1e5)
    tau1_s: float = Field(default=2.279, gt=0, le=1e4)
    k2_mn_per_mm: float | None = Field(default=None, ge=0, le=1e5)
    tau2_s: float = Field(default=0.149, gt=0, le=1e4)
    arms: tuple[ArmSettings, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _either(self) -> Self:
        if self.arms and not (self.k1_mn_per_mm is None and self.k2_mn_per_mm is None):
            raise ValueError("arms stand in place of k1_mn_per_mm and k2_mn_per_mm: give one or the other")
        return self

    @property
    def k1(self) -> float:
        """Stiffness of the slow arm, mN/mm."""
        return 0.371 * self.k0_mn_per_mm if self.k1_mn_per_mm is None else self.k1_mn_per_mm

    @property
    def k2(self) -> float:
        """Stiffness of the fast arm, mN/mm."""
        return 0.294 * self.k0_mn_per_mm if self.k2_mn_per_mm is None else self.k2_mn_per_mm


class LeverSettings(_Frozen):
    """The lever: its servo (300B figures), its arm."""

    natural_frequency_rad_s: float = Field(default=5.0e3, ge=100, le=2e4)
    damping_ratio: float = Field(default=1.0, ge=0.1, le=5)
    arm_mass_g: float = Field(default=0.6, ge=0, le=20)


class SpecimenSettings(_Frozen):
    """Fingers, sites and the stiff block; what is drawn is drawn from the bench's seed.

    Tissue is living: no two fingers and no two sites are alike. Fingers differ in stiffness by
    ``finger_variation`` (a relative standard deviation; in times and ratios by half of it). ``site_variation``
    is how far the sites of a finger scatter: ``"published"``, so that times and ratios scatter over fingers and
    sites as the published ones do, or one relative standard deviation for stiffness, ratios and times alike.
    ``published_tissue`` gives every finger and site exactly the constants of ``[tissue]``: a gel.
    """

    published_tissue: bool = False
    finger_variation: float = Field(default=0.10, ge=0, le=0.5)
    site_variation: Literal["published"] | Annotated[float, Field(ge=0, le=0.5)] = "published"
    surface_low_mm: float = Field(default=3.0, ge=0.5, le=9)
    surface_high_mm: float = Field(default=6.0, ge=0.5, le=9)
    block_mm: float = Field(default=4.6, ge=0.5, le=9)
    block_mn_per_mm: float = Field(default=2.0e4, ge=1e4, le=1e6)
    micrometer_error_um_rms: float = Field(default=0.1, ge=0, le=20)
    hang_angle_error_deg: float = Field(default=1.0, ge=0, le=10)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.surface_high_mm < self.surface_low_mm:
            raise ValueError("surface_high_mm must not be below surface_low_mm")
        return self


class NoiseSettings(_Frozen):
    """Noise of the bench: white by default.

    A share ``correlated_share`` of the force noise's variance has the correlation time ``correlation_ms``;
    the white rest has the tails of Student's t with ``tail_degrees_of_freedom`` (0: of a Gaussian);
    ``one_over_f_mn_rms`` is noise whose power falls as 1/f from 0.02 to 200 Hz;
    ``wander_mn_rms`` is a slow wander of the force's zero with the time ``wander_time_s``;
    ``gain_jitter`` is the relative standard deviation of the force's gain from trial to trial.
    """

    force_mn_rms: float = Field(default=0.3, ge=0, le=50)
    position_um_rms: float = Field(default=0.25, ge=0, le=50)
    correlated_share: float = Field(default=0.0, ge=0, le=1)
    correlation_ms: float = Field(default=2.0, gt=0, le=1e4)
    tail_degrees_of_freedom: float = Field(default=0.0, ge=0, le=1e3)
    one_over_f_mn_rms: float = Field(default=0.0, ge=0, le=50)
    wander_mn_rms: float = Field(default=0.0, ge=0, le=50)
    wander_time_s: float = Field(default=5.0, gt=0, le=1e4)
    gain_jitter: float = Field(default=0.0, ge=0, le=0.2)

    @model_validator(mode="after")
    def _of_finite_variance(self) -> Self:
        if 0 < self.tail_degrees_of_freedom <= 2:
            raise ValueError("tail_degrees_of_freedom must be 0 (Gaussian) or above 2, for a finite variance")
        return self


class ConverterSettings(_Frozen):
    """The converters: 0 bits stands for ideal ones.

    The output moves in a line from sample to sample, or, ``stepwise_output``, holds each until the next.
    """

    bits: int = Field(default=16, ge=0, le=24)
    range_v: float = Field(default=10.0, gt=0, le=10)
    offset_mv_rms: float = Field(default=0.3, ge=0, le=50)
    stepwise_output: bool = False


class ConstantsSettings(_Frozen):
    """Nominal constants of the wiring, and how far (relative, and in volts) the true ones lie from them."""

    volts_per_mm: float = Field(default=2.042, gt=0.1, le=20)
    position_zero_v: float = Field(default=-10.0, ge=-10, le=10)
    volts_per_mn: float = Field(default=0.015, gt=1e-4, le=1)
    force_zero_v: float = Field(default=0.0, ge=-10, le=10)
    spread: float = Field(default=0.02, ge=0, le=0.1)
    zero_spread_v: float = Field(default=0.03, ge=0, le=0.5)


class TlsSettings(_Frozen):
    """Files (PEM) by which the card's server proves who it is, and refuses who does not."""

    authority: str
    certificate: str
    key: str


class FaultSettings(_Frozen):
    """A fault to order, ``at_s`` after the bench was started."""

    kind: Literal["unplug", "stall", "coerce_rate", "late_start"]
    at_s: float = Field(default=0.0, ge=0)
    duration_s: float = Field(default=0.0, ge=0)
    rate_hz: float = Field(default=8000.0, gt=0)
    samples: int = Field(default=0, ge=0)


class EffectSettings(BaseModel):
    """An effect by name; every other key is one of its parameters (or ``rough``)."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str

    @property
    def given(self) -> dict[str, object]:
        """The parameters that were given."""
        return dict(self.__pydantic_extra__ or {})

    @model_validator(mode="after")
    def _known(self) -> Self:
        make_effect(self.name, self.given)
        return self


class BenchSettings(_Frozen):
    """All settings of a simulated bench.

    ``substeps`` fine steps are integrated between two samples. The arm is at ``initial_command_v`` when the
    bench is switched on. ``late_start_samples``: by how many samples the card's outputs start late.
    """

    seed: int = Field(default=1, ge=0, lt=2**63)
    time: Literal["real", "virtual"] = "real"
    loopback_wired: bool = True
    tls: TlsSettings | None = None
    late_start_samples: int = Field(default=0, ge=0, le=80000)
    faults: tuple[FaultSettings, ...] = Field(default=(), strict=False)
    substeps: int = Field(default=4, ge=4, le=64)
    initial_command_v: float = Field(default=-9.5, ge=-10, le=10)
    lever: LeverSettings = LeverSettings()
    tissue: TissueSettings = TissueSettings()
    specimens: SpecimenSettings = SpecimenSettings()
    noise: NoiseSettings = NoiseSettings()
    converters: ConverterSettings = ConverterSettings()
    constants: ConstantsSettings = ConstantsSettings()
    effects: tuple[EffectSettings, ...] = Field(default=(), strict=False)

    @classmethod
    def from_toml(cls, text: str) -> Self:
        """Read settings from TOML; ValueError with one line that names key and unit."""
        try:
            return cls.model_validate(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"bench settings: not valid TOML: {error}") from None
        except ValidationError as error:
            raise ValueError(f"bench settings: {_one_line(error)}") from None


def _one_line(error: ValidationError) -> str:
    """Say the first thing that is wrong: key, value, unit."""
    first: Any = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    message = str(first["msg"]).removeprefix("Value error, ")
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if first["type"] == "extra_forbidden":
        return f"unknown key {key!r}{more}"
    if first["type"] == "value_error":
        return f"{key}: {message}{more}" if key and not key.startswith("effects") else f"{message}{more}"
    plain = {"tuple_type": "must be a list of tables", "model_type": "must be a table"}
    if first["type"] in plain:
        return f"{key} = {first['input']!r}: {plain[first['type']]}{more}"
    unit = next((u for suffix, u in _UNITS.items() if key.endswith(suffix)), None)
    unit_text = f" ({unit})" if unit else ""
    return f"{key} = {first['input']!r}: {message[:1].lower()}{message[1:]}{unit_text}{more}"
