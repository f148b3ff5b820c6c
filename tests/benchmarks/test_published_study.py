"""The published study on the simulated bench, by the published procedure and by the ramp fit.

The tissue is chosen such that the published procedure returns the published numbers; the ramp fit then says
what such a finger really was, and which trend with depth was the procedure's own. `pytest -m benchmark -s`
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from analysis.recordings.trial import Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.published import RESULTS, STIFFNESS_MN_PER_UM
from analysis.relaxation.result import Model, TrialFit
from analysis.relaxation.study import summarise
from sim_hardware.concealment.offline import study_plans

pytestmark = pytest.mark.benchmark
FINGERS = ("thumb", "index", "middle", "ring", "little")
NAMES = ("A1_over_A0", "A2_over_A0", "t1_s", "t2_s")
BenchTrials = Callable[..., list[Trial]]


def settings(tissue: Sequence[float], variation: float, seed: int, noise_mn: float = 0.3) -> str:
    k0, k1, k2, tau1, tau2 = tissue
    published = "true" if variation == 0 else "false"
    return f"""
seed = {seed}
[tissue]
k0_mn_per_mm = {k0}
k1_mn_per_mm = {k1}
tau1_s = {tau1}
k2_mn_per_mm = {k2}
tau2_s = {tau2}
[specimens]
published_tissue = {published}
finger_variation = {variation}
site_variation = 0.0
[noise]
force_mn_rms = {noise_mn}
"""


def step_results(rows: Sequence[TrialFit]) -> np.ndarray:
    """Return what the study would have published: mean ratios and times, slope of A0 over depth."""
    means = [np.mean([row.estimates[name].value for row in rows]) for name in NAMES]
    return np.array([*means, summarise(rows).slope_mn_per_um])


def test_three_columns(bench_trials: BenchTrials):
    wanted = np.array([*(RESULTS[name].mean for name in NAMES), STIFFNESS_MN_PER_UM])
    # each number is moved by as much as the procedure misses it: ratios, times, then the stiffness
    ratio1, ratio2, tau1, tau2, stiffness = wanted
    for _ in range(5):
        tissue = np.array([1.0, ratio1, ratio2, 0.0, 0.0]) * 1000.0 * stiffness + [0, 0, 0, tau1, tau2]
        trials = bench_trials(settings(tissue, 0.0, 3, 0.05), study_plans(repeats=1))
        got = step_results([fit_trial(trial, "step") for trial in trials])
        ratio1, ratio2, tau1, tau2, stiffness = (
            np.array([ratio1, ratio2, tau1, tau2, stiffness]) * wanted / got
        )
    plans = study_plans(fingers=FINGERS, repeats=5)
    # as published: 10 good trials of the index finger, 19 of every other
    kept = [plan for plan in plans if plan.finger != "index"]
    kept = [plan for plan in kept if not (plan.depth_mm == 0.8 and plan.repeat == 5)]
    kept += [plan for plan in plans if plan.finger == "index"][::2]
    assert len(kept) == 86
    trials = bench_trials(settings(tissue, 0.1, 4), kept)
    models: tuple[Model, ...] = ("step", "ramp")
    rows = {model: [fit_trial(trial, model) for trial in trials] for model in models}
    print(
        f"\ntissue: k0 {tissue[0]:.1f}, k1 {tissue[1]:.1f}, k2 {tissue[2]:.1f} mN/mm, "
        f"tau1 {tissue[3]:.3f}, tau2 {tissue[4]:.3f} s; 86 trials"
    )
    print(f"{'':12s} {'published':>16s} {'step fit':>16s} {'ramp fit':>16s} {'true':>8s}")
    true = dict(zip(NAMES, (tissue[1] / tissue[0], tissue[2] / tissue[0], tissue[3], tissue[4]), strict=True))
    for name in NAMES:
        cells = [f"{RESULTS[name].mean:.3f} +- {RESULTS[name].sd:.3f}"]
        for model in models:
            values = np.array([row.estimates[name].value for row in rows[model]])
            cells.append(f"{values.mean():.3f} +- {values.std(ddof=1):.3f}")
        print(f"{name:12s} {cells[0]:>16s} {cells[1]:>16s} {cells[2]:>16s} {true[name]:8.3f}")
    slopes = {model: summarise(rows[model]).slope_mn_per_um for model in models}
    print(
        f"{'A0 mN/um':12s} {STIFFNESS_MN_PER_UM:16.3f} {slopes['step']:16.3f} {slopes['ramp']:16.3f} "
        f"{tissue[0] / 1000:8.3f}"
    )
    trends = {}
    print("A2/A0 by depth, mm:" + "".join(f"{depth:9.1f}" for depth in (0.2, 0.4, 0.6, 0.8)))
    for model in models:
        by_depth = [
            np.mean([r.estimates["A2_over_A0"].value for r in rows[model] if r.depth_mm == depth])
            for depth in (0.2, 0.4, 0.6, 0.8)
        ]
        trends[model] = by_depth[-1] / by_depth[0] - 1.0
        print(
            f"  {model} fit          "
            + "".join(f"{value:9.3f}" for value in by_depth)
            + f"   from 0.2 to 0.8 mm: {100 * trends[model]:+.1f} %"
        )
    step_mean = np.mean([row.estimates["A2_over_A0"].value for row in rows["step"]])
    ramp_mean = np.mean([row.estimates["A2_over_A0"].value for row in rows["ramp"]])
    print(
        f"the ramp correction takes A2/A0 from {step_mean:.3f} to {ramp_mean:.3f}, {ramp_mean / step_mean:.2f} times"
    )
    for name in NAMES:
        step = np.mean([row.estimates[name].value for row in rows["step"]])
        assert step == pytest.approx(RESULTS[name].mean, rel=0.1), name
    assert abs(trends["ramp"]) < 0.05 < abs(trends["step"])
