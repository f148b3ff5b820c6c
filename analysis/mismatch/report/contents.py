"""What a diagnosis says, as data: the contents of `report.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from analysis.mismatch.levels import LEVEL
from analysis.mismatch.name.own_sizes import Quantity
from analysis.mismatch.propose.proposal import NextExperiment
from analysis.mismatch.study.intake import Setting

Verdict = Literal["no_mismatch", "named", "one_of", "unknown"]
Signal = Literal["force", "position"]

NOTHING_BESIDE = 1e-3


@dataclass(frozen=True, slots=True)
class Window:
    """Where simulation and recording differ: phase, and time from a trial's first sample (median of trials).

    ``mean_residual_mn`` and ``rms_mn`` speak of the force (None in the position), ``mean_residual_um`` of the
    position (None in the force). ``after_naming``: what is left beside everything that was found.
    """

    signal: Signal
    phase: str
    start_s: float
    stop_s: float
    mean_residual_mn: float | None
    p_value: float
    share_of_mismatch: float
    conditions: str
    rms_mn: float | None = None
    mean_residual_um: float | None = None
    after_naming: bool = False

    @property
    def mean_told_mn(self) -> float | None:
        """The mean of the force (mN), zero where it is nothing beside its rms."""
        if self.mean_residual_mn is None or abs(self.mean_residual_mn) > NOTHING_BESIDE * (
            self.rms_mn or 0.0
        ):
            return self.mean_residual_mn
        return 0.0


@dataclass(frozen=True, slots=True)
class FoundMechanism:
    """A mechanism that was left out, how probable its name is, and what this data can't tell from it."""

    name: str
    stage: str
    alternatives: tuple[str, ...]
    p_value: float
    parameters: Mapping[str, Quantity]
    explanation: str
    share_of_mismatch: float
    probability: float
    alternative_probabilities: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class NotIdentifiable:
    """A mechanism that could hide in this data, what it would do, and the run that would show it."""

    name: str
    reason: str
    separated_by: str


@dataclass(frozen=True, slots=True)
class Remainder:
    """What is significant but small after everything named; ``share`` of its rms in that of the baseline's mismatch."""

    share: float
    rms_mn: float
    where: tuple[Window, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Prediction of recordings that were not fitted, before and after; chi2 a sample, by the noise floor."""

    scheme: str
    n_trials: int
    noise_floor_mn: float
    baseline_rms_mn: float
    improved_rms_mn: float
    baseline_chi2: float
    improved_chi2: float
    p_value: float


@dataclass(frozen=True)
class Report:
    """Everything `report.json` holds, under its own names."""

    verdict: Verdict
    summary: str
    n_trials: int
    sample_rate_hz: float
    baseline: str
    mismatch: tuple[Window, ...]
    mechanisms: tuple[FoundMechanism, ...]
    not_identifiable: tuple[NotIdentifiable, ...]
    baseline_parameters: Mapping[str, Quantity]
    improved_parameters: Mapping[str, Quantity]
    heldout: Comparison
    explained_share: float
    remainder: Remainder | None
    next_experiment: NextExperiment | None
    left_out: tuple[str, ...]
    notes: tuple[str, ...]
    tolerance_mn: float
    seed: int
    peak_force_mn: float
    setting: Setting
    imports: tuple[tuple[str, tuple[str, ...]], ...]

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON knows it: no NaN, no infinity."""
        body = asdict(self)
        head = {"format": "indenter-diagnosis", "format_version": 1, "false_alarm_rate": LEVEL}
        return {key: _finite(value) for key, value in {**head, **body}.items()}


def _finite(value: Any) -> Any:
    """Return a value with its infinities and NaNs as null, which JSON can carry."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, bool | int | str) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None
