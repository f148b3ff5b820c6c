"""What the bench is made of: the mechanical parts that the world integrates, and a block of its signals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SAMPLE_RATE_HZ = 8000.0


@dataclass(frozen=True, slots=True)
class Arm:
    """A Maxwell arm: a spring in series with a dashpot.

    ``stiffness_mn_per_mm`` may be negative where a sum of arms stands for a kernel that overshoots its ends.
    """

    stiffness_mn_per_mm: float
    time_s: float


@dataclass(frozen=True, slots=True)
class Memory:
    """What the tissue has not forgotten: fluid that was pressed out fast and flows back slowly.

    While the punch presses, a part y of the depression sets with ``setting_s``; it recovers with ``time_s``.
    The next contact, also at a neighbouring site, starts with a load of -``mn_per_mm`` * y that goes on
    recovering with ``time_s``; a neighbouring site feels the share ``neighbour``.
    """

    mn_per_mm: float
    setting_s: float
    time_s: float
    neighbour: float


@dataclass(frozen=True, slots=True)
class Parts:
    """The mechanical parts between command and force sensor, as they are for one specimen.

    An effect replaces some of them. Everything optional is absent by default.

    Attributes:
        natural_frequency_rad_s, damping_ratio: the servo of the lever.
        command_lag_s: a pole in front of the servo (0 = none).
        compliance_mm_per_mn: spring between motor and tip.
        creep_compliance_mm_per_mn, creep_time_s: a spring beside a dashpot in series with the tip.
        slack_mm, slack_force_mn: play of the mount, taken up by F / (F + slack_force).
        k0_mn_per_mm, arms, memory: the tissue's spring, its Maxwell arms, its slow memory (None: none).
        dashpot_mn_s_per_mm: dashpot beside them.
        stiffening_per_mm, stiffening_growth: b and g of the elongation that drives spring and arms,
            e(d) = d + b d^2 + g (2/3 b^2 d^3 + 1/3 b^3 d^4); with g = 1 the start of an exponential.
        exponent, reference_mm: p and r of an elongation r (d / r)^p instead (1: none).
        pull_off_mn, peel_mm, peel_mn_s_per_mm: what the skin clings with, over which opening the bond
            peels (0 = it snaps at once), and the viscosity of the peeling front.
        support_mass_g, support_mn_per_mm, support_damping_ratio: what the specimen lies on (0 g = rigid).
    """

    natural_frequency_rad_s: float = 5.0e3
    damping_ratio: float = 1.0
    command_lag_s: float = 0.0
    compliance_mm_per_mn: float = 0.0
    creep_compliance_mm_per_mn: float = 0.0
    creep_time_s: float = 1.0
    slack_mm: float = 0.0
    slack_force_mn: float = 1.0
    k0_mn_per_mm: float = 120.0
    arms: tuple[Arm, ...] = ()
    memory: Memory | None = None
    dashpot_mn_s_per_mm: float = 0.0
    stiffening_per_mm: float = 0.0
    stiffening_growth: float = 0.0
    exponent: float = 1.0
    reference_mm: float = 0.4
    pull_off_mn: float = 0.0
    peel_mm: float = 0.0
    peel_mn_s_per_mm: float = 0.0
    support_mass_g: float = 0.0
    support_mn_per_mm: float = 0.0
    support_damping_ratio: float = 0.05


@dataclass(slots=True)
class Block:
    """A block of the world's signals on its way through the effects.

    Arrays named ``fine_`` have n * m elements (m fine steps a sample), the last of each m at the sample's
    instant; the others have n. ``force_mn`` is what the sensor is about to report; effects change it.

    Attributes:
        time_s: bench time, (n,).
        trial_time_s: time since the trial began, negative before, (n,).
        step_s, substeps: length of a fine step, s, and how many make a sample.
        touched_s: trial time of the first touch, infinite before; of use from half a second after it on,
            since a block does not know what happens within itself.
        skin: True where the specimen is a finger.
        command_mm: where the motor was told to be, (n,).
        fine_position_mm, fine_velocity_mm_s, fine_acceleration_mm_s2: the motor.
        fine_tip_mm: the punch.
        fine_gap_mm: punch above (positive) or below the undisturbed surface.
        fine_force_mn: force on the punch.
    """

    time_s: FloatArray
    trial_time_s: FloatArray
    step_s: float
    substeps: int
    touched_s: float
    skin: bool
    command_mm: FloatArray
    fine_position_mm: FloatArray
    fine_velocity_mm_s: FloatArray
    fine_acceleration_mm_s2: FloatArray
    fine_tip_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    fine_gap_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    fine_force_mn: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def fine_trial_time_s(self) -> FloatArray:
        """Time since the trial began at the fine steps, (n * m,), s."""
        within = np.arange(1 - self.substeps, 1) * self.step_s
        return (self.trial_time_s[:, None] + within).ravel()

    @property
    def position_mm(self) -> FloatArray:
        """Motor position at the samples, (n,), mm."""
        return self.fine_position_mm[self.substeps - 1 :: self.substeps]

    @property
    def velocity_mm_s(self) -> FloatArray:
        """Motor velocity at the samples, (n,), mm/s."""
        return self.fine_velocity_mm_s[self.substeps - 1 :: self.substeps]

    @property
    def contact_force_mn(self) -> FloatArray:
        """Force on the punch at the samples, (n,), mN."""
        return self.fine_force_mn[self.substeps - 1 :: self.substeps]
