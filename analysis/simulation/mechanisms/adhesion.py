"""The skin clings to the punch on the way back."""

from __future__ import annotations

import numpy as np

from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.cells import CellTrial


class Adhesion(Mechanism):
    """On the retract F_t goes down to -``pull_off_mn`` before contact is lost.

    The tissue follows the punch until its force would fall below -P; from there the contact peels: the force
    returns to zero over ``peel_um`` of further travel (0: at once, the textbook's snap).
    """

    name = "adhesion"
    stage = "contact"
    parameters = (
        Parameter("pull_off_mn", "mN", 0.0, 1.0e3),
        Parameter("peel_um", "um", 0.5, 2.0e3, "log", inner=True),
    )
    amplitude = "pull_off_mn"
    null = {"pull_off_mn": 0.0, "peel_um": 2.0}
    probes = (
        {"pull_off_mn": 0.2, "peel_um": 2.0},
        {"pull_off_mn": 1.0, "peel_um": 2.0},
        {"pull_off_mn": 1.0, "peel_um": 50.0},
        {"pull_off_mn": 5.0, "peel_um": 5.0},
        {"pull_off_mn": 5.0, "peel_um": 60.0},
    )
    typical = {"pull_off_mn": 2.0, "peel_um": 5.0}
    words = "on the way back the skin clings to the punch and pulls before it lets go"
    source = "pull-off of an adhering flat punch"
    separated_by = "talcum on the punch"

    def contact_force_mn(
        self, trial: CellTrial, free_force_mn: FloatArray, contact_force_mn: FloatArray, p: Values
    ) -> FloatArray:
        """Force with the skin clinging until -P, then peeling."""
        pull = p["pull_off_mn"]
        back = np.flatnonzero(trial.retracting)
        if pull <= 0.0 or back.size < 2:
            return contact_force_mn
        first = int(back[0])
        free = free_force_mn[first:]
        lost = np.flatnonzero(free <= -pull)
        out = contact_force_mn.copy()
        if not lost.size or lost[0] == 0:
            out[first:] = np.maximum(free, -pull)
            return out
        i = int(lost[0])
        x = trial.position_mm[first:]
        share = (free[i - 1] + pull) / max(free[i - 1] - free[i], 1e-12)
        x_lost = x[i - 1] + share * (x[i] - x[i - 1])
        # the cell in which contact is lost is part clinging, part peeling: average over both
        edge = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
        begin, end = edge[:-1], np.minimum(edge[1:], edge[:-1] - 1e-9)
        clinging = np.clip((begin - x_lost) / (begin - end), 0.0, 1.0)
        clinging[:i - 1] = 1.0
        clinging[i + 1 :] = 0.0
        middle = 0.5 * (begin + np.maximum(end, x_lost))
        held = np.interp(-middle, -x[: i + 1], free[: i + 1])
        length = 1e-3 * p["peel_um"]
        near, far = np.maximum(x_lost - begin, 0.0), np.maximum(x_lost - end, 1e-9)
        peeling = -pull * length * (np.exp(-near / length) - np.exp(-far / length)) / np.maximum(far - near, 1e-9)
        held[:i - 1] = free[: i - 1]
        out[first:] = clinging * held + (1.0 - clinging) * peeling
        return out
