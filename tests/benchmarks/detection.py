"""Detection power with many replicates: one study with an effect and one without, and fresh noise each time.

What the effect adds to the force, scaled to any strength, is put onto the noise-free study; the statistics
of `analysis.mismatch` look at it as they do first of all: the baseline fitted, everything scored together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.mismatch.candidates import hum_candidate
from analysis.mismatch.intake import take_in_memory
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import look
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.problem import Problem
from analysis.mismatch.shared import Simulation
from analysis.mismatch.start import start_own, start_tissue
from analysis.mismatch.weighing import weighed
from analysis.recordings.trial import Calibration, Phase, ProtocolSummary, Specimen, Trial
from analysis.simulation.cells import CellTrial
from sim_hardware.concealment.knobs import LIBRARY
from sim_hardware.concealment.plans import TrialPlan, study_plans
from sim_hardware.concealment.strength import Quiet, quiet_bench, record_quietly
from sim_hardware.settings import BenchSettings, EffectSettings

NOISE_MN = 0.3
STUDY = tuple(study_plans())


@dataclass(frozen=True)
class Study:
    """A noise-free study in cells, its baseline fit, and what an effect of strength 1 adds to each sample."""

    trials: tuple[CellTrial, ...]
    added_mn: tuple[Any, ...]
    fit: JointFit
    bench: BenchSettings
    effect: EffectSettings
    strength: float
    """Strength of the effect as it was recorded, by the analysis' own baseline."""


def study_with(name: str, seed: int, plans: tuple[TrialPlan, ...] = STUDY) -> Study:
    """Record a study with an effect of the library, as it usually is, and one without."""
    bench = BenchSettings(seed=seed)
    knob = LIBRARY[name]
    drawn = knob.draw(np.random.default_rng(seed))
    # small enough to be linear: shapes are those at the limit of detection
    effect = EffectSettings.model_validate(
        {"name": name, **knob.values(0.05 * knob.start, drawn), "rough": 0.5}
    )
    without = record_quietly(quiet_bench(bench, (), False), plans)
    with_it = record_quietly(quiet_bench(bench, (effect,), False), plans)
    trials = take_in_memory(
        [_trial(q, i, p) for i, (q, p) in enumerate(zip(without, plans, strict=True))]
    ).trials
    problem = weighed(trials, NoiseModel(NOISE_MN))
    fit = problem.fit(Simulation(start_tissue(trials)), start_own(trials), rounds=25)
    # the noise-free study is made the model's own, so that a strength of 0 holds nothing at all
    trials = tuple(
        replace(t, force_mn=fit.simulation.force_mn(t, own)) for t, own in zip(trials, fit.own, strict=True)
    )
    difference = [b.force_mn - a.force_mn for a, b in zip(without, with_it, strict=True)]
    scale = _orthogonal_norm(weighed(trials, NoiseModel(NOISE_MN)), fit, difference)
    return Study(trials, tuple(d / scale for d in difference), fit, bench, effect, scale)


def _cells(trial: CellTrial, signal: Any) -> Any:
    return np.add.reduceat(signal, trial.starts) / trial.counts


def _orthogonal_norm(problem: Problem, fit: JointFit, added_mn: Sequence[Any]) -> float:
    """Norm of what the baseline can't absorb: shared parameters, contact points and offsets projected out."""
    from analysis.mismatch.linearised import linearise, project_out

    parts = []
    for j, (t, w) in enumerate(zip(problem.trials, problem.whiteners, strict=True)):
        line = linearise(t, w, fit.simulation, fit.own[j], problem.trials, fit.latents[j])
        left, _ = project_out(line.A, np.column_stack([w(_cells(t, added_mn[j])), line.J]))
        parts.append(left)
    stacked = np.concatenate(parts)
    left, _ = project_out(stacked[:, 1:], stacked[:, :1])
    return float(np.linalg.norm(left))


def detects(study: Study, strength: float, random: np.random.Generator) -> bool:
    """Whether an effect of a strength in fresh white noise is seen at all, by any of the statistics."""
    trials = []
    for t, added in zip(study.trials, study.added_mn, strict=True):
        more = strength * added + NOISE_MN * random.standard_normal(len(added))
        base = np.interp(np.arange(len(added)) / t.sample_rate_hz, t.time_s, t.force_mn)
        trials.append(
            replace(t, force_mn=t.force_mn + _cells(t, more), full_force_mn=(base + more).astype(np.float32))
        )
    problem = weighed(trials, NoiseModel(NOISE_MN))
    fit = problem.fit(study.fit.simulation, study.fit.own, rounds=4)
    seen = look(problem, fit, random)
    return not seen.quiet or hum_candidate(problem, fit) is not None


def _trial(quiet: Quiet, number: int, plan: TrialPlan) -> Trial:
    day = "2024-05-06T09:00:00+00:00"
    return Trial(
        trial_id=f"quiet-{number}",
        started=f"2024-05-06T{9 + number // 20:02d}:{3 * number % 60:02d}:00+00:00",
        kind="ramp_hold_retract",
        source="simulated",
        status="complete",
        sample_rate_hz=8000.0,
        position_v=quiet.position_mm,
        force_v=quiet.force_mn,
        command_v=quiet.command_mm,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0, day, {}),
        phases=tuple(Phase(*p) for p in quiet.phases),
        surface=None,
        protocol=ProtocolSummary(
            depth_mm=quiet.depth_mm,
            ramp_speed_mm_s=plan.ramp_speed_mm_s,
            hold_s=plan.hold_s,
            dwell_s=plan.dwell_s,
            approach_speed_mm_s=plan.approach_speed_mm_s,
            retract_speed_mm_s=plan.retract_speed_mm_s,
            contact_threshold_mn=plan.contact_threshold_mn,
        ),
        specimen=Specimen(
            finger="index", site=str(number), repeat=1, punch_diameter_mm=0.5, rest_s=plan.rest_s
        ),
    )
