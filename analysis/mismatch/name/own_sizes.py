"""How large what comes in each trial anew is: an event or an oscillation, over the trials that have it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.inexactness import exact_state
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT, KEPT
from analysis.mismatch.model.effects import simulate, touches
from analysis.mismatch.name.oscillations import band_hz, steady_gains
from analysis.simulation.mechanism import Mechanism

FloatArray = NDArray[np.float64]

SIZE_INEXACT = INEXACT / np.sqrt(3.0)
"""Standard deviation of what is anywhere within a tenth: so much a law's effect may be off, in all trials alike."""

OTHER, OTHERS = 0.5, 26
"""By such a share of itself a slow rhythm's frequency may be another at most, and how many are tried."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value with its standard error and unit."""

    value: float
    se: float
    unit: str


@dataclass(frozen=True, slots=True)
class WouldDo:
    """The frequencies at which a rhythm would do as well, each trial's its own about the median; Hz."""

    lowest_hz: float
    highest_hz: float

    @property
    def se_hz(self) -> float:
        """Standard deviation of what is anywhere between."""
        return (self.highest_hz - self.lowest_hz) / float(np.sqrt(12.0))

    def is_likely(self, mechanism: Mechanism) -> bool:
        """Return whether at least half of them are in the mechanism's band: one is as likely as another."""
        lowest_hz, highest_hz = band_hz(mechanism)
        inside_hz = min(self.highest_hz, highest_hz) - max(self.lowest_hz, lowest_hz)
        return inside_hz >= KEPT * (self.highest_hz - self.lowest_hz)


def would_do(account: Account, mechanism: Mechanism) -> WouldDo | None:
    """Return the frequencies that a rhythm may have by its form; None of what is none. One of many cycles has its own.

    Its form is right to a tenth: if all trials' frequencies were others by one factor, any would do that explains all
    but a tenth. Of a cycle or so in tissue that takes up what is slow these are many.
    """
    if mechanism.form != "oscillation":
        return None
    states = account.fit.states
    quick_hz = [r.frequency_hz for s in states for r in s.rhythms if r.effect == mechanism.name]
    if quick_hz:
        own_hz = float(np.median(quick_hz))
        return WouldDo(own_hz, own_hz)
    of_trials = [(j, state.shapes, state.shapes.of(mechanism.name)) for j, state in enumerate(states)]
    slow = [(j, shapes[mine[0]]) for j, shapes, mine in of_trials if mine]
    if not slow:
        return None
    without = account.stripped(mechanism.name).quick().fit
    factors = np.linspace(1.0 - OTHER, 1.0 + OTHER, OTHERS)
    # its sine alone: one half as quick has all of it among its overtones
    explained = sum(
        steady_gains(without, j, s.at * factors, float(np.sqrt(s.prior)), overtones=False) for j, s in slow
    )
    near = factors[explained >= (1.0 - INEXACT) * np.max(explained)]
    found_hz = float(np.median([s.at for _, s in slow]))
    half = 0.5 * float(factors[1] - factors[0])
    return WouldDo(found_hz * (float(near[0]) - half), found_hz * (float(near[-1]) + half))


def own_sizes(account: Account, mechanism: Mechanism, unsure_at: float = 0.0) -> dict[str, Quantity]:
    """Return the size of an event or an oscillation: mean over the trials that have it, error from their spread.

    ``unsure_at`` is the standard deviation, in all trials alike, of where it is. A part of it that stands as what it is
    granted to be off by is its own: each of a trial's several shapes is drawn to nothing, and that part spares them.
    """
    fit = account.fit
    states = tuple(exact_state(state, mechanism.name) for state in fit.states)
    # nothing is granted to a rhythm's band
    if any(exact is not state for exact, state in zip(states, fit.states, strict=True)):
        fit = replace(fit, states=states).with_states()
    each = _shape_sizes(fit, mechanism) + _rhythm_sizes(fit, mechanism)
    sizes, errors, places = (list(values) for values in zip(*each, strict=True))
    unit = 1e3 if mechanism.stage == "specimen" else 1.0
    values: FloatArray = unit * np.array(sizes)
    n = len(values)
    weight, large = np.full(n, 1.0 / n), np.full(n, True)
    if mechanism.form == "oscillation":
        value = float(np.sqrt(max(float(np.mean(np.sign(values) * values**2)), 0.0)))
    else:
        # each by its own size: the little that other effects leave over may pass for small steps
        weight = np.abs(values) / max(float(np.abs(values).sum()), 1e-300)
        size = float(weight @ np.abs(values))
        large = np.abs(values) >= 0.5 * size
        signs = np.unique(np.sign(values[large]))
        value = float(signs[0]) * size if len(signs) == 1 else size
    off = np.abs(values) - abs(value)
    spread = float(np.sqrt(weight**2 @ off**2 * n / (n - 1))) if n > 1 else 0.0
    fitted = unit * float(np.sqrt(np.mean(np.square(errors)) / n))
    error = float(np.sqrt(spread**2 + fitted**2 + (SIZE_INEXACT * value) ** 2))
    where = mechanism.parameters[1]
    found_at = np.array(places)[large]
    scatter = float(np.std(found_at, ddof=1)) if len(found_at) > 1 else 0.0
    grid = 0.02 * float(np.median(found_at)) if mechanism.form == "oscillation" else 1e-3
    return {
        mechanism.amplitude: Quantity(value, error, mechanism.parameter(mechanism.amplitude).unit),
        where.name: Quantity(
            float(np.median(found_at)),
            float(np.sqrt((1.25 * scatter) ** 2 / len(found_at) + grid**2 + unsure_at**2)),
            where.unit,
        ),
    }


def _shape_sizes(fit: StudyFit, mechanism: Mechanism) -> list[tuple[float, float, float]]:
    """Return size, its error, and time (s) or frequency (Hz) of an effect's shapes in every trial that has them."""
    found = []
    for trial, own, state in zip(fit.trials, fit.own, fit.states, strict=True):
        mine = state.shapes.of(mechanism.name)
        if not mine:
            continue
        at = [own.tissue.stop + k for k in mine]
        c, V = state.coefficients[mine], np.linalg.pinv(own.information, hermitian=True)[np.ix_(at, at)]
        size, error = float(c[0]), float(np.sqrt(V[0, 0]))
        if mechanism.form == "oscillation":
            # a sine has half of its amplitude's square; what the fit is unsure of adds to the square of what was found
            S = np.array([state.shapes[k].shape for k in mine])
            shown = trial.counts * touches(trial, state, fit.shared)
            M = 2.0 * (S * shown) @ S.T / max(float(shown.sum()), 1.0)
            unsure = float(np.sum(M * V))
            power = float(c @ M @ c) - unsure
            size, error = float(np.sign(power) * np.sqrt(abs(power))), float(np.sqrt(unsure))
        found.append((size, error, state.shapes[mine[0]].at))
    return found


def _rhythm_sizes(fit: StudyFit, mechanism: Mechanism) -> list[tuple[float, float, float]]:
    """Return amplitude (mm), its error, and frequency (Hz) of a rhythm in every trial: of its sine, without overtones.

    What is left open of it adds to the square of what was found.
    """
    found = []
    for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        at = next((k for k, r in enumerate(state.rhythms) if r.effect == mechanism.name), None)
        if at is None:
            continue
        rhythm = state.rhythms[at]
        left_mn = trial.force_mn - simulate(trial, state, fit.shared)
        amplitudes = (
            fit.whiteners[j].amplitudes(left_mn)[at],
            fit.whiteners[j].left_open(np.random.default_rng(j))[at],
        )
        sine_mm = rhythm.size_mm * rhythm.waves[:, :2]
        shown = trial.counts * touches(trial, state, fit.shared)
        likeliest, unsure = (
            2.0 * float(shown @ np.sum(A[:, :2] * sine_mm, axis=1) ** 2) / max(float(shown.sum()), 1.0)
            for A in amplitudes
        )
        found.append((float(np.sqrt(likeliest + unsure)), float(np.sqrt(unsure)), rhythm.frequency_hz))
    return found
