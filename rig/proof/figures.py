"""The figures of a proof over all its cases: rates with their counts, by kind and by strength."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import mean, median

from rig.proof.scores import (
    BIASED,
    NO_MISMATCH,
    Outcome,
    all_named,
    all_within,
    decibel,
    first_right,
    is_alarm,
    location_overlap,
    matched_strength,
    rate,
    recoveries,
    right_phase,
    spurious,
    strength_at,
    tissue_bias,
    wrong_and_alone,
)

STRONG = 20.0
"""From this strength on an effect is to be named."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table: what is measured, its value, and over how many."""

    what: str
    value: str
    over: int


@dataclass(frozen=True, slots=True)
class Rung:
    """The single effects of one rung of the ladder of strength: counts."""

    rung: float
    cases: int
    detected: int
    first: int
    within: int
    wrong_and_alone: int


def ladder(outcomes: Sequence[Outcome]) -> list[Rung]:
    """Return the single effects by rung, weakest first."""
    single = [o for o in outcomes if o.truth.kind == "single"]
    found = []
    for rung in sorted({o.truth.rung for o in single}):
        of = [o for o in single if o.truth.rung == rung]
        counts = [sum(map(test, of)) for test in (is_alarm, first_right, all_within, wrong_and_alone)]
        found.append(Rung(rung, len(of), *counts))
    return found


def figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Return every figure that these cases allow."""
    nulls = _of_kind(outcomes, "null")
    strong = [o for o in _of_kind(outcomes, "single") if o.truth.rung >= STRONG]
    found = [
        _rate("false alarms on nulls", nulls, is_alarm),
        _rate("single, strength 20 and more: first name right", strong, first_right),
        _rate("single, strength 20 and more: truth within the named set", strong, all_within),
        _rate("single, any strength: wrong and alone", _of_kind(outcomes, "single"), wrong_and_alone),
        _rate("pairs: both named", _of_kind(outcomes, "pair"), all_named),
        _rate(
            "outside the library: unknown", _of_kind(outcomes, "outside"), lambda o: o.verdict == "unknown"
        ),
        _rate("outside the library: right phase", _of_kind(outcomes, "outside"), right_phase),
        _rate("absorbed: nothing forced, or named", _of_kind(outcomes, "absorbed"), _not_forced),
    ]
    named = [o for o in outcomes if o.named_sets and o.truth.effects]
    found.append(_mean("mean size of the named set", [len(s) for o in named for s in o.named_sets]))
    found.append(_mean("mechanisms named beside the truth, a case", [float(spurious(o)) for o in named]))
    overlaps = [location_overlap(o) for o in outcomes if o.truth.effects]
    found.append(
        _mean("share of the reported mismatch in the right phases", [x for x in overlaps if x is not None])
    )
    return [
        f
        for f in [*found, *_recovery(named), *_tissue(outcomes), *_heldout(outcomes), *_power(outcomes)]
        if f.over
    ]


def _of_kind(outcomes: Iterable[Outcome], kind: str) -> list[Outcome]:
    return [o for o in outcomes if o.truth.kind == kind]


def _not_forced(outcome: Outcome) -> bool:
    said = {str(n["name"]) for n in outcome.report.get("not_identifiable") or []}
    return all_within(outcome) or (not outcome.named_sets and outcome.truth.names <= said)


def _rate(what: str, outcomes: Sequence[Outcome], test: Callable[[Outcome], bool]) -> Figure:
    hits, n = rate(map(test, outcomes))
    return Figure(what, f"{hits} of {n} ({hits / n:.1%})" if n else "", n)


def _mean(what: str, values: Sequence[float]) -> Figure:
    return Figure(what, f"{mean(values):.2f}" if values else "", len(values))


def _recovery(outcomes: Sequence[Outcome]) -> list[Figure]:
    found = [r for o in outcomes for r in recoveries(o)]
    if not found:
        return []
    covered, n = rate(r.covered for r in found)
    return [
        Figure(
            "parameters of named mechanisms: median error",
            f"{median(r.relative_error for r in found):.1%}",
            n,
        ),
        Figure(
            "their intervals (1.96 standard errors) hold the truth",
            f"{covered} of {n} ({covered / n:.0%})",
            n,
        ),
    ]


def _tissue(outcomes: Sequence[Outcome]) -> list[Figure]:
    biased = [
        (tissue_bias(o, "baseline"), tissue_bias(o, "improved"))
        for o in outcomes
        if o.verdict == "named" and tissue_bias(o, "baseline") > BIASED
    ]
    if not biased:
        return []
    before, after = (median(b[i] for b in biased) for i in (0, 1))
    ratio = median(b / max(a, 1e-6) for b, a in biased)
    return [
        Figure("tissue's largest bias where named, before", f"{before:.1%}", len(biased)),
        Figure("tissue's largest bias where named, after", f"{after:.2%}", len(biased)),
        Figure("tissue's bias, median reduction", f"{ratio:.1f} times", len(biased)),
    ]


def _heldout(outcomes: Sequence[Outcome]) -> list[Figure]:
    named = [o.report["heldout"] for o in outcomes if o.verdict == "named"]
    if not named:
        return []
    before, after = (median(float(h[f"{w}_chi2"]) for h in named) for w in ("baseline", "improved"))
    close, n = rate(float(h["improved_chi2"]) <= 1.05 for h in named)
    return [
        Figure("held-out chi2 where named, median before", f"{before:.3f}", n),
        Figure("held-out chi2 where named, median after", f"{after:.4f}", n),
        Figure("held-out chi2 where named, within 5 % of the floor", f"{close} of {n}", n),
    ]


def _power(outcomes: Sequence[Outcome]) -> list[Figure]:
    single = [o for o in outcomes if o.truth.kind == "single"]
    if not single:
        return []
    strengths = [o.truth.effects[0].strength for o in single]
    nulls = _of_kind(outcomes, "null")
    level = min(max(sum(map(is_alarm, nulls)) / len(nulls), 0.01), 0.2) if nulls else 0.05
    found = []
    for power in (0.5, 0.9):
        reached = strength_at(power, strengths, [o.verdict != NO_MISMATCH for o in single])
        if reached is None:
            continue
        ideal = matched_strength(power, level)
        found.append(
            Figure(
                f"strength detected at {power:.0%}, over the matched test's at {level:.0%} false alarms",
                f"{reached:.1f} over {ideal:.1f}: {decibel(reached / ideal):.1f} dB",
                len(single),
            )
        )
    return found
