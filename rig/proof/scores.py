"""How right a diagnosis was, once the truth is opened: functions of what was concealed and what was said."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from analysis.errors import BadInputError

NO_MISMATCH = "no_mismatch"
EXPECTED = {"null": ("no_mismatch",), "outside": ("unknown",)}
"""The right verdicts on a kind of case, where they are others than `named` and `one_of`."""


@dataclass(frozen=True, slots=True)
class Effect:
    """What was concealed; ``in_library``: whether the library has it, ``phases``: where it shows."""

    name: str
    in_library: bool
    parameters: Mapping[str, float]
    phases: tuple[str, ...]
    strength: float


@dataclass(frozen=True, slots=True)
class Truth:
    """One case as it was sealed; ``tissue``: the baseline's five constants, geometric means over its trials."""

    number: int
    kind: str
    noise: str
    skin: str
    effects: tuple[Effect, ...]
    tissue: Mapping[str, float]

    @property
    def names(self) -> frozenset[str]:
        """Names of what was concealed."""
        return frozenset(e.name for e in self.effects)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One case opened: the truth and the report (formats.md, section 4) on it."""

    truth: Truth
    report: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """The report's verdict."""
        return str(self.report["verdict"])

    @property
    def named_sets(self) -> list[tuple[str, ...]]:
        """Each mechanism's name with its alternatives behind it, in the report's order."""
        return [(str(m["name"]), *map(str, m["alternatives"])) for m in self.report["mechanisms"]]


def read_truth(data: Mapping[str, Any]) -> Truth:
    """Read one sealed case; BadInputError where it is none."""
    try:
        effects = tuple(
            Effect(
                str(e["name"]),
                bool(e["in_library"]),
                {str(k): float(v) for k, v in e["parameters"].items()},
                tuple(e["phases"]),
                float(e["strength"]),
            )
            for e in data["hidden"]
        )
        tissue = {str(k): float(v) for k, v in data["tissue"].items()}
        number, (kind, noise, skin) = int(data["number"]), (str(data[k]) for k in ("kind", "noise", "skin"))
        return Truth(number, kind, noise, skin, effects, tissue)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"sealed truth: not a concealed case ({error}); draw the cases again") from error


def is_alarm(outcome: Outcome) -> bool:
    """Whether anything was said to differ."""
    return outcome.verdict != NO_MISMATCH


def first_right(outcome: Outcome) -> bool:
    """Whether the first named is one of the concealed."""
    sets = outcome.named_sets
    return bool(sets) and sets[0][0] in outcome.truth.names


def all_within(outcome: Outcome) -> bool:
    """Whether every concealed effect is among the named or their alternatives."""
    return outcome.truth.names <= {name for names in outcome.named_sets for name in names}


def all_named(outcome: Outcome) -> bool:
    """Whether every concealed effect is named, each by a mechanism of its own (itself or an alternative)."""
    return _matched([set(s) for s in outcome.named_sets], sorted(outcome.truth.names))


def _matched(sets: Sequence[set[str]], wanted: Sequence[str]) -> bool:
    if not wanted:
        return True
    return any(
        wanted[0] in names and _matched([*sets[:i], *sets[i + 1 :]], wanted[1:])
        for i, names in enumerate(sets)
    )


def wrong_and_alone(outcome: Outcome) -> bool:
    """Whether the first mechanism is wrong and has no alternative: the tool misled its user."""
    sets = outcome.named_sets
    return (
        bool(sets)
        and outcome.verdict == "named"
        and len(sets[0]) == 1
        and sets[0][0] not in outcome.truth.names
    )


def spurious(outcome: Outcome) -> int:
    """Number of mechanisms that were named beside what is there."""
    return sum(not outcome.truth.names & set(names) for names in outcome.named_sets)


def right_phase(outcome: Outcome) -> bool:
    """Whether the largest share of the mismatch was found in a phase in which something concealed shows."""
    found = outcome.report.get("mismatch") or []
    if not found:
        return False
    largest = max(found, key=lambda m: float(m["share_of_mismatch"]))
    return any(str(largest["phase"]) in e.phases for e in outcome.truth.effects)


def location_overlap(outcome: Outcome) -> float | None:
    """Share of the reported mismatch in phases in which something concealed shows; None: none reported."""
    found = outcome.report.get("mismatch") or []
    total = sum(float(m["share_of_mismatch"]) for m in found)
    if total <= 0:
        return None
    phases = {p for e in outcome.truth.effects for p in e.phases}
    return sum(float(m["share_of_mismatch"]) for m in found if m["phase"] in phases) / total


def wrong_library_name(outcome: Outcome) -> bool:
    """Whether a mechanism is named whose set holds nothing that is there."""
    return spurious(outcome) > 0


def is_right(outcome: Outcome) -> bool:
    """Whether a case came out as it should: the right verdict, all that is there named, and nothing else.

    What the baseline can absorb (``absorbed``) need not be named, under any verdict.
    """
    kind = outcome.truth.kind
    if wrong_library_name(outcome):
        return False
    if kind == "absorbed":
        return all_within(outcome) or not outcome.named_sets
    right_verdict = outcome.verdict in EXPECTED.get(kind, ("named", "one_of"))
    return right_verdict and (kind in EXPECTED or all_named(outcome))


def rate(hits: Iterable[bool]) -> tuple[int, int]:
    """Return how many of how many."""
    listed = list(hits)
    return sum(listed), len(listed)
