"""What an account leaves over that is no noise: evidence for any shape, common to the trials or different in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.mismatch.evidence.account import Account, inexact_columns
from analysis.mismatch.fit.law_fit import law_columns, law_prior
from analysis.mismatch.levels import ENOUGH_UNKNOWN, INEXACT
from analysis.mismatch.locate.windows import common_evidence, own_evidence


@dataclass(frozen=True)
class Remainder:
    """Evidence in nats for a shape that all trials have in common, and for windows that differ from trial to trial."""

    common: float
    own: float

    @property
    def evidence(self) -> float:
        """Evidence for whatever it is."""
        return max(self.common, self.own, 0.0)

    @property
    def significant(self) -> bool:
        """Whether it is more than noise."""
        return self.evidence > ENOUGH_UNKNOWN


def remainder_of(account: Account) -> Remainder:
    """Weigh what an account leaves, beside what its laws may leave as they are right to a tenth."""
    fit = account.fit
    precision = law_prior(fit.shared.laws)[0]
    present = [
        np.column_stack([law_columns(t, s, fit.shared), inexact])
        for t, s, inexact in zip(fit.trials, fit.states, inexact_columns(fit), strict=True)
    ]
    spare = np.full(present[0].shape[1] - len(precision), INEXACT**-2)
    return Remainder(common_evidence(fit, present, np.concatenate([precision, spare])), own_evidence(fit)[0])
