"""One look at what a fit leaves: every law, window, frequency and event scored, and tested together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.amplitude_t import amplitude_p_value
from analysis.mismatch.events import (
    EventScan,
    event_mechanisms,
    event_p_value,
    scan_events,
)
from analysis.mismatch.freed import freed_evidence, freed_residuals
from analysis.mismatch.joint import JointFit
from analysis.mismatch.oscillations import (
    Spectrum,
    bands,
    line_gain,
    oscillation_scores,
    quick_frequencies,
    quick_spectrum,
    scan_frequencies,
    smoothed,
    surface_spectrum,
)
from analysis.mismatch.problem import Problem
from analysis.mismatch.profiles import OUTSIDE
from analysis.mismatch.signatures import FEW_TRIALS, Probe, Signatures, accumulate
from analysis.mismatch.signflip import Family, flip_test
from analysis.mismatch.weighing import weighed_slow
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

FloatArray = NDArray[np.float64]

LEVEL = 0.006
"""Chance of a false alarm that is accepted, over all that is looked at together."""

LAWS_SHARE, BINS_SHARE, SPECTRA_SHARE, EVENTS_SHARE = 0.6, 0.15, 0.2, 0.05
"""How the level is shared out: most of it to known physics, for most mismatches are of that kind."""

STRICT_LEVEL = 5e-4
"""The same chance for tests that trust noise to be near Gaussian, which it is not quite."""

T_LEVEL = 0.002
"""The same chance for amplitudes judged by their t, which trusts trials to scatter nearly as Gaussian numbers do."""

WANDERING_HZ = 0.5
WANDERS_BELOW_HZ = 4.0
FAINT_BELOW_HZ, FAINT_GAIN = 0.7, 5.0
"""Where a trial holds but a few periods, a line has to gain so much a trial: noise is not known well enough there."""

CLEAR_GAIN, CLEAR_SHARE = 1e3, 0.9
WIDEST = 1.6


@dataclass(frozen=True)
class Look:
    """One look at a fit's residual: what is significant in it, before anything is named.

    ``bin_p`` (2, B): p-values of the residual's bins, plain and with depth; ``p_of`` the p-value of each
    mechanism; ``best`` its best probes; ``critical`` what a law's statistic by sign-flips had to reach.
    """

    signatures: Signatures
    p_of: dict[str, float]
    best: dict[str, list[tuple[float, Probe, float]]]
    bin_p: FloatArray
    spectra: tuple[Spectrum, ...]
    spectrum_p: FloatArray
    scans: tuple[EventScan, ...]
    critical: float

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies that ``spectrum_p`` speaks of."""
        return np.concatenate([s.frequency_hz for s in self.spectra]) if self.spectra else np.zeros(0)

    @property
    def quiet(self) -> bool:
        """Whether nothing at all is significant."""
        return min([1.0, *self.p_of.values()]) > LEVEL and float(self.bin_p.min()) > LEVEL


def look(problem: Problem, fit: JointFit, rng: np.random.Generator) -> Look:
    """Score every law, window, frequency and event against a fit's residual, tested together."""
    present = [a.mechanism.name for a in fit.simulation.additions]
    probes = law_probes(problem.trials, present)
    signatures = accumulate(problem.trials, problem.whiteners, fit, probes)
    # a signature that the baseline absorbs but for rounding has no score worth the name
    seen = signatures.norm > 1e-4 * np.maximum(signatures.raw_norm, 1e-12)
    blocks = [signatures.scores * seen, signatures.bin_scores]
    sided = [np.array([p.mechanism.one_sided for p in probes], dtype=bool), np.zeros(2 * OUTSIDE, dtype=bool)]
    families = [Family(len(probes), LAWS_SHARE), Family(2 * OUTSIDE, BINS_SHARE)]
    spectra: list[Spectrum] = []
    many = len(problem.trials) >= FEW_TRIALS
    skin = any(t.kind not in ("air_sweep", "rigid_target") for t in problem.trials)
    if many and skin:
        freed = freed_residuals(problem.trials, problem.whiteners, fit)
        quick = quick_spectrum(problem.trials, freed, fit, quick_frequencies())
        slow = surface_spectrum(problem.trials, problem.whiteners, freed, fit, scan_frequencies())
        spectra = [slow, quick, smoothed(quick, WANDERING_HZ)]
        for spectrum in spectra:
            blocks.append(oscillation_scores(spectrum))
            sided.append(np.ones(len(spectrum.frequency_hz), dtype=bool))
        families.append(Family(sum(len(s.frequency_hz) for s in spectra), SPECTRA_SHARE))
    slow_problem = weighed_slow(problem, fit) if skin else problem
    scans = _event_scans(problem, slow_problem, fit, present) if skin else ()
    signed = [s for s in scans if s.mechanism.one_sided and many]
    for scan in signed:
        blocks.append(scan.asymmetry()[:, None])
        sided.append(np.ones(1, dtype=bool))
    families.append(Family(len(signed), EVENTS_SHARE))
    test = flip_test(np.hstack(blocks), np.concatenate(sided), rng, families)
    p_of: dict[str, float] = {}
    for probe, p in zip(probes, test.p_value, strict=False):
        p_of[probe.mechanism.name] = min(p_of.get(probe.mechanism.name, 1.0), float(p))
    if many:
        for probe, p in zip(probes, amplitude_p_value(signatures, rng), strict=True):
            by_t = min(1.0, float(p) * LEVEL / T_LEVEL)
            p_of[probe.mechanism.name] = min(p_of[probe.mechanism.name], by_t)
    m = len(probes)
    bin_p = test.p_value[m : m + 2 * OUTSIDE].reshape(2, OUTSIDE)
    at = m + 2 * OUTSIDE
    all_spectrum_p = test.p_value[at : len(test.p_value) - len(signed)]
    for spectrum in spectra:
        spectrum_p = test.p_value[at : at + len(spectrum.frequency_hz)]
        at += len(spectrum.frequency_hz)
        for name, p in _bands_p(spectrum, spectrum_p, present).items():
            p_of[name] = min(p_of.get(name, 1.0), p)
    p_of.update(dict.fromkeys(_only_wanders(problem, slow_problem, fit, spectra, p_of), 1.0))
    for scan in scans:
        p_of[scan.mechanism.name] = strict(event_p_value(scan))
    for scan, p in zip(signed, test.p_value[len(test.p_value) - len(signed) :], strict=True):
        p_of[scan.mechanism.name] = min(p_of[scan.mechanism.name], float(p))
    critical = test.critical(LEVEL, LAWS_SHARE)
    best = best_probes(signatures)
    return Look(signatures, p_of, best, bin_p, tuple(spectra), all_spectrum_p, scans, critical)


def _event_scans(
    problem: Problem, slow_problem: Problem, fit: JointFit, present: Sequence[str]
) -> tuple[EventScan, ...]:
    """Return the scans of the events that are not in the simulation yet.

    A step in noise that wanders is no event, and events are no wander: noise is weighed the way that explains more.
    """
    absent = [m for m in event_mechanisms() if m.name not in present]
    # an event's scan has its own account of how tissues scatter
    ways = (problem,) if slow_problem is problem else (problem, slow_problem)
    weighings = tuple([w.tight for w in p.whiteners] for p in ways)
    return tuple(
        max(
            (scan_events(m, problem.trials, w, fit) for w in weighings),
            # where much is left in every trial without its strongest step, noise was weighed wrong
            key=lambda s: (s.width < WIDEST, s.evidence),
        )
        for m in absent
    )


def _bands_p(spectrum: Spectrum, p_value: FloatArray, present: Sequence[str]) -> dict[str, float]:
    """Return the smallest p-value in the band of each oscillation that is not in the simulation yet."""
    found = {}
    for band in bands():
        inside = band.holds(spectrum.frequency_hz)
        if band.mechanism not in present and inside.any():
            found[band.mechanism] = float(p_value[inside].min())
    return found


def _only_wanders(
    problem: Problem,
    slow_problem: Problem,
    fit: JointFit,
    spectra: Sequence[Spectrum],
    p_of: dict[str, float],
) -> list[str]:
    """Return the slow oscillations that seem significant, but explain less than noise that wanders does.

    The spectrum of such noise has a hump where what a trial is free to have, a course and a tissue of its own, ends.
    """
    doubtful = [b for b in bands() if b.lower_hz < WANDERS_BELOW_HZ and p_of.get(b.mechanism, 1.0) <= LEVEL]
    if not doubtful or not spectra:
        return []
    wanders = freed_evidence(problem.trials, slow_problem.whiteners, fit)
    steady = freed_evidence(problem.trials, problem.whiteners, fit)
    found = []
    for band in doubtful:
        beyond = FAINT_GAIN * len(problem.trials) if band.lower_hz < FAINT_BELOW_HZ else 0.0
        gain, of_noise = line_gain(spectra[0], band), max(wanders - steady, 0.0)
        # no line is quite regular: of a large one a part is left that noise which wanders explains as well
        clear = gain > CLEAR_GAIN * len(problem.trials) and gain > CLEAR_SHARE * of_noise
        if gain < of_noise + beyond and not clear:
            found.append(band.mechanism)
    return found


def law_probes(trials: Sequence[CellTrial], present: Sequence[str]) -> list[Probe]:
    """Return the probes of every law of the library that is not in the simulation yet."""
    peak = max(float(t.force_mn.max() - t.offset_start_mn) for t in trials)
    return [
        Probe(m, values)
        for m in library().values()
        if m.form == "law" and m.name not in present and any(m.applies(t) for t in trials)
        for values in m.probe_settings(peak)
    ]


def best_probes(signatures: Signatures, keep: int = 2) -> dict[str, list[tuple[float, Probe, float]]]:
    """Return for each mechanism its best probes: (linear gain, probe, amplitude in units of the probe)."""
    total = signatures.trial_scores.sum(axis=0)
    power = np.diag(signatures.gram)
    found: dict[str, list[tuple[float, Probe, float]]] = {}
    for k, probe in enumerate(signatures.probes):
        if power[k] <= (1e-4 * signatures.raw_norm[k]) ** 2:
            continue
        amplitude = float(total[k] / power[k])
        if probe.mechanism.one_sided and amplitude <= 0:
            continue
        found.setdefault(probe.mechanism.name, []).append((float(total[k] ** 2 / power[k]), probe, amplitude))
    return {name: sorted(items, key=lambda i: -i[0])[:keep] for name, items in found.items()}


def strict(p_value: float) -> float:
    """Return a p-value that trusts noise to be near Gaussian, raised so that only a strict one is significant."""
    return min(1.0, p_value * LEVEL / STRICT_LEVEL)
