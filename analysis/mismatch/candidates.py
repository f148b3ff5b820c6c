"""What is significant in a look, fitted for real beside what was there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.event_at import SAME_EVENT_S, EventAt, event_addition
from analysis.mismatch.events import EventScan, by_chance, refine_time, scan_events
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import LEVEL, Look, strict
from analysis.mismatch.oscillations import (
    Band,
    Spectrum,
    bands,
    hum_addition,
    line_p_value,
    line_power,
    mains_lines,
)
from analysis.mismatch.problem import Problem
from analysis.mismatch.shared import Addition, Simulation
from analysis.mismatch.signatures import Probe
from analysis.mismatch.start import start_tissue
from analysis.mismatch.surface_oscillation import surface_addition
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

REFITTED = 7
WORTH_REFITTING = 0.08
EVENT_MUST_EXCEED = 4.0
QUICK_ABOVE_HZ = 4.0
LARGE_GAIN = 1e3


@dataclass(frozen=True)
class Candidate:
    """A mechanism fitted beside what was there: its fit and the held-out gain of each trial (T,)."""

    mechanism: Mechanism
    fit: JointFit
    gain: FloatArray
    p_value: float

    @property
    def total_gain(self) -> float:
        """Held-out gain over all trials, in units of chi2."""
        return float(self.gain.sum())


def candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return everything that is significant in a fit's residual, refitted, best held-out gain first."""
    found = law_candidates(problem, fit, seen) + event_candidates(problem, fit, seen)
    found = [c for c in found if not _same_event(fit, c)]
    found += surface_candidates(problem, fit, seen, max((c.total_gain for c in found), default=0.0))
    hum = hum_candidate(problem, fit)
    if hum is not None:
        found.append(hum)
    return sorted((c for c in found if c.total_gain > 0), key=lambda c: -c.total_gain)


def refit_with(problem: Problem, fit: JointFit, probe: Probe, amplitude: float, rounds: int = 10) -> JointFit:
    """Fit the simulation with one more law, started at the linear estimate."""
    addition = Addition(probe.mechanism, start_values(probe, amplitude))
    return refit_added(problem, fit, addition, rounds)


def refit_added(problem: Problem, fit: JointFit, addition: Addition, rounds: int = 10) -> JointFit:
    """Fit the simulation with one more addition."""
    simulation = replace(fit.simulation, additions=(*fit.simulation.additions, addition))
    return problem.fit(simulation, fit.own, rounds=rounds)


def start_values(probe: Probe, amplitude: float) -> dict[str, float]:
    """Return a probe's values with its amplitude scaled by what the linear estimate says."""
    m = probe.mechanism
    parameter = m.parameter(m.amplitude)
    values = dict(probe.values)
    null, at = m.null[m.amplitude], values[m.amplitude]
    if parameter.scale == "linear":
        wanted = null + amplitude * (at - null)
        values[m.amplitude] = min(max(wanted, parameter.lower), parameter.upper)
    elif parameter.scale == "inverse_square":
        values[m.amplitude] = parameter.from_fit(parameter.to_fit(at) * max(amplitude, 0.02))
    return values


def law_candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return the significant laws, refitted."""
    best = seen.best
    significant = sorted((n for n in best if seen.p_of.get(n, 1.0) <= LEVEL), key=lambda n: -best[n][0][0])
    if not significant:
        return []
    worth = WORTH_REFITTING * best[significant[0]][0][0]
    found = []
    for name in [n for n in significant if best[n][0][0] >= worth][:REFITTED]:
        refitted = best_refit(problem, fit, best[name])
        probe = best[name][0][1]
        found.append(
            Candidate(probe.mechanism, refitted, fit.heldout_cost - refitted.heldout_cost, seen.p_of[name])
        )
    return found


def best_refit(problem: Problem, fit: JointFit, starts: list[tuple[float, Probe, float]]) -> JointFit:
    """Refit from the best probes, and go on with the better of them until it has settled."""
    fits = [refit_with(problem, fit, probe, amplitude, rounds=6) for _, probe, amplitude in starts]
    best = min(fits, key=lambda f: float(f.cost.sum()))
    return problem.fit(best.simulation, best.own, rounds=14)


def surface_candidates(problem: Problem, fit: JointFit, seen: Look, to_beat: float) -> list[Candidate]:
    """Return the significant oscillations of the specimen, refitted with each trial's own frequency.

    Bands whose whole power is far below ``to_beat``, the gain of a law, are not worth a fit.
    """
    if not seen.spectra:
        return []
    found = []
    for band in bands():
        f, power = _spectrum_for(band, seen).frequency_hz, _spectrum_for(band, seen).power
        if seen.p_of.get(band.mechanism, 1.0) > LEVEL:
            continue
        inside = band.holds(f)
        if 4.0 * float(power[:, inside].max(axis=1).sum()) < 0.5 * to_beat:
            continue
        centre = float(f[inside][int(np.argmax(power[:, inside].sum(axis=0)))])
        near = inside & (np.abs(np.log(f / centre)) < 0.2)
        own_hz = {
            t.label: float(f[near][int(np.argmax(row[near]))])
            for t, row in zip(problem.trials, power, strict=True)
        }
        shapes = [(1, np.inf), (1, 3.0 / centre), (1, 1.5 / centre)]
        if centre < QUICK_ABOVE_HZ:
            shapes += [(3, np.inf), (3, 2.5 / centre)]
        mechanism, p_value = library()[band.mechanism], seen.p_of[band.mechanism]
        waves = [surface_addition(mechanism, own_hz, *shape) for shape in shapes]
        best = max(
            (
                _latent_candidate(mechanism, fit, refit_added(problem, fit, w, rounds=3), p_value)
                for w in waves
            ),
            key=lambda c: c.total_gain,
        )
        if centre < QUICK_ABOVE_HZ and best.total_gain > LARGE_GAIN * len(problem.trials):
            best = _settled(problem, fit, best, waves)
        found.append(best)
    return found


def _settled(problem: Problem, fit: JointFit, best: Candidate, waves: Sequence[Addition]) -> Candidate:
    """Return a large and slow movement settled: it had bent everything else, which takes its rounds to come right.

    It had also passed for tissues that scatter: beside such, waves of any shape explain as much. Then the one of
    ``waves`` is taken that explains most without.
    """
    anew = _begun_anew(problem, best.fit)
    if problem.scatter_mn:
        tight = problem.tight
        fits = [
            tight.fit(replace(anew, additions=(*fit.simulation.additions, w)), best.fit.own, rounds=6)
            for w in waves
        ]
        shaped = min(fits, key=lambda f: float(f.heldout_cost.sum()) + 2.0 * sum(map(len, f.latents)))
        starts = [(shaped.simulation, shaped.own)]
    else:
        starts = [(best.fit.simulation, best.fit.own), (anew, best.fit.own)]
    options = [
        _latent_candidate(best.mechanism, fit, problem.fit(simulation, own, rounds=20), best.p_value)
        for simulation, own in starts
    ]
    return max(options, key=lambda c: c.total_gain)


def _begun_anew(problem: Problem, fit: JointFit) -> Simulation:
    """Return a fit's simulation with a first tissue of the trials without what is latent in them."""
    still = [
        replace(
            t, force_mn=t.force_mn - fit.simulation.whole_force_mn(t, o, c) + fit.simulation.force_mn(t, o)
        )
        for t, o, c in zip(problem.trials, fit.own, fit.latents, strict=True)
    ]
    return replace(fit.simulation, tissue=start_tissue(still))


def _spectrum_for(band: Band, seen: Look) -> Spectrum:
    slow, quick, _ = seen.spectra
    return quick if band.lower_hz >= QUICK_ABOVE_HZ else slow


def _latent_candidate(mechanism: Mechanism, fit: JointFit, refitted: JointFit, p_value: float) -> Candidate:
    """Make a candidate whose gain is charged 2 for every coefficient that each trial was free to choose."""
    more = np.array([len(b) - len(a) for a, b in zip(fit.latents, refitted.latents, strict=True)])
    return Candidate(mechanism, refitted, fit.heldout_cost - refitted.heldout_cost - 2.0 * more, p_value)


def hum_candidate(problem: Problem, fit: JointFit) -> Candidate | None:
    """Return hum of the mains, if any line stands out of its neighbourhood over all trials."""
    if any(a.mechanism.name == "mains_hum" for a in fit.simulation.additions):
        return None
    rate = problem.common_rate_hz
    grid = mains_lines(rate) if rate is not None else np.zeros(0)
    if rate is None or not len(grid):
        return None
    residuals = [problem.full_residual(fit, j) for j in range(len(problem.trials))]
    power = np.array([line_power(r, rate, grid) for r in residuals])
    p = line_p_value(power, grid)
    k = int(np.argmin(p))
    if strict(float(p[k])) > LEVEL:
        return None
    k = int(np.argmax(power.sum(axis=0)))
    addition, gain = hum_addition(library()["mains_hum"], float(grid[k]), problem.trials, residuals)
    refitted = refit_added(problem, fit, addition, rounds=3)
    return Candidate(library()["mains_hum"], refitted, gain - 4.0, float(max(p[k], 1e-12)))


def event_candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return the events that stand out of their own trials, refitted at each trial's own time."""
    found: list[Candidate] = []
    # steps look alike: what shows that there are any does not say which
    p = min((seen.p_of[scan.mechanism.name] for scan in seen.scans), default=1.0)
    if p > LEVEL:
        return found
    for scan in seen.scans:
        mechanism = scan.mechanism
        times = _event_times(problem, fit, scan)
        known: dict[str, float] = {}
        refitted = None
        while len(times) > len(known):
            known = times
            refitted = refit_added(problem, fit, event_addition(mechanism, known), rounds=12)
            # events bend what is shared, and so hide others: those stand out once the first are taken care of
            again = scan_events(mechanism, problem.trials, [w.tight for w in problem.whiteners], refitted)
            times = {**_event_times(problem, refitted, again), **known}
        if refitted is not None:
            found.append(_latent_candidate(mechanism, fit, refitted, p))
    return found


def _event_times(problem: Problem, fit: JointFit, scan: EventScan) -> dict[str, float]:
    """Return the time of the event (s) by label, of the trials in which a step stands out of noise."""
    score, at = scan.strongest()
    times = {}
    for j, trial in enumerate(problem.trials):
        size = score[j] if scan.mechanism.one_sided else abs(score[j])
        if size >= scan.width * np.sqrt(by_chance(len(scan.scores[j])) + EVENT_MUST_EXCEED):
            times[trial.label] = refine_time(
                scan.mechanism, problem.trials, problem.whiteners[j], fit, j, float(at[j])
            )
    return times


def _same_event(fit: JointFit, candidate: Candidate) -> bool:
    """Tell whether an event is what another law for the same event, named before, left over."""
    new = candidate.fit.simulation.additions[-1].latent
    if not isinstance(new, EventAt):
        return False
    for a in fit.simulation.additions:
        if isinstance(a.latent, EventAt):
            shared = [abs(t - a.latent.times_s[k]) for k, t in new.times_s.items() if k in a.latent.times_s]
            if shared and float(np.median(shared)) < SAME_EVENT_S:
                return True
    return False
