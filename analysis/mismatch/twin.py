"""The twin: a rig file whose simulated bench behaves as the recordings do, what was found switched on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.quantities import SERVO, event_times
from analysis.mismatch.report import Report
from analysis.simulation.mechanism import library

SLOW_S = 0.05
SURFACE_MM = (0.5, 9.0)
BLOCK_MN_PER_MM = (1.0e4, 1.0e6)
STEP_ONLY = "finite_ramp"
POSITION_NOISE_UM = 0.25


def write_twin(path: Path, diagnosis: Diagnosis, report: Report) -> None:
    """Write the twin's rig file: found tissue, noise, servo and mechanisms by their textbook laws."""
    import tomlkit

    document = tomlkit.document()
    document.add(tomlkit.comment("A simulated rig that behaves as the diagnosed recordings do."))
    document.add("name", tomlkit.item("twin"))
    document.add("card", {"address": "companion:card", "loopback_channel": "ai2", "read_interval_s": 0.05})
    document.add("stage", {"port": "companion:stage"})
    document.add("balance", {"port": "companion:balance"})
    document.add("operator", {"address": "companion:control"})
    document.add("clock", {"address": "companion:control"})
    if diagnosis.intake.punch_diameter_mm is not None:
        document.add("punch", {"diameter_mm": float(diagnosis.intake.punch_diameter_mm)})
    document.add(
        "companion",
        {"command": ["{python}", "-m", "sim_hardware"], "settings": bench_settings(diagnosis, report)},
    )
    path.write_text(tomlkit.dumps(document), encoding="utf-8")


def bench_settings(diagnosis: Diagnosis, report: Report) -> dict[str, Any]:
    """Return the settings of the simulated bench, as its TOML has them."""
    skin = [o.z0_mm for t, o in zip(diagnosis.problem.trials, diagnosis.improved.own, strict=True)
            if t.kind == "ramp_hold_retract"] or [4.0, 5.0]  # fmt: skip
    low, high = (float(np.clip(z, *SURFACE_MM)) for z in (min(skin), max(skin)))
    tissue = diagnosis.improved.simulation.tissue
    long_first = tissue.tau1 >= tissue.tau2
    arms = [(tissue.k1, tissue.tau1), (tissue.k2, tissue.tau2)]
    (k1, tau1), (k2, tau2) = arms if long_first else arms[::-1]
    settings: dict[str, Any] = {
        "seed": report.seed,
        "time": "virtual",
        "loopback_wired": True,
        "tissue": {
            "k0_mn_per_mm": tissue.k0,
            "k1_mn_per_mm": k1,
            "tau1_s": tau1,
            "k2_mn_per_mm": k2,
            "tau2_s": tau2,
        },
        "specimens": {
            "published_tissue": True,
            "surface_low_mm": low,
            "surface_high_mm": high,
            "block_mn_per_mm": float(
                np.clip(diagnosis.improved.simulation.rigid_stiffness, *BLOCK_MN_PER_MM)
            ),
        },
        "noise": noise_settings(diagnosis.noise, diagnosis.position.noise_mm if diagnosis.position else None),
        # the recordings were calibrated: here the nominal constants are the true ones
        "constants": {"spread": 0.0, "zero_spread_v": 0.0},
    }
    effects = [_effect(diagnosis, report, k) for k in range(len(report.mechanisms))]
    effects = [e for e in effects if e is not None]
    if effects:
        settings["effects"] = effects
    return settings


def noise_settings(noise: NoiseModel, position_noise_mm: float | None) -> dict[str, float]:
    """Return the bench's noise for a noise model: white, quickly correlated, and slowly wandering parts."""
    quick = [(v, t) for v, t in noise.parts if t <= SLOW_S]
    slow = [(v, t) for v, t in noise.parts if t > SLOW_S]
    fast_variance = noise.white_mn**2 + sum(v for v, _ in quick)
    settings = {
        "force_mn_rms": float(np.sqrt(fast_variance)),
        "position_um_rms": POSITION_NOISE_UM if position_noise_mm is None else 1e3 * position_noise_mm,
    }
    for parts, share, time, scale in (
        (quick, "correlated_share", "correlation_ms", 1e3),
        (slow, "", "wander_time_s", 1.0),
    ):
        variance = sum(v for v, _ in parts)
        if variance <= 0:
            continue
        settings[time] = scale * sum(v * t for v, t in parts) / variance
        if share:
            settings[share] = variance / fast_variance
        else:
            settings["wander_mn_rms"] = float(np.sqrt(variance))
    return settings


def _effect(diagnosis: Diagnosis, report: Report, k: int) -> dict[str, Any] | None:
    """Return one found mechanism as an effect of the bench, by its textbook law."""
    found = report.mechanisms[k]
    if found.name == STEP_ONLY:
        return None
    effect: dict[str, Any] = {"name": found.name}
    effect.update({name: q.value for name, q in found.parameters.items()})
    effect["rough"] = 0.0
    if library()[found.name].form == "event":
        place = next(
            i for i, a in enumerate(diagnosis.improved.simulation.additions) if a.mechanism.name == found.name
        )
        times = np.array(
            list(event_times(diagnosis.problem, diagnosis.improved.simulation.additions[place]).values())
        )
        effect["scatter_s"] = float(min(np.std(times), 5.0))
        if found.name == "motion_artefact":
            effect["share"] = len(times) / len(diagnosis.problem.trials)
    if found.name == SERVO:
        effect["damping_ratio"] = float(np.clip(effect["damping_ratio"], 0.1, 5.0))
        effect["natural_frequency_rad_s"] = float(np.clip(effect["natural_frequency_rad_s"], 100.0, 2.0e4))
    return effect
