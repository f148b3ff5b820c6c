"""What was found: each effect with its size, how probable it is, and what else it may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import is_off
from analysis.mismatch.fit.law_fit import at_bound
from analysis.mismatch.levels import INEXACT, TEMPER, TWO_ERRORS, WORTH_NAMING
from analysis.mismatch.name.law_sizes import law_sizes, loosened
from analysis.mismatch.name.lines import Line
from analysis.mismatch.name.own_sizes import Quantity, own_sizes, would_do
from analysis.mismatch.name.rivals import Named, Rival
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

LOOKED_AT = 60
"""Laws at their settings, events and bands that an adjusted p-value counts."""


@dataclass(frozen=True)
class Finding:
    """One effect: evidence (nats) lost without it, adjusted p-value, sizes, probability, alternatives by name.

    One ``at_bound`` is at an end of what its law may be, or off by more than what is named may be.
    """

    mechanism: Mechanism
    evidence: float
    p_value: float
    parameters: Mapping[str, Quantity]
    probability: float
    alternatives: Mapping[str, float]
    at_bound: bool = False

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name


def findings(named: Named, baseline: Account, lines: Sequence[Line]) -> tuple[Finding, ...]:
    """Return everything that was named, most evidence first."""
    account = named.account
    # once for all laws: their columns are costly
    loose = loosened(account)
    found = []
    for name in account.names:
        mechanism = library().get(name)
        if mechanism is None:
            continue
        if len(account.names) == 1:
            evidence = account.gain_over(baseline)[0]
        elif name in named.adds:
            evidence = named.adds[name]
        else:
            evidence = account.gain_over(account.without(name).reweighed())[0]
        probability, alternatives = weighed(mechanism, named.rivals.get(name, ()), account.names)
        law = next((law for law in account.fit.shared.laws if law.name == name), None)
        if law is not None:
            errors = named.errors.get(name, {})
            sizes = {
                n: replace(q, se=max(q.se, errors.get(n, 0.0))) for n, q in law_sizes(loose, law).items()
            }
            elsewhere = at_bound(law)
        else:
            rhythm = would_do(account, mechanism)
            sizes = own_sizes(account, mechanism, rhythm.se_hz if rhythm else 0.0)
            elsewhere = rhythm is not None and not rhythm.is_likely(mechanism)
        found.append(
            Finding(
                mechanism,
                evidence,
                min(1.0, LOOKED_AT * float(np.exp(-min(max(evidence, 0.0), 700.0)))),
                sizes,
                probability,
                alternatives,
                elsewhere or is_off(account, name, evidence),
            )
        )
    for line in lines:
        # a harmonic is no second hum
        if line.name and all(f.name != line.name for f in found):
            m = library()[line.name]
            sizes = {
                "amplitude_mn": Quantity(line.amplitude_mn, line.amplitude_se_mn, "mN"),
                "frequency_hz": Quantity(line.frequency_hz, 0.03, "Hz"),
            }
            found.append(Finding(m, -float(np.log(max(line.p_value, 1e-300))), line.p_value, sizes, 1.0, {}))
    return tuple(sorted(found, key=lambda f: -f.evidence))


def weighed(
    mechanism: Mechanism, rivals: Sequence[Rival], present: Sequence[str]
) -> tuple[float, dict[str, float]]:
    """Return how probable a name is, and the probabilities of its alternatives.

    Evidence is tempered, and a lead within a tenth of the evidence, to which laws are right, is none. Nor is it an
    effect at all if the laws before it leave over so much: H0 is that this is exponential about what they are expected
    to leave. Alternatives are those that remain probable, those within two paired errors, and those the library knows
    to be inseparable under one punch.
    """
    own = next((r for r in rivals if r.name == mechanism.name), None)
    if own is None or own.gain <= 0:
        return 1.0, {}
    temperature = 1.0 + TEMPER * own.gain
    logits = {"": -own.gain / max(temperature, own.left), mechanism.name: 0.0}
    close = set()
    for r in rivals:
        if r.name == mechanism.name or r.name in present or r.is_another:
            continue
        lead, error = own.account.gain_over(r.account)
        logits[r.name] = -max(lead - INEXACT * own.gain, 0.0) / temperature
        if lead < TWO_ERRORS * error:
            close.add(r.name)
    several_punches = len({t.punch_ratio for t in own.account.fit.trials}) > 1
    for name in () if several_punches else mechanism.inseparable:
        if name not in present:
            logits.setdefault(name, float(np.log(WORTH_NAMING)))
            close.add(name)
    total = float(np.logaddexp.reduce(np.array(list(logits.values()))))
    probability = {name: float(np.exp(v - total)) for name, v in logits.items() if name}
    mine = probability.pop(mechanism.name)
    kept = {n: p for n, p in probability.items() if p >= WORTH_NAMING or n in close}
    return mine, dict(sorted(kept.items(), key=lambda item: -item[1]))
