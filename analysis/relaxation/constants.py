"""The constants of the solid in the three languages they are reported in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray


@dataclass(frozen=True, slots=True)
class Solid:
    """Springs and dashpots: k0 beside arms, given as (stiffness mN/mm, time s), longest time first.

    ``dashpots_mn_s_per_mm`` are k_i tau_i.
    """

    k0_mn_per_mm: float
    arms: tuple[tuple[float, float], ...] = ()

    @property
    def dashpots_mn_s_per_mm(self) -> tuple[float, ...]:
        """The viscosity of every arm's dashpot, k_i tau_i."""
        return tuple(stiffness * tau for stiffness, tau in self.arms)

    @classmethod
    def from_dashpots(
        cls,
        k0_mn_per_mm: float,
        springs_mn_per_mm: tuple[float, ...],
        dashpots_mn_s_per_mm: tuple[float, ...],
    ) -> Solid:
        """Return the solid of given springs and dashpots, each arm one of both."""
        pairs = zip(springs_mn_per_mm, dashpots_mn_s_per_mm, strict=True)
        return cls(k0_mn_per_mm, _ordered((k, eta / k) for k, eta in pairs))

    def step_answer(self, depth_mm: float) -> StepAnswer:
        """Return the answer to an ideal step of ``depth_mm``: A_i = k_i d."""
        return StepAnswer(
            self.k0_mn_per_mm * depth_mm, tuple((stiffness * depth_mm, tau) for stiffness, tau in self.arms)
        )


@dataclass(frozen=True, slots=True)
class StepAnswer:
    """Equation (5) of the published study: F(t) = A0 + sum_i A_i exp(-t / t_i), t from the end of the ramp.

    ``terms`` are (A_i in mN, t_i in s), longest time first.
    """

    a0_mn: float
    terms: tuple[tuple[float, float], ...] = ()

    def force_mn(self, time_s: FloatArray) -> FloatArray:
        """Return the force (N,) mN at times (N,) s since the step."""
        force_mn = np.full(np.shape(time_s), self.a0_mn)
        for amplitude_mn, tau_s in self.terms:
            force_mn = force_mn + amplitude_mn * np.exp(-np.asarray(time_s) / tau_s)
        return force_mn

    def solid(self, depth_mm: float) -> Solid:
        """Return the solid that gives this answer to an ideal step of ``depth_mm`` (mm, above 0)."""
        if not depth_mm > 0:
            raise ValueError(f"a step needs a depth above 0, not {depth_mm} mm")
        return Solid(self.a0_mn / depth_mm, tuple((a / depth_mm, tau) for a, tau in self.terms))

    @property
    def prony(self) -> tuple[tuple[float, float], ...]:
        """Equation (7), G(t) / G(0) = 1 - sum_i g_i (1 - exp(-t / t_i)): pairs (g_i, t_i).

        g_i = A_i / (A0 + sum of all A_i).
        """
        instantaneous_mn = self.a0_mn + sum(a for a, _ in self.terms)
        return tuple((a / instantaneous_mn, tau) for a, tau in self.terms)

    @classmethod
    def from_prony(cls, instantaneous_mn: float, prony: tuple[tuple[float, float], ...]) -> StepAnswer:
        """Return the step answer of a Prony series whose force starts at ``instantaneous_mn``."""
        share = 1.0 - sum(g for g, _ in prony)
        return cls(instantaneous_mn * share, _ordered((instantaneous_mn * g, tau) for g, tau in prony))


def ramp_bias(ramp_s: float, tau_s: float) -> float:
    """Return what a step fit makes of an arm after a ramp of ``ramp_s``: (tau / T) (1 - exp(-T / tau)).

    On linear tissue the hold after a ramp of constant speed is the ideal step answer with each A_i times
    this.
    """
    ratio = ramp_s / tau_s
    return float(-np.expm1(-ratio) / ratio) if ratio > 0 else 1.0


def _ordered(terms: Iterable[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    return tuple(sorted(terms, key=lambda term: -term[1]))
