"""What might be added to an account: each law, event and rhythm with its evidence to a line, and how it is refitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.evidence.itself import textbook_forms
from analysis.mismatch.evidence.scatter import scatter_explained
from analysis.mismatch.fit.baseline import noise_left
from analysis.mismatch.fit.contacts import contacts_begun_anew
from analysis.mismatch.fit.gram import gram, solve
from analysis.mismatch.fit.law_fit import fit_laws
from analysis.mismatch.fit.settled import Settled, settled_columns
from analysis.mismatch.fit.steadied import steadied
from analysis.mismatch.fit.study_fit import StudyFit, with_own_values
from analysis.mismatch.levels import (
    ENOUGH_OWN,
    ENOUGH_SHARED,
    FEWEST_HELD_OUT,
    STARTS,
)
from analysis.mismatch.model.dictionary import Template, templates
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.name.event_scan import comes_with_motion, scan_events
from analysis.mismatch.name.events import EVENTS, EventScan, with_events
from analysis.mismatch.name.oscillations import OscillationScan, scan_oscillations, with_oscillation
from analysis.mismatch.name.overtones import plainer

FloatArray = NDArray[np.float64]

FIRST_ROUNDS = 5


@dataclass(frozen=True)
class Option:
    """An effect that might be added: name, linear evidence (nats), what is enough, how to add it to an account.

    ``found_in`` is the account in which it was found, ``beside`` its evidence beside the law that has most.
    """

    name: str
    nats: float
    enough: float
    found_in: Account
    added_to: Callable[[Account], Account]
    beside: float = 0.0

    def refit(self) -> Account:
        """Return the account in which the effect was found, refitted with it."""
        return self.added_to(self.found_in)


def added(options: Sequence[Option], account: Account) -> Account:
    """Return the account, by laws that are exact, with an effect refitted from the best of its options.

    With an effect recordings are as likely as without it, but for its price. Where one fell behind by more, what else
    is missing has bent the tissue, as no slow noise was granted where it was found; then it is added where the account
    stands, too.
    """
    refitted = []
    for option in options:
        here = option.refit().weighed_anew()
        if here.nats <= account.of_exact_laws - option.enough and option.found_in is not account:
            here = max(here, option.added_to(account).weighed_anew(), key=lambda a: a.nats)
        refitted.append(here)
    return max(refitted, key=lambda a: a.nats)


def law_options(
    account: Account,
    nothing: Account,
    wanted: list[Template],
    settled: Sequence[Settled],
    *,
    beside_exact: bool = False,
) -> list[Option]:
    """Return the laws that might be added, weighed beside what the present laws may leave over, unless they are exact.

    ``settled`` is what each template changes in each trial, by `settled_columns`.
    """
    if not wanted:
        return []
    fit = account.fit
    known = account if beside_exact else account.as_off
    present = len(known.precision)
    columns = (np.hstack([known.columns(j), changed.force_mn]) for j, changed in enumerate(settled))
    grams = gram(fit, columns, np.append(known.precision, np.zeros(len(wanted))))
    before = predictive_deviance(grams, range(present))
    total = grams.total()

    def weighed(*at: int) -> tuple[float, float]:
        """Return what templates gain, and the coefficient of the last."""
        added = [present + k for k in at]
        coefficients = solve(
            total, grams.ridge, [*range(TISSUE_SIZE + present), *(TISSUE_SIZE + k for k in added)]
        )[0]
        # as of a law that was refitted: a size is known to about itself, whatever the scale of these recordings
        ridge = grams.ridge.copy()
        ridge[[TISSUE_SIZE + k for k in added]] = 1.0 / np.maximum(coefficients[-len(at) :] ** 2, 1e-24)
        after = predictive_deviance(replace(grams, ridge=ridge), [*range(present), *added])
        if wanted[at[-1]].mechanism.one_sided and coefficients[-1] <= 0:
            return 0.0, float(coefficients[-1])
        return 0.5 * float((before - after).sum()), float(coefficients[-1])

    best: dict[str, list[tuple[float, int, float]]] = {}
    for k, (template, (calmer, at)) in enumerate(zip(wanted, scatter_explained(fit, settled), strict=True)):
        gain, coefficient = weighed(k)
        if calmer > gain and (at > 0.0 or not template.mechanism.one_sided):
            gain, coefficient = calmer, at
        best.setdefault(template.name, []).append((gain, k, coefficient))
    options = []
    most, leader, _ = max((max(found) for found in best.values()), default=(0.0, 0, 0.0))
    for name, found in best.items():
        found.sort(reverse=True)
        beside = 0.0 if name == wanted[leader].name else weighed(leader, found[0][1])[0] - most
        starts = found[:1]
        for other in found[1:]:
            if len(starts) < STARTS and all(abs(other[1] - f[1]) >= len(found) / STARTS for f in starts):
                starts.append(other)
        refit = _law_refit(nothing, wanted, starts)
        options.append(Option(name, found[0][0], ENOUGH_SHARED, account, refit, beside))
    return options


def _law_refit(
    nothing: Account, wanted: list[Template], starts: list[tuple[float, int, float]]
) -> Callable[[Account], Account]:
    def refit(account: Account) -> Account:
        exact = account.exact
        fits = [
            replace(f, shared=replace(f.shared, laws=(*f.shared.laws, wanted[k].as_law(c))))
            for _, k, c in starts
            for f in (exact.fit, *_anew(account, nothing))
        ]
        # the population moves little: it is left alone until the best start is known
        refitted = [fit_laws(f, rounds=FIRST_ROUNDS) for f in fits]
        depth_mm = account.fit.trials[0].study_depth_mm
        hold = [
            f for f in refitted if all(law.mechanism.holds(law.values, depth_mm) for law in f.shared.laws)
        ]
        best = with_own_values(min(hold or refitted, key=lambda f: f.cost))
        return replace(exact, fit=best).with_laws(best.shared.laws)

    return refit


def _anew(account: Account, nothing: Account) -> list[StudyFit]:
    """Return from where a present law is refitted beside where it stands: of one or two trials, from the textbook.

    There nothing keeps the first law, and the trial's own parameters with it, from standing for one still missing.
    """
    fit = account.exact.fit
    if len(fit.trials) >= FEWEST_HELD_OUT or len(fit.shared.laws) != 1:
        return []
    start = nothing.fit.weighed_by(fit.noise)
    textbook = textbook_forms(fit, fit.shared.laws[0].name)
    return [replace(start, shared=replace(start.shared, laws=(law,))) for law in textbook]


def own_options(account: Account, only: str = "") -> list[Option]:
    """Return the events and the oscillation that might be added, or what is called ``only``.

    They are told from a law by coming in each trial anew: one or two trials can't show that.
    """
    if len(account.fit.trials) < FEWEST_HELD_OUT:
        return []
    scans = scan_events(
        account.fit, [e for e in EVENTS if e.name not in account.steps and only in ("", e.name)]
    )
    # a gain that goes down only does what a slip does
    drops = max((scan.evidence for scan in scans if scan.event.one_sided), default=-np.inf)
    options = [
        Option(scan.event.name, scan.evidence, ENOUGH_OWN, account, _event_refit(scan))
        for scan in scans
        if not (scan.event.channel and scan.evidence < drops + ENOUGH_OWN)
        and not (scan.event.once and comes_with_motion(account.fit, scan))
    ]
    if any(e.name == only for e in EVENTS):
        return options
    for found_in in (account, *plainer(account)):
        scan = scan_oscillations(found_in.fit, only)
        if scan.name not in account.steps and scan.size_mm > 0.0:
            options.append(Option(scan.name, scan.evidence, ENOUGH_OWN, found_in, _oscillation_refit(scan)))
    return options


def _event_refit(scan: EventScan) -> Callable[[Account], Account]:
    def refit(account: Account) -> Account:
        added = _with_steps(account.exact, scan)
        if scan.event.once:
            return added
        again = scan_events(added.fit, [scan.event])[0]
        return _with_steps(added, again) if again.evidence > ENOUGH_OWN else added

    return refit


def _with_steps(account: Account, scan: EventScan) -> Account:
    """Return the account refitted with a step in every trial that more likely has one than not."""
    # a time was chosen in each of them
    price = float(np.log(scan.event.looked_at)) * int((scan.probability > 0.5).sum())
    steps = {**account.steps, scan.event.name: account.steps.get(scan.event.name, 0.0) + price}
    return replace(account, fit=with_events(account.fit, scan), steps=steps).with_laws(
        account.fit.shared.laws
    )


def _oscillation_refit(scan: OscillationScan) -> Callable[[Account], Account]:
    name = scan.name

    def refit(account: Account) -> Account:
        exact, laws = account.exact, account.fit.shared.laws
        added = replace(
            exact,
            fit=with_oscillation(exact.fit, scan),
            steps={**account.steps, name: float(np.log(max(len(scan.grid_hz), 1)))},
        ).with_laws(laws)
        if not any(r.effect == name for s in added.fit.states for r in s.rhythms):
            return added
        touching = contacts_begun_anew(added.fit).with_population(1)
        beside = touching.weighed_by(noise_left(touching))
        return replace(added, fit=steadied(beside, name)).with_laws(laws)

    return refit


def begun_again(account: Account, name: str, nothing: Account) -> Account:
    """Return the account with what was added last begun from each of its forms or times, if it then predicts better.

    They were chosen by a noise that the mismatch itself had made, and by a tissue bent by it.
    """
    stripped = account.exact.stripped(name)
    forms = [t for t in templates(account.fit.trials) if t.name == name]
    if name in account.steps:
        options = own_options(stripped.quick(), name)
    elif len(forms) > 1:
        options = law_options(stripped, nothing, forms, settled_columns(stripped.fit, forms))
    else:
        return account
    return better(account, options)


def better(account: Account, options: Sequence[Option]) -> Account:
    """Return the account, or that of an option that predicts better by laws that are exact."""
    best = max((o.refit().weighed_anew() for o in options), key=lambda a: a.nats, default=None)
    if best is None or best.nats <= account.of_exact_laws:
        return account
    return max(account, best.with_rhythms_settled().granting(), key=lambda a: a.nats)
