"""Fluid drains from under the punch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Arm, Parts

_PER_DECADE = 4
_FASTEST = 3e-6


class PoroelasticDrainage(Effect):
    """Relaxation 1.304 exp(-sqrt(t / T)) - 0.304 exp(-0.254 t / T) of a flat punch (Hu et al. 2010).

    Shows in every contact, steeply after every change of depth and over some T. exp(-sqrt t) stands as its
    spectrum of plain exponentials, the integral of s^(-3/2) exp(-1 / (4 s)) / (2 sqrt(pi)) exp(-s t) ds, four
    arms a decade. Rough: the pad is no half-space; beyond 10 T the deep fluid meets bone and drains no more,
    so the slowest arms are missing.
    """

    name = "poroelastic_drainage"
    stage = "tissue"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("ratio_to_k0", "1", 0.3, -0.5, 20.0, "stiffness of the undrained fluid over k0"),
        Parameter("time_constant_s", "s", 0.5, 1e-3, 1000.0, "T: punch radius squared over diffusivity"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the draining fluid in."""
        if not skin:
            return parts
        k, T = self["ratio_to_k0"] * parts.k0_mn_per_mm, self["time_constant_s"]
        slowest = 40.0 if self.rough == 0 else 10.0
        n = round(math.log10(slowest / _FASTEST) * _PER_DECADE) + 1
        times = np.geomspace(_FASTEST, slowest, n)  # 1 / s, in units of T
        width = math.log(times[1] / times[0])
        share = np.sqrt(times) * np.exp(-times / 4) * width / (2 * math.sqrt(math.pi))
        share[0] += 1 - share.sum()  # what is faster than the fastest arm
        arms = [Arm(float(1.304 * k * s), float(T * t)) for s, t in zip(share, times, strict=True)]
        arms.append(Arm(-0.304 * k, T / 0.254))
        return replace(parts, arms=(*parts.arms, *arms))
