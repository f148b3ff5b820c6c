"""Sizes and tissue as they were found, against what was concealed."""

from __future__ import annotations

from dataclasses import dataclass

from rig.proof.scores import Outcome

TISSUE = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
COVERED_SIGMA = 1.96
BIASED = 0.02
"""Relative bias of the tissue from which on it is counted as biased by an effect."""
SIZES = {
    "adhesion": "pull_off_mn",
    "arm_inertia": "mass_g",
    "coulomb_friction": "force_mn",
    "force_drift": "rate_mn_per_s",
    "force_lag": "time_constant_ms",
    "force_saturation": "level_mn",
    "heartbeat": "amplitude_um",
    "incomplete_recovery": "fraction",
    "lever_arc": "radius_mm",
    "lever_compliance": "compliance_um_per_mn",
    "mains_hum": "amplitude_mn",
    "motion_artefact": "shift_um",
    "parallel_dashpot": "coefficient_mn_s_per_mm",
    "poroelastic_drainage": "ratio_to_k0",
    "position_crosstalk": "gain_mn_per_mm",
    "power_law_relaxation": "coefficient_mn_per_mm",
    "respiration": "amplitude_um",
    "servo_bandwidth": "natural_frequency_rad_s",
    "slip": "drop_mn",
    "stiffening": "coefficient_per_mm",
    "third_relaxation": "ratio_to_k0",
    "tremor": "amplitude_um",
    "viscous_friction": "coefficient_mn_s_per_mm",
}
"""The parameter that says how large a mechanism is."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """One parameter of a rightly named mechanism; ``covered``: the truth lies within 1.96 standard errors."""

    mechanism: str
    parameter: str
    truth: float
    value: float
    se: float

    @property
    def relative_error(self) -> float:
        """|value - truth| over |truth|."""
        return abs(self.value - self.truth) / abs(self.truth) if self.truth else abs(self.value)

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.value - self.truth) <= COVERED_SIGMA * self.se


def recoveries(outcome: Outcome) -> list[Recovery]:
    """Return the parameters of every rightly named mechanism that both truth and report have."""
    found = []
    for effect in outcome.truth.effects:
        for mechanism in outcome.report["mechanisms"]:
            if mechanism["name"] != effect.name:
                continue
            for name, said in mechanism["parameters"].items():
                if name in effect.parameters and said.get("se") is not None:
                    value, se = float(said["value"]), float(said["se"])
                    found.append(Recovery(effect.name, name, effect.parameters[name], value, se))
    return found


def sizes(outcome: Outcome) -> list[Recovery]:
    """Return the sizes of every rightly named mechanism."""
    return [r for r in recoveries(outcome) if r.parameter == SIZES.get(r.mechanism)]


def tissue_bias(outcome: Outcome, which: str) -> float:
    """Return the largest relative error over the tissue's five constants, of ``baseline`` or ``improved``."""
    said = outcome.report[f"{which}_parameters"]
    truth = outcome.truth.tissue
    return max(abs(float(said[name]["value"]) - truth[name]) / truth[name] for name in TISSUE if name in said)
