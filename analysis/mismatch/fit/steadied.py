"""How large and how steady rhythms are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from analysis.mismatch.fit.slow_noise import restricted_deviance
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.rhythm import CYCLES

FloatArray = NDArray[np.float64]

MOST_LOG = 4.0
"""How far size and steadiness may be from where they were looked for, as logarithms."""
FIRST_LOGS = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, 0.7]])
NEAR = 0.3
"""Both are known to no better a logarithm, nor their evidence to better nats."""
SAME = 4.0
"""What two numbers fitted gain of nothing (a chi2 of two degrees of freedom is larger once in seven)."""


def steadied(fit: StudyFit, name: str) -> StudyFit:
    """Return the fit with a rhythm of the size and steadiness that make the trials most likely (restricted likelihood).

    They are told by the noise that is left beside it: where none is granted all that is left would be the rhythm's.
    """
    mine = [r for s in fit.states for r in s.rhythms if r.effect == name]
    least = max(float(np.log(CYCLES / (r.frequency_hz * r.coherent_s))) for r in mine)

    def at(logs: FloatArray) -> StudyFit:
        larger, steadier = np.exp(np.clip(logs, (-MOST_LOG, least), MOST_LOG))
        rhythms = (
            tuple(r.of(larger, steadier) if r.effect == name else r for r in s.rhythms) for s in fit.states
        )
        states = tuple(replace(s, rhythms=of_it) for s, of_it in zip(fit.states, rhythms, strict=True))
        there = replace(fit, states=states)
        # no simulation changes
        there.__dict__["force_columns"] = fit.force_columns
        return there

    found = minimize(
        lambda logs: restricted_deviance(at(logs), fit.noise),
        np.zeros(2),
        method="Nelder-Mead",
        # the stubs know no options of a method
        options={"xatol": NEAR, "fatol": NEAR, "initial_simplex": FIRST_LOGS},  # type: ignore[call-overload]
    )
    if restricted_deviance(fit, fit.noise) - float(found.fun) < SAME:
        return fit
    return at(found.x).weighed_by(fit.noise)
