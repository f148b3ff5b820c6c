"""The figures of a proof over all its cases: rates with their counts, by kind and by mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import mean, median

from rig.proof.probability import expected_calibration_error, set_size, statements
from rig.proof.recovery import BIASED, sizes, tissue_bias
from rig.proof.scores import (
    Outcome,
    all_named,
    all_within,
    first_right,
    is_alarm,
    is_right,
    location_overlap,
    rate,
    right_phase,
    spurious,
    wrong_and_alone,
    wrong_library_name,
)


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table: what is measured, its value, and over how many."""

    what: str
    value: str
    over: int


@dataclass(frozen=True, slots=True)
class ByName:
    """What became of one mechanism concealed alone: counts; ``sized``: of which ``covered`` hold the truth."""

    name: str
    cases: int
    detected: int
    first: int
    within: int
    wrong_and_alone: int
    sized: int
    covered: int


def by_name(outcomes: Sequence[Outcome]) -> list[ByName]:
    """Return the single effects by their names."""
    single = _of_kind(outcomes, "single")
    found = []
    for name in sorted({e.name for o in single for e in o.truth.effects}):
        of = [o for o in single if name in o.truth.names]
        detected, first, within, misled = (
            sum(map(test, of)) for test in (is_alarm, first_right, all_within, wrong_and_alone)
        )
        covered, sized = rate(r.covered for o in of for r in sizes(o))
        found.append(ByName(name, len(of), detected, first, within, misled, sized, covered))
    return found


def figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Return every figure that these cases allow."""
    single, outside = _of_kind(outcomes, "single"), _of_kind(outcomes, "outside")
    found = [
        _rate("false alarms on nulls", _of_kind(outcomes, "null"), is_alarm),
        _rate("single: first name right", single, first_right),
        _rate("single: truth within the named set", single, all_within),
        _rate("single: wrong and alone", single, wrong_and_alone),
        _rate("single: nothing named beside it", single, lambda o: not spurious(o)),
    ]
    for kind in ("pair", "triple"):
        of = _of_kind(outcomes, kind)
        found.append(_rate(f"{kind}s: all named", of, all_named))
        found.append(_rate(f"{kind}s: all named and nothing else", of, is_right))
    found += [
        _rate("outside the library: unknown", outside, lambda o: o.verdict == "unknown"),
        _rate("outside the library: right phase", outside, right_phase),
        _rate("outside the library: a wrong library name", outside, wrong_library_name),
        _rate("absorbed: nothing forced, or named", _of_kind(outcomes, "absorbed"), _not_forced),
    ]
    named = [o for o in outcomes if o.named_sets and o.truth.effects]
    found.append(_mean("mean size of the named set", [len(s) for o in named for s in o.named_sets]))
    overlaps = [location_overlap(o) for o in outcomes if o.truth.effects]
    found.append(
        _mean("share of the reported mismatch in the right phases", [x for x in overlaps if x is not None])
    )
    more = [*_recovery(named), *_probability(outcomes), *_tissue(outcomes), *_heldout(outcomes)]
    return [f for f in [*found, *more] if f.over]


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


def _recovery(named: Sequence[Outcome]) -> list[Figure]:
    found = [r for o in named for r in sizes(o)]
    if not found:
        return []
    covered, n = rate(r.covered for r in found)
    error = median(r.relative_error for r in found)
    return [
        Figure("sizes of named mechanisms: median error", f"{error:.1%}", n),
        Figure(
            "their intervals (1.96 standard errors) hold the truth",
            f"{covered} of {n} ({covered / n:.0%})",
            n,
        ),
    ]


def _probability(outcomes: Sequence[Outcome]) -> list[Figure]:
    said = [s for o in outcomes for s in statements(o)]
    if not said:
        return []
    held, n = rate(s.held for s in said)
    names = sum(len(s.probabilities) - 1 for s in said)
    return [
        Figure("probability: expected calibration error", f"{expected_calibration_error(said):.3f}", names),
        Figure("probability: 90 % sets hold the truth", f"{held} of {n} ({held / n:.0%})", n),
        Figure("probability: names in a 90 % set", f"{set_size(said):.2f}", n),
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
