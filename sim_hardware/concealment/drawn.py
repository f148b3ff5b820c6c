"""A laboratory drawn from a seed: what its study does, whose skin it presses, by how much sites and sensor differ.

A diagnosis that is proven on one study is proven for that study. Ranges are those of published pads and of benches.
"""

from __future__ import annotations

import numpy as np

from sim_hardware.concealment.plans import TrialPlan, study_plans
from sim_hardware.settings import SpecimenSettings, TissueSettings
from sim_hardware.world.specimens import FINGERS

DEPTHS_MM = tuple(round(0.2 + 0.05 * k, 2) for k in range(13))
TRIALS = (8, 12, 16, 20, 24)
HOLDS_S = (5.0, 7.0, 10.0, 15.0)
"""What comes once in a trial comes before the shortest is over."""
RAMPS_MM_S, RETRACTS_MM_S = (2.0, 5.0, 10.0, 20.0), (2.0, 5.0, 10.0)


def drawn_study(seed: int) -> list[TrialPlan]:
    """Return a study of one to five fingers at two to four depths, some 8 to 24 trials, one speed and one hold."""
    random = np.random.default_rng([seed, 14])
    fingers = FINGERS[: int(random.integers(1, 6))]
    depths_mm = sorted(float(d) for d in random.choice(DEPTHS_MM, int(random.integers(2, 5)), replace=False))
    return study_plans(
        fingers=fingers,
        depths_mm=depths_mm,
        repeats=max(1, round(int(random.choice(TRIALS)) / (len(fingers) * len(depths_mm)))),
        hold_s=float(random.choice(HOLDS_S)),
        ramp_speed_mm_s=float(random.choice(RAMPS_MM_S)),
        retract_speed_mm_s=float(random.choice(RETRACTS_MM_S)),
    )


def drawn_skin(seed: int) -> tuple[SpecimenSettings, float, TissueSettings]:
    """Return how fingers and sites differ, how the sensor's gain does from trial to trial, and the mean tissue."""
    random = np.random.default_rng([seed, 15])
    specimens = SpecimenSettings(
        site_variation=float(random.uniform(0.02, 0.25)), finger_variation=float(random.uniform(0.0, 0.2))
    )
    k0 = float(random.uniform(60.0, 250.0))
    tissue = TissueSettings(
        k0_mn_per_mm=k0,
        k1_mn_per_mm=k0 * float(random.uniform(0.2, 0.6)),
        tau1_s=float(random.uniform(1.2, 4.0)),
        k2_mn_per_mm=k0 * float(random.uniform(0.15, 0.5)),
        tau2_s=float(random.uniform(0.06, 0.3)),
    )
    return specimens, float(random.uniform(0.0, 0.15)), tissue
