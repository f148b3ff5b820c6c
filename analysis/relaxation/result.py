"""What a fit found: estimates with standard errors, checks with their numbers, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from analysis.recordings.trial import FloatArray
from analysis.relaxation.constants import StepAnswer

Model = Literal["ramp", "step"]
NAMES = ("A0_mn", "A1_over_A0", "A2_over_A0", "t1_s", "t2_s")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its standard error."""

    value: float
    se: float


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval; ``low`` is 0, ``high`` infinity where the recording sets no bound there."""

    low: float
    value: float
    high: float


@dataclass(frozen=True, slots=True)
class Check:
    """A question asked of a trial's quality and its answer in numbers.

    ``raised`` where ``value`` (in ``unit``) goes beyond ``limit``; ``text`` says in plain words what was
    found.
    """

    name: str
    value: float
    limit: float
    unit: str
    raised: bool
    text: str

    @property
    def flag(self) -> str:
        """The check as it stands in fits.csv: name, number and unit."""
        return f"{self.name}={self.value:.3g}{' ' if self.unit else ''}{self.unit}"


@dataclass(frozen=True, slots=True)
class Amplitudes:
    """The fitted solid and its place: stiffnesses (1 + n_arms,) mN/mm, k0 first, times longest first.

    ``contact_mm`` in lever coordinates and ``offset_mn`` belong to the trial; ``parameters`` names the
    rows of ``covariance`` (P, P). The force is that of a flat punch at the depth d (d / reference_mm)^(exponent - 1).
    """

    stiffness_mn_per_mm: tuple[float, ...]
    times_s: tuple[float, ...]
    contact_mm: float
    contact_se_mm: float
    contact_seen: bool
    offset_mn: float
    offset_se_mn: float
    indentation_mm: float
    parameters: tuple[str, ...]
    covariance: FloatArray = field(repr=False)
    exponent: float = 1.0
    reference_mm: float = 1.0


@dataclass(frozen=True, slots=True)
class TrialFit:
    """One row of a study: a trial's labels, its estimates by the names of `NAMES`, its checks.

    ``intervals`` are profile intervals (95 %) by the same names, where they were asked for.
    ``creep`` says that force was held, so that creep was fitted in place of relaxation.
    ``peak_mn`` is the largest force over the one before contact, ``log`` how an import came to be.
    ``untold`` says by name why an estimate is missing; ``step_answer`` is the step model's curve.
    ``exponent`` is what the loading says of the contact law d^p, None where it says nothing.
    ``failure`` is the reason why ``estimates`` is empty. ``depth_mm`` is the protocol's, or the measured
    travel of the ramp where it has none. ``solid`` is None where nothing was fitted and for the step
    model.
    """

    file: str
    trial_id: str
    model: Model
    finger: str = ""
    subject: str = ""
    depth_mm: float | None = None
    repeat: int | None = None
    n_samples: int = 0
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    stiffness_mn_per_um: float | None = None
    rms_mn: float | None = None
    r2: float | None = None
    ramp_s: float | None = None
    hold_s: float | None = None
    solid: Amplitudes | None = None
    checks: tuple[Check, ...] = ()
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    failure: str = ""
    discarded: str = ""
    exponent: Estimate | None = None
    untold: Mapping[str, str] = field(default_factory=dict)
    step_answer: StepAnswer | None = None
    peak_mn: float | None = None
    log: tuple[str, ...] = ()
    creep: str = ""

    @property
    def fitted(self) -> bool:
        """Whether there are estimates."""
        return not self.failure

    @property
    def rms_percent(self) -> float | None:
        """The root mean square of the residual in per cent of the peak force."""
        return 100.0 * self.rms_mn / self.peak_mn if self.rms_mn is not None and self.peak_mn else None

    @property
    def flags(self) -> str:
        """What the flags column of fits.csv says."""
        parts = [f"discarded: {self.discarded}"] if self.discarded else []
        if self.creep:
            parts.append(f"creep, the trial has no phase named hold: {self.creep}")
        if self.failure:
            parts.append(f"not fitted: {self.failure}")
        parts.extend(check.flag for check in self.checks if check.raised)
        return "; ".join(" ".join(part.split()) for part in parts)
