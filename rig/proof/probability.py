"""How well the probabilities of a report's names are calibrated."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rig.proof.scores import Outcome

NONE = "none of these"
SET = 0.9
_BINS = 10


@dataclass(frozen=True, slots=True)
class Statement:
    """What a report said of one mechanism: the probability of each name and of none; ``truth``: what it was."""

    probabilities: tuple[tuple[str, float], ...]
    truth: str

    @property
    def credible(self) -> tuple[str, ...]:
        """The smallest set of names that is 90 % probable, none of these among them."""
        total, names = 0.0, []
        for name, p in sorted(self.probabilities, key=lambda x: -x[1]):
            names.append(name)
            total += p
            if total >= SET - 1e-9:
                break
        return tuple(names)

    @property
    def held(self) -> bool:
        """Whether that set holds the truth."""
        return self.truth in self.credible


def statements(outcome: Outcome) -> list[Statement]:
    """Return what was said of each mechanism of a report that gives probabilities; no mechanism, none."""
    found = []
    for mechanism in outcome.report["mechanisms"]:
        if mechanism.get("probability") is None:
            continue
        of = {str(mechanism["name"]): float(mechanism["probability"])}
        of |= {str(n): float(p) for n, p in (mechanism.get("alternative_probabilities") or {}).items()}
        true = [n for n in of if n in outcome.truth.names]
        of[NONE] = max(1.0 - sum(of.values()), 0.0)
        # several may be there: the statement is about the one that it holds most probable
        found.append(Statement(tuple(of.items()), max(true, key=lambda n: of[n]) if true else NONE))
    return found


def expected_calibration_error(said: Iterable[Statement]) -> float:
    """Return the mean distance, over the statements, of a probability from how often it was right.

    Every name of every statement counts, in ten bins of equal width (Naeini, Cooper and Hauskrecht 2015). With n
    statements it is not zero even where all is well: about 0.3 sqrt(10 / n), where all probabilities are as likely.
    """
    pairs = [(p, name == s.truth) for s in said for name, p in s.probabilities if name != NONE]
    if not pairs:
        return float("nan")
    p, right = (np.array(column, dtype=float) for column in zip(*pairs, strict=True))
    at = np.minimum((p * _BINS).astype(int), _BINS - 1)
    total = sum(abs(float((p - right)[at == b].sum())) for b in range(_BINS))
    return total / len(pairs)


def set_size(said: Sequence[Statement]) -> float:
    """Return the mean number of names in the 90 % sets, none of these not counted."""
    return float(np.mean([sum(n != NONE for n in s.credible) for s in said])) if said else float("nan")
