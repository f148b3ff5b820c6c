"""What may lie under the punch: fingers with many sites, a stiff block on a micrometer stage, nothing."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from sim_hardware.parts import Arm, Parts
from sim_hardware.settings import BenchSettings, SpecimenSettings

FINGERS = ("thumb", "index", "middle", "ring", "little")
FAR_MM = 1.0e3
"""Where the surface is when nothing lies under the arm."""
_HAND_MM = 0.05
_PUBLISHED = {"k1": 0.082 / 0.371, "k2": 0.059 / 0.294, "tau1": 0.233 / 2.279, "tau2": 0.022 / 0.149}
"""Relative standard deviations of ratios to k0 and of times over all curves (Kumar et al. 2015)."""
_STIFFNESS = 0.10
"""That of k0 from site to site: no figure was published; that of a finger's other constants, roughly."""


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


def site_scatter(about: SpecimenSettings) -> dict[str, float]:
    """Return the relative standard deviation of k0, and of each ratio to it and time, over a finger's sites.

    As published, fingers and sites together scatter as the published curves do: what the fingers take
    (half of ``finger_variation``) is left to the sites no more.
    """
    if about.published_tissue:
        return dict.fromkeys(("k0", *_PUBLISHED), 0.0)
    if about.site_variation != "published":
        return dict.fromkeys(("k0", *_PUBLISHED), float(about.site_variation))
    of_fingers = (about.finger_variation / 2) ** 2
    return {"k0": _STIFFNESS, **{c: math.sqrt(max(v**2 - of_fingers, 0.0)) for c, v in _PUBLISHED.items()}}


class Solid(TypedDict):
    """The tissue's part of ``Parts``."""

    k0_mn_per_mm: float
    arms: tuple[Arm, ...]


def tissue(settings: BenchSettings, name: str, site: str) -> Solid:
    """Return spring and arms of a finger at a site; lognormal over sites, of unit mean."""
    about, given = settings.specimens, settings.tissue
    stiffer, slower = 1.0, 1.0
    ratio = [1.0, 1.0]
    times = [1.0, 1.0]
    if not about.published_tissue:
        spread = about.finger_variation
        draws = _draws(settings, _key(name), 4, 2.0)
        stiffer *= math.exp(spread * draws[0])
        slower *= math.exp(spread / 2 * draws[1])
        ratio = [math.exp(spread / 2 * d) for d in draws[2:]]
        scatter = site_scatter(about)
        widths = [math.sqrt(math.log1p(v**2)) for v in scatter.values()]
        at_site = _draws(settings, _key(name, site), len(widths), 3.0)
        factors = [math.exp(w * d - w**2 / 2) for w, d in zip(widths, at_site, strict=True)]
        stiffer *= factors[0]
        ratio = [r * f for r, f in zip(ratio, factors[1:3], strict=True)]
        times = factors[3:]
    if given.arms:
        # each of a calibrated pad's arms varies as the published arm that is nearer in time
        apart_s = math.sqrt(given.tau1_s * given.tau2_s)
        arms = [(a.stiffness_mn_per_mm, a.time_s, int(a.time_s < apart_s)) for a in given.arms]
    else:
        arms = [(given.k1, given.tau1_s, 0), (given.k2, given.tau2_s, 1)]
    return Solid(
        k0_mn_per_mm=given.k0_mn_per_mm * stiffer,
        arms=tuple(Arm(k * stiffer * ratio[i], tau_s * slower * times[i]) for k, tau_s, i in arms),
    )


def _draws(settings: BenchSettings, key: int, n: int, within: float) -> list[float]:
    """Return n standard normal draws, cut at ``within``; the same key draws the same."""
    random = np.random.default_rng([settings.seed, 5, key])
    return [float(d) for d in np.clip(random.standard_normal(n), -within, within)]


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
    parts = Parts(
        natural_frequency_rad_s=settings.lever.natural_frequency_rad_s,
        damping_ratio=settings.lever.damping_ratio,
        **tissue(settings, name, site),
    )
    return SpecimenPart(f"{name}/{site}/{repeat}", name, surface_mm, parts, skin=True)


def _key(*labels: str) -> int:
    return zlib.crc32("/".join(labels).encode())
