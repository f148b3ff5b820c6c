"""The twin: a rig file whose simulated bench behaves as the recordings do, what was found switched on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit.noise import SLOW_S, NoiseModel
from analysis.mismatch.report.contents import Report
from analysis.mismatch.report.verdict import SERVO
from analysis.simulation.mechanism import library

SURFACE_MM = (0.5, 9.0)
BLOCK_MN_PER_MM = (1.0e4, 1.0e6)
STEP_ONLY = "finite_ramp"
POWER_OF_DEPTH = "stiffening"
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
    fit = diagnosis.improved.fit
    skin = [s.z0_mm for s in fit.states if s.has_tissue] or [4.0, 5.0]
    low, high = (float(np.clip(z, *SURFACE_MM)) for z in (min(skin), max(skin)))
    tissue = {name: q.value for name, q in report.improved_parameters.items()}
    scatter = float(np.sqrt(fit.population.covariance[0, 0])) if tissue else 0.0
    settings: dict[str, Any] = {
        "seed": report.seed,
        "time": "virtual",
        "loopback_wired": True,
        "specimens": {
            "finger_variation": 0.0,
            "site_variation": float(np.clip(scatter, 0.0, 0.5)),
            "surface_low_mm": low,
            "surface_high_mm": high,
            "block_mn_per_mm": float(np.clip(fit.shared.rigid_stiffness, *BLOCK_MN_PER_MM)),
        },
        "noise": noise_settings(fit.noise, diagnosis.position.noise_mm if diagnosis.position else None),
        # the recordings were calibrated: here the nominal constants are the true ones
        "constants": {"spread": 0.0, "zero_spread_v": 0.0},
    }
    if tissue:
        settings["tissue"] = tissue
    effects = [_effect(diagnosis, report, k) for k in range(len(report.mechanisms))]
    effects = [e for e in effects if e is not None]
    if effects:
        settings["effects"] = effects
    return settings


def noise_settings(noise: NoiseModel, position_noise_mm: float | None) -> dict[str, float]:
    """Return the bench's noise for a noise model: white, quickly correlated, and slowly wandering parts.

    A band is as large and as quick there, but no band.
    """
    bands = tuple((v, 1.0 / (2.0 * np.pi * frequency_hz)) for v, frequency_hz, _ in noise.bands)
    quick = noise.quicker_than(SLOW_S).exponentials + bands
    slow = noise.slower_from(SLOW_S).exponentials
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
    values = {name: q.value for name, q in found.parameters.items()}
    effect = bench_effect(found.name, values, diagnosis.intake.trials[0].study_depth_mm)
    for law in diagnosis.improved.fit.shared.laws:
        if law.name == found.name and "growth" in law.free:
            effect["rough"] = float(np.clip(law.values["growth"], 0.0, 1.0))
    if library()[found.name].form == "event":
        states = diagnosis.improved.fit.states
        times = [s.shapes[k].at for s in states for k in s.shapes.of(found.name)]
        effect["scatter_s"] = min(float(np.std(times)), 5.0)
        if found.name == "motion_artefact":
            effect["share"] = len(times) / len(states)
    return effect


def bench_effect(name: str, values: Mapping[str, float], study_depth_mm: float) -> dict[str, Any]:
    """Return a mechanism with its parameters as an effect of the bench, within what the bench can do."""
    effect: dict[str, Any] = {"name": name, **values, "rough": 0.0}
    if name == POWER_OF_DEPTH and values.get("exponent", 1.0) != 1.0:
        effect["exponent"] = float(np.clip(effect["exponent"], 1.0, 3.0))
        effect["reference_mm"] = float(np.clip(0.5 * study_depth_mm, 0.01, 5.0))
        effect["coefficient_per_mm"] = float(np.clip(effect["coefficient_per_mm"], -0.3, 5.0))
    if name == SERVO:
        effect["damping_ratio"] = float(np.clip(effect["damping_ratio"], 0.1, 5.0))
        effect["natural_frequency_rad_s"] = float(np.clip(effect["natural_frequency_rad_s"], 100.0, 2.0e4))
    return effect
