"""The bench's true constants, drawn once per bench from its seed around the nominal ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_hardware.settings import BenchSettings


@dataclass(frozen=True, slots=True)
class TrueConstants:
    """What turns this bench's volts into millimetres and millinewtons; zeros include the converters' offsets.

    position_mm = (position_v - position_zero_v) / volts_per_mm, and likewise for the others.
    ``hang_angle_error_rad`` is how far the inverted arm is from level.
    """

    volts_per_mm: float
    position_zero_v: float
    volts_per_mn: float
    force_zero_v: float
    command_volts_per_mm: float
    command_zero_v: float
    hang_angle_error_rad: float


def draw_constants(settings: BenchSettings) -> TrueConstants:
    """Draw the true constants within 2.5 spreads; command and position, of one instrument, nearly agree."""
    nominal = settings.constants
    random = np.random.default_rng([settings.seed, 1])

    def near(spread: float) -> float:
        return float(spread * np.clip(random.standard_normal(), -2.5, 2.5))

    volts_per_mm = nominal.volts_per_mm * (1 + near(nominal.spread))
    position_zero_v = nominal.position_zero_v + near(nominal.zero_spread_v)
    offset_v = settings.converters.offset_mv_rms * 1e-3
    return TrueConstants(
        volts_per_mm=volts_per_mm,
        position_zero_v=position_zero_v + near(offset_v),
        volts_per_mn=nominal.volts_per_mn * (1 + near(nominal.spread)),
        force_zero_v=nominal.force_zero_v + near(nominal.zero_spread_v) + near(offset_v),
        command_volts_per_mm=volts_per_mm * (1 + near(nominal.spread / 10)),
        command_zero_v=position_zero_v + near(offset_v),
        hang_angle_error_rad=math.radians(
            float(random.uniform(-1, 1)) * settings.specimens.hang_angle_error_deg
        ),
    )
