"""Relaxation without a time of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Arm, Parts

_FASTEST_S, _SLOWEST_S, _PER_DECADE = 2e-5, 2e4, 3


class PowerLawRelaxation(Effect):
    """A spring-pot in parallel: kernel c t^-a, t in s.

    Shows in every contact, at all times after every change of depth. The fractional element stands as its
    spectrum, t^-a = 1 / Gamma(a) times the integral of s^(a - 1) exp(-s t) ds, three arms a decade from
    20 us to 20000 s. Rough: a is not quite constant, the spectrum droops by 4 % a decade around 0.5 s.
    """

    name = "power_law_relaxation"
    stage = "tissue"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("coefficient_mn_per_mm", "mN/mm", 20.0, -500.0, 5000.0, "stiffness after 1 s"),
        Parameter("exponent", "1", 0.15, 0.01, 0.95, "a"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the spring-pot in."""
        if not skin:
            return parts
        a = self["exponent"]
        n = round(math.log10(_SLOWEST_S / _FASTEST_S) * _PER_DECADE) + 1
        times = np.geomspace(_FASTEST_S, _SLOWEST_S, n)
        width = math.log(times[1] / times[0])
        k = self["coefficient_mn_per_mm"] / math.gamma(a) * times**-a * width
        slower = math.exp(-width / 2) / times[-1]  # what is slower than the slowest arm stands still
        k[-1] += self["coefficient_mn_per_mm"] / math.gamma(a) * slower**a / a
        k *= 1 - 0.04 * self.rough * np.tanh(np.log10(times / 0.5))
        arms = tuple(Arm(float(s), float(t)) for s, t in zip(k, times, strict=True))
        return replace(parts, arms=(*parts.arms, *arms))
