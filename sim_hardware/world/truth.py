"""What the bench knows and a recording does not, for tests and scoring only."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from sim_hardware.parts import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from sim_hardware.world.bench import World


def truth(world: World) -> dict[str, object]:
    """Return what was drawn and what is under the arm; ``trial_start_s`` is -1 before a trial has begun."""
    tissue = asdict(world.specimen.parts)
    del tissue["memory"]
    start = world.clock.start
    return {
        **asdict(world.constants),
        "arm_mass_g": world.settings.lever.arm_mass_g,
        "natural_frequency_rad_s": world.settings.lever.natural_frequency_rad_s,
        "damping_ratio": world.settings.lever.damping_ratio,
        "gain": world.noise.gain,
        "force_noise_mn": world.settings.noise.force_mn_rms,
        "position_noise_um": world.settings.noise.position_um_rms,
        "specimen": world.specimen.label,
        "surface_mm": world.specimen.surface_mm,
        "tissue": tissue,
        "effects": [
            {"name": e.name, "rough": e.rough, **e.values, "drawn": e.drawn()} for e in world.effects
        ],
        "trial": world.trial,
        "trial_start_s": -1.0 if start is None else start / SAMPLE_RATE_HZ,
    }
