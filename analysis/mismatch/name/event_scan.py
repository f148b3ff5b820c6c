"""What all trials say of steps that come once in each: every time is weighed, sizes and shares at their best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp
from scipy.stats import chi2

from analysis.mismatch.evidence.marginal import log_ratio
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import KEPT
from analysis.mismatch.model.effects import own_effects, simulate
from analysis.mismatch.name.events import EVENTS, Event, EventScan, event_shape, one_unit
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

MOST_TIMES = 70
SHARES = np.array([0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 0.999])
SIZES = np.geomspace(3.0, 3e4, 17)
"""Sizes of a step, in noise standard deviations of a typical trial."""
UNKNOWN_SIZE_AND_SHARE = 3.0
"""What two numbers fitted to some 20 trials are worth, in nats: half of ln 20 each."""
REFINED = 2
PROMISING = 12.0
"""Chi2 of the best of some times without which no closer look is taken: noise reaches it once in fifty trials."""
JUMPS, RUNS = 4, (1, 2, 4)
"""Edges that are looked at besides in a trial, most striking first, and over how many cells one may go."""
ONCE_IN = 50
"""Trials in one of which noise has such an edge."""
FINER = (0.8, 0.2, 0.05, 0.012)
"""Widths, in gaps between times, of the looks that are taken about the best."""
FAR_APART = 20.0
"""Ratio of times beyond which an event says little of one that takes longer: all times are looked at with both."""
STEP = 0.01
"""Of a unit: of a finite difference. Where contact ends a force is a line over a fraction of a micron only."""
AFTER = 0.03
"""Share of a phase that must follow a step."""


def at_rest(trial: CellTrial, phases: Sequence[str], lasts_s: float = 0.0) -> FloatArray:
    """Return from when to when (P, 2) the middle of a step that lasts so long may lie in each phase, s.

    It must be seen to stay: what goes on at the very end of a phase is one of the motion that follows.
    """
    spans = []
    for name in phases:
        cells = np.flatnonzero(trial.in_phase(name))
        if len(cells) > 4:
            first, last = trial.time_s[cells[[2, -3]]]
            spans.append((first + 0.5 * lasts_s, last - max(AFTER * (last - first), 0.5 * lasts_s)))
    return np.array(spans).reshape(-1, 2)


def middles(event: Event, trial: CellTrial, rise_s: float) -> FloatArray:
    """Return from when to when (P, 2) the middle of an event may lie in each phase, s.

    What returns may begin in a motion, and is seen to be over. What swells begins at rest, and may go on.
    """
    if event.returns:
        return at_rest(trial, event.phases)
    if event.goes_on:
        return at_rest(trial, event.phases) + 0.5 * rise_s
    return at_rest(trial, event.phases, rise_s)


def comes_with_motion(fit: StudyFit, scan: EventScan) -> bool:
    """Return whether most trials that have an event have it at an end of rest: a motion brought it, or takes it on."""
    there = np.flatnonzero(scan.probability > 0.5)
    ends = []
    for j in there:
        trial, time_s = fit.trials[j], scan.times_s[j]
        spans = middles(scan.event, trial, scan.event.rises_s[int(scan.forms[j])])
        cell_s = trial.widths_s[np.argmin(np.abs(trial.time_s - time_s))]
        ends.append(not inside(spans + cell_s * np.array([1.0, -1.0]), time_s[None])[0])
    return bool(ends) and float(np.mean(ends)) > KEPT


def far_apart(rises_s: Sequence[float]) -> list[int]:
    """Return which forms all times are looked at with: the first, and each that takes so much longer than the last."""
    found = [0]
    for form, rise_s in enumerate(rises_s):
        if rise_s >= FAR_APART * rises_s[found[-1]]:
            found.append(form)
    return found


def inside(spans: FloatArray, times: FloatArray) -> NDArray[np.bool_]:
    """Return which of some times (T,) lie in one of the spans (P, 2)."""
    lies = (times[:, None] >= spans[:, 0]) & (times[:, None] < spans[:, 1])
    return np.asarray(lies.any(axis=1), dtype=np.bool_)


def within(spans: FloatArray, times: FloatArray) -> FloatArray:
    """Return those of some times (T,) that lie in one of the spans (P, 2)."""
    return times[inside(spans, times)]


def candidate_times(trial: CellTrial, phases: Sequence[str]) -> FloatArray:
    """Return times at rest in contact where a step may lie, evenly spread, no finer than the cells."""
    spans = at_rest(trial, phases)
    every = within(spans, trial.time_s)
    total = float(np.diff(spans).sum())
    times, last = [], -np.inf
    for t in every:
        if t - last >= total / MOST_TIMES:
            times.append(float(t))
            last = float(t)
    return np.array(times)


def scan_events(fit: StudyFit, events: Sequence[Event] = EVENTS) -> list[EventScan]:
    """Weigh each kind of step in every trial at every time, sizes and shares marginalised or at their best."""
    per_trial: dict[str, list[tuple[FloatArray, FloatArray, FloatArray]]] = {e.name: [] for e in events}
    for j, trial in enumerate(fit.trials):
        for event in events:
            pressed = trial.kind == "ramp_hold_retract"
            times = candidate_times(trial, event.phases) if pressed else np.zeros(0)
            if not len(times):
                per_trial[event.name].append((times, times, times))  # nothing pressed
                continue
            per_trial[event.name].append(_refined(fit, j, event, times))
    return [_weigh(e, per_trial[e.name]) for e in events]


def _refined(
    fit: StudyFit, j: int, event: Event, times: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places (3, G: time, form and gap), norms and weights (2, G), scores (G,), more densely about the best.

    All times are looked at with forms far apart, the others about the best time: which one it is shows where times lie
    no further apart than a step takes.
    """
    gap = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    edges = edges_s(fit, j, event.phases)
    # a fine time stands for a smaller part of the trial than a coarse one
    fine_weight = 0.3 / len(event.rises_s)
    apart = far_apart(event.rises_s)
    weight = np.append(np.full(len(times), 1.0 / len(apart)), np.full(len(edges), fine_weight * FINER[1]))
    weight = np.tile(weight, len(apart))
    times = np.append(times, edges)
    gaps = gaps_mm(fit, j, event, times)
    places = np.hstack([np.vstack([times, np.full(len(times), form), gaps]) for form in apart])
    a, c = np.hstack([_scores(fit, j, event, times, form, gaps) for form in apart])
    promising = float(np.max(c**2 / np.maximum(a, 1e-12))) > PROMISING
    spans = [middles(event, fit.trials[j], rise_s) for rise_s in event.rises_s] if promising else []
    for width in FINER if promising else ():
        best = places[:, best_of(places[1], c**2 / np.maximum(a, 1e-12), REFINED if width > 0.1 else 1)]
        forms = range(len(event.rises_s)) if width > FINER[-1] else np.unique(best[1].astype(int))
        about = np.unique(np.concatenate([b + gap * width * np.linspace(-1.0, 1.0, 6) for b in best[0]]))
        for form in forms:
            fine = within(spans[form], about)
            gaps = gaps_mm(fit, j, event, fine)
            fine_a, fine_c = _scores(fit, j, event, fine, form, gaps)
            places = np.hstack([places, np.vstack([fine, np.full(len(fine), form), gaps])])
            weight = np.concatenate([weight, np.full(len(fine), fine_weight * width)])
            a, c = np.concatenate([a, fine_a]), np.concatenate([c, fine_c])
    return places, np.vstack([a, weight]), c


def best_of(forms: FloatArray, gains: FloatArray, number: int) -> NDArray[np.intp]:
    """Return where (K,) the best of some places (G,) stand: ``number`` of them, of as many forms as may be."""
    in_order = np.argsort(-gains)
    first = np.sort(np.unique(forms[in_order], return_index=True)[1])
    rest = np.delete(np.arange(len(in_order)), first)
    return np.asarray(in_order[np.concatenate([first, rest])[:number]])


def edges_s(fit: StudyFit, j: int, phases: Sequence[str]) -> FloatArray:
    """Return the times at rest (K,) at which a trial's whitened residual jumps further than noise alone would, s.

    Beside noise that is slow and large a step shows by its edge only, within a few cells, and a time further away has
    nothing of it.
    """
    trial, left = fit.trials[j], fit.projectors[j].residual
    times = trial.time_s[trial.fitted]
    jumps = np.max([np.convolve(left, np.ones(n))[n - 1 :] ** 2 / n for n in RUNS], axis=0)
    jumps[~inside(at_rest(trial, phases), times)] = 0.0
    least = chi2.isf(1.0 / (ONCE_IN * len(RUNS) * len(left)), 1)
    found: list[float] = []
    while len(found) < JUMPS and jumps.max() > least:
        k = int(np.argmax(jumps))
        found.append(float(times[k]))
        jumps[max(k - RUNS[-1], 0) : k + RUNS[-1] + 1] = 0.0
    return np.array(found)


def _scores(
    fit: StudyFit, j: int, event: Event, times: FloatArray, form: int, gaps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return squared norm and score (G,) of a unit step at each time; ``gaps`` (G,) are by how much skin left, mm.

    Where skin has left the punch a step by one unit shows nothing: it is by the gap and a unit that it left.
    """
    trial, state = fit.trials[j], fit.states[j]
    own = own_effects(state)
    base = simulate(trial, state, fit.shared, own)
    acts, rise_s = event.acts, event.rises_s[form]
    unit = event.unit * one_unit(event, trial, base - state.offset_mn)
    shapes = np.array([event_shape(event, trial, float(time_s), rise_s) for time_s in times])
    shapes = shapes.reshape(len(times), len(base))
    # where skin has left the punch it is since then where it is now
    left = (gaps > 0.0)[:, None]
    does = np.where(left, (gaps[:, None] + unit) * (1.0 - shapes), STEP * unit * shapes)
    there = {**own, acts: own.get(acts, 0.0) + does}
    columns = ((simulate(trial, state, fit.shared, there) - base) / np.where(left, 1.0, STEP)).T
    projector = fit.projectors[j]
    white = projector(columns)
    scores = projector.residual @ white
    return np.einsum("nk,nk->k", white, white), np.where(gaps > 0.0, np.maximum(scores, 0.0), scores)


def gaps_mm(fit: StudyFit, j: int, event: Event, times: FloatArray) -> FloatArray:
    """Return how far (G,) the skin is from a punch that dwells, where an event at such times took it away, mm."""
    trial, state = fit.trials[j], fit.states[j]
    dwell = trial.in_phase("dwell")
    if event.acts != "surface" or event.returns or not np.any(dwell):
        return np.zeros(len(times))
    surface = own_effects(replace(state, rhythms=())).get("surface", np.zeros(len(dwell)))
    gap = float(np.min((state.z0_mm - surface - trial.position_mm)[dwell]))
    inside = (times >= trial.time_s[dwell][0]) & (times <= trial.time_s[dwell][-1])
    return np.where(inside, max(gap, 0.0), 0.0)


def _log_ratio_of_size(a: FloatArray, c: FloatArray, size: float, one_sided: bool) -> FloatArray:
    """Return ln of the marginal likelihood ratio (G,) of a step whose size is normal (or half normal) about zero."""
    v = size**2
    found = log_ratio(a, c**2, v)
    if one_sided:
        found = found + np.log(2.0) + log_ndtr(c * size / np.sqrt(1.0 + v * a))
    return found


def _weigh(event: Event, per_trial: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> EventScan:
    n = len(per_trial)
    norms = [norm for _, a, _ in per_trial if a.size and (norm := float(np.median(a[0]))) > 0.0]
    nothing = EventScan(
        event, -np.inf, 0.0, 0.0, np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    )
    if not norms:
        return nothing
    typical = 1.0 / np.sqrt(float(np.median(norms)))
    best = nothing
    for strength in SIZES:
        size = float(strength) * typical
        ratios = np.zeros(n)
        for j, (times, a, c) in enumerate(per_trial):
            if times.size:
                w = a[1]
                ratios[j] = logsumexp(_log_ratio_of_size(a[0], c, size, event.one_sided), b=w / w.sum())
        for share in SHARES:
            by_trial = np.logaddexp(np.log1p(-share), np.log(share) + ratios)
            if float(by_trial.sum()) > best.evidence:
                probability = np.exp(np.log(share) + ratios - by_trial)
                best = replace(
                    nothing,
                    evidence=float(by_trial.sum()),
                    share=float(share),
                    size=size,
                    probability=probability,
                )
    most_probable, coefficients = np.zeros((3, n)), np.zeros(n)
    for j, (times, a, c) in enumerate(per_trial):
        if times.size:
            k = int(np.argmax(_log_ratio_of_size(a[0], c, best.size, event.one_sided)))
            most_probable[:, j] = times[:, k]
            coefficients[j] = event.unit * c[k] / (a[0][k] + 1.0 / best.size**2)
            if times[2, k] > 0.0:
                coefficients[j] = -(times[2, k] + coefficients[j])
    return replace(
        best,
        evidence=best.evidence - UNKNOWN_SIZE_AND_SHARE,
        size=best.size * event.unit,
        times_s=most_probable[0],
        forms=most_probable[1],
        gaps_mm=most_probable[2],
        coefficients=coefficients,
    )
