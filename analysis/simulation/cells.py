"""A trial in cells: averages over few samples where things happen and over many where little does."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.converter import Levels
from analysis.simulation.response import Steps
from analysis.simulation.samples import NEIGHBOURS, kept_by_mean, winsorised

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOVING_MM_S, MOVING_SHARE = 0.05, 0.05
"""Speed from which the arm moves: of a slow instrument this share of the largest in the trial."""
TRAVEL_MIDDLE_MM = 5.0
RIGID_STIFFNESS_MN_PER_MM = 1.0e4
AWAY_S = 0.1
"""Distance from motion, and from what happened, of what is at rest."""
SETTLED_S = 0.005
"""How long a servo takes to end a motion."""


@dataclass(frozen=True, eq=False)
class CellMotion:
    """How an arm moves from cell to cell: velocity (n,), mm/s, and the cells' lengths (n,), s. Equal to itself only."""

    velocity_mm_s: FloatArray
    widths_s: FloatArray


@dataclass(frozen=True, eq=False)
class CellPath:
    """Where a tip was in every cell (n,), as in a trial, by what of the recorded position is taken for noise."""

    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    position_error_mm: FloatArray
    position_noise_mm: float
    beside_servo_mm: FloatArray


@dataclass(frozen=True)
class CellTrial:
    """One trial in n cells; every other array is (n,).

    ``full_force_mn`` and ``full_servo_residual_mm`` (N,) keep every sample, taken at ``uneven_s`` (N,) where they are
    not evenly spaced. ``starts`` is the first sample of each cell and ``counts`` how many it has; ``time_s`` are the
    cells' centres, counted from the trial's first sample;
    ``position_mm``, ``velocity_mm_s``, ``acceleration_mm_s2``, ``shake_mm_s2`` (n, 2) the smoothed motion; ``force_mn``
    and ``servo_residual_mm`` (recorded position less the nominal servo's) plain averages of what was recorded;
    ``servo_signature_mm`` (n, 2) the change of the servo's position by ln(natural frequency) and ln(damping);
    ``phase`` indexes PHASE_NAMES (-1: none).
    ``condition`` is what was stated of the trial, and which of the motions that were run so is its own.
    ``pressed_before`` is the indentation before this one, where it is known: its depth (mm), and how long before the
    first sample it ended (s). ``study_depth_mm`` is the largest depth of all trials that are compared (in the air: the
    travel). ``lever`` tells whether the tip is that of a lever arm. ``finger`` is whose and which finger,
    ``site`` where on it, as far as was stated. ``punch_ratio`` is the diameter of its flat punch over the study's.
    ``late_samples`` is how much later the position was read than its servo answered. ``levels`` are those to which a
    coarse converter rounded the force. ``position_error_mm`` is what smoothing left of the position's noise
    ``position_noise_mm``, ``beside_servo_mm`` what of the position no servo explains.
    ``louder`` is how much louder than at rest its white noise is, where that grows with force.
    ``if_noise_lasts`` is where the tip was if what wanders beside a servo's answer is the sensor's; None if that is
    nothing else.
    """

    label: str
    kind: str
    condition: str
    order: int
    sample_rate_hz: float
    starts: IntArray
    counts: FloatArray
    full_force_mn: NDArray[np.float32]
    full_servo_residual_mm: NDArray[np.float32]
    time_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    shake_mm_s2: FloatArray
    command_mm: FloatArray
    force_mn: FloatArray
    servo_residual_mm: FloatArray
    servo_signature_mm: FloatArray
    phase: IntArray
    z0_start_mm: float
    offset_start_mn: float
    depth_mm: float
    has_command: bool
    pressed_before: tuple[float, float] | None = None
    target_stiffness_mn_per_mm: float | None = None
    study_depth_mm: float = 1.0
    lever: bool = True
    finger: str = ""
    site: str = ""
    punch_ratio: float = 1.0
    levels: Levels | None = None
    position_error_mm: FloatArray | None = None
    position_noise_mm: float = 0.0
    beside_servo_mm: FloatArray | None = None
    if_noise_lasts: CellPath | None = None
    fitted: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    uneven_s: FloatArray | None = None
    late_samples: float = 0.0
    louder: FloatArray | None = None

    @cached_property
    def full_time_s(self) -> FloatArray:
        """When every sample was taken, (N,)."""
        if self.uneven_s is not None:
            return self.uneven_s
        return np.arange(len(self.full_force_mn)) / self.sample_rate_hz

    @cached_property
    def edges_s(self) -> FloatArray:
        """Where cells begin and the last ends (n + 1,), s: midway between the samples about it."""
        t, later = self.full_time_s, self.starts[1:]
        between = 0.5 * (t[later] + t[later - 1])
        return np.concatenate([[1.5 * t[0] - 0.5 * t[1]], between, [1.5 * t[-1] - 0.5 * t[-2]]])

    @cached_property
    def at_rest(self) -> NDArray[np.bool_]:
        """Which samples (N,) are away from motion."""
        return ~near(self.full_time_s, self.time_s[moves(self.velocity_mm_s)])

    @cached_property
    def steady(self) -> NDArray[np.bool_]:
        """Which samples (N,) are off their neighbours as noise only: the arm rests, and contact does not end there.

        Where a motion ends the force turns within a sample, but not beyond.
        """
        moving, t = moves(self.velocity_mm_s), self.full_time_s
        beside = maximum_filter1d(np.repeat(moving, self.counts.astype(np.int64)), 2 * NEIGHBOURS + 1)
        leaves = self.time_s[moving & self.retracting]
        return np.asarray(~beside & ~near(t, self.time_s[moving], SETTLED_S) & ~near(t, leaves))

    def cell_means(self, force_mn: FloatArray) -> FloatArray:
        """Return the mean (n,) of a force (N,) in each cell; no steady sample is further off than noise.

        What a coarse converter made of it is undone.
        """
        kept_mn = winsorised(force_mn, self.steady, self.levels.apart_mn if self.levels else 0.0)
        means_mn = np.add.reduceat(kept_mn, self.starts) / self.counts
        if self.levels is None:
            return means_mn
        return self.levels.before_rounding(means_mn, self.counts)

    def read_at_samples(self, force_mn: FloatArray) -> FloatArray:
        """Return what is read on average at every sample (N,) of a force that has these averages (n,) in the cells."""
        at_samples_mn = self.at_samples(force_mn)
        return at_samples_mn if self.levels is None else self.levels.mean_read(at_samples_mn)

    def at_samples(self, cells: FloatArray) -> FloatArray:
        """Return at every sample (N,) what has these averages (n,) in the cells, smoothly.

        It is the slope of a cubic spline through its integral. Lines between the averages would take four hundredths
        from what comes ten times in a second, and leave them in a residual.
        """
        integral = np.append(0.0, np.cumsum(cells * np.diff(self.edges_s)))
        found = CubicSpline(self.edges_s, integral)(self.full_time_s, 1)
        alone = self.counts == 1
        found[self.starts[alone]] = cells[alone]
        return np.asarray(found)

    def as_loud_as_rest(self, samples: FloatArray) -> FloatArray:
        """Return noise (N,) as it were if it did not grow with force."""
        return samples if self.louder is None else samples / np.repeat(self.louder, self.counts.astype(int))

    def span_s(self, cells: IntArray) -> tuple[float, float]:
        """Return when the first of these cells begins and the last ends, s from the trial's first sample."""
        first, last = cells[0], cells[-1]
        half_s = 0.5 * self.widths_s
        return float(self.time_s[first] - half_s[first]), float(self.time_s[last] + half_s[last])

    @cached_property
    def widths_s(self) -> FloatArray:
        """How long the samples of each cell took, (n,)."""
        if self.uneven_s is None:
            return self.counts / self.sample_rate_hz
        last = self.starts + self.counts.astype(np.int64) - 1
        return np.asarray(self.uneven_s[last] - self.uneven_s[self.starts] + 1.0 / self.sample_rate_hz)

    @cached_property
    def motion(self) -> CellMotion:
        """The motion of the arm."""
        return CellMotion(self.velocity_mm_s, self.widths_s)

    @cached_property
    def fitted_widths_s(self) -> tuple[FloatArray, IntArray]:
        """The few lengths that fitted cells have (K,), s, and which of them each has."""
        widths_s, which = np.unique(self.widths_s[self.fitted], return_inverse=True)
        return widths_s, which.astype(np.int64)

    @property
    def touches(self) -> bool:
        """Whether anything is below the arm in this trial."""
        return self.kind != "air_sweep"

    @property
    def begins_mm(self) -> float:
        """Where the trial begins: before contact, by what a trial is (mm)."""
        return float(self.position_mm[0])

    @cached_property
    def highest_contact_mm(self) -> float:
        """Above which nothing can be touched (mm): where the approach begins; what has none may begin in contact."""
        return self.begins_mm if self.in_phase("approach").any() else -np.inf

    @property
    def frees_offset(self) -> bool:
        """Whether the offset is fitted: a hold by itself can't tell it from the stiffness, so there it is measured."""
        return bool(self.fitted.all())

    def in_phase(self, *names: str) -> NDArray[np.bool_]:
        """Mask (n,) of the cells of a phase, or of several."""
        return np.asarray(np.logical_or.reduce([self.phase == PHASE_NAMES.index(name) for name in names]))

    @cached_property
    def angle_travel_mm(self) -> FloatArray:
        """Lever coordinate counted from the middle of travel, where the angle is zero, (n,), mm."""
        return self.position_mm - TRAVEL_MIDDLE_MM

    @cached_property
    def half_travel_mm(self) -> FloatArray:
        """Half of the way that the tip goes within each cell, (n,), mm; never quite zero."""
        return 0.5 * np.abs(self.velocity_mm_s) * self.widths_s + 1e-9

    @cached_property
    def by_position(self) -> tuple[tuple[FloatArray, float], ...]:
        """How far the simulated force is off in cells (n,), mN rms, for the position's error, and for how long, s.

        A contact is as stiff as the block, or as the force was large at the depth. White noise smoothed by a Gaussian
        has what is left of it correlated as exp(-t^2 / (4 w^2)); with s of its rms left, that lasts for 1 / (2 s^2)
        samples. Cells whose widths w are within a factor of two are taken together.
        """
        error_mm = self.position_error_mm
        if error_mm is None or not self.touches or not np.all(error_mm > 0.0):
            return ()
        stiffness = self.target_stiffness_mn_per_mm or RIGID_STIFFNESS_MN_PER_MM
        if self.kind != "rigid_target":
            stiffness = float(np.ptp(self.force_mn)) / max(abs(self.depth_mm), 1e-9)
        touching = self.position_mm > self.z0_start_mm
        octave = np.round(2.0 * np.log2(self.position_noise_mm / error_mm))
        terms = []
        for k in np.unique(octave[touching]):
            lasts_s = 0.5 * 2.0**k / self.sample_rate_hz
            in_cells = np.sqrt(kept_by_mean(self.widths_s / lasts_s))
            terms.append((stiffness * error_mm * in_cells * (touching & (octave == k)), float(lasts_s)))
        return tuple(terms)

    @cached_property
    def steps(self) -> Steps:
        """The times between the cells."""
        return Steps.between(self.time_s)

    @cached_property
    def onset_steps(self) -> Steps:
        """The times between the cells as if everything before the hold had happened at its first instant."""
        time_s = self.time_s.copy()
        first = int(np.argmax(self.in_phase("hold")))
        time_s[:first] = time_s[first] - 1e-9 * np.arange(first, 0, -1)
        return Steps.between(time_s)

    @cached_property
    def hold_window_s(self) -> tuple[float, float]:
        """First and last time of the hold; (0, 0) without one."""
        t = self.time_s[self.in_phase("hold")]
        return (float(t[0]), float(t[-1])) if t.size else (0.0, 0.0)

    @cached_property
    def retracting(self) -> NDArray[np.bool_]:
        """Mask (n,) of the cells from the retract on."""
        return self.in_phase("retract", "clear")


def moves(velocity_mm_s: FloatArray) -> NDArray[np.bool_]:
    """Whether the arm moves, (n,)."""
    speed = np.abs(velocity_mm_s)
    return np.asarray(speed > min(MOVING_MM_S, MOVING_SHARE * float(speed.max(initial=0.0))))


def near(samples_s: FloatArray, times_s: FloatArray, away_s: float = AWAY_S) -> NDArray[np.bool_]:
    """Return which samples (N,) are less than ``away_s`` from any of some times."""
    if not len(times_s):
        return np.zeros(len(samples_s), dtype=bool)
    times_s = np.sort(times_s)
    at = np.searchsorted(times_s, samples_s)
    before = np.abs(samples_s - times_s[np.clip(at - 1, 0, len(times_s) - 1)])
    after = np.abs(times_s[np.clip(at, 0, len(times_s) - 1)] - samples_s)
    return np.asarray(np.minimum(before, after) < away_s)
