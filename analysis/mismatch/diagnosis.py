"""The diagnosis on one page: noise, baseline, locate, name, model, confirm; then what to record next is proposed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.mismatch.confirm.heldout import HeldOut, confirm
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.locate.absorbed import Absorbed, find_absorbed
from analysis.mismatch.locate.located import Located, locate, where_trend, with_bursts
from analysis.mismatch.locate.position_channel import PositionFinding, look_at_position
from analysis.mismatch.locate.remainder import Nameless, Remainder, find_transients, nameless_of, remainder_of
from analysis.mismatch.name.finding import Finding, findings
from analysis.mismatch.name.lines import Line, beside_tones
from analysis.mismatch.name.ramp import undo_step
from analysis.mismatch.name.rivals import Named
from analysis.mismatch.name.search import search
from analysis.mismatch.study.intake import Intake


@dataclass(frozen=True)
class Diagnosis:
    """Everything a report says, before it is put into words."""

    intake: Intake
    baseline: Account
    named: Named
    findings: tuple[Finding, ...]
    lines: tuple[Line, ...]
    located: tuple[Located, ...]
    left: tuple[Located, ...]
    remainder: Remainder
    nameless: Nameless
    absorbed: tuple[Absorbed, ...]
    position: PositionFinding | None
    confirmed: HeldOut

    @property
    def improved(self) -> Account:
        """The account with everything that was named."""
        return self.named.account


def diagnose(intake: Intake, *, baseline: str = "ramp", seed: int = 0) -> Diagnosis:
    """Say what the baseline simulation leaves out: where it is, its name and size, and how sure that is."""
    rng = np.random.default_rng(seed)
    # every trial its own tissue, drawn from a population; noise from what differs between trials at rest
    ideal_step = baseline == "step"
    fit, lines = beside_tones(fit_baseline(intake.trials, ideal_step=ideal_step), ideal_step=ideal_step)
    # name: laws, events and oscillations compete by how well they predict trials that were not fitted
    start, ramp = undo_step(Account(fit))
    named = search(start)
    # model: before and after, by the same noise
    before = Account(fit).best_at(named.account.fit.noise)
    found = (*ramp, *findings(named, before, lines))
    # confirm on trials that were not fitted, and look at what is left
    nothing = Account(fit)
    remainder = remainder_of(named.account, nothing)
    bursts = find_transients(nothing.fit) if named.account.names else remainder.bursts
    nameless = nameless_of(named.account, before, [f.name for f in found if not f.at_bound])
    trend, somewhere = where_trend(remainder.trend), bool(found) or remainder.lasts
    return Diagnosis(
        intake=intake,
        baseline=before,
        named=named,
        findings=found,
        lines=lines,
        located=(*with_bursts(locate(before.fit, rng, somewhere=somewhere), bursts), *trend),
        left=(*with_bursts(locate(nameless.left, rng), remainder.bursts), *trend),
        remainder=remainder,
        nameless=nameless,
        absorbed=find_absorbed(named.account.fit),
        position=look_at_position(intake.trials, rng),
        confirmed=confirm(before, named.account, rng),
    )
