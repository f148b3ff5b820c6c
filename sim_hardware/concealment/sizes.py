"""How large each effect is on a real bench: the range from which a concealed one is drawn, evenly."""

from __future__ import annotations

from collections.abc import Mapping

BENCH_SIZES: Mapping[str, tuple[float, float]] = {
    "adhesion": (2.0, 5.0),
    "coulomb_friction": (1.0, 3.0),
    "force_saturation": (5.0, 15.0),
    "parallel_dashpot": (0.3, 1.0),
    "slip": (2.0, 5.0),
    "motion_artefact": (10.0, 30.0),
    "respiration": (10.0, 30.0),
    "heartbeat": (2.0, 5.0),
    "stiffening": (0.2, 0.6),
    "third_relaxation": (0.1, 0.2),
    "force_drift": (0.1, 0.3),
    "force_lag": (1.0, 3.0),
    "arm_inertia": (0.2, 0.5),
}
"""Sizes that decide: mN, mN, mN below the largest force of the study, mN s/mm, mN, um, um, um, 1/mm, of k0,
mN/s, ms, g."""

OTHER_SIZES: Mapping[str, tuple[float, float]] = {
    "incomplete_recovery": (0.1, 0.3),
    "lever_arc": (25.0**-2, 15.0**-2),
    "lever_compliance": (0.3, 1.0),
    "mains_hum": (0.3, 1.0),
    "poroelastic_drainage": (0.15, 0.4),
    "position_crosstalk": (0.3, 1.0),
    "power_law_relaxation": (10.0, 40.0),
    "servo_bandwidth": (0.1, 0.4),
    "tremor": (1.0, 4.0),
    "viscous_friction": (0.1, 0.4),
}
"""The library's others; the arc's is 1/R^2, R 15 to 25 mm."""

OUTSIDE_SIZES: Mapping[str, tuple[float, float]] = {
    "cable_drag": (2.0, 6.0),
    "command_crosstalk": (1.5, 5.0),
    "dropped_bit": (0.003, 0.01),
    "edge_contact": (0.3, 0.7),
    "force_spikes": (3.0, 10.0),
    "gain_step": (0.03, 0.08),
    "glue_creep": (0.15, 0.5),
    "hydration": (0.3, 1.0),
    "loose_mount": (8.0, 25.0),
    "mullins": (0.05, 0.15),
    "pressed_seal": (0.02, 0.06),
    "punch_tilt": (0.02, 0.06),
    "range_jump": (2.0, 6.0),
    "servo_hunting": (1.0, 4.0),
    "skin_hair": (0.8, 3.0),
    "stick_slip": (1.5, 4.0),
    "support_resonance": (0.05, 0.2),
    "sweat_meniscus": (1.0, 4.0),
    "switching_beat": (0.3, 1.0),
    "warm_touch": (1.5, 5.0),
    "warming_tissue": (0.1, 0.3),
}
"""What no library has."""

SIZES: Mapping[str, tuple[float, float]] = {**BENCH_SIZES, **OTHER_SIZES, **OUTSIDE_SIZES}
