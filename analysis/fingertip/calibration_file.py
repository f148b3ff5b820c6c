"""calibrated.json: what was measured, the pad's file, every calibrated pad; the other commands go on from it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import CalibratedPad, Kind
from analysis.fingertip.fits_file import MeasuredTrial
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.viscoelastic import Prony, Relaxation

NAME = "calibrated.json"
_FORMAT, _VERSION = "indenter-fingertip", 1


@dataclass(frozen=True, slots=True)
class Calibration:
    """A pad's file, the mean of the trials it was calibrated on, the pads, and the scan over ratios."""

    pad: PadFile
    measured: MeasuredTrial
    pads: tuple[CalibratedPad, ...]
    scan: tuple[CalibratedPad, ...]


def write_calibration(folder: Path, found: Calibration) -> None:
    """Write calibrated.json into a folder that exists."""
    measured = found.measured
    document = {
        "format": _FORMAT,
        "format_version": _VERSION,
        "pad": found.pad.model_dump(mode="json"),
        "measured": {
            "file": measured.file,
            "finger": measured.finger,
            "model": measured.model,
            "depth_mm": measured.depth_mm,
            "ramp_s": measured.ramp_s,
            "hold_s": measured.hold_s,
            "stiffness_mn_per_mm": measured.stiffness_mn_per_mm.tolist(),
            "times_s": measured.times_s.tolist(),
            "covariance": measured.covariance.tolist(),
        },
        "pads": _plain(found.pads),
        "scan": _plain(found.scan),
    }
    (folder / NAME).write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _plain(pads: Sequence[CalibratedPad]) -> list[dict[str, Any]]:
    return [
        {
            "kind": pad.kind,
            "ratio_core_to_epidermis": pad.ratio,
            "epidermis": _material(pad.epidermis),
            "core": _material(pad.core),
            "log_se": pad.errors().tolist(),
            "log_covariance": pad.covariance.tolist(),
            "rms_share_of_a0": pad.rms_share,
            "worst_share_of_a0": pad.worst_share,
            "force": {
                "relaxed_mn_per_mm": pad.force.relaxed_mn_per_mm,
                "arms": [
                    {"stiffness_mn_per_mm": k, "time_s": t}
                    for k, t in zip(
                        pad.force.arms_mn_per_mm.tolist(), pad.force.times_s.tolist(), strict=True
                    )
                ],
            },
        }
        for pad in pads
    ]


def _material(material: Prony) -> dict[str, Any]:
    return {
        "relaxed_kpa": material.relaxed_kpa,
        "instantaneous_kpa": material.instantaneous_kpa,
        "arms": [
            {"modulus_kpa": m, "g": g, "time_s": t}
            for (m, t), g in zip(material.arms, material.g, strict=True)
        ],
    }


def read_calibration(folder: Path) -> Calibration:
    """Read calibrated.json of a folder; BadInputError where it is not there or not whole."""
    path = folder / NAME
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(
            f"{path}: can't be read: run `indenter fingertip calibrate FITS --out {folder}` first"
        ) from error
    except json.JSONDecodeError as error:
        raise BadInputError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise BadInputError(f"{path}: was not written by `indenter fingertip calibrate`")
    try:
        measured = document["measured"]
        arrays = {n: np.array(measured[n]) for n in ("stiffness_mn_per_mm", "times_s", "covariance")}
        return Calibration(
            PadFile.model_validate(document["pad"]),
            MeasuredTrial(**(measured | arrays)),
            tuple(_calibrated(pad) for pad in document["pads"]),
            tuple(_calibrated(pad) for pad in document["scan"]),
        )
    except (KeyError, TypeError, ValueError, ValidationError) as error:
        reason = " ".join(str(error).split())
        raise BadInputError(f"{path}: is damaged ({reason}): calibrate again") from error


def _calibrated(entry: dict[str, Any]) -> CalibratedPad:
    if entry["kind"] not in get_args(Kind):
        raise ValueError(f"kind {entry['kind']!r} is not known")
    force = entry["force"]
    return CalibratedPad(
        entry["kind"],
        float(entry["ratio_core_to_epidermis"]),
        _prony(entry["epidermis"]),
        _prony(entry["core"]),
        np.array(entry["log_covariance"]),
        float(entry["rms_share_of_a0"]),
        float(entry["worst_share_of_a0"]),
        Relaxation(
            float(force["relaxed_mn_per_mm"]),
            np.array([arm["stiffness_mn_per_mm"] for arm in force["arms"]]),
            np.array([arm["time_s"] for arm in force["arms"]]),
        ),
    )


def _prony(entry: dict[str, Any]) -> Prony:
    arms = tuple((float(arm["modulus_kpa"]), float(arm["time_s"])) for arm in entry["arms"])
    return Prony(float(entry["relaxed_kpa"]), arms)
