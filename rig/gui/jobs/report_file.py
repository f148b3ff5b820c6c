"""A diagnosis as its folder holds it: report.json read by its contract, and the files beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from analysis.errors import BadInputError


class _Part(BaseModel):
    """A frozen part of a report; what a later version adds is passed over."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Quantity(_Part):
    """A value with its standard error and unit."""

    value: float
    se: float | None = None
    unit: str = ""


class Window(_Part):
    """A stretch in which simulation and recordings differ; times from a trial's first sample, s."""

    signal: str
    phase: str
    start_s: float
    stop_s: float
    mean_residual_mn: float | None = None
    p_value: float | None = None
    share_of_mismatch: float = 0.0
    conditions: str = ""


class Mechanism(_Part):
    """Physics that was left out, its size, and what could as well be it."""

    name: str
    stage: str = ""
    alternatives: tuple[str, ...] = ()
    p_value: float | None = None
    parameters: Mapping[str, Quantity] = {}
    explanation: str = ""
    probability: float | None = None
    alternative_probabilities: Mapping[str, float] = {}
    share_of_mismatch: float | None = None


class NotIdentifiable(_Part):
    """Physics that could hide in these recordings, and what would show it."""

    name: str
    reason: str = ""
    separated_by: str = ""


class HeldOut(_Part):
    """How well recordings that were not fitted are predicted, before and after."""

    n_trials: int = 0
    noise_floor_mn: float | None = None
    baseline_rms_mn: float | None = None
    improved_rms_mn: float | None = None
    baseline_chi2: float | None = None
    improved_chi2: float | None = None
    p_value: float | None = None


class NextExperiment(_Part):
    """The protocol to run next, and why."""

    protocol: str
    reason: str = ""


class Report(_Part):
    """What a page needs of report.json."""

    format: Literal["indenter-diagnosis"]
    format_version: Literal[1]
    verdict: Literal["no_mismatch", "named", "one_of", "unknown"]
    summary: str
    n_trials: int
    baseline: Literal["ramp", "step"] = "ramp"
    mismatch: tuple[Window, ...] = ()
    mechanisms: tuple[Mechanism, ...] = ()
    not_identifiable: tuple[NotIdentifiable, ...] = ()
    baseline_parameters: Mapping[str, Quantity]
    improved_parameters: Mapping[str, Quantity]
    heldout: HeldOut = HeldOut()
    explained_share: float | None = None
    next_experiment: NextExperiment | None = None
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class DiagnosisFolder(_Part):
    """A report and the files that stand beside it; None where a diagnosis wrote none."""

    folder: Path
    report: Report
    page: Path | None
    twin: Path | None
    next_protocol: Path | None
    figures: tuple[Path, ...]


def read_diagnosis(folder: Path) -> DiagnosisFolder:
    """Read the folder of a diagnosis. Raises BadInputError where it holds none."""
    path = folder / "report.json"
    try:
        report = Report.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BadInputError(
            f"{path}: can't be read ({error.strerror}): give the folder of a diagnosis"
        ) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "its contents"
        raise BadInputError(f"{path}: {where}: {first['msg']}: diagnose the trials again") from None
    following = report.next_experiment
    return DiagnosisFolder(
        folder=folder,
        report=report,
        page=_there(folder / "report.html"),
        twin=_there(folder / "twin.toml"),
        next_protocol=_there(folder / following.protocol) if following else None,
        figures=tuple(sorted(folder.glob("*.png"))),
    )


def _there(path: Path) -> Path | None:
    return path if path.is_file() else None
