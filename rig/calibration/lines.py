"""What the trials of a calibration add up to: straight lines with honest errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray, Trial


@dataclass(frozen=True)
class Line:
    """A straight line through points (x, y) by least squares, each point once, with equal weight.

    ``slope_se`` and ``intercept_se`` come from the scatter about the line with ``dof`` degrees of freedom;
    ``half_width_95`` is Student's t times ``slope_se``.
    """

    x: FloatArray
    y: FloatArray
    slope: float
    intercept: float
    slope_se: float
    intercept_se: float
    r2: float

    @property
    def dof(self) -> int:
        """Points less the two constants of the line."""
        return len(self.x) - 2

    @property
    def residuals(self) -> FloatArray:
        """Distance of each point from the line, in units of y."""
        return self.y - self.intercept - self.slope * self.x


def line_through(x: Sequence[float] | FloatArray, y: Sequence[float] | FloatArray) -> Line:
    """Return the least-squares line of y on x; at least 3 points with 3 different x."""
    x_, y_ = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    mean = x_.mean()
    spread = float(np.sum((x_ - mean) ** 2))
    slope = float(np.sum((x_ - mean) * y_) / spread)
    intercept = float(y_.mean() - slope * mean)
    residuals = y_ - intercept - slope * x_
    variance = float(np.sum(residuals**2)) / (len(x_) - 2)
    total = float(np.sum((y_ - y_.mean()) ** 2))
    return Line(
        x=x_,
        y=y_,
        slope=slope,
        intercept=intercept,
        slope_se=math.sqrt(variance / spread),
        intercept_se=math.sqrt(variance * (1 / len(x_) + mean**2 / spread)),
        r2=1 - variance * (len(x_) - 2) / total,
    )


def student_95(dof: int) -> float:
    """Return the factor that turns a standard error with `dof` degrees of freedom into a 95 % interval."""
    from scipy.stats import t

    return float(t.ppf(0.975, dof))


@dataclass(frozen=True, slots=True)
class Constant:
    """A measured constant of the bench; 95 % interval: value -+ student_95(dof) * se."""

    value: float
    se: float
    dof: int


@dataclass(frozen=True)
class PositionResult:
    """Constants of position and command, with the line they rest on: volts over stage millimetres."""

    constants: Mapping[str, Constant]
    line: Line


@dataclass(frozen=True)
class ForceResult:
    """Constants of force, the mass of the arm, and the line they rest on: volts over millinewtons hung."""

    constants: Mapping[str, Constant]
    line: Line
    arm_mass_g: float


def position_constants(
    contacts: Sequence[tuple[float, Trial]], sweep: Trial, position_zero_v: float
) -> PositionResult:
    """Return the constants of position and command.

    `contacts` are heights of the stage, um, with the trial that found the block there. All approaches at a
    height share the error of the stage there, so their mean is one point of the line. A rising reading lowers
    the block or raises it, as the stage is mounted; the lever counts the same either way. `sweep` relates
    command and position over the travel, there and back so that the lag of the servo cancels.

    The stage says nothing of where the lever's zero is: `position_zero_v` stays as it was, and the command's
    zero is set such that the lever at rest stands where it is commanded to.
    """
    heights_um = sorted({height_um for height_um, _ in contacts})
    volts = [np.mean([_contact_v(trial) for h, trial in contacts if h == height]) for height in heights_um]
    line = line_through([h / 1e3 for h in heights_um], [float(v) for v in volts])
    volts_per_mm = abs(line.slope)
    phase = sweep.phase("sweep")
    assert phase is not None, "an air sweep has its phase"
    assert sweep.command_v is not None, "a sweep recorded by this program has its command"
    follow = line_through(sweep.command_v[phase.samples], sweep.position_v[phase.samples])
    command = volts_per_mm / follow.slope
    relative_se = math.hypot(line.slope_se / volts_per_mm, follow.slope_se / follow.slope)
    zero_v = (position_zero_v - follow.intercept) / follow.slope
    return PositionResult(
        {
            "volts_per_mm": Constant(volts_per_mm, line.slope_se, line.dof),
            "command_volts_per_mm": Constant(command, command * relative_se, line.dof),
            "position_zero_v": Constant(position_zero_v, 0.0, line.dof),
            "command_zero_v": Constant(zero_v, follow.intercept_se / follow.slope, line.dof),
        },
        line,
    )


def _contact_v(trial: Trial) -> float:
    assert trial.surface is not None, "an approach that ended has found its surface"
    c = trial.calibration
    return trial.surface.position_mm * c.volts_per_mm + c.position_zero_v


def force_constants(
    hung: Sequence[tuple[float, Trial]], upright: Trial, gravity_m_s2: float, level_within_deg: float
) -> ForceResult:
    """Return the constants of force from W + m g / 2 = (V + V0) k, solved as V over W.

    `hung` are masses, g, with the trial recorded under each; repeats of a weight (the trial's site names it, and
    a balance says something else of it every time) are one point of the line.
    An arm that is out of level by an angle t shows cos(t) of a weight. With t anywhere within
    +-`level_within_deg` (a, in radians) the shown share is 1 - a^2/6 on average, with a standard deviation of
    a^2 / sqrt(45), which no repeat can show: the first divides the slope, the second adds to its error.
    The zero is that of the free arm upright, as trials find it; the arm's mass m follows from the two zeros.
    """
    weights: dict[str, list[tuple[float, float]]] = {}
    for mass_g, trial in hung:
        weights.setdefault(trial.specimen.site, []).append((mass_g, _mean_v(trial)))
    means = np.array(sorted(tuple(np.mean(repeats, axis=0)) for repeats in weights.values()))
    line = line_through(means[:, 0] * gravity_m_s2, means[:, 1])
    out_of_level = math.radians(level_within_deg) ** 2
    slope = line.slope / (1 - out_of_level / 6)
    se = math.hypot(line.slope_se, abs(slope) * out_of_level / math.sqrt(45))
    # the interval is Student's where the scatter of the points rules, and nearly normal where the level does
    dof = round(min(line.dof * (se / max(line.slope_se, 1e-300)) ** 4, 1e6))
    zero_v = _mean_v(upright)
    arm_mn = abs(line.intercept - zero_v) / abs(slope)
    return ForceResult(
        {
            "volts_per_mn": Constant(abs(slope), se, dof),
            "force_zero_v": Constant(zero_v, _mean_se_v(upright), len(_settled_v(upright)) - 1),
        },
        line,
        arm_mass_g=arm_mn / gravity_m_s2,
    )


def _settled_v(trial: Trial) -> FloatArray:
    phase = trial.phase("dwell")
    assert phase is not None, "a force calibration is recorded at rest"
    return trial.force_v[phase.samples]


def _mean_v(trial: Trial) -> float:
    return float(np.mean(_settled_v(trial)))


def _mean_se_v(trial: Trial) -> float:
    """Return the standard error of the mean, from ten stretches, so that slow noise counts in full."""
    means = [float(np.mean(part)) for part in np.array_split(_settled_v(trial), 10)]
    return float(np.std(means, ddof=1)) / math.sqrt(len(means))
