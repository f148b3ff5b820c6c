"""Concealed cases: which effects a bench hides, how strong, and with what noise; drawn from a seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from sim_hardware.concealment.knobs import ABSORBED, LIBRARY, OUTSIDE
from sim_hardware.concealment.plans import TrialPlan, study_plans
from sim_hardware.concealment.strength import strength
from sim_hardware.effects import EFFECTS
from sim_hardware.settings import BenchSettings, ConstantsSettings, EffectSettings, NoiseSettings
from sim_hardware.world.specimens import finger

Kind = Literal["null", "single", "pair", "outside", "absorbed"]
Noise = Literal["white", "correlated", "wandering", "gain_jitter"]

RUNGS = (3.0, 5.0, 8.0, 12.0, 20.0, 50.0, 100.0, 300.0, 1000.0)
NOISES: Mapping[Noise, NoiseSettings] = {
    "white": NoiseSettings(),
    "correlated": NoiseSettings(correlated_share=0.3, correlation_ms=3.0),
    "wandering": NoiseSettings(wander_mn_rms=0.15, wander_time_s=4.0),
    "gain_jitter": NoiseSettings(gain_jitter=0.01),
}
KINDS: tuple[Kind, ...] = ("null", "single", "pair", "outside", "single", "absorbed", "null", "single")
_CLOSE = 0.05
_STEPS = 10
_NONE = 1e-3
_SAME_SHAPE = {"third_relaxation", "poroelastic_drainage"}


@dataclass(frozen=True, slots=True)
class Hidden:
    """One concealed effect: name, parameters, where it shows, and its strength by itself."""

    name: str
    in_library: bool
    parameters: Mapping[str, float]
    phases: tuple[str, ...]
    strength: float


@dataclass(frozen=True, slots=True)
class Case:
    """A bench and what it conceals; ``rung`` is the strength that was asked for (0: none)."""

    number: int
    kind: Kind
    rung: float
    noise: Noise
    settings: BenchSettings
    hidden: tuple[Hidden, ...]

    def truth(self) -> dict[str, object]:
        """Return what is sealed, as plain data."""
        return {
            "number": self.number,
            "kind": self.kind,
            "rung": self.rung,
            "noise": self.noise,
            "tissue": true_tissue(self.settings),
            "hidden": [asdict(h) for h in self.hidden],
            "settings": self.settings.model_dump(mode="json"),
        }


def true_tissue(settings: BenchSettings, name: str = "index") -> dict[str, float]:
    """Return the five constants of a finger of this bench, named as a diagnosis names them."""
    parts = finger(settings, name, "1", 1).parts
    slow, fast = sorted(parts.arms, key=lambda arm: -arm.time_s)
    return {
        "k0_mn_per_mm": parts.k0_mn_per_mm,
        "k1_mn_per_mm": slow.stiffness_mn_per_mm,
        "tau1_s": slow.time_s,
        "k2_mn_per_mm": fast.stiffness_mn_per_mm,
        "tau2_s": fast.time_s,
    }


def draw_cases(n: int, seed: int, kinds: Sequence[Kind] = KINDS) -> list[Case]:
    """Draw cases of all kinds in turn, the strengths of single effects up the ladder."""
    random = np.random.default_rng([seed, 11])
    names = list(LIBRARY)
    random.shuffle(names)
    cases = []
    single = 0
    for i in range(n):
        kind = kinds[i % len(kinds)]
        rung = 0.0
        chosen: tuple[str, ...] = ()
        if kind == "single":
            chosen, rung = (names[single % len(names)],), RUNGS[(4 * single + 2) % len(RUNGS)]
            single += 1
        elif kind == "pair":
            chosen, rung = draw_pair(random), float(random.choice(RUNGS[4:8]))
        elif kind == "outside":
            chosen, rung = (str(random.choice(list(OUTSIDE))),), float(random.choice(RUNGS[4:8]))
        elif kind == "absorbed":
            chosen = (str(random.choice(list(ABSORBED))),)
        noise: Noise = list(NOISES)[int(random.integers(len(NOISES)))] if kind == "null" else "white"
        cases.append(draw_case(i, kind, chosen, rung, noise, seed=int(random.integers(2**31))))
    return cases


def draw_pair(random: np.random.Generator) -> tuple[str, str]:
    """Draw two mechanisms of the library that one experiment can tell from each other."""
    names = list(LIBRARY)
    while True:
        first, second = random.choice(len(names), 2, replace=False)
        pair = names[first], names[second]
        if set(pair) != _SAME_SHAPE:
            return pair


def draw_case(
    number: int,
    kind: Kind,
    names: Sequence[str],
    rung: float,
    noise: Noise = "white",
    *,
    seed: int,
    plans: Sequence[TrialPlan] = (),
) -> Case:
    """Draw one case: its bench, the named effects, each by itself of strength ``rung`` (0: as it usually is).

    Strength is that over ``plans``, the study that will be recorded (empty: the published one), since some effects
    live in few of its trials. It comes within 5 % of the rung where an effect's range allows it; what was reached
    is kept.
    """
    random = np.random.default_rng([seed, 12])
    study = tuple(plans) or tuple(study_plans())
    # as after a perfect calibration: what is left of the tissue's bias is the diagnosis's own
    known = ConstantsSettings(spread=0.0, zero_spread_v=0.0)
    bench = BenchSettings(seed=seed, time="virtual", noise=NOISES[noise], constants=known)
    hidden, effects = [], []
    for name in names:
        effect, reached = _of_strength(bench, name, rung, random, study)
        effects.append(effect)
        kind_of = EFFECTS[name]
        given = {k: float(str(v)) for k, v in effect.given.items()}
        hidden.append(Hidden(name, kind_of.in_library, given, kind_of.phases, reached))
    settings = bench.model_copy(update={"effects": tuple(effects)})
    return Case(number, kind, rung, noise, settings, tuple(hidden))


def _of_strength(
    bench: BenchSettings, name: str, rung: float, random: np.random.Generator, plans: tuple[TrialPlan, ...]
) -> tuple[EffectSettings, float]:
    """Return an effect whose strength is near the rung, and its strength: secants on logarithms."""
    knob = {**LIBRARY, **ABSORBED, **OUTSIDE}[name]
    drawn, rough = knob.draw(random), float(random.uniform(0.5, 1.0))

    def effect(size: float) -> EffectSettings:
        return EffectSettings.model_validate({"name": name, **knob.values(size, drawn), "rough": rough})

    def kept(size: float) -> float:
        return min(max(size, knob.low), knob.high)

    size = knob.start
    reached = strength(bench, (effect(size),), plans)
    if rung == 0:
        return effect(size), reached
    slope = 1.0
    below, above = knob.low, knob.high
    best = (abs(math.log(max(reached, _NONE) / rung)), size, reached)
    for _ in range(_STEPS):
        if best[0] < _CLOSE:
            break
        below, above = (max(size, below), above) if reached < rung else (below, min(size, above))
        following = size * math.exp(math.log(rung / max(reached, _NONE)) / slope)
        if not below < following < above:
            following = math.sqrt(below * above) if knob.low < below or above < knob.high else kept(following)
        if math.isclose(following, size, rel_tol=1e-6):
            break
        now = strength(bench, (effect(following),), plans)
        if min(now, reached) > _NONE:
            slope = min(max(math.log(now / reached) / math.log(following / size), 0.3), 6.0)
        size, reached = following, now
        best = min(best, (abs(math.log(max(reached, _NONE) / rung)), size, reached))
    return effect(best[1]), best[2]
