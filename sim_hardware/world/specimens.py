"""What may lie under the punch: fingers with many sites, a stiff block on a micrometer stage, nothing."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from sim_hardware.parts import Arm, Parts
from sim_hardware.settings import BenchSettings

FINGERS = ("thumb", "index", "middle", "ring", "little")
FAR_MM = 1.0e3
"""Where the surface is when nothing lies under the arm."""
_HAND_MM = 0.05


@dataclass(frozen=True, slots=True)
class SpecimenPart:
    """A specimen under the punch: its parts and where its surface is, in lever coordinates."""

    label: str
    finger: str
    surface_mm: float
    parts: Parts
    skin: bool


def lever_parts(settings: BenchSettings) -> Parts:
    """Return the lever's parts with nothing to press on."""
    return Parts(
        natural_frequency_rad_s=settings.lever.natural_frequency_rad_s,
        damping_ratio=settings.lever.damping_ratio,
    )


def nothing(settings: BenchSettings) -> SpecimenPart:
    """Return free air."""
    return SpecimenPart("nothing", "", FAR_MM, lever_parts(settings), skin=False)


def block(settings: BenchSettings, micrometer_um: float) -> SpecimenPart:
    """Return the stiff block; a larger micrometer reading lowers it, so it is found further along the travel.

    The screw has an error of its own at each reading, the same whenever it comes back to that reading.
    """
    random = np.random.default_rng([settings.seed, 4, round(micrometer_um * 10) + 10**6])
    error_um = settings.specimens.micrometer_error_um_rms * float(random.standard_normal())
    surface_mm = settings.specimens.block_mm + (micrometer_um + error_um) / 1e3
    parts = Parts(
        natural_frequency_rad_s=settings.lever.natural_frequency_rad_s,
        damping_ratio=settings.lever.damping_ratio,
        k0_mn_per_mm=settings.specimens.block_mn_per_mm,
    )
    return SpecimenPart("block", "", surface_mm, parts, skin=False)


def finger(
    settings: BenchSettings, name: str, site: str, repeat: int, surface_mm: float | None = None
) -> SpecimenPart:
    """Return a finger at a site: the same labels give the same tissue and height on the same bench.

    Where a hand was asked for a height it comes within some 50 um of it.
    """
    about = settings.specimens
    height = np.random.default_rng([settings.seed, 3, _key(name, site, str(repeat))])
    if surface_mm is None:
        surface_mm = float(height.uniform(about.surface_low_mm, about.surface_high_mm))
    else:
        surface_mm += _HAND_MM * float(np.clip(height.standard_normal(), -2, 2))
    tissue = settings.tissue
    stiffer, slower = 1.0, 1.0
    ratio = [1.0, 1.0]
    if not about.published_tissue:
        for spread, key in ((about.finger_variation, _key(name)), (about.site_variation, _key(name, site))):
            random = np.random.default_rng([settings.seed, 5, key])
            draws = np.clip(random.standard_normal(4), -2, 2)
            stiffer *= math.exp(spread * draws[0])
            slower *= math.exp(spread / 2 * draws[1])
            ratio = [r * math.exp(spread / 2 * d) for r, d in zip(ratio, draws[2:], strict=True)]
    if tissue.arms:
        # each of a calibrated pad's arms varies as the published arm that is nearer in time
        apart_s = math.sqrt(tissue.tau1_s * tissue.tau2_s)
        arms = [(a.stiffness_mn_per_mm, a.time_s, ratio[a.time_s < apart_s]) for a in tissue.arms]
    else:
        arms = [(tissue.k1, tissue.tau1_s, ratio[0]), (tissue.k2, tissue.tau2_s, ratio[1])]
    parts = Parts(
        natural_frequency_rad_s=settings.lever.natural_frequency_rad_s,
        damping_ratio=settings.lever.damping_ratio,
        k0_mn_per_mm=tissue.k0_mn_per_mm * stiffer,
        arms=tuple(Arm(k * stiffer * r, tau_s * slower) for k, tau_s, r in arms),
    )
    return SpecimenPart(f"{name}/{site}/{repeat}", name, surface_mm, parts, skin=True)


def _key(*labels: str) -> int:
    return zlib.crc32("/".join(labels).encode())
