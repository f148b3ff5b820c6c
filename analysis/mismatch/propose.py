"""What to record next: the protocol that is predicted to separate best what these trials can't tell apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.joint import Addition, JointFit, linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.planned import PlannedTrial, planned_cells
from analysis.mismatch.report import NextExperiment, Report
from analysis.mismatch.wording import listed, spoken
from analysis.recordings import read_trial
from analysis.recordings.trial import FINGERS
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Values, library

FloatArray = NDArray[np.float64]

ENOUGH = 10.0
WORTH = 3.0
PLENTY = 30.0
MOST_ITEMS = 4
MOST_FEATURES = 3
SKIN_TRIALS = 8
SLIGHT = 0.01
TRAVEL_MM = (0.0, 9.5)
LONG_HOLD = 4.0
LONGEST_HOLD_S = 60.0
RAMP_SPEEDS_MM_S = (1.0, 5.0, 20.0)
SWEEP_SPEEDS_MM_S = (1.0, 5.0, 20.0)
SURFACES_MM = (2.0, 4.5, 7.0)
BLOCK_DEPTHS_MM = (0.004, 0.005, 0.006, 0.007, 0.008, 0.009, 0.01, 0.011, 0.012, 0.013)
"""Ten: sign-flips over trials need so many to be sure, and 13 um into a block are some 260 mN."""
BLOCK_SPEED_MM_S = 0.5
MOST_DEPTHS = 4
HINTS = {
    "rigid_target": ("rigid_target",),
    "air_sweep": ("air_sweep",),
    "ramp_speeds": ("ramp", "speed"),
    "long_hold": ("longer hold",),
    "surface_heights": ("surface heights",),
    "rests": ("rests",),
}
"""Words by which a mechanism's ``separated_by`` means a feature of a study."""


@dataclass(frozen=True)
class Item:
    """Two accounts that fit alike: ``fit`` is free to adapt, ``other`` with a tissue is what it must imitate.

    ``scale`` undoes that a signature was taken at a fraction of its typical size.
    """

    pair: tuple[str, str]
    fit: JointFit
    other: tuple[tuple[Mechanism, Values], ...]
    tissue_of: JointFit
    scale: float


@dataclass(frozen=True)
class Feature:
    """Something a study can have besides its plain trials: settings of [study], and the trials they add."""

    name: str
    words: str
    settings: dict[str, Any]
    trials: tuple[PlannedTrial, ...]
    repeated: bool = True


@dataclass(frozen=True)
class _Statistics:
    """Sums over trials from which any union of trials can be judged: J'J (P, P), J'g (P,), g'g."""

    JJ: FloatArray
    Jg: FloatArray
    gg: float

    def __add__(self, other: _Statistics) -> _Statistics:
        return _Statistics(self.JJ + other.JJ, self.Jg + other.Jg, self.gg + other.gg)

    def times(self, n: float) -> _Statistics:
        return _Statistics(n * self.JJ, n * self.Jg, n * self.gg)

    @property
    def strength(self) -> float:
        """Noise standard deviations that remain of g after everything in J was refitted."""
        absorbed = (
            self.Jg @ np.linalg.pinv(self.JJ, rcond=1e-12, hermitian=True) @ self.Jg if self.JJ.size else 0.0
        )
        return float(np.sqrt(max(self.gg - float(absorbed), 0.0)))


def propose(diagnosis: Diagnosis, report: Report, out: Path) -> NextExperiment | None:
    """Write the protocol to run next to ``out``, say what it will show; None where nothing needs separating.

    None too where the trials can't have come from this kind of lever, or nothing it can do would help.
    """
    items = _items(diagnosis, report)
    if not items or not _from_such_a_lever(diagnosis):
        return None
    base, repeats = _base(diagnosis)
    features = _features(diagnosis, base)
    rate = diagnosis.problem.trials[0].sample_rate_hz
    cells = {f.name: [planned_cells(p, rate, i) for i, p in enumerate(f.trials)] for f in (base, *features)}
    judged = {
        (f.name, i): _statistics(diagnosis, item, cells[f.name], f.trials).times(repeats if f.repeated else 1)
        for f in (base, *features)
        for i, item in enumerate(items)
    }
    _only_what_is_known_to_help(judged, items, features, base.name)
    chosen, strengths = _choose(features, judged, base.name, len(items))
    gained = [i for i in range(len(items)) if strengths[i] >= WORTH]
    if not chosen or not gained:
        return None
    out.write_text(_toml(diagnosis, base, chosen, repeats), encoding="utf-8")
    pairs = tuple(items[i].pair for i in gained)
    return NextExperiment(
        protocol=out.name,
        adds=listed([f.words for f in chosen]),
        separates=pairs,
        reason=_reason(chosen, [items[i] for i in gained], [strengths[i] for i in gained]),
        predicted_separation={" | ".join(item.pair): strengths[i] for i, item in enumerate(items)},
    )


def _items(diagnosis: Diagnosis, report: Report) -> list[Item]:
    """Return what needs separating: rivals of what was named first, then what could hide."""
    fit, found = diagnosis.improved, []
    for listed_one in report.mechanisms:
        names = [a.mechanism.name for a in fit.simulation.additions]
        place = names.index(listed_one.name) if listed_one.name in names else None
        if place is None or fit.simulation.additions[place].mechanism.form != "law":
            continue
        for name in listed_one.alternatives:
            rival = _rival(diagnosis, place, name)
            if rival is not None:
                here = tuple((a.mechanism, a.values) for a in fit.simulation.additions)
                found.append(Item((listed_one.name, name), rival, here, fit, 1.0))
    present = tuple((a.mechanism, a.values) for a in fit.simulation.additions if a.latent is None)
    named = {n for item in found for n in item.pair}
    for absorbed in diagnosis.absorbed:
        if absorbed.mechanism.name in named:
            continue
        m, values = absorbed.mechanism, dict(absorbed.values)
        p = m.parameter(m.amplitude)
        scale = 1.0 / SLIGHT
        if p.scale == "linear":
            values[m.amplitude] = m.null[m.amplitude] + SLIGHT * (values[m.amplitude] - m.null[m.amplitude])
        else:
            values[m.amplitude] = p.from_fit(SLIGHT * p.to_fit(values[m.amplitude]))
        found.append(Item((m.name, "tissue"), _without_latents(fit), (*present, (m, values)), fit, scale))
    return found[:MOST_ITEMS]


def _without_latents(fit: JointFit) -> JointFit:
    kept = tuple(a for a in fit.simulation.additions if a.latent is None)
    return replace(fit, simulation=replace(fit.simulation, additions=kept))


def _rival(diagnosis: Diagnosis, place: int, name: str) -> JointFit | None:
    """Return the fit with another mechanism in the place of a named one."""
    mechanism = library().get(name)
    if mechanism is None or mechanism.form != "law":
        return None
    fit = diagnosis.improved
    considered = [c for step in diagnosis.named.considered for c in step if c.mechanism.name == name]
    values = (
        considered[0].fit.simulation.additions[-1].values
        if considered
        else {**mechanism.null, **mechanism.typical}
    )
    start = considered[0].fit if considered else fit
    additions = list(fit.simulation.additions)
    additions[place] = Addition(mechanism, values)
    simulation = replace(start.simulation, additions=tuple(additions))
    return _without_latents(diagnosis.problem.fit(simulation, start.own, rounds=6))


def _from_such_a_lever(diagnosis: Diagnosis) -> bool:
    """Whether the trials look like this rig's: commanded, within its travel, some of them on skin."""
    trials = diagnosis.problem.trials
    inside = all(
        TRAVEL_MM[0] - 0.5 <= float(t.position_mm.min()) and float(t.position_mm.max()) <= TRAVEL_MM[1] + 0.5
        for t in trials
    )
    return (
        inside and all(t.has_command for t in trials) and any(t.kind == "ramp_hold_retract" for t in trials)
    )


def _base(diagnosis: Diagnosis) -> tuple[Feature, int]:
    """Return the plain study like the one that was recorded, and how often it is repeated."""
    skin = [j for j, t in enumerate(diagnosis.problem.trials) if t.kind == "ramp_hold_retract"]
    trials = [diagnosis.problem.trials[j] for j in skin]
    depths = sorted({round(_nominal(t, "mm", t.depth_mm), 3) for t in trials})
    if len(depths) > MOST_DEPTHS:
        depths = [depths[i] for i in np.linspace(0, len(depths) - 1, MOST_DEPTHS).round().astype(int)]
    z0 = float(np.median([diagnosis.improved.own[j].z0_mm for j in skin]))
    speed = float(np.median([_nominal(t, "mm/s", 5.0) for t in trials]))
    hold = float(np.median([_nominal(t, "s", t.hold_window_s[1] - t.hold_window_s[0]) for t in trials]))
    hold = min(max(round(hold, 2), 0.5), LONGEST_HOLD_S)
    plans = tuple(
        PlannedTrial(z0_mm=z0, depth_mm=d, ramp_speed_mm_s=speed, hold_s=hold, previous_depth_mm=max(depths))
        for d in depths
    )
    return Feature("plain", "the same again", {}, plans), max(1, int(np.ceil(SKIN_TRIALS / len(depths))))


def _nominal(trial: CellTrial, unit: str, otherwise: float) -> float:
    """Return a number of the trial's condition by its unit, as its protocol had it."""
    found = re.search(rf"([\d.e+-]+) {re.escape(unit)}(?= |$)", trial.condition)
    value = float(found.group(1)) if found else otherwise
    return value if value > 0 else max(otherwise, 0.05)


def _features(diagnosis: Diagnosis, base: Feature) -> list[Feature]:
    first = base.trials[0]
    deepest = max(base.trials, key=lambda p: p.depth_mm)
    speeds = tuple(s for s in RAMP_SPEEDS_MM_S if s != first.ramp_speed_mm_s)
    hold = min(LONG_HOLD * first.hold_s, LONGEST_HOLD_S)
    surfaces = tuple(z for z in SURFACES_MM if z + deepest.depth_mm < TRAVEL_MM[1] - 0.3)
    found = [
        Feature(
            "rigid_target",
            "a run on a rigid target",
            {"rigid_target": True, "rigid_target_depths_mm": list(BLOCK_DEPTHS_MM)},
            tuple(
                replace(first, kind="rigid_target", z0_mm=4.5, depth_mm=d, ramp_speed_mm_s=BLOCK_SPEED_MM_S,
                        approach_speed_mm_s=0.2, hold_s=2.0)
                for d in BLOCK_DEPTHS_MM
            ),
            repeated=False,
        ),
        Feature(
            "air_sweep",
            f"air sweeps at {listed([f'{s:g}' for s in SWEEP_SPEEDS_MM_S])} mm/s",
            {"air_sweep_speeds_mm_s": list(SWEEP_SPEEDS_MM_S)},
            tuple(replace(first, kind="air_sweep", ramp_speed_mm_s=s) for s in SWEEP_SPEEDS_MM_S),
            repeated=False,
        ),
        Feature(
            "ramp_speeds",
            f"ramps at {listed([f'{s:g}' for s in sorted({*speeds, first.ramp_speed_mm_s})])} mm/s",
            {"ramp_speeds_mm_s": sorted({*speeds, first.ramp_speed_mm_s})},
            tuple(replace(p, ramp_speed_mm_s=s) for s in speeds for p in base.trials),
        ),
    ]  # fmt: skip
    if hold > 1.5 * first.hold_s:
        found.append(
            Feature(
                "long_hold",
                f"a hold of {hold:g} s beside that of {first.hold_s:g} s",
                {"holds_s": [first.hold_s, hold]},
                tuple(replace(p, hold_s=hold) for p in base.trials),
            )
        )
    if len(surfaces) == len(SURFACES_MM):
        found.append(
            Feature(
                "surface_heights",
                f"the skin at three heights, {listed([f'{z:g}' for z in surfaces])} mm of travel",
                {"surface_positions_mm": list(surfaces)},
                tuple(replace(p, z0_mm=z) for z in surfaces for p in base.trials),
            )
        )
    found.append(
        Feature(
            "rests",
            "rests between 10 and 180 s in shuffled order",
            {"rest_s": [10.0, 180.0], "order": "shuffled"},
            tuple(
                replace(deepest, rest_s=r, previous_depth_mm=d)
                for r in (10.0, 60.0)
                for d in (first.depth_mm, deepest.depth_mm)
            ),
        )
    )  # fmt: skip
    return found


def _statistics(
    diagnosis: Diagnosis, item: Item, cells: Sequence[CellTrial], plans: Sequence[PlannedTrial]
) -> _Statistics:
    """Return what planned trials tell between the two accounts of an item."""
    # every trial speaks of the same shared parameters, whether it touches skin or not
    skin = [t for t in diagnosis.problem.trials if t.kind == "ramp_hold_retract"][:1]
    size = len(item.fit.simulation.vector(skin))
    JJ, Jg, gg = np.zeros((size, size)), np.zeros(size), 0.0
    for trial, plan in zip(cells, plans, strict=True):
        own = PerTrial(plan.z0_mm, 0.0)
        whitener = Whitener(trial, diagnosis.noise)
        nothing = np.zeros((len(trial.time_s), 0))
        line = linearise(trial, whitener, item.fit.simulation, own, [*skin, trial], nothing, np.zeros(0))
        other = item.tissue_of.simulation
        true = simulate_force(
            trial,
            other.tissue,
            own,
            item.other,
            rigid_stiffness=item.fit.simulation.rigid_stiffness,
            ideal_step=other.ideal_step and trial.kind == "ramp_hold_retract",
        )
        difference = whitener(true - item.fit.simulation.force_mn(trial, own))
        left, _ = project_out(line.A, np.column_stack([difference, line.J[:, :size]]))
        g, J = item.scale * left[:, 0], left[:, 1:]
        JJ, Jg, gg = JJ + J.T @ J, Jg + J.T @ g, gg + float(g @ g)
    return _Statistics(JJ, Jg, gg)


def _only_what_is_known_to_help(
    judged: dict[tuple[str, int], _Statistics], items: Sequence[Item], features: Sequence[Feature], base: str
) -> None:
    """Silence features beside those that the library names, where a rival's law fits too badly to be trusted.

    Real effects follow laws roughly: of two inseparable ones the worse fits visibly worse, and its misfit
    would pass for separation under any protocol.
    """
    for i, item in enumerate(items):
        if judged[base, i].strength <= PLENTY:
            continue
        hint = " ".join(library()[n].separated_by for n in item.pair if n in library())
        for f in features:
            if not any(word in hint for word in HINTS[f.name]):
                judged[f.name, i] = judged[f.name, i].times(0.0)


def _choose(
    features: Sequence[Feature], judged: dict[tuple[str, int], _Statistics], base: str, n_items: int
) -> tuple[list[Feature], list[float]]:
    """Add the feature that separates most, until everything is separated or nothing helps any more.

    Returns the features, and for each item what they add to the separation of the same study without them.
    """
    plain = [judged[base, i] for i in range(n_items)]

    def added(total: Sequence[_Statistics]) -> list[float]:
        pairs = zip(total, plain, strict=True)
        return [float(np.sqrt(max(t.strength**2 - p.strength**2, 0.0))) for t, p in pairs]

    chosen: list[Feature] = []
    total, gained = plain, [0.0] * n_items
    while len(chosen) < MOST_FEATURES and min(gained) < ENOUGH:
        rest = [f for f in features if f not in chosen]
        tried = [[total[i] + judged[f.name, i] for i in range(n_items)] for f in rest]
        scores = [_score(added(t)) for t in tried]
        best = int(np.argmax(scores))
        if scores[best] < _score(gained) + WORTH:
            break
        chosen.append(rest[best])
        total = tried[best]
        gained = added(total)
    return chosen, gained


def _score(gained: Sequence[float]) -> float:
    """Sum what each separation is worth: no more beyond 30 standard deviations."""
    return float(sum(min(s, PLENTY) for s in gained))


def _reason(chosen: Sequence[Feature], items: Sequence[Item], strengths: Sequence[float]) -> str:
    told = []
    for item, strength in zip(items, strengths, strict=True):
        a, b = item.pair
        other = "the fitted tissue" if b == "tissue" else spoken(b)
        told.append(f"{spoken(a)} from {other} by {sigmas(strength)}")
    return f"The study in next.toml, with {listed([f.words for f in chosen])}, would tell {listed(told)}."


def sigmas(strength: float) -> str:
    """Return a separation in words; beyond a thousand its digits mean nothing."""
    size = (
        "more than 1000" if strength > 1000.0 else f"{strength:.2g}" if strength < 10 else f"{strength:.0f}"
    )
    return f"{size} noise standard deviations"


def _toml(diagnosis: Diagnosis, base: Feature, chosen: Sequence[Feature], repeats: int) -> str:
    """Return the protocol's text."""
    import tomlkit

    first = base.trials[0]
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Proposed by the diagnosis: {listed([f.words for f in chosen])}."))
    document.add("kind", tomlkit.item("study"))
    study = tomlkit.table()
    settings: dict[str, Any] = {
        "fingers": _fingers(diagnosis),
        "depths_mm": [p.depth_mm for p in base.trials],
        "repeats": repeats,
        "rest_s": [120.0, 180.0],
    }
    for feature in chosen:
        settings.update(feature.settings)
    for key, value in settings.items():
        study.add(key, value)
    document.add("study", study)
    indentation = tomlkit.table()
    for key in ("dwell_s", "ramp_speed_mm_s", "hold_s", "retract_speed_mm_s"):
        indentation.add(key, float(getattr(first, key)))
    document.add("indentation", indentation)
    return tomlkit.dumps(document)


def _fingers(diagnosis: Diagnosis) -> list[str]:
    """Return one finger of those that were recorded: the tissue is shared by all trials of a diagnosis."""
    for trial in diagnosis.problem.trials:
        if trial.kind == "ramp_hold_retract" and Path(trial.label).is_file():
            finger = read_trial(Path(trial.label)).specimen.finger
            if finger in FINGERS:
                return [finger]
    return ["index"]
