"""The skin clings to the punch on the way back."""

from __future__ import annotations

import numpy as np
from numba import njit

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

SHARE_OF_PEAK = 0.1
"""A probe's pull-off (mN) is at most so much of the largest force (mN) for every mN of it."""


@njit(cache=True)
def _clinging(free: FloatArray, x: FloatArray, law: tuple[float, float, float, float, float]) -> FloatArray:
    """Return the force (n,) of a retract along x (mm, falling), skin clinging until contact is lost, then peeling."""
    pull, scale, q, reach, length = law
    n = free.size
    out = np.empty(n)
    lost = n
    for k in range(n):
        u = -free[k] / scale
        if u >= reach and lost == n:
            lost = k
        if k > lost > 0:
            break
        c = min(u, 2.0 * reach)
        out[k] = free[k] if u <= 0.0 else -scale * c / (1.0 + c**q) ** (1.0 / q)
    if lost in (n, 0):
        return np.maximum(out, -pull)
    before = max(-free[lost - 1] / scale, 0.0)
    share = (reach - before) / max(-free[lost] / scale - before, 1e-12)
    x_lost = x[lost - 1] + share * (x[lost] - x[lost - 1])
    near_by = slice(max(lost - 2, 0), lost + 1)
    seen, clung = -x[near_by], out[near_by].copy()
    for k in range(lost - 1, n):
        # the cell in which contact is lost is part clinging, part peeling: average over both
        begin = x[0] if k == 0 else 0.5 * (x[k - 1] + x[k])
        end = min(x[n - 1] if k == n - 1 else 0.5 * (x[k] + x[k + 1]), begin - 1e-9)
        near, far = max(x_lost - begin, 0.0), max(x_lost - end, 1e-9)
        gone = -np.expm1(-(far - near) / length) * np.exp(-near / length)
        peeling = -pull * length * gone / max(far - near, 1e-9)
        clinging = 0.0 if k > lost else min(max((begin - x_lost) / (begin - end), 0.0), 1.0)
        out[k] = (1.0 - clinging) * peeling
        if clinging > 0.0:
            out[k] += clinging * np.interp(-0.5 * (begin + max(end, x_lost)), seen, clung)
    return out


class Adhesion(Mechanism):
    """On the retract F_t goes down to -``pull_off_mn`` before contact is lost.

    With u the pull of skin that clings in full, in units of the pull-off, the contact carries
    u / (1 + u^q)^(1/q) of it: it gives way gradually (small ``roundness`` q) or follows in full until the end
    (large q). Contact is lost at u = ``reach``, and the force returns to zero over a share ``peel`` of the
    study's depth of further travel.
    Large q, reach 1 and no peel are the textbook's snap.
    """

    name = "adhesion"
    stage = "contact"
    parameters = (
        Parameter("pull_off_mn", "mN", 0.0, 1.0e3),
        Parameter("peel", "1", 5e-4, 2.0, "log", inner=True),
        Parameter("roundness", "1", 1.0, 60.0, "log", inner=True),
        Parameter("reach", "1", 1.0, 8.0, "log", inner=True),
    )
    amplitude = "pull_off_mn"
    null = {"pull_off_mn": 0.0, "peel": 2e-3, "roundness": 30.0, "reach": 1.0}
    probes = (
        *(
            {"pull_off_mn": pull, "peel": peel, "roundness": 30.0, "reach": 1.0}
            for pull, peel in ((0.2, 2e-3), (1.0, 2e-3), (1.0, 0.05), (5.0, 5e-3), (5.0, 0.06))
        ),
        {"pull_off_mn": 5.0, "peel": 5e-3, "roundness": 3.0, "reach": 1.5},
    )
    typical = {"pull_off_mn": 2.0, "peel": 5e-3, "roundness": 30.0, "reach": 1.0}
    of_site = ("pull_off_mn",)
    words = "on the way back the skin clings to the punch and pulls before it lets go"
    source = "pull-off of an adhering flat punch"
    separated_by = "talcum on the punch"

    def probe_settings(self, peak_force_mn: float, depth_mm: float) -> tuple[Values, ...]:
        """Pull-offs that are no more than a share of the largest force: on a cell it is a thousandth of a finger's."""
        return tuple(
            {**p, "pull_off_mn": min(p["pull_off_mn"], SHARE_OF_PEAK * p["pull_off_mn"] * peak_force_mn)}
            for p in self.probes
        )

    def contact_force_mn(
        self, trial: CellTrial, free_force_mn: FloatArray, contact_force_mn: FloatArray, p: Values
    ) -> FloatArray:
        """Force with the skin clinging until contact is lost, then peeling."""
        pull, q, reach = p["pull_off_mn"], p["roundness"], p["reach"]
        back = np.flatnonzero(trial.retracting)
        if pull <= 1e-9 or back.size < 2:
            return contact_force_mn
        first = int(back[0])
        # the largest force, carried at u = reach, is the pull-off itself
        scale = pull * (1.0 + reach**q) ** (1.0 / q) / reach
        law = (pull, scale, q, reach, p["peel"] * trial.study_depth_mm)
        out = contact_force_mn.copy()
        n = out.shape[-1]
        for row, free in zip(out.reshape(-1, n), free_force_mn.reshape(-1, n), strict=True):
            row[first:] = _clinging(free[first:], trial.position_mm[first:], law)
        return out
