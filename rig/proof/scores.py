"""How right a diagnosis was, once the truth is opened: functions of what was concealed and what was said."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from analysis.errors import BadInputError

NO_MISMATCH = "no_mismatch"
TISSUE = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
COVERED_SIGMA = 1.96
BIASED = 0.02
"""Relative bias of the tissue from which on it is counted as biased by an effect."""


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
    """One case as it was sealed; ``tissue`` holds the five constants of the baseline."""

    number: int
    kind: str
    rung: float
    noise: str
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
        return Truth(
            int(data["number"]), str(data["kind"]), float(data["rung"]), str(data["noise"]), effects, tissue
        )
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


@dataclass(frozen=True, slots=True)
class Recovery:
    """One parameter of a rightly named mechanism; ``covered``: the truth lies within 1.96 standard errors."""

    mechanism: str
    parameter: str
    truth: float
    value: float
    se: float

    @property
    def relative_error(self) -> float:
        """|value - truth| over |truth|."""
        return abs(self.value - self.truth) / abs(self.truth) if self.truth else abs(self.value)

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.value - self.truth) <= COVERED_SIGMA * self.se


def recoveries(outcome: Outcome) -> list[Recovery]:
    """Return the parameters of every rightly named mechanism that both truth and report have."""
    found = []
    for effect in outcome.truth.effects:
        for mechanism in outcome.report["mechanisms"]:
            if mechanism["name"] != effect.name:
                continue
            for name, said in mechanism["parameters"].items():
                if name in effect.parameters and said.get("se") is not None:
                    value, se = float(said["value"]), float(said["se"])
                    found.append(Recovery(effect.name, name, effect.parameters[name], value, se))
    return found


def tissue_bias(outcome: Outcome, which: str) -> float:
    """Return the largest relative error over the tissue's five constants, of ``baseline`` or ``improved``."""
    said = outcome.report[f"{which}_parameters"]
    truth = outcome.truth.tissue
    return max(abs(float(said[name]["value"]) - truth[name]) / truth[name] for name in TISSUE if name in said)


def matched_power(strength: float, false_alarm_rate: float) -> float:
    """Return the chance that a test which knows the effect's shape detects it: Phi(strength - z)."""
    from scipy.special import ndtr, ndtri

    return float(ndtr(strength - ndtri(1 - false_alarm_rate)))


def matched_strength(power: float, false_alarm_rate: float) -> float:
    """Return the strength at which the matched test reaches a power."""
    from scipy.special import ndtri

    return float(ndtri(power) + ndtri(1 - false_alarm_rate))


def strength_at(power: float, strengths: Sequence[float], detected: Sequence[bool]) -> float | None:
    """Return the strength at which a detection rate is reached, by a probit over ln(strength).

    None where everything or nothing was detected, so that no curve can be told.
    """
    import numpy as np
    from scipy.optimize import minimize
    from scipy.special import log_ndtr, ndtri

    x, y = np.log(np.asarray(strengths, dtype=float)), np.asarray(detected, dtype=bool)
    if y.all() or not y.any():
        return None

    def cost(p: Any) -> float:
        z = (x - p[0]) / np.exp(np.clip(p[1], -5, 3))
        # a weak pull to a width of 0.4, so that separated data do not make the curve a step
        return float(-log_ndtr(np.where(y, z, -z)).sum() + 0.5 * (p[1] + 0.9) ** 2)

    best = minimize(cost, [float(x.mean()), -0.9], method="Nelder-Mead")
    return float(np.exp(best.x[0] + np.exp(np.clip(best.x[1], -5, 3)) * ndtri(power)))


def decibel(ratio: float) -> float:
    """Return a ratio of strengths in dB."""
    return 20 * math.log10(ratio)


def rate(hits: Iterable[bool]) -> tuple[int, int]:
    """Return how many of how many."""
    listed = list(hits)
    return sum(listed), len(listed)
