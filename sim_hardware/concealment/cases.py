"""Concealed cases: which effects a bench hides, how large, on what skin and with what noise; drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from sim_hardware.concealment.drawn import drawn_skin
from sim_hardware.concealment.knobs import ABSORBED, KNOBS, LIBRARY, OUTSIDE, SAME_AS_A_LAW, TAKEN_UP
from sim_hardware.concealment.plans import TrialPlan, study_plans
from sim_hardware.concealment.sizes import BENCH_SIZES, SIZES
from sim_hardware.concealment.strength import peak_mn, strength, tissue_of
from sim_hardware.effects import EFFECTS
from sim_hardware.settings import (
    BenchSettings,
    ConstantsSettings,
    ConverterSettings,
    EffectSettings,
    NoiseSettings,
    SpecimenSettings,
    TissueSettings,
)

Kind = Literal["null", "single", "pair", "triple", "outside", "absorbed"]
Noise = Literal["white", "correlated", "wandering", "one_over_f", "heavy_tails", "stepwise"]
Skin = Literal["published", "living", "shared", "drawn"]

NOISES: Mapping[Noise, NoiseSettings] = {
    "white": NoiseSettings(force_mn_rms=0.25),
    "correlated": NoiseSettings(force_mn_rms=0.28, correlated_share=0.5, correlation_ms=15.0),
    "wandering": NoiseSettings(force_mn_rms=0.2, wander_mn_rms=0.15, wander_time_s=4.0),
    "one_over_f": NoiseSettings(force_mn_rms=0.2, one_over_f_mn_rms=0.2),
    "heavy_tails": NoiseSettings(force_mn_rms=0.2, tail_degrees_of_freedom=5.0),
    "stepwise": NoiseSettings(force_mn_rms=0.2, correlated_share=0.2, correlation_ms=10.0),
}
"""The last is that of a bench whose output is held from sample to sample."""

SKINS: Mapping[Skin, tuple[SpecimenSettings, float]] = {
    "published": (SpecimenSettings(), 0.0),
    "living": (SpecimenSettings(finger_variation=0.10, site_variation=0.10), 0.10),
    "shared": (SpecimenSettings(finger_variation=0.0, site_variation=0.0), 0.02),
}
"""What lies under the punch, and the relative standard deviation of the sensor's gain from trial to trial.

``drawn`` skin is another one in every case."""

KINDS: tuple[Kind, ...] = ("null", "single", "pair", "outside", "single", "absorbed", "null", "single")
TISSUE = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
"""The five constants as a diagnosis names them, tau1 the longer time."""
_NOT_TOGETHER = (
    {"third_relaxation", "poroelastic_drainage", "power_law_relaxation"},  # one shape in one study
    {"parallel_dashpot", "force_lag", "viscous_friction", "coulomb_friction"},  # inseparable at one speed
    {"stiffening", "lever_arc", "edge_contact"},
)


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
    """A bench and what it conceals; ``tissue``: its five constants, geometric means over the study's trials."""

    number: int
    kind: Kind
    noise: Noise
    skin: Skin
    settings: BenchSettings
    hidden: tuple[Hidden, ...]
    tissue: Mapping[str, float]

    def truth(self) -> dict[str, object]:
        """Return what is sealed, as plain data."""
        return {**asdict(self), "settings": self.settings.model_dump(mode="json")}


def draw_cases(
    n: int, seed: int, plans: Sequence[TrialPlan], *, kinds: Sequence[Kind] = KINDS, skin: Skin = "published"
) -> list[Case]:
    """Draw cases of all kinds in turn."""
    random = np.random.default_rng([seed, 11])
    names, outside = list(LIBRARY), outsiders(skin)
    random.shuffle(names)
    random.shuffle(outside)
    cases = []
    singles = strangers = 0
    for i in range(n):
        kind = kinds[i % len(kinds)]
        chosen: tuple[str, ...] = ()
        if kind == "single":
            chosen, singles = (names[singles % len(names)],), singles + 1
        elif kind in ("pair", "triple"):
            chosen = draw_together(random, 2 if kind == "pair" else 3, names)
        elif kind == "outside":
            chosen, strangers = (outside[strangers % len(outside)],), strangers + 1
        elif kind == "absorbed":
            chosen = (str(random.choice(list(ABSORBED))),)
        noise: Noise = list(NOISES)[int(random.integers(len(NOISES)))]
        drawn = int(random.integers(2**31))
        cases.append(draw_case(i, kind, chosen, noise, skin, seed=drawn, plans=plans))
    return cases


def outsiders(skin: Skin) -> list[str]:
    """Return the effects of which `unknown` is the right thing to say on a skin."""
    taken_up = () if skin == "shared" else TAKEN_UP
    return [name for name in OUTSIDE if name not in SAME_AS_A_LAW and name not in taken_up]


def draw_together(
    random: np.random.Generator, n: int, names: Sequence[str] = tuple(BENCH_SIZES)
) -> tuple[str, ...]:
    """Draw mechanisms that one experiment can tell from each other."""
    while True:
        chosen = {str(name) for name in random.choice(list(names), n, replace=False)}
        if all(len(chosen & alike) < 2 for alike in _NOT_TOGETHER):
            return tuple(sorted(chosen))


def draw_case(
    number: int,
    kind: Kind,
    names: Sequence[str],
    noise: Noise = "white",
    skin: Skin = "living",
    *,
    seed: int,
    plans: Sequence[TrialPlan] = (),
) -> Case:
    """Draw one case: its bench, and the named effects, each of a size that benches have.

    ``plans`` is the study that will be recorded (empty: the published one): over it strengths are told, and a
    saturation lies below its largest force.
    """
    random = np.random.default_rng([seed, 12])
    study = tuple(plans) or tuple(study_plans())
    specimens, gain_jitter, tissue = drawn_skin(seed) if skin == "drawn" else (*SKINS[skin], TissueSettings())
    # as after a perfect calibration: what is left of the tissue's bias is the diagnosis's own
    bench = BenchSettings(
        seed=seed,
        time="virtual",
        tissue=tissue,
        specimens=specimens,
        noise=NOISES[noise].model_copy(update={"gain_jitter": gain_jitter}),
        converters=ConverterSettings(stepwise_output=noise == "stepwise"),
        constants=ConstantsSettings(spread=0.0, zero_spread_v=0.0),
    )
    peak = peak_mn(bench, study)
    hidden, effects = [], []
    for name in names:
        knob, size = KNOBS[name], float(random.uniform(*SIZES[name]))
        drawn, rough = knob.draw(random), float(random.uniform(0.5, 1.0))
        given = knob.values(peak - size if knob.below_peak else size, drawn)
        effect = EffectSettings.model_validate({"name": name, **given, "rough": rough})
        effects.append(effect)
        kind_of = EFFECTS[name]
        told = {k: float(str(v)) for k, v in effect.given.items()}
        reached = strength(bench, (effect,), study)
        hidden.append(Hidden(name, kind_of.in_library, told, kind_of.phases, reached))
    settings = bench.model_copy(update={"effects": tuple(effects)})
    means = dict(zip(TISSUE, tissue_of(bench, study), strict=True))
    return Case(number, kind, noise, skin, settings, tuple(hidden), means)
