"""The trials to be explained, the weights of their cells, and what a fit leaves of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.joint import JointFit, fit_jointly
from analysis.mismatch.linearised import weighed_residual
from analysis.mismatch.noise import Whitener
from analysis.mismatch.profiles import OUTSIDE, bins_of, profile, repeatable_energy
from analysis.mismatch.shared import Simulation
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial

FloatArray = NDArray[np.float64]

REPEATS = 3
"""Of fewer trials nothing tells what repeats and what is noise."""


@dataclass(frozen=True)
class Problem:
    """The trials to be explained, with the weights of their cells.

    ``scatter_mn``: by how much (rms over all samples) repeats were seen to differ in their tissue.
    """

    trials: tuple[CellTrial, ...]
    whiteners: tuple[Whitener, ...]
    white_mn: float
    scatter_mn: float = 0.0

    @property
    def common_rate_hz(self) -> float | None:
        """The sample rate of all trials, None where they differ."""
        rates = [t.sample_rate_hz for t in self.trials]
        return rates[0] if np.allclose(rates, rates[0], rtol=1e-6) else None

    @property
    def tight(self) -> Problem:
        """The same trials weighed by noise alone, as if repeats did not differ in their tissue."""
        return Problem(self.trials, tuple(w.tight for w in self.whiteners), self.white_mn)

    def fit(self, simulation: Simulation, own: Sequence[PerTrial], rounds: int = 12) -> JointFit:
        """Fit a simulation to the trials."""
        return fit_jointly(self.trials, self.whiteners, simulation, own, rounds=rounds)

    def residual(self, fit: JointFit, j: int) -> FloatArray:
        """Return what a fit leaves of one trial's cells, (n,), mN, less what repeats of it deviate by."""
        t = self.trials[j]
        left = t.force_mn - fit.simulation.whole_force_mn(t, fit.own[j], fit.latents[j])
        return self.whiteners[j].settled(left)

    def weighed_residual(self, fit: JointFit, j: int) -> FloatArray:
        """Return what a fit leaves of one trial's fitted cells, whitened, (m,)."""
        return weighed_residual(self.trials[j], self.whiteners[j], fit.simulation, fit.own[j], fit.latents[j])

    def residuals(self, fit: JointFit) -> list[FloatArray]:
        """Return what a fit leaves of every trial's cells, mN."""
        return [self.residual(fit, j) for j in range(len(self.trials))]

    def full_residual(self, fit: JointFit, j: int) -> FloatArray:
        """Return what a fit leaves of the compared samples of one trial at full rate, mN."""
        t = self.trials[j]
        smooth = t.force_mn - self.residual(fit, j)
        time_s = np.arange(len(t.full_force_mn)) / t.sample_rate_hz
        hums = [a.hum for a in fit.simulation.additions if a.hum is not None]
        quick = np.zeros(len(time_s))
        for hum in hums:
            smooth = smooth - hum.at(t.label, t.time_s, t.counts / t.sample_rate_hz)
            quick += hum.at(t.label, time_s)
        residual = t.full_force_mn - np.interp(time_s, t.time_s, smooth) - quick
        return np.asarray(residual[np.repeat(t.fitted, t.counts.astype(np.int64))])

    def repeatable(self, fit: JointFit) -> FloatArray:
        """Return the repeatable energy of a fit's residual by bin, (B,), in units of white-noise chi2."""
        p = profile(self.trials, self.residuals(fit), [o.z0_mm for o in fit.own])
        return repeatable_energy(p.standardised(self.white_mn), p.conditions)

    def weighed_repeatable(self, fit: JointFit) -> float:
        """Return the repeatable energy of the whitened residual: in the units in which gains are counted."""
        sums = np.zeros((len(self.trials), OUTSIDE))
        for j, trial in enumerate(self.trials):
            r = self.weighed_residual(fit, j)
            bins = bins_of(trial, fit.own[j].z0_mm)[trial.fitted]
            size = np.maximum(np.bincount(bins, minlength=OUTSIDE + 1)[:OUTSIDE], 1)
            sums[j] = np.bincount(bins, weights=r, minlength=OUTSIDE + 1)[:OUTSIDE] / np.sqrt(size)
        return float(repeatable_energy(sums, [t.condition for t in self.trials]).sum())
