"""A measured surface beside the calibrated pads: which fail, where along the finger, and what ratio fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2, f

from analysis.fingertip.line_load import LineAnswers
from analysis.fingertip.surface_file import MeasuredSurface
from analysis.recordings.trial import FloatArray

FAILS_BELOW = 0.01
"""A pad fails where a misfit as large as this one is rarer under the measurement's errors."""
COVERAGE = 0.95
_STARTS = 7
_FINEST_MM, _ROUNDING = 1e-6, 1e-12
"""What no surface is measured better than; and the variance that such a one is given."""


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of the finger where a pad is off: its ends (mm), and the mean of measured minus pad (mm)."""

    start_mm: float
    stop_mm: float
    mean_mm: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """A pad beside the surface.

    ``deflection_mm`` (N,) is the pad's where the surface was measured, ``curve_mm`` (A,) all along the finger.
    ``p_value``: of a misfit as large, were the pad right. ``spans``: where it is off by more than its errors.
    """

    name: str
    deflection_mm: FloatArray
    curve_mm: FloatArray
    rms_mm: float
    p_value: float
    spans: tuple[Span, ...]

    @property
    def fails(self) -> bool:
        """Whether the surface refutes the pad."""
        return self.p_value < FAILS_BELOW


@dataclass(frozen=True, slots=True)
class Located:
    """What a surface says of the layers.

    Attributes:
        error_mm: standard error of a place, from the file, or from what the best pad leaves.
        error_known: whether it is the file's.
        mesh_mm: how far off the mesh may put the best pad's skin at a place, as two meshes differ.
        ratio, ratio_low, ratio_high: relaxed core over epidermis with its 95 % profile interval, thickness free.
        at_end: whether an end of the interval is an end of the ratios that were solved.
        thickness_mm, thickness_se_mm: of the epidermis that fits best; no error where a mesh of the user's own
            holds it.
        profile_log_ratio, profile_misfit: the profile: log ratios (P,), and how far the weighted sum of
            squares lies above its least (P,).
        along_mm: places (A,) mm from the first measured one to the last that pads' curves are given at.
        pads: homogeneous, the pad file's layered pad at its best ratio, the best of all where that is another.
    """

    surface: MeasuredSurface
    error_mm: FloatArray
    error_known: bool
    mesh_mm: FloatArray
    ratio: float
    ratio_low: float
    ratio_high: float
    at_end: bool
    thickness_mm: float
    thickness_se_mm: float | None
    limit: float
    profile_log_ratio: FloatArray
    profile_misfit: FloatArray
    along_mm: FloatArray
    pads: tuple[Comparison, ...]


def locate(surface: MeasuredSurface, answers: LineAnswers) -> Located:
    """Set the surface beside every pad and find the ratio of layers, thickness of the epidermis let free if it can be.

    Where the file gives no errors they are taken from what the best pad leaves, and the tests are F tests. What
    the mesh may be off by counts as an error beside the measurement's: no interval is narrower than the mesh.
    """
    known = bool(np.isfinite(surface.error_mm).all())
    places_mm = surface.position_mm
    nothing = np.zeros(len(places_mm))
    first = _fitted(surface, answers, surface.error_mm if known else np.ones(len(places_mm)), nothing)
    freedom = len(places_mm) - _free(answers)
    scale_mm = max(np.sqrt(2 * float(first.cost) / freedom), _FINEST_MM)
    error_mm = surface.error_mm if known else np.full(len(places_mm), scale_mm)
    return _located(surface, answers, error_mm, known, answers.mesh_error_at(places_mm, float(first.x[0])))


def _free(answers: LineAnswers) -> int:
    """Return how many values are fitted: the ratio, and the thickness where there is more than one."""
    return 1 if len(answers.thickness_mm) == 1 else 2


def _fitted(surface: MeasuredSurface, answers: LineAnswers, error_mm: FloatArray, mesh_mm: FloatArray) -> Any:
    """Return the solution that fits best: log ratio, and thickness where it is free."""
    layered, whiten = answers.layered_at(surface.position_mm), _whitener(error_mm, mesh_mm)
    first, last = np.log(answers.ratios[[0, -1]]).tolist()
    thin, thick = answers.thickness_mm[[0, -1]].tolist()
    own_mm, count = _own_mm(answers), _free(answers)

    def off(values: FloatArray) -> FloatArray:
        log_ratio, thickness_mm = [*values.tolist(), own_mm][:2]
        return whiten(layered(log_ratio, thickness_mm) - surface.deflection_mm)

    starts = np.linspace(first, last, _STARTS + 2)[1:-1].tolist()
    tried = [
        _solve(off, [start, own_mm][:count], [first, thin][:count], [last, thick][:count]) for start in starts
    ]
    return min(tried, key=_cost)


def _whitener(error_mm: FloatArray, mesh_mm: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return what makes misfits (N,) mm independent and of variance 1.

    The mesh is off all along the finger at once, by so much of its estimate as nobody knows, and at every place
    by itself: two meshes differ in both ways.
    """
    covariance = np.diag(error_mm**2 + mesh_mm**2) + np.outer(mesh_mm, mesh_mm)
    factor = np.linalg.cholesky(covariance)
    return lambda off_mm: np.asarray(solve_triangular(factor, off_mm, lower=True), dtype=float)


def _own_mm(answers: LineAnswers) -> float:
    return float(answers.thickness_mm[len(answers.thickness_mm) // 2])


def _located(
    surface: MeasuredSurface, answers: LineAnswers, error_mm: FloatArray, known: bool, mesh_mm: FloatArray
) -> Located:
    layered, whiten = answers.layered_at(surface.position_mm), _whitener(error_mm, mesh_mm)
    along_mm = _along(surface, answers)
    layered_along = answers.layered_at(along_mm)
    first, last = np.log(answers.ratios[[0, -1]]).tolist()
    thin, thick = answers.thickness_mm[[0, -1]].tolist()
    own_mm, count = _own_mm(answers), _free(answers)

    def off(log_ratio: float, thickness_mm: float) -> FloatArray:
        return whiten(layered(log_ratio, thickness_mm) - surface.deflection_mm)

    def least_at(log_ratio: float) -> float:
        if count == 1:
            return float(np.sum(off(log_ratio, own_mm) ** 2))

        def by_thickness(values: FloatArray) -> FloatArray:
            return off(log_ratio, float(values[0]))

        return 2 * float(_solve(by_thickness, [(thin + thick) / 2], [thin], [thick]).cost)

    def by_ratio(values: FloatArray) -> FloatArray:
        return off(float(values[0]), own_mm)

    solved = _fitted(surface, answers, error_mm, mesh_mm)
    freedom = len(surface.position_mm) - count
    least = 2 * float(solved.cost)
    variance = 1.0 if known else max(least / freedom, _ROUNDING)
    log_ratio, thickness = [*np.asarray(solved.x).tolist(), own_mm][:2]
    limit = float(chi2.ppf(COVERAGE, 1) if known else f.ppf(COVERAGE, 1, freedom))

    def above(at: float) -> float:
        return (least_at(at) - least) / variance

    low, high, at_end = _interval(above, log_ratio, limit, (first, last))
    grid = np.unique(np.append(np.linspace(first, last, 61), [low, log_ratio, high]))
    jacobian = np.asarray(solved.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    thickness_se = float(np.sqrt(covariance[1, 1])) if count == 2 else None

    def compared(at_mm: float, at: float, fitted: int) -> Comparison:
        name = f"elastic epidermis of {at_mm:.3g} mm, ratio {np.exp(at):.3g}"
        mesh_there_mm = answers.mesh_error_at(surface.position_mm, at)
        curves = layered(at, at_mm), layered_along(at, at_mm)
        return _compared(name, curves, surface, error_mm, mesh_there_mm, known, (fitted, count))

    plain = _compared(
        "homogeneous", (answers.homogeneous_at(surface.position_mm), answers.homogeneous_at(along_mm)), surface,
        error_mm, answers.mesh_error_at(surface.position_mm, 0.0), known, (0, count),
    )  # fmt: skip
    pads: tuple[Comparison, ...] = (plain, compared(thickness, log_ratio, count))
    if count == 2:
        own = _solve(by_ratio, [log_ratio], [first], [last])
        pads = (plain, compared(own_mm, float(own.x[0]), 1), pads[1])
    return Located(
        surface, error_mm, known, mesh_mm, float(np.exp(log_ratio)), float(np.exp(low)), float(np.exp(high)), at_end,
        thickness, thickness_se, limit, grid, np.array([above(g) for g in grid]), along_mm, pads,
    )  # fmt: skip


def _along(surface: MeasuredSurface, answers: LineAnswers) -> FloatArray:
    """Return the measured places and, between them, all that the pads were read at: skin falls fast near the line."""
    measured_mm, read_mm = surface.position_mm, answers.position_mm
    between = read_mm[(read_mm > measured_mm[0]) & (read_mm < measured_mm[-1])]
    return np.union1d(measured_mm, between)


def _solve(
    off: Callable[[FloatArray], FloatArray], start: list[float], low: list[float], high: list[float]
) -> Any:
    return least_squares(off, start, bounds=(low, high), x_scale=np.subtract(high, low), xtol=1e-12)


def _cost(solved: Any) -> float:
    return float(solved.cost)


def _interval(
    above: Callable[[float], float], best: float, limit: float, ends: tuple[float, float]
) -> tuple[float, float, bool]:
    """Return where the profile crosses its limit on both sides of the best, or the end of what was solved."""
    found, at_end = [], False
    for end in ends:
        # outwards in small steps: the profile need not be convex
        steps = np.linspace(best, end, 41)[1:]
        inside = best
        for step in steps:
            if above(float(step)) > limit:
                found.append(float(brentq(lambda at: above(at) - limit, inside, float(step), xtol=1e-4)))
                break
            inside = float(step)
        else:
            found.append(end)
            at_end = True
    return found[0], found[1], at_end


def _compared(
    name: str,
    curves: tuple[FloatArray, FloatArray],
    surface: MeasuredSurface,
    error_mm: FloatArray,
    mesh_mm: FloatArray,
    known: bool,
    fitted: tuple[int, int],
) -> Comparison:
    """Set a pad beside the surface.

    ``curves``: its deflection at the measured places, and all along; ``fitted`` counts its values, and those of the
    best pad.
    """
    deflection, curve = curves
    left = surface.deflection_mm - deflection
    freedom, best_freedom = (len(left) - count for count in fitted)
    squares = float(np.sum(_whitener(error_mm, mesh_mm)(left) ** 2))
    # with errors taken from the best pad's own misfit the ratio is Fisher's
    p_value = chi2.sf(squares, freedom) if known else f.sf(squares / freedom, freedom, best_freedom)
    return Comparison(
        name,
        deflection,
        curve,
        float(np.sqrt(np.mean(left**2))),
        float(p_value),
        _spans(surface.position_mm, left / np.hypot(error_mm, mesh_mm), left),
    )


def _spans(position_mm: FloatArray, scaled: FloatArray, left: FloatArray) -> tuple[Span, ...]:
    """Return stretches of three places or more whose mean is off by more than three of its standard errors."""
    width = 3
    if len(scaled) < width:
        return ()
    mean = np.convolve(scaled, np.ones(width) / np.sqrt(width), mode="valid")
    far = np.zeros(len(scaled), dtype=int)
    for start in np.flatnonzero(np.abs(mean) > 3.0):
        far[start : start + width] = int(np.sign(mean[start]))
    edges = np.flatnonzero(np.diff(far)) + 1
    pieces = np.split(np.arange(len(far)), edges)
    return tuple(
        Span(float(position_mm[p[0]]), float(position_mm[p[-1]]), float(left[p].mean()))
        for p in pieces
        if far[p[0]] != 0
    )
