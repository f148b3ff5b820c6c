"""A calibrated pad as a specimen of the simulated rig: a rig file, its tissue the pad's own relaxation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.fingertip.calibrate import CalibratedPad

TOLERANCE = 1e-5
"""Of the force at once: as much as the specimen's few arms may differ from the pad's many."""


def write_specimen(path: Path, pad: CalibratedPad, punch_diameter_mm: float) -> None:
    """Write a rig file whose simulated finger relaxes as the calibrated pad does."""
    import tomlkit

    document = tomlkit.document()
    document.add(
        tomlkit.comment(f"A simulated rig with a calibrated finger pad under the punch: {pad.kind}.")
    )
    document.add("name", tomlkit.item(f"pad-{pad.kind}"))
    document.add("card", {"address": "companion:card", "loopback_channel": "ai2", "read_interval_s": 0.05})
    document.add("stage", {"port": "companion:stage"})
    document.add("balance", {"port": "companion:balance"})
    document.add("operator", {"address": "companion:control"})
    document.add("clock", {"address": "companion:control"})
    document.add("punch", {"diameter_mm": punch_diameter_mm})
    document.add(
        "companion", {"command": ["{python}", "-m", "sim_hardware"], "settings": bench_settings(pad)}
    )
    path.write_text(tomlkit.dumps(document), encoding="utf-8")


def bench_settings(pad: CalibratedPad) -> dict[str, Any]:
    """Return the settings of the simulated bench, as its TOML has them."""
    force = pad.force.thinned(TOLERANCE)
    arms = [
        {"stiffness_mn_per_mm": stiffness, "time_s": time_s}
        for stiffness, time_s in zip(force.arms_mn_per_mm.tolist(), force.times_s.tolist(), strict=True)
    ]
    return {
        "time": "virtual",
        "loopback_wired": True,
        "tissue": {"k0_mn_per_mm": force.relaxed_mn_per_mm, "arms": arms},
        # every finger and site is this pad
        "specimens": {"published_tissue": True},
    }
