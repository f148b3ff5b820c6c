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

    ``values`` turns the number and what was drawn into the effect's parameters. ``below_peak``: the number says
    how far below the largest force of the study.
    """

    values: Callable[[float, Values], dict[str, float]]
    draw: Draw = lambda random: {}
    below_peak: bool = False


def _of(name: str, draw: Draw | None = None, *, signed: bool = False) -> Knob:
    """Return the knob of an effect whose parameter ``name`` scales it; ``signed``: of either sign."""

    def drawn(random: np.random.Generator) -> dict[str, float]:
        found = draw(random) if draw else {}
        if signed:
            found["sign"] = float(random.choice([-1.0, 1.0]))
        return found

    def values(size: float, others: Values) -> dict[str, float]:
        given = dict(others)
        return {name: given.pop("sign", 1.0) * size, **given}

    return Knob(values, drawn)


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


def _both(*draws: Draw) -> Draw:
    return lambda random: {name: value for draw in draws for name, value in draw(random).items()}


def _breath(low_hz: float, high_hz: float) -> Draw:
    return _even(frequency_hz=(low_hz, high_hz), wander=(0.5, 1.5))


LIBRARY: Mapping[str, Knob] = {
    "adhesion": _of("pull_off_mn", _log("front_s_per_mm", (0.002, 0.02))),
    "arm_inertia": _of("mass_g"),
    "coulomb_friction": _of(
        "force_mn", _both(_log("presliding_um", (0.5, 5.0)), _even(stribeck=(0.0, 0.25)))
    ),
    "force_drift": _of("rate_mn_per_s", _log("bend_s", (12.0, 100.0)), signed=True),
    "force_lag": _of("time_constant_ms"),
    "force_saturation": Knob(lambda level_mn, _: {"level_mn": level_mn}, below_peak=True),
    "heartbeat": _of("amplitude_um", _breath(1.0, 2.0)),
    "incomplete_recovery": _of("fraction", _log("time_constant_s", (40.0, 150.0))),
    # 1 / R^2
    "lever_arc": Knob(lambda size, _: {"radius_mm": size**-0.5}),
    "mains_hum": _of("amplitude_mn", _mains),
    "motion_artefact": _of("shift_um", _even(time_s=(4.0, 7.0), share=(0.3, 0.6)), signed=True),
    "parallel_dashpot": _of("coefficient_mn_s_per_mm"),
    "poroelastic_drainage": _of("ratio_to_k0", _log("time_constant_s", (0.2, 1.5))),
    "position_crosstalk": _of("gain_mn_per_mm", signed=True),
    "power_law_relaxation": _of("coefficient_mn_per_mm", _even(exponent=(0.1, 0.4))),
    "respiration": _of("amplitude_um", _breath(0.2, 0.45)),
    "servo_bandwidth": Knob(_servo, _servo_draw),
    "slip": _of("drop_mn", _even(time_s=(5.0, 7.0))),
    "stiffening": _of("coefficient_per_mm"),
    "third_relaxation": _of("ratio_to_k0", _log("time_constant_s", (0.01, 0.04), (0.4, 0.8))),
    "tremor": _of("amplitude_um", _even(frequency_hz=(7.5, 12.0))),
    "viscous_friction": _of("coefficient_mn_s_per_mm"),
}
"""The library's mechanisms; `lever_compliance` stands in `ABSORBED`, `finite_ramp` is no effect."""

ABSORBED: Mapping[str, Knob] = {"lever_compliance": _of("compliance_um_per_mn")}

OUTSIDE: Mapping[str, Knob] = {
    "cable_drag": _of("drag_mn"),
    "command_crosstalk": _of("coupling_mn_per_mm", _log("time_constant_s", (0.1, 0.6))),
    "dropped_bit": _of("share", lambda random: {"bit": float(random.integers(7, 11))}),
    "edge_contact": _of("lack", _log("depth_um", (40.0, 120.0))),
    "force_spikes": _of("height_mn", _log("rate_hz", (0.5, 3.0))),
    "gain_step": _of("change", _even(time_s=(4.5, 6.5), share=(0.3, 0.7)), signed=True),
    "glue_creep": _of("creep_um_per_mn", _log("time_constant_s", (0.4, 1.0))),
    "hydration": _of("change", _log("trials", (5.0, 20.0))),
    "loose_mount": _of("play_um", _log("seat_mn", (5.0, 12.0))),
    "mullins": _of("softening"),
    "pressed_seal": _of("share"),
    "punch_tilt": _of("loss", _log("rate_hz", (0.3, 1.5))),
    "range_jump": _of("jump_mn", _log("level_mn", (30.0, 70.0)), signed=True),
    "servo_hunting": _of("amplitude_um", _log("frequency_hz", (17.0, 35.0))),
    "skin_hair": _of("force_mn", _log("length_um", (200.0, 400.0))),
    "stick_slip": _of("height_mn", _log("ridge_um", (30.0, 120.0))),
    # a lighter support gives more
    "support_resonance": Knob(
        lambda size, drawn: {"mass_g": 1 / size, **drawn}, _log("frequency_hz", (40.0, 90.0))
    ),
    "sweat_meniscus": _of("pull_mn", _log("length_um", (150.0, 350.0))),
    "switching_beat": _of("amplitude_mn", _log("wander_hz", (150.0, 500.0))),
    "warm_touch": _of("zero_mn", _log("time_constant_s", (0.6, 4.0)), signed=True),
    "warming_tissue": _of("softening", _log("time_constant_s", (600.0, 2400.0))),
}
"""What the library has not."""

KNOBS: Mapping[str, Knob] = {**LIBRARY, **ABSORBED, **OUTSIDE}

SAME_AS_A_LAW: Mapping[str, str] = {
    "cable_drag": "force_drift",
    "glue_creep": "third_relaxation",
    "skin_hair": "position_crosstalk",
}
"""Of these, what a law of the library is as well, so that its name is no wrong answer and none is asked to say
`unknown`: a spring beside a dashpot, in series with a solid of two arms, is a solid of three; a cable that is
dragged to and fro and a hair that bends are explained to 87 % and more where each trial's tissue is free."""

TAKEN_UP = ("warming_tissue",)
"""Of these, what living skin takes up whole: a stiffness that differs from trial to trial."""
