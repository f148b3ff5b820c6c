"""What to record next: the protocol that is predicted to separate best what these trials can't tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit.study_fit import sampled_alike
from analysis.mismatch.levels import LEVEL
from analysis.mismatch.model.words import listed, spoken
from analysis.mismatch.name.finding import LOOKED_AT
from analysis.mismatch.propose.planned import planned_cells
from analysis.mismatch.propose.proposal import NextExperiment
from analysis.mismatch.propose.separation import Item, Separation, confusable, separation
from analysis.mismatch.propose.study_features import TRAVEL_MM, Feature, plain_study, study_features
from analysis.recordings import read_trial
from analysis.recordings.trial import FINGERS
from analysis.simulation.mechanism import library

ENOUGH = 10.0
WORTH = 3.0
PLENTY = 30.0
MOST_FEATURES = 3
HINTS = {
    "rigid_target": ("rigid_target",),
    "air_sweep": ("air_sweep",),
    "ramp_speeds": ("ramp", "speed"),
    "long_hold": ("longer hold",),
    "surface_heights": ("surface heights",),
    "rests": ("rests",),
}
"""Words by which a mechanism's ``separated_by`` means a feature of a study."""


def propose(diagnosis: Diagnosis, out: Path) -> NextExperiment | None:
    """Write the protocol to run next to ``out``, say what it will show; None where nothing needs separating.

    None too where the trials can't have come from this kind of lever, or nothing it can do would help.
    """
    items = confusable(diagnosis)
    trials = diagnosis.intake.trials
    rate = trials[0].sample_rate_hz
    if not items or not sampled_alike(trials) or not _from_such_a_lever(diagnosis):
        return None
    base, repeats = plain_study(diagnosis)
    features = study_features(diagnosis, base)
    cells = {f.name: [planned_cells(p, rate, i) for i, p in enumerate(f.trials)] for f in (base, *features)}
    judged = {
        (f.name, i): separation(diagnosis, item, cells[f.name], f.trials).repeated(
            repeats if f.repeated else 1
        )
        for f in (base, *features)
        for i, item in enumerate(items)
    }
    _only_what_is_known_to_help(judged, items, features, base.name)
    critical = float(np.sqrt(2.0 * np.log(LOOKED_AT / LEVEL)))
    choice = _choose(features, judged, base.name, len(items), critical)
    gained = [i for i in range(len(items)) if choice.gained[i] >= WORTH]
    if not choice.features or not gained:
        return None
    out.write_text(_toml(diagnosis, base, choice.features, repeats), encoding="utf-8")
    return NextExperiment(
        protocol=out.name,
        adds=listed([f.words for f in choice.features]),
        separates=tuple(items[i].pair for i in gained),
        reason=_reason(choice, items, gained, critical),
        predicted_separation={" | ".join(item.pair): choice.gained[i] for i, item in enumerate(items)},
        predicted_flip_statistic={" | ".join(items[i].pair): choice.flips[i] for i in gained},
        needed_flip_statistic=critical,
    )


def _from_such_a_lever(diagnosis: Diagnosis) -> bool:
    """Whether the trials look like this rig's: commanded, within its travel, some of them on skin."""
    trials = diagnosis.intake.trials
    inside = all(
        TRAVEL_MM[0] - 0.5 <= float(t.position_mm.min()) and float(t.position_mm.max()) <= TRAVEL_MM[1] + 0.5
        for t in trials
    )
    return (
        inside and all(t.has_command for t in trials) and any(t.kind == "ramp_hold_retract" for t in trials)
    )


def _only_what_is_known_to_help(
    judged: dict[tuple[str, int], Separation], items: Sequence[Item], features: Sequence[Feature], base: str
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
                judged[f.name, i] = judged[f.name, i].silenced()


@dataclass(frozen=True)
class _Choice:
    """Features to add, what they add to each item's separation (0 where no test could show it), its flip statistic."""

    features: tuple[Feature, ...]
    gained: tuple[float, ...]
    flips: tuple[float, ...]


def _choose(
    features: Sequence[Feature],
    judged: dict[tuple[str, int], Separation],
    base: str,
    n_items: int,
    critical: float,
) -> _Choice:
    """Add the feature that separates most, until everything is separated or nothing helps any more."""
    plain = [judged[base, i] for i in range(n_items)]

    def added(total: Sequence[Separation], features: Sequence[Feature]) -> list[float]:
        # beside as many plain trials: more of the same is no reason to change a study
        like_plain = len(plain[0].gg) + sum(len(judged[f.name, 0].gg) for f in features if f.repeated)
        return [
            float(np.sqrt(max(t.strength**2 - like_plain / len(p.gg) * p.strength**2, 0.0)))
            if t.can_show(critical)
            else 0.0
            for t, p in zip(total, plain, strict=True)
        ]

    chosen: list[Feature] = []
    total, gained = plain, [0.0] * n_items
    while len(chosen) < MOST_FEATURES and min(gained) < ENOUGH:
        rest = [f for f in features if f not in chosen]
        tried = [[total[i] + judged[f.name, i] for i in range(n_items)] for f in rest]
        scores = [_score(added(t, [*chosen, f])) for t, f in zip(tried, rest, strict=True)]
        best = int(np.argmax(scores))
        if scores[best] < _score(gained) + WORTH:
            break
        chosen.append(rest[best])
        total = tried[best]
        gained = added(total, chosen)
    return _Choice(tuple(chosen), tuple(gained), tuple(t.flip_statistic for t in total))


def _score(gained: Sequence[float]) -> float:
    """Sum what each separation is worth: no more beyond 30 standard deviations."""
    return float(sum(min(s, PLENTY) for s in gained))


def _reason(choice: _Choice, items: Sequence[Item], gained: Sequence[int], critical: float) -> str:
    told = []
    for i in gained:
        a, b = items[i].pair
        other = "the fitted tissue" if b == "tissue" else spoken(b)
        told.append(f"{spoken(a)} from {other} by {sigmas(choice.gained[i])}")
    words = f"The study in next.toml, with {listed([f.words for f in choice.features])}, would tell {listed(told)}."
    flips = min(choice.flips[i] for i in gained)
    if flips < critical:
        return words + " So few trials show it that their spread has to prove it: run none of them short."
    return (
        words
        + f" Turning the sign of whole trials, the test that trusts no noise, would show it: {flips:.2g} where "
        f"{critical:.2g} is needed."
    )


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
    for trial in diagnosis.intake.trials:
        if trial.kind == "ramp_hold_retract" and Path(trial.label).is_file():
            finger = read_trial(Path(trial.label)).specimen.finger
            if finger in FINGERS:
                return [finger]
    return ["index"]
