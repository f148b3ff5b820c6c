"""All that a batch of fits found: what the tables and the page are made of."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.relaxation.cross_prediction import CrossPrediction
from analysis.relaxation.joint import FingerSolid
from analysis.relaxation.result import TrialFit
from analysis.relaxation.study import Study


@dataclass(frozen=True, slots=True)
class Findings:
    """One row a file, the study's table, what ramps predict of each other, one solid a finger if asked for."""

    rows: tuple[TrialFit, ...]
    study: Study
    predictions: tuple[CrossPrediction, ...] = ()
    solids: tuple[FingerSolid, ...] = ()
