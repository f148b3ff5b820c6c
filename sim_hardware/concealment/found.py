"""The constants that a calibration of the bench found: the true ones, or such as are a little off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_hardware.world import World


@dataclass(frozen=True, slots=True)
class FoundCalibration:
    """Constants as a calibration of this bench gave them, with their standard errors."""

    volts_per_mm: float
    position_zero_v: float
    volts_per_mn: float
    force_zero_v: float
    command_volts_per_mm: float
    command_zero_v: float
    standard_errors: Mapping[str, float]


def true_calibration(world: World) -> FoundCalibration:
    """Return the bench's true constants."""
    c = world.constants
    return FoundCalibration(
        c.volts_per_mm,
        c.position_zero_v,
        c.volts_per_mn,
        c.force_zero_v,
        c.command_volts_per_mm,
        c.command_zero_v,
        {},
    )


def found_calibration(world: World) -> FoundCalibration:
    """Return constants with the errors of a good calibration, drawn from the bench's seed."""
    random = np.random.default_rng([world.settings.seed, 7])
    c = world.constants
    errors = {
        "volts_per_mm": 1e-4 * c.volts_per_mm,
        "position_zero_v": 1e-3,
        "volts_per_mn": 1e-3 * c.volts_per_mn,
        "force_zero_v": 2e-3,
        "command_volts_per_mm": 1e-4 * c.command_volts_per_mm,
        "command_zero_v": 1e-3,
    }
    values = {k: float(getattr(c, k) + e * random.standard_normal()) for k, e in errors.items()}
    return FoundCalibration(**values, standard_errors=errors)
