"""How each effect is made stronger or weaker, and what else about it is drawn by chance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Values = Mapping[str, float]
Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True, slots=True)
class Knob:
    """A positive number that scales an effect, and the values it stands for.

    ``values`` turns the number and what was drawn into the effect's parameters. ``start`` is where a search
    begins; ``low`` and ``high`` are its bounds.
    """

    values: Callable[[float, Values], dict[str, float]]
    start: float
    low: float
    high: float
    draw: Draw = lambda random: {}


def _of(name: str, start: float, high: float, draw: Draw | None = None, *, signed: bool = False) -> Knob:
    """Return the knob of an effect whose parameter ``name`` scales it; ``signed``: of either sign."""

    def drawn(random: np.random.Generator) -> dict[str, float]:
        found = draw(random) if draw else {}
        if signed:
            found["sign"] = float(random.choice([-1.0, 1.0]))
        return found

    def values(size: float, others: Values) -> dict[str, float]:
        given = dict(others)
        return {name: given.pop("sign", 1.0) * size, **given}

    return Knob(values, start, 1e-9, high, drawn)


def _log(name: str, *spans: tuple[float, float]) -> Draw:
    """Return a draw of one parameter, even on the logarithm over one of the spans."""

    def draw(random: np.random.Generator) -> dict[str, float]:
        low, high = spans[int(random.integers(len(spans)))]
        return {name: float(math.exp(random.uniform(math.log(low), math.log(high))))}

    return draw


def _even(**spans: tuple[float, float]) -> Draw:
    return lambda random: {name: float(random.uniform(*span)) for name, span in spans.items()}


def _mains(random: np.random.Generator) -> dict[str, float]:
    return {"frequency_hz": float(random.choice([50.0, 60.0]) * random.integers(1, 4))}


def _servo(size: float, others: Values) -> dict[str, float]:
    """Another servo: frequency and damping both move away from the nominal ones."""
    return {
        "natural_frequency_rad_s": float(np.clip(5.0e3 * math.exp(-others["slower"] * size), 100, 2e4)),
        "damping_ratio": float(np.clip(math.exp(others["damped"] * size), 0.1, 5)),
    }


def _servo_draw(random: np.random.Generator) -> dict[str, float]:
    return {"slower": float(random.choice([-0.7, 1.0])), "damped": float(random.uniform(-0.5, 0.5))}


LIBRARY: Mapping[str, Knob] = {
    "adhesion": _of("pull_off_mn", 4.0, 200.0),
    "arm_inertia": _of("mass_g", 0.5, 20.0),
    "coulomb_friction": _of("force_mn", 2.0, 100.0),
    "force_drift": _of("rate_mn_per_s", 0.2, 50.0, signed=True),
    "force_lag": _of("time_constant_ms", 2.0, 500.0),
    # how far the level lies below the largest force that a study of 0.8 mm reaches
    "force_saturation": Knob(lambda size, _: {"level_mn": 220.0 * (1 - size)}, 0.3, 1e-3, 0.9),
    "heartbeat": _of("amplitude_um", 5.0, 500.0, _even(frequency_hz=(1.0, 2.0))),
    "incomplete_recovery": _of("fraction", 0.3, 50.0, _log("time_constant_s", (40.0, 150.0))),
    # 1 / R^2
    "lever_arc": Knob(lambda size, _: {"radius_mm": size**-0.5}, 30.0**-2, 300.0**-2, 6.0**-2),
    "mains_hum": _of("amplitude_mn", 0.5, 50.0, _mains),
    "motion_artefact": _of("shift_um", 30.0, 1000.0, _even(time_s=(4.0, 7.0), share=(0.3, 0.6)), signed=True),
    "parallel_dashpot": _of("coefficient_mn_s_per_mm", 0.5, 50.0),
    "poroelastic_drainage": _of("ratio_to_k0", 0.3, 20.0, _log("time_constant_s", (0.2, 1.5))),
    "position_crosstalk": _of("gain_mn_per_mm", 0.5, 50.0, signed=True),
    "power_law_relaxation": _of("coefficient_mn_per_mm", 20.0, 5000.0, _even(exponent=(0.1, 0.4))),
    "respiration": _of("amplitude_um", 15.0, 2000.0, _even(frequency_hz=(0.2, 0.45))),
    "servo_bandwidth": Knob(_servo, 0.2, 1e-6, 2.0, _servo_draw),
    "slip": _of("drop_mn", 3.0, 200.0, _even(time_s=(5.0, 7.0))),
    "stiffening": _of("coefficient_per_mm", 0.3, 5.0),
    "third_relaxation": _of("ratio_to_k0", 0.15, 20.0, _log("time_constant_s", (0.01, 0.04), (0.4, 0.8))),
    "tremor": _of("amplitude_um", 2.0, 500.0, _even(frequency_hz=(7.5, 12.0))),
    "viscous_friction": _of("coefficient_mn_s_per_mm", 0.3, 50.0),
}
"""The library's mechanisms; `lever_compliance` stands in `ABSORBED`, `finite_ramp` is no effect."""

ABSORBED: Mapping[str, Knob] = {"lever_compliance": _of("compliance_um_per_mn", 0.5, 10.0)}

OUTSIDE: Mapping[str, Knob] = {
    "cable_drag": _of("drag_mn", 4.0, 50.0),
    "command_crosstalk": _of("coupling_mn_per_mm", 3.0, 50.0, _log("time_constant_s", (0.1, 0.6))),
    "dropped_bit": _of("share", 0.005, 1.0, lambda random: {"bit": float(random.integers(7, 11))}),
    "gain_step": _of("change", 0.05, 1.0, _even(time_s=(4.5, 6.5), share=(0.3, 0.7)), signed=True),
    "glue_creep": _of("creep_um_per_mn", 0.3, 10.0, _log("time_constant_s", (0.4, 1.0))),
    "loose_mount": _of("play_um", 15.0, 500.0, _log("seat_mn", (5.0, 12.0))),
    "servo_hunting": _of("amplitude_um", 2.0, 200.0, _log("frequency_hz", (17.0, 35.0))),
    "skin_hair": _of("force_mn", 1.5, 50.0, _log("length_um", (200.0, 400.0))),
    # a lighter support gives more
    "support_resonance": Knob(
        lambda size, drawn: {"mass_g": 1 / size, **drawn},
        0.1,
        1 / 5000,
        2.0,
        _log("frequency_hz", (40.0, 90.0)),
    ),
    "sweat_meniscus": _of("pull_mn", 2.0, 50.0, _log("length_um", (150.0, 350.0))),
    "switching_beat": _of("amplitude_mn", 0.6, 50.0, _log("wander_hz", (150.0, 500.0))),
    "warming_tissue": _of("softening", 0.08, 0.9, _log("time_constant_s", (600.0, 2400.0))),
}
