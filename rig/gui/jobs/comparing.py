"""A diagnosis run, and one trial beside the simulation before and after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from analysis.errors import BadInputError
from analysis.recordings.attributes import attributes_in, group_of
from analysis.recordings.folders import find_trials
from analysis.recordings.live.locking import is_locked
from analysis.recordings.opening import access, open_file
from analysis.recordings.reading import read_trial
from analysis.recordings.tables import read_phases
from analysis.recordings.trial import FloatArray, Phase
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Tissue, Values, library
from analysis.simulation.motion import estimate_motion
from analysis.simulation.reduction import reduce_trial
from rig.gui.jobs.report_file import Quantity, Report

_ENOUGH = 200
"""Trials from which the median start of a phase is taken."""

_GAIN = (0.05, 20.0)
"""How far a trial's own stiffnesses may lie from the shared ones, as factors."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One trial and both simulations, cell by cell: all (n,), time in s from the first sample, forces in mN.

    Contact point, force offset and stiffnesses of the trial's own are fitted, as skin differs from site to
    site; times and mechanisms are the report's.
    ``left_out`` names what the report found and the line "after" does not hold, with the reason.
    ``phase_starts_s`` says when each phase of the trial begins.
    """

    path: str
    time_s: FloatArray
    recorded_mn: FloatArray
    before_mn: FloatArray
    after_mn: FloatArray
    rms_before_mn: float
    rms_after_mn: float
    left_out: tuple[str, ...]
    phase_starts_s: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Offer:
    """Trials that can be compared, and when their phases begin in the median, s: a report's times mean those."""

    paths: tuple[str, ...]
    phase_starts_s: Mapping[str, float]


def run_diagnosis(paths: Sequence[Path], out: Path, baseline: str) -> Path:
    """Diagnose files and folders into ``out``; return it. Raises BadInputError as `diagnose_paths`."""
    from analysis.mismatch.diagnose import diagnose_paths

    diagnose_paths(list(paths), baseline=baseline, out=out)
    return out


def trials_to_compare(paths: Sequence[Path]) -> Offer:
    """Return the trial files that are meant, leaving out those that are being written or can't be read."""
    starts: dict[str, list[float]] = {}
    readable: list[str] = []
    for path in find_trials(paths):
        try:
            if is_locked(path):
                continue
            own = _phase_starts_s(path) if len(readable) < _ENOUGH else {}
        except (BadInputError, OSError):
            continue
        readable.append(str(path))
        for name, start_s in own.items():
            starts.setdefault(name, []).append(start_s)
    return Offer(tuple(readable), {name: float(np.median(values)) for name, values in starts.items()})


def _phase_starts_s(path: Path) -> dict[str, float]:
    with open_file(path) as file, access(path, "the file's structure"):
        signals = group_of(path, file, "signals")
        rate = attributes_in(path, signals, "/signals")["sample_rate_hz"]
        phases = read_phases(path, file, len(signals["position_v"]), clip=False)
    return _starts_s(phases, rate)


def _starts_s(phases: Sequence[Phase], sample_rate_hz: float) -> dict[str, float]:
    return {phase.name: phase.start / sample_rate_hz for phase in reversed(phases)}


def compare_trial(path: str, report: Report) -> Comparison:
    """Simulate a trial's force from its recorded motion, before and after. Raises BadInputError as the reader."""
    trial = read_trial(Path(path))
    cell = reduce_trial(trial, estimate_motion(trial), hold_only=report.baseline == "step")
    before_tissue = _tissue(path, report.baseline_parameters)
    after_tissue = _tissue(path, report.improved_parameters)
    laws, left_out = _laws(report)
    ideal_step = report.baseline == "step"
    before_mn = _fitted(cell, before_tissue, (), ideal_step=ideal_step)
    named_ramp = any(mechanism.name == "finite_ramp" for mechanism in report.mechanisms)
    after_mn = _fitted(cell, after_tissue, laws, ideal_step=ideal_step and not named_ramp)
    if not laws and report.improved_parameters == report.baseline_parameters and not named_ramp:
        after_mn = before_mn
    weights = cell.counts * cell.fitted
    return Comparison(
        path,
        cell.time_s,
        cell.force_mn,
        np.where(cell.fitted, before_mn, np.nan),
        np.where(cell.fitted, after_mn, np.nan),
        _rms(cell.force_mn - before_mn, weights),
        _rms(cell.force_mn - after_mn, weights),
        left_out,
        _starts_s(trial.phases, trial.sample_rate_hz),
    )


def _tissue(path: str, parameters: Mapping[str, Quantity]) -> Tissue:
    names = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
    missing = [name for name in names if name not in parameters]
    if missing:
        raise BadInputError(f"{path}: the report lacks {missing[0]}: no simulation can be drawn from it")
    return Tissue(*(parameters[name].value for name in names))


def _laws(report: Report) -> tuple[tuple[tuple[Mechanism, Values], ...], tuple[str, ...]]:
    """Return the laws of the report with their parameters, and what can't be drawn from a report."""
    laws: list[tuple[Mechanism, Values]] = []
    left_out = []
    for found in report.mechanisms:
        known = library().get(found.name)
        spoken = found.name.replace("_", " ")
        if known is None:
            left_out.append(f"{spoken}: this version's library does not know it")
        elif known.form == "law":
            stated = {name: quantity.value for name, quantity in found.parameters.items()}
            names = {parameter.name for parameter in known.parameters}
            laws.append(
                (known, {**known.null, **known.typical, **{k: v for k, v in stated.items() if k in names}})
            )
        elif known.form != "ramp":
            left_out.append(f"{spoken}: it has a time or phase of its own in every trial")
    return tuple(laws), tuple(left_out)


def _fitted(
    cell: CellTrial, tissue: Tissue, laws: tuple[tuple[Mechanism, Values], ...], *, ideal_step: bool
) -> FloatArray:
    """Return the simulated force (n,) mN with what belongs to the trial fitted.

    That is its contact point, offset and stiffnesses, and the play of each law that a report does not state.
    """
    weights = np.sqrt(cell.counts) * cell.fitted
    inner = [(i, p) for i, (law, _) in enumerate(laws) for p in law.parameters if p.inner]

    def simulated(own: FloatArray) -> FloatArray:
        z0_mm, offset_mn, *gains = own[:5].tolist()
        mine = Tissue(
            gains[0] * tissue.k0, gains[1] * tissue.k1, tissue.tau1, gains[2] * tissue.k2, tissue.tau2
        )
        values = [dict(stated) for _, stated in laws]
        for (i, parameter), fitted in zip(inner, own[5:].tolist(), strict=True):
            values[i][parameter.name] = parameter.from_fit(fitted)
        added = [(law, mine_of_law) for (law, _), mine_of_law in zip(laws, values, strict=True)]
        return simulate_force(cell, mine, PerTrial(z0_mm, offset_mn), added, ideal_step=ideal_step)

    def missed(own: FloatArray) -> FloatArray:
        return weights * (simulated(own) - cell.force_mn)

    play = [parameter.to_fit(laws[i][1][parameter.name]) for i, parameter in inner]
    bounds = [sorted((p.to_fit(p.lower), p.to_fit(p.upper))) for _, p in inner]
    found = least_squares(
        missed,
        np.array([cell.z0_start_mm, cell.offset_start_mn, 1.0, 1.0, 1.0, *play]),
        x_scale=np.array([0.01, 1.0, 0.1, 0.1, 0.1, *[0.3] * len(inner)]),
        bounds=(
            [-np.inf, -np.inf, *[_GAIN[0]] * 3, *(low for low, _ in bounds)],
            [np.inf, np.inf, *[_GAIN[1]] * 3, *(high for _, high in bounds)],
        ),
        max_nfev=40,
    )
    return simulated(found.x)


def _rms(residual_mn: FloatArray, weights: FloatArray) -> float:
    return float(np.sqrt(np.sum(weights * residual_mn**2) / max(float(np.sum(weights)), 1.0)))
