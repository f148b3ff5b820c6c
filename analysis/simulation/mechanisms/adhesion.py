"""The skin clings to the punch on the way back."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

SHARE_OF_PEAK = 0.1
"""A probe's pull-off (mN) is at most so much of the largest force (mN) for every mN of it."""


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
    of_site = True
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
        free = free_force_mn[first:]
        pulled = free < 0.0
        u, clung = np.zeros_like(free), free.copy()
        u[pulled] = -free[pulled] / scale
        capped = np.minimum(u[pulled], 2.0 * reach)
        clung[pulled] = -scale * capped / (1.0 + capped**q) ** (1.0 / q)
        out = contact_force_mn.copy()
        lost = np.flatnonzero(u >= reach)
        if not lost.size or lost[0] == 0:
            out[first:] = np.maximum(clung, -pull)
            return out
        i = int(lost[0])
        x = trial.position_mm[first:]
        share = (reach - u[i - 1]) / max(u[i] - u[i - 1], 1e-12)
        x_lost = x[i - 1] + share * (x[i] - x[i - 1])
        # the cell in which contact is lost is part clinging, part peeling: average over both
        edge = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
        begin, end = edge[:-1], np.minimum(edge[1:], edge[:-1] - 1e-9)
        clinging = np.clip((begin - x_lost) / (begin - end), 0.0, 1.0)
        clinging[: i - 1] = 1.0
        clinging[i + 1 :] = 0.0
        middle = 0.5 * (begin + np.maximum(end, x_lost))
        held = np.interp(-middle, -x[: i + 1], clung[: i + 1])
        length = p["peel"] * trial.study_depth_mm
        near, far = np.maximum(x_lost - begin, 0.0), np.maximum(x_lost - end, 1e-9)
        peeling = (
            -pull * length * (np.exp(-near / length) - np.exp(-far / length)) / np.maximum(far - near, 1e-9)
        )
        held[: i - 1] = clung[: i - 1]
        out[first:] = clinging * held + (1.0 - clinging) * peeling
        return out
