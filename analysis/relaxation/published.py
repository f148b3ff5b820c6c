"""The published study's results: Kumar, Liu, Schloerb, Srinivasan, J. Biomech. Eng. 137(6):061002 (2015)."""

from __future__ import annotations

from dataclasses import dataclass

SOURCE = "Kumar, Liu, Schloerb, Srinivasan, J. Biomech. Eng. 137(6):061002 (2015)"
DEPTHS_MM = (0.2, 0.4, 0.6, 0.8)
CURVES = 86
STIFFNESS_MN_PER_UM = 0.120  # slope of A0 over depth
LEAST_R2 = 0.95


@dataclass(frozen=True, slots=True)
class Published:
    """Mean and standard deviation over all curves."""

    mean: float
    sd: float


RESULTS = {
    "t1_s": Published(2.279, 0.233),
    "t2_s": Published(0.149, 0.022),
    "A1_over_A0": Published(0.371, 0.082),
    "A2_over_A0": Published(0.294, 0.059),
}
