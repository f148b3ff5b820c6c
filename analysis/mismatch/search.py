"""Name what was left out: significant candidates are fitted for real, the best held-out gain is added, and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import t as student_t

from analysis.mismatch.events import (
    EventAt,
    EventScan,
    event_addition,
    event_mechanisms,
    event_p_value,
    refine_time,
    scan_events,
)
from analysis.mismatch.joint import Addition, JointFit, Simulation, fit_jointly
from analysis.mismatch.noise import Whitener
from analysis.mismatch.oscillations import (
    Band,
    Spectrum,
    bands,
    hum_addition,
    line_p_value,
    line_power,
    mains_lines,
    oscillation_scores,
    quick_frequencies,
    quick_spectrum,
    scan_frequencies,
    smoothed,
    surface_addition,
    surface_spectrum,
)
from analysis.mismatch.profiles import OUTSIDE, bins_of, profile, repeatable_energy
from analysis.mismatch.signatures import FEW_TRIALS, Probe, Signatures, accumulate
from analysis.mismatch.signflip import Family, flip_test
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

LEVEL = 0.01
LAWS_SHARE, BINS_SHARE, SPECTRA_SHARE, EVENTS_SHARE = 0.6, 0.15, 0.2, 0.05
REPEATS = 3
STRICT_LEVEL = 5e-4
REFITTED = 7
WORTH_REFITTING = 0.08
MOST_MECHANISMS = 4
SHARE_EXPLAINED = (0.35, 0.6, 0.8)
SMALL_SHARE = 0.10
SMALL_MUST_EXPLAIN = 0.80
EVENT_SCORE = 4.5
SAME_EVENT_S = 0.3
MOST_TRIALS = 0.6
SMALLEST_SHARE = 0.002
EXTRA_SHARE = 0.02
SINGLE_TRIAL_SHARE = 0.01
WANDERING_HZ = 0.5
QUICK_ABOVE_HZ = 4.0
FEW_CONTRIBUTE = 7.0
CONTRIBUTES = 0.03
MOST_FREEDOM = 12.0


@dataclass(frozen=True)
class Problem:
    """The trials to be explained, with the weights of their cells."""

    trials: tuple[CellTrial, ...]
    whiteners: tuple[Whitener, ...]
    white_mn: float

    def fit(self, simulation: Simulation, own: Sequence[PerTrial], rounds: int = 12) -> JointFit:
        """Fit a simulation to the trials."""
        return fit_jointly(self.trials, self.whiteners, simulation, own, rounds=rounds)

    def residual(self, fit: JointFit, j: int) -> FloatArray:
        """Return what a fit leaves of one trial's cells, (n,), mN."""
        t, o = self.trials[j], fit.own[j]
        return (
            t.force_mn - fit.simulation.force_mn(t, o) - fit.simulation.latent_columns(t, o) @ fit.latents[j]
        )

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
        for j, (trial, whitener) in enumerate(zip(self.trials, self.whiteners, strict=True)):
            r = whitener(self.residual(fit, j))
            bins = bins_of(trial, fit.own[j].z0_mm)[trial.fitted]
            size = np.maximum(np.bincount(bins, minlength=OUTSIDE + 1)[:OUTSIDE], 1)
            sums[j] = np.bincount(bins, weights=r, minlength=OUTSIDE + 1)[:OUTSIDE] / np.sqrt(size)
        return float(repeatable_energy(sums, [t.condition for t in self.trials]).sum())


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


@dataclass(frozen=True)
class Look:
    """One look at a fit's residual: what is significant in it, before anything is named.

    ``bin_p`` (2, B): p-values of the residual's bins, plain and with depth; ``p_of`` the p-value of each
    mechanism; ``best`` its best probes.
    """

    signatures: Signatures
    p_of: dict[str, float]
    best: dict[str, list[tuple[float, Probe, float]]]
    bin_p: FloatArray
    spectra: tuple[Spectrum, ...]
    spectrum_p: FloatArray
    scans: tuple[EventScan, ...]

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies that ``spectrum_p`` speaks of."""
        return np.concatenate([s.frequency_hz for s in self.spectra]) if self.spectra else np.zeros(0)

    @property
    def quiet(self) -> bool:
        """Whether nothing at all is significant."""
        return min([1.0, *self.p_of.values()]) > LEVEL and float(self.bin_p.min()) > LEVEL


def law_probes(trials: Sequence[CellTrial], present: Sequence[str]) -> list[Probe]:
    """Return the probes of every law of the library that is not in the simulation yet."""
    peak = max(float(t.force_mn.max() - t.offset_start_mn) for t in trials)
    return [
        Probe(m, values)
        for m in library().values()
        if m.form == "law" and m.name not in present and any(m.applies(t) for t in trials)
        for values in m.probe_settings(peak)
    ]


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
        quick = quick_spectrum(
            problem.trials, problem.whiteners, problem.residuals(fit), fit, quick_frequencies()
        )
        slow = surface_spectrum(problem.trials, problem.whiteners, fit, scan_frequencies())
        spectra = [slow, quick, smoothed(quick, WANDERING_HZ)]
        for spectrum in spectra:
            blocks.append(oscillation_scores(spectrum))
            sided.append(np.ones(len(spectrum.frequency_hz), dtype=bool))
        families.append(Family(sum(len(s.frequency_hz) for s in spectra), SPECTRA_SHARE))
    scans: tuple[EventScan, ...] = ()
    if skin:
        absent = [m for m in event_mechanisms() if m.name not in present]
        scans = tuple(scan_events(m, problem.trials, problem.whiteners, fit) for m in absent)
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
        for probe, p in zip(probes, few_trials_p_value(signatures), strict=True):
            p_of[probe.mechanism.name] = min(p_of[probe.mechanism.name], strict(float(p)))
    m = len(probes)
    bin_p = test.p_value[m : m + 2 * OUTSIDE].reshape(2, OUTSIDE)
    at = m + 2 * OUTSIDE
    all_spectrum_p = test.p_value[at : len(test.p_value) - len(signed)]
    for spectrum in spectra:
        spectrum_p = test.p_value[at : at + len(spectrum.frequency_hz)]
        at += len(spectrum.frequency_hz)
        for band in bands():
            inside = (spectrum.frequency_hz >= band.lower_hz) & (spectrum.frequency_hz <= band.upper_hz)
            if band.mechanism not in present and inside.any():
                p_of[band.mechanism] = min(p_of.get(band.mechanism, 1.0), float(spectrum_p[inside].min()))
    for scan in scans:
        p_of[scan.mechanism.name] = strict(event_p_value(scan))
    for scan, p in zip(signed, test.p_value[len(test.p_value) - len(signed) :], strict=True):
        p_of[scan.mechanism.name] = min(p_of[scan.mechanism.name], float(p))
    return Look(signatures, p_of, best_probes(signatures), bin_p, tuple(spectra), all_spectrum_p, scans)


def few_trials_p_value(signatures: Signatures) -> FloatArray:
    """Return p-values (M,) of probes that live in so few trials that flipping trials can't make them significant.

    The amplitude is estimated in each contributing trial; a moderated t over these, Bonferroni over such probes. It
    trusts the scores of different trials to be Gaussian about one amplitude, but takes their spread from what it is
    for all probes. Probes that most trials speak of have p-value 1 here.
    """
    norm2 = signatures.trial_norm2
    effective = norm2.sum(axis=0) ** 2 / np.maximum((norm2**2).sum(axis=0), 1e-300)
    seen = np.flatnonzero(
        (signatures.norm > 1e-4 * np.maximum(signatures.raw_norm, 1e-12)) & (effective > 2.0)
    )
    used = norm2[:, seen] > CONTRIBUTES * norm2[:, seen].max(axis=0)
    seen, used = seen[used.sum(axis=0) >= 3], used[:, used.sum(axis=0) >= 3]
    p_value = np.ones(norm2.shape[1])
    few = effective[seen] < FEW_CONTRIBUTE
    if not few.any():
        return p_value
    weight = np.where(used, norm2[:, seen], 0.0)
    score = np.where(used, signatures.trial_scores[:, seen], 0.0)
    amplitude = score.sum(axis=0) / weight.sum(axis=0)
    squares = np.divide((score - amplitude * weight) ** 2, weight, out=np.zeros_like(weight), where=used)
    freedom = used.sum(axis=0) - 1.0
    spread, freedom = moderated(squares.sum(axis=0) / freedom, freedom)
    t = amplitude * np.sqrt(weight.sum(axis=0) / spread)
    one_sided = np.array([signatures.probes[k].mechanism.one_sided for k in seen])
    tail = student_t.sf(np.where(one_sided, t, np.abs(t)), freedom)
    p_value[seen[few]] = np.minimum(1.0, 2.0 * tail * few.sum())[few]
    return p_value


def moderated(variance: FloatArray, freedom: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return variances (M,) drawn towards each other, and their degrees of freedom with what that adds.

    The prior's variance s0^2 and degrees of freedom d0 are those that make the variances s^2 scatter as they do:
    (d0 s0^2 + d s^2) / (d0 + d); Smyth, Stat. Appl. Genet. Mol. Biol. 3:3 (2004), eqs. 5 to 8. As the probes are
    not independent, d0 is kept to ``MOST_FREEDOM``, and s0^2 to no less than the white noise's 1.
    """
    e = np.log(np.maximum(variance, 1e-3)) - digamma(freedom / 2) + np.log(freedom / 2)
    excess = float(np.var(e, ddof=1) - np.mean(polygamma(1, freedom / 2))) if len(e) > 1 else 0.0
    d0 = MOST_FREEDOM
    if excess > float(polygamma(1, MOST_FREEDOM / 2)):
        d0 = 2 * float(brentq(lambda half: float(polygamma(1, half)) - excess, 1e-3, MOST_FREEDOM / 2))
    s0 = max(float(np.exp(np.mean(e) + digamma(d0 / 2) - np.log(d0 / 2))), 1.0)
    return (d0 * s0 + freedom * variance) / (d0 + freedom), d0 + freedom


def refit_with(problem: Problem, fit: JointFit, probe: Probe, amplitude: float, rounds: int = 10) -> JointFit:
    """Fit the simulation with one more law, started at the linear estimate."""
    addition = Addition(probe.mechanism, start_values(probe, amplitude))
    return refit_added(problem, fit, addition, rounds)


def refit_added(problem: Problem, fit: JointFit, addition: Addition, rounds: int = 10) -> JointFit:
    """Fit the simulation with one more addition."""
    simulation = replace(fit.simulation, additions=(*fit.simulation.additions, addition))
    return problem.fit(simulation, fit.own, rounds=rounds)


def law_candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return the significant laws, refitted."""
    best = seen.best
    significant = sorted((n for n in best if seen.p_of.get(n, 1.0) <= LEVEL), key=lambda n: -best[n][0][0])
    if not significant:
        return []
    worth = WORTH_REFITTING * best[significant[0]][0][0]
    found = []
    for name in [n for n in significant if best[n][0][0] >= worth][:REFITTED]:
        refitted = _best_refit(problem, fit, best[name])
        probe = best[name][0][1]
        found.append(
            Candidate(probe.mechanism, refitted, fit.heldout_cost - refitted.heldout_cost, seen.p_of[name])
        )
    return found


def _best_refit(problem: Problem, fit: JointFit, starts: list[tuple[float, Probe, float]]) -> JointFit:
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
        inside = (f >= band.lower_hz) & (f <= band.upper_hz)
        if 4.0 * float(power[:, inside].max(axis=1).sum()) < 0.5 * to_beat:
            continue
        centre = float(f[inside][int(np.argmax(power[:, inside].sum(axis=0)))])
        near = inside & (np.abs(np.log(f / centre)) < 0.2)
        own_hz = {
            t.label: float(f[near][int(np.argmax(row[near]))])
            for t, row in zip(problem.trials, power, strict=True)
        }
        shapes = [(1, np.inf), (3, np.inf), (1, 3.0 / centre), (3, 2.5 / centre), (1, 1.5 / centre)]
        options = []
        for harmonics, knot_s in shapes:
            addition = surface_addition(library()[band.mechanism], own_hz, harmonics, knot_s)
            refitted = refit_added(problem, fit, addition, rounds=3)
            options.append(
                _latent_candidate(library()[band.mechanism], fit, refitted, seen.p_of[band.mechanism])
            )
        found.append(max(options, key=lambda c: c.total_gain))
    return found


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
    rate = problem.trials[0].sample_rate_hz
    grid = mains_lines(rate)
    if not len(grid):
        return None
    residuals = [problem.full_residual(fit, j) for j in range(len(problem.trials))]
    power = np.array([line_power(r, rate, grid) for r in residuals])
    p = line_p_value(power, len(grid))
    k = int(np.argmin(p))
    if strict(float(p[k])) > LEVEL:
        return None
    k = int(np.argmax(power.sum(axis=0)))
    addition, gain = hum_addition(library()["mains_hum"], float(grid[k]), problem.trials, residuals)
    refitted = refit_added(problem, fit, addition, rounds=3)
    return Candidate(library()["mains_hum"], refitted, gain - 4.0, float(max(p[k], 1e-12)))


def strict(p_value: float) -> float:
    """Return a p-value that trusts noise to be near Gaussian, raised so that only a strict one is significant."""
    return min(1.0, p_value * LEVEL / STRICT_LEVEL)


def event_candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return the events that stand out of their own trials, refitted at each trial's own time."""
    found = []
    for scan in seen.scans:
        mechanism, p = scan.mechanism, seen.p_of[scan.mechanism.name]
        if p > LEVEL:
            continue
        score, at = scan.strongest()
        times = {}
        for j, trial in enumerate(problem.trials):
            wanted = score[j] >= EVENT_SCORE if mechanism.one_sided else abs(score[j]) >= EVENT_SCORE
            if wanted:
                times[trial.label] = refine_time(
                    mechanism, problem.trials, problem.whiteners[j], fit, j, float(at[j])
                )
        if not times:
            continue
        refitted = refit_added(problem, fit, event_addition(mechanism, times), rounds=4)
        found.append(_latent_candidate(mechanism, fit, refitted, p))
    return found


def candidates(problem: Problem, fit: JointFit, seen: Look) -> list[Candidate]:
    """Return everything that is significant in a fit's residual, refitted, best held-out gain first."""
    found = law_candidates(problem, fit, seen) + event_candidates(problem, fit, seen)
    found = [c for c in found if not _same_event(fit, c)]
    found += surface_candidates(problem, fit, seen, max((c.total_gain for c in found), default=0.0))
    hum = hum_candidate(problem, fit)
    if hum is not None:
        found.append(hum)
    return sorted((c for c in found if c.total_gain > 0), key=lambda c: -c.total_gain)


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


@dataclass(frozen=True)
class Named:
    """What the search arrived at: fits from the baseline on, and what was considered at each step."""

    fits: tuple[JointFit, ...]
    chosen: tuple[Candidate, ...]
    considered: tuple[tuple[Candidate, ...], ...]
    first_look: Look
    last_look: Look


def search(problem: Problem, baseline: JointFit, rng: np.random.Generator) -> Named:
    """Add mechanisms while they are significant and explain enough of what repeats; at most four."""
    fits = [baseline]
    chosen: list[Candidate] = []
    considered: list[tuple[Candidate, ...]] = []
    first = seen = look(problem, baseline, rng)
    explained = 0.0
    while len(chosen) < MOST_MECHANISMS:
        found = candidates(problem, fits[-1], seen)
        considered.append(tuple(found))
        if not found:
            break
        best = next((c for c in found if _worth_naming(problem, fits[-1], c, explained)), None)
        if best is None or best.total_gain < 0.5 * found[0].total_gain:
            break
        chosen.append(best)
        fits.append(best.fit)
        explained += best.total_gain
        seen = look(problem, best.fit, rng)
    return Named(tuple(fits), tuple(chosen), tuple(considered), first, seen)


def _worth_naming(problem: Problem, fit: JointFit, best: Candidate, explained: float) -> bool:
    """Judge whether a mechanism explains enough of what is left, the more the smaller it is beside the others.

    A rough law's remainder can look like a little of anything; only what takes most of it away earns a name. The
    more laws are there already, the more a further one has to explain: three that explain a third each of what is
    left are no physics but a fit.
    """
    if best.total_gain < SMALLEST_SHARE * explained:
        return False
    if len(problem.trials) < REPEATS:
        # what repeats can't be asked of one or two trials
        return best.total_gain > SINGLE_TRIAL_SHARE * explained
    if best.mechanism.form == "oscillation":
        # an oscillation is in every trial; what is in a few is something else's remainder
        return float(np.mean(best.gain > 0)) >= MOST_TRIALS and best.total_gain > EXTRA_SHARE * explained
    if best.mechanism.form == "event":
        return best.total_gain > EXTRA_SHARE * explained
    left = max(problem.weighed_repeatable(fit), 0.0)
    slack = 2.0 * np.sqrt(2.0 * OUTSIDE)
    share = best.total_gain / (explained + max(best.total_gain, left))
    laws = sum(a.mechanism.form == "law" for a in fit.simulation.additions)
    needed = SHARE_EXPLAINED[min(laws, 2)] if share > SMALL_SHARE else SMALL_MUST_EXPLAIN
    return bool(best.total_gain + slack >= needed * left)
