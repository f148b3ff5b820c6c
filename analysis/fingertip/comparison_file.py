"""compare.json: what a surface said of the layers."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from analysis.fingertip.compare import Located
from analysis.fingertip.line_load import LineMotion


def write_comparison(path: Path, found: Located, motion: LineMotion) -> None:
    """Write the ratio with its interval, the thickness, and every pad with where it is off."""
    document = {
        "format": "indenter-fingertip-comparison",
        "format_version": 1,
        "surface": found.surface.file,
        "motion": asdict(motion),
        "mesh_error_mm": {
            "largest": float(abs(found.mesh_mm).max()),
            "rms": float((found.mesh_mm**2).mean() ** 0.5),
        },
        "errors": "file" if found.error_known else "what the best pad leaves",
        "ratio_core_to_epidermis": {
            "value": found.ratio,
            "low_95": found.ratio_low,
            "high_95": found.ratio_high,
            "end_of_what_was_solved": found.at_end,
        },
        "epidermis_mm": {"value": found.thickness_mm, "se": found.thickness_se_mm},
        "pads": [
            {
                "name": pad.name,
                "fails": pad.fails,
                "p_value": pad.p_value,
                "rms_mm": pad.rms_mm,
                "off_where": [asdict(span) for span in pad.spans],
            }
            for pad in found.pads
        ],
    }
    path.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
