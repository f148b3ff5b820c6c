"""The whole diagnosis of a set of trials: baseline, noise, search, alternatives, what is absorbed, confirmation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.candidates import Candidate, refit_with
from analysis.mismatch.confirm import HeldOut, held_out
from analysis.mismatch.intake import Intake
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import LEVEL
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.position_channel import PositionFinding, look_at_position
from analysis.mismatch.problem import REPEATS, Problem
from analysis.mismatch.search import Named, search
from analysis.mismatch.shared import TISSUE_PARAMETERS, Addition, Simulation
from analysis.mismatch.signatures import FEW_TRIALS, Probe, accumulate
from analysis.mismatch.single_trials import search_few
from analysis.mismatch.start import start_own, start_rigid, start_tissue
from analysis.mismatch.strays import Stray, find_strays
from analysis.mismatch.weighing import first_noise, noise_of, settled, weighed, weighs_otherwise
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, library
from analysis.simulation.mechanisms.finite_ramp import FiniteRamp

FloatArray = NDArray[np.float64]

SAME_GAIN = 0.05
ALTERNATIVES_TRIED = 6
ABSORBED_SHARE = 0.06
HIDDEN_STRENGTH = 6.0
SLIGHT = 0.01
SAME_SCATTER = 0.8
TISSUE_NAMES = frozenset(p.name for p in TISSUE_PARAMETERS)


@dataclass(frozen=True)
class Absorbed:
    """A mechanism this data can't see: what share of its signature is left, and what it would do to the tissue."""

    mechanism: Mechanism
    values: dict[str, float]
    share_left: float
    shift_percent: dict[str, float]


@dataclass(frozen=True)
class Diagnosis:
    """Everything a report says, before it is put into words.

    ``alternatives`` gives for each chosen mechanism the names of those that this data can't tell from it.
    """

    intake: Intake
    problem: Problem
    noise: NoiseModel
    named: Named
    alternatives: tuple[tuple[str, ...], ...]
    absorbed: tuple[Absorbed, ...]
    position: PositionFinding | None
    confirmed: HeldOut
    confirmed_condition: HeldOut | None
    strays: tuple[Stray, ...]

    @property
    def baseline(self) -> JointFit:
        """The fit of the baseline simulation."""
        return self.named.fits[0]

    @property
    def improved(self) -> JointFit:
        """The fit with everything that was named."""
        return self.named.fits[-1]


def diagnose(intake: Intake, *, baseline: str = "ramp", seed: int = 0) -> Diagnosis:
    """Diagnose trials: locate, name, model and confirm what the baseline simulation leaves out."""
    rng = np.random.default_rng(seed)
    trials = intake.trials
    step = baseline == "step"
    simulation = Simulation(start_tissue(trials), rigid_stiffness=start_rigid(trials), ideal_step=step)
    problem = weighed(trials, NoiseModel(first_noise(trials)))
    fit = problem.fit(simulation, start_own(trials), rounds=25)
    noise = noise_of(problem, fit)
    if step:
        problem = weighed(trials, noise)
        fit = problem.fit(fit.simulation, fit.own)
    else:
        # what repeats deviate by is asked of a simulation that has the motion right
        problem, fit, noise = settled(trials, noise, fit.simulation, fit.own)
    ramp = _finite_ramp(problem, fit, rng) if step else None
    search_all = search_few if nothing_repeats(trials) else search
    named = search_all(problem, fit if ramp is None else ramp.fit, rng)
    again = _weighed_with(problem, noise, named.fits[-1]) if named.chosen else None
    if again is not None:
        # large effects had been taken for noise: search again without them in it
        problem, noise = again
        fit = problem.fit(fit.simulation, fit.own)
        if ramp is not None:
            ramp = _finite_ramp(problem, fit, rng)
        named = search_all(problem, fit if ramp is None else ramp.fit, rng)
    if ramp is not None:
        named = replace(
            named,
            fits=(fit, *named.fits),
            chosen=(ramp, *named.chosen),
            considered=((ramp,), *named.considered),
        )
    named = drop_needless(problem, named)
    alternatives = tuple(find_alternatives(problem, named, k) for k in range(len(named.chosen)))
    confirmed, by_condition = held_out(problem, named.fits[0], named.fits[-1], rng)
    return Diagnosis(
        intake=intake,
        problem=problem,
        noise=noise,
        named=named,
        alternatives=alternatives,
        absorbed=find_absorbed(problem, named.fits[-1]),
        position=look_at_position(trials, rng),
        confirmed=confirmed,
        confirmed_condition=by_condition,
        strays=find_strays(problem, named.fits[-1]),
    )


def _weighed_with(problem: Problem, noise: NoiseModel, found: JointFit) -> tuple[Problem, NoiseModel] | None:
    """Return the trials weighed by what noise and scatter of tissues are with everything found in the simulation.

    None where they are as they were.
    """
    if problem.scatter_mn:
        anew, _, measured = settled(problem.trials, noise, found.simulation, found.own)
    else:
        measured = noise_of(problem, found)
        anew = weighed(problem.trials, measured)
    changed = weighs_otherwise(noise, measured, problem.trials[0].sample_rate_hz)
    if changed or anew.scatter_mn < SAME_SCATTER * problem.scatter_mn:
        return anew, measured
    return None


def nothing_repeats(trials: Sequence[CellTrial]) -> bool:
    """Tell whether trials are so few that none repeats another's condition, or too few to say what repeats."""
    alone = len({t.condition for t in trials}) == len(trials) < FEW_TRIALS
    return len(trials) < REPEATS or alone


def _finite_ramp(problem: Problem, fit: JointFit, rng: np.random.Generator) -> Candidate | None:
    """Return the ramp undone as a candidate, if it explains the hold better than the step does."""
    # a first simulation of the ramp from the step's tissue: the lost fast force is what the fit has to find
    refitted = problem.fit(replace(fit.simulation, ideal_step=False), fit.own, rounds=25)
    gain = fit.heldout_cost - refitted.heldout_cost
    signs = rng.integers(0, 2, size=(4999, len(gain))) * 2.0 - 1.0
    p_value = float((1 + np.sum(signs @ gain >= gain.sum() - 1e-12)) / 5000)
    if gain.sum() <= 0 or (p_value > LEVEL and len(gain) >= 8):
        return None
    marked = replace(
        refitted, simulation=replace(refitted.simulation, additions=(Addition(FiniteRamp(), {}),))
    )
    return Candidate(FiniteRamp(), marked, gain, p_value)


def drop_needless(problem: Problem, named: Named) -> Named:
    """Take out each mechanism that the others make needless."""
    if len(named.chosen) < 2:
        return named
    final = named.fits[-1]
    for k, candidate in enumerate(named.chosen[:-1]):
        if candidate.mechanism.form == "ramp":
            continue
        kept = tuple(a for a in final.simulation.additions if a.mechanism.name != candidate.mechanism.name)
        without = problem.fit(replace(final.simulation, additions=kept), final.own, rounds=8)
        gain = float((without.heldout_cost - final.heldout_cost).sum())
        spread = float(np.std(without.heldout_cost - final.heldout_cost) * np.sqrt(len(final.cost)))
        if gain < 2.0 * spread and gain < 0.1 * candidate.total_gain:
            chosen = named.chosen[:k] + named.chosen[k + 1 :]
            return drop_needless(problem, replace(named, chosen=chosen, fits=(*named.fits[:-1], without)))
    return named


def find_alternatives(problem: Problem, named: Named, k: int) -> tuple[str, ...]:
    """Return the mechanisms that explain the part of the k-th chosen one as well, as far as this data tells."""
    chosen = named.chosen[k]
    mechanism = chosen.mechanism
    if mechanism.form == "ramp":
        return ()
    final = named.fits[-1]
    present = {a.mechanism.name for a in final.simulation.additions}
    found = [n for n in mechanism.inseparable if n not in present]
    if mechanism.form != "law":
        at = next((i for i, c in enumerate(named.considered) if any(x is chosen for x in c)), 0)
        later = {c.mechanism.name: c.total_gain for c in (*named.considered, ())[at + 1]}
        for rival in named.considered[at]:
            behind = chosen.gain - rival.gain
            spread = float(np.std(behind) * np.sqrt(len(behind)))
            close = float(behind.sum()) < max(2.5 * spread, SAME_GAIN * chosen.total_gain)
            unnamed = rival.mechanism.name not in {mechanism.name, *present, *found}
            # what explains as much once the chosen one is there explained something else
            elsewhere = later.get(rival.mechanism.name, 0.0) > 0.5 * rival.total_gain
            if unnamed and close and not elsewhere and rival.total_gain > 0.5 * chosen.total_gain:
                found.append(rival.mechanism.name)
        return tuple(found)
    kept = tuple(a for a in final.simulation.additions if a.mechanism.name != mechanism.name)
    without = problem.fit(replace(final.simulation, additions=kept), final.own, rounds=6)
    gain = without.heldout_cost - final.heldout_cost
    # whoever was considered at that step, best first; their refits tell how far they come
    step = next((c for c in named.considered if any(x.mechanism.name == mechanism.name for x in c)), ())
    rivals = [c for c in step if c.mechanism.name not in present and c.mechanism.form == "law"]
    worth = [c for c in rivals if c.total_gain > 0.5 * chosen.total_gain][:ALTERNATIVES_TRIED]
    for rival in worth:
        addition = rival.fit.simulation.additions[-1]
        probe = Probe(rival.mechanism, addition.values)
        refitted = refit_with(problem, without, probe, 1.0, rounds=8)
        other = without.heldout_cost - refitted.heldout_cost
        behind = gain - other
        spread = float(np.std(behind) * np.sqrt(len(behind)))
        if rival.mechanism.name not in found and float(behind.sum()) < max(
            2.5 * spread, SAME_GAIN * float(gain.sum())
        ):
            found.append(rival.mechanism.name)
    return tuple(found)


def find_absorbed(problem: Problem, fit: JointFit) -> tuple[Absorbed, ...]:
    """Return the laws whose effect the fitted parameters can imitate so well that these trials can't show it."""
    present = {a.mechanism.name for a in fit.simulation.additions}
    probes = [
        Probe(m, _slight(m))
        for m in library().values()
        if m.form == "law"
        and m.typical
        and m.name not in present
        and any(m.applies(t) for t in problem.trials)
    ]
    if not probes:
        return ()
    signatures = accumulate(problem.trials, problem.whiteners, fit, probes)
    names = [p.name for p in fit.simulation.parameters(problem.trials)]
    found = []
    for k, probe in enumerate(probes):
        raw, left = float(signatures.raw_norm[k] / SLIGHT), float(signatures.norm[k] / SLIGHT)
        if raw < HIDDEN_STRENGTH:
            continue
        if left > ABSORBED_SHARE * raw and left > HIDDEN_STRENGTH:
            continue
        if left > 5 * HIDDEN_STRENGTH:
            continue
        shift = {
            n: 100.0 * float(signatures.absorbed[i, k]) / SLIGHT
            for i, n in enumerate(names)
            if n in TISSUE_NAMES
        }
        values = {**probe.mechanism.null, **probe.mechanism.typical}
        found.append(Absorbed(probe.mechanism, values, left / raw, shift))
    return tuple(found)


def _slight(mechanism: Mechanism) -> dict[str, float]:
    """Return the typical parameters with a hundredth of their amplitude, at which every law is linear."""
    values = {**mechanism.null, **mechanism.typical}
    name = mechanism.amplitude
    parameter = mechanism.parameter(name)
    if parameter.scale == "linear":
        values[name] = mechanism.null[name] + SLIGHT * (values[name] - mechanism.null[name])
    else:
        values[name] = parameter.from_fit(SLIGHT * parameter.to_fit(values[name]))
    return values
