"""What a trial's own parameters can take up: its columns, and a projector that marginalises them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import TISSUE_SIZE, Shared, TrialState, own_effects, simulate
from analysis.mismatch.model.population import Population
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Tissues

FloatArray = NDArray[np.float64]

STEP_LOG = 1e-4
STEP_OF_DEPTH = 1e-5
STEP_OF_FORCE = 1e-5
STEP_OF_SPREAD = 1e-3
NOTHING, LEAST = 1e-13, 1e-300


@dataclass(frozen=True)
class OwnColumns:
    """Whitened derivatives (n, q) of a trial's force by what is its own, and its whitened residual (n,).

    ``prior`` (q, q) is the precision of each before the trial was seen (zero: contact point and offset), ``pull`` (q,)
    that precision times the distance to the prior's mean. ``tissue`` are the columns of the five log constants.
    """

    columns: FloatArray
    residual: FloatArray
    prior: FloatArray
    pull: FloatArray
    tissue: slice

    @cached_property
    def information(self) -> FloatArray:
        """Information (q, q) of data and priors together."""
        return self.columns.T @ self.columns + self.prior

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (q, q) of the own parameters, given data and priors."""
        return self.solve(np.eye(self.n_own))

    @property
    def mean_columns(self) -> FloatArray:
        """Derivatives (n, 5) by the population's mean; nothing where there is no tissue."""
        tissue = self.columns[:, self.tissue]
        return tissue if tissue.shape[1] else np.zeros((len(self.residual), TISSUE_SIZE))

    @property
    def residual_at_mean(self) -> FloatArray:
        """The residual (n,) as it was at the population's mean: what the fit took up is given back."""
        return self.residual + self.columns @ from_mean(self)

    def solve(self, b: FloatArray) -> FloatArray:
        """Return the own parameters (q,) or (q, m) that solve information @ x = b.

        What the trial shows nothing of (its contact out of reach) stays where it is.
        """
        return solved(self.information, b)

    def pull_at(self, state: TrialState, population: Population) -> FloatArray:
        """Return what the priors pull with (q,) at another state."""
        pull = np.zeros(self.n_own)
        if state.has_tissue:
            pull[self.tissue] = population.precision @ (population.mean - state.log_tissue)
        if len(state.shapes):
            pull[self.tissue.stop :] = -state.coefficients / np.array([s.prior for s in state.shapes])
        return pull

    @property
    def tissue_and_free(self) -> range:
        """Columns of tissue, contact and offset."""
        return range(self.tissue.stop)

    @property
    def n_own(self) -> int:
        """Return q."""
        return int(self.columns.shape[1])


@dataclass(frozen=True)
class ForceColumns:
    """A trial's residual and its derivatives by what is its own, (n, 1 + q) mN, before any weighing.

    ``tissue`` is where the log constants stand among the q.
    """

    columns_mn: FloatArray
    tissue: slice


def force_columns(trial: CellTrial, state: TrialState, shared: Shared) -> ForceColumns:
    """Return a trial's own columns at a state, in the order offset, contact, tissue, shapes."""
    own = own_effects(state)
    base = simulate(trial, state, shared, own)
    columns = [trial.force_mn - base]
    if trial.frees_offset:
        columns.append(_offset_column(trial, state, shared, base))
    if trial.touches:
        step = STEP_OF_DEPTH * max(abs(trial.depth_mm), 1e-6)
        columns.append((simulate(trial, replace(state, z0_mm=state.z0_mm + step), shared, own) - base) / step)
    first = len(columns) - 1
    if state.has_tissue:
        elsewhere = Tissues.at(state.log_tissue + STEP_LOG * np.eye(TISSUE_SIZE))
        columns.extend((simulate(trial, state, shared, own, elsewhere) - base) / STEP_LOG)
    last = len(columns) - 1
    found = np.empty((len(base), len(columns) + len(state.shapes)))
    found[:, : len(columns)] = np.column_stack(columns)
    for k, shape in enumerate(state.shapes):
        if shape.is_number:
            step = STEP_OF_SPREAD * float(np.sqrt(shape.prior))
            coefficients = state.coefficients.copy()
            coefficients[k] += step
            there = simulate(trial, replace(state, coefficients=coefficients), shared, own)
            found[:, len(columns) + k] = (there - base) / step
    for acts, (at, shapes) in state.shapes.by_stage.items():
        if acts == "force":
            found[:, len(columns) + at] = shapes.T
            continue
        # in rows: one by one they take up to twice as long
        steps = STEP_OF_SPREAD * np.sqrt([[state.shapes[k].prior] for k in at])
        there = simulate(trial, state, shared, {**own, acts: own[acts] + steps * shapes})
        found[:, len(columns) + at] = ((there - base) / steps).T
    return ForceColumns(found, slice(first, last))


def _offset_column(trial: CellTrial, state: TrialState, shared: Shared, base: FloatArray) -> FloatArray:
    """Return the change of a trial's force (n,) by its offset: as much, where no law bends what is read."""
    if not any(law.mechanism.bends_reading for law in shared.laws):
        return np.ones_like(base)
    step = STEP_OF_FORCE * max(float(np.ptp(trial.force_mn)), 1e-12)
    higher = replace(state, offset_mn=state.offset_mn + step)
    return (simulate(trial, higher, shared) - base) / step


def own_columns(
    force: ForceColumns, whitener: Whitener, state: TrialState, population: Population
) -> OwnColumns:
    """Return a trial's own columns weighed by its noise, with what is known of them beforehand."""
    white = whitener(force.columns_mn)
    first, last = force.tissue.start, force.tissue.stop
    prior = np.zeros((white.shape[1] - 1, white.shape[1] - 1))
    pull = np.zeros(len(prior))
    if state.has_tissue:
        prior[first:last, first:last] = population.precision
        pull[first:last] = population.precision @ (population.mean - state.log_tissue)
    for k, shape in enumerate(state.shapes):
        prior[last + k, last + k] = 1.0 / shape.prior
        pull[last + k] = -state.coefficients[k] / shape.prior
    return OwnColumns(white[:, 1:], white[:, 0], prior, pull, force.tissue)


def moved(state: TrialState, trial: CellTrial, step: FloatArray) -> TrialState:
    """Return the state with its own parameters moved by a step (q,) in the order of `own_columns`."""
    at = 0
    offset, z0, tissue = state.offset_mn, state.z0_mm, state.log_tissue
    if trial.frees_offset:
        offset, at = offset + float(step[at]), at + 1
    if trial.touches:
        z0, at = z0 + float(step[at]), at + 1
    if state.has_tissue:
        tissue, at = tissue + step[at : at + TISSUE_SIZE], at + TISSUE_SIZE
    return replace(
        state, log_tissue=tissue, z0_mm=z0, offset_mn=offset, coefficients=state.coefficients + step[at:]
    )


class Projector:
    """Takes out of whitened columns what a trial's own parameters may explain, each as far as its prior lets it.

    With V = 1 + O P^-1 O', O the own columns and P their prior precision, columns x become V^(-1/2) x, so that products
    of projected columns are those of generalised least squares with the own parameters integrated out.
    """

    def __init__(self, own: OwnColumns, whitener: Whitener) -> None:
        self._whitener = whitener
        Q, R = orthonormal(own.columns)
        H = R.T @ R + own.prior
        kept = np.eye(len(R)) - R @ solved(H, R.T)
        values, vectors = np.linalg.eigh(0.5 * (kept + kept.T))
        values = np.clip(values, 0.0, 1.0)
        self._basis = Q @ vectors
        self._taken = 1.0 - np.sqrt(values)
        self.log_determinant = log_determinant(own)
        self.residual = self._project(own.residual_at_mean)
        self.mean_columns = self._project(own.mean_columns)

    def _project(self, white: FloatArray) -> FloatArray:
        inside = self._basis.T @ white
        taken = self._taken if white.ndim == 1 else self._taken[:, None]
        return np.asarray(white - self._basis @ (taken * inside))

    def __call__(self, columns_mn: FloatArray) -> FloatArray:
        """Return columns (n, m) of force, whitened and projected."""
        shown = np.any(columns_mn, axis=0)
        if np.all(shown) and len(shown):
            return self._project(self._whitener(columns_mn))
        # much of what a law may leave over is nothing in this trial
        found = np.zeros_like(columns_mn)
        if np.any(shown):
            found[:, shown] = self(columns_mn[:, shown])
        return found


def orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q (n, q) and R (q, q) of columns = Q R, by Cholesky factors taken twice.

    Forty times as fast as Householder reflections on a few long columns, and as exact up to a condition of 1e7
    (Yamamoto et al., ETNA 44:306, 2015); columns beyond that are reflected.
    """
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    Q, R = columns / scale, np.diag(scale)
    try:
        for _ in range(2):
            step = np.linalg.cholesky(Q.T @ Q).T
            Q, R = Q @ np.linalg.inv(step), step @ R
    except np.linalg.LinAlgError:
        Q, R = np.linalg.qr(columns / scale)
        R = R * scale
    return Q, R


def solved(H: FloatArray, b: FloatArray) -> FloatArray:
    """Return x of H x = b, H (q, q) symmetric and scaled to a unit diagonal; 0 where row and column are zero."""
    size = np.maximum(np.diag(H), LEAST)
    root = (size > LEAST) / np.sqrt(size)
    scaled = H * np.outer(root, root) + NOTHING * np.eye(len(H))
    of_rows = root if b.ndim == 1 else root[:, None]
    return np.asarray(of_rows * np.linalg.solve(scaled, of_rows * b))


def log_determinant(own: OwnColumns) -> float:
    """Return ln |V|, own parameters integrated out over their prior, or evenly where they are free.

    What a trial shows nothing of counts nothing.
    """
    H = own.information
    shown = np.flatnonzero(np.diag(H) > 0.0)
    known = np.flatnonzero(np.diag(own.prior) > 0.0)
    of_prior = float(np.linalg.slogdet(own.prior[np.ix_(known, known)])[1]) if len(known) else 0.0
    return float(np.linalg.slogdet(H[np.ix_(shown, shown)])[1]) - of_prior


def from_mean(own: OwnColumns) -> FloatArray:
    """Return how far (q,) the state lies from its prior's mean; 0 in what is free."""
    found = np.zeros(own.n_own)
    known = np.flatnonzero(np.diag(own.prior) > 0)
    if len(known):
        found[known] = -np.linalg.solve(own.prior[np.ix_(known, known)], own.pull[known])
    return found
