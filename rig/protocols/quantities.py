"""The types of the values in a protocol file: a number is a number, finite, and within what a finger bears."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, ge=1)]
Whole = Annotated[int, Field(strict=True, ge=0)]
Text = Annotated[str, Field(strict=True, min_length=1)]

DepthMm = Annotated[float, Field(strict=True, gt=0, le=3.0, allow_inf_nan=False)]
"""Depth of an indentation: the lever travels 10 mm, a finger pad is not pressed by more than 3 mm."""

SpeedMmS = Annotated[float, Field(strict=True, gt=0, le=50.0, allow_inf_nan=False)]
"""Speed of a movement; the lever's own limit in the rig file may be lower."""

ApproachSpeedMmS = Annotated[float, Field(strict=True, gt=0, le=5.0, allow_inf_nan=False)]
"""Speed towards the skin: some 10 ms pass before the arm stops, so 5 mm/s press 50 um too deep."""

DurationS = Annotated[float, Field(strict=True, ge=0, le=3600.0, allow_inf_nan=False)]
"""A wait inside a trial."""

ThresholdMn = Annotated[float, Field(strict=True, gt=0, le=250.0, allow_inf_nan=False)]
"""Force that counts as contact: well inside the lever's 500 mN."""


class Settings(BaseModel):
    """A table of a protocol file: nothing unknown, nothing changed once read."""

    model_config = ConfigDict(frozen=True, extra="forbid")
