"""What each mechanism would look like in the residual, with all that the baseline can absorb taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.profiles import OUTSIDE, bins_of
from analysis.mismatch.shared import Addition
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, Values

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BLOCK_CELLS = 25
BLOCKS_A_PHASE = 12
FEWEST_CELLS = 6
FEW_TRIALS = 8


@dataclass(frozen=True, slots=True)
class Probe:
    """A mechanism at a setting at which its signature is taken."""

    mechanism: Mechanism
    values: Values


@dataclass(frozen=True)
class Signatures:
    """Accumulated statistics of M probes; no column is kept.

    ``scores`` (U, M): score contributions of each unit (trial, or block of a trial); ``bin_scores``
    (U, 2B): the residual itself summed over the bins of `profiles`, plain and weighted by how deep the trial went;
    ``trial_scores`` (T, M);
    ``gram`` (M, M) of the orthogonal signatures over all trials; ``raw_norm`` (M,) of the signatures before the
    baseline's parameters were taken out; ``trial_norm2`` (T, M) their squared norms by trial; ``absorbed``
    (P, M): shift of the shared parameters (scale of the fit) by one unit of the probe.
    """

    probes: tuple[Probe, ...]
    scores: FloatArray
    bin_scores: FloatArray
    trial_scores: FloatArray
    gram: FloatArray
    raw_norm: FloatArray
    trial_norm2: FloatArray
    absorbed: FloatArray

    @property
    def norm(self) -> FloatArray:
        """Norm (M,) of the orthogonal signatures: their strength at the probe's setting."""
        return np.sqrt(np.maximum(np.diag(self.gram), 0.0))


def block_edges(phase: IntArray) -> IntArray:
    """Return the edges of blocks of neighbouring cells, each in one phase; ``phase`` (n,) of the cells.

    A phase has a dozen blocks where its cells suffice: what shows in one phase only could not be significant by the
    signs of fewer.
    """
    ends = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist(), len(phase)]
    edges = [0]
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        blocks = max((b - a) // BLOCK_CELLS, min(BLOCKS_A_PHASE, (b - a) // FEWEST_CELLS), 1)
        edges += np.linspace(a, b, blocks + 1).astype(int)[1:].tolist()
    return np.array(edges, dtype=np.int64)


def probe_columns(trial: CellTrial, fit: JointFit, index: int, probes: Sequence[Probe]) -> FloatArray:
    """Return the change of the simulated force (n, M) that each probe makes."""
    simulation, own = fit.simulation, fit.own[index]
    base = simulation.force_mn(trial, own)
    columns = np.zeros((len(base), len(probes)))
    for k, probe in enumerate(probes):
        if not probe.mechanism.applies(trial):
            continue
        added = Addition(probe.mechanism, probe.values)
        with_it = replace(simulation, additions=(*simulation.additions, added))
        columns[:, k] = with_it.force_mn(trial, own) - base
    return columns


def accumulate(
    trials: Sequence[CellTrial],
    whiteners: Sequence[Whitener],
    fit: JointFit,
    probes: Sequence[Probe],
) -> Signatures:
    """Return the statistics of probes around a joint fit."""
    parts = []
    depths = np.array([t.depth_mm for t in trials])
    contrast = (depths - depths.mean()) / max(float(depths.std()), 1e-9) if len(trials) > 1 else np.zeros(1)
    raw2 = np.zeros(len(probes))
    for j, (trial, whitener) in enumerate(zip(trials, whiteners, strict=True)):
        line = linearise(trial, whitener, fit.simulation, fit.own[j], trials, fit.latents[j])
        columns = whitener(probe_columns(trial, fit, j, probes))
        raw2 += (columns**2).sum(axis=0)
        left, _ = project_out(line.A, np.column_stack([line.r, line.J, columns]))
        p = line.J.shape[1]
        r, J, G = left[:, 0], left[:, 1 : 1 + p], left[:, 1 + p :]
        edges = block_edges(trial.phase[trial.fitted]) if len(trials) < FEW_TRIALS else np.array([0, len(r)])
        block_JG = np.array(
            [
                np.concatenate([J[a:b].T @ r[a:b], G[a:b].T @ r[a:b]])
                for a, b in zip(edges[:-1], edges[1:], strict=True)
            ]
        )
        bins = bins_of(trial, fit.own[j].z0_mm)[trial.fitted]
        by_bin = np.array(
            [
                np.bincount(bins[a:b], weights=r[a:b], minlength=OUTSIDE + 1)[:OUTSIDE]
                for a, b in zip(edges[:-1], edges[1:], strict=True)
            ]
        )
        parts.append((J.T @ J, J.T @ G, G.T @ G, block_JG, np.hstack([by_bin, by_bin * contrast[j]])))
    p = parts[0][0].shape[0]
    units = np.concatenate([x[3] for x in parts])
    known_JJ, known_Jr, _ = fit.simulation.known(trials)
    pinned = fit.simulation.pinned(units[:, :p].sum(axis=0) + known_Jr, trials)
    for JJ_j, JG_j, _, _, _ in parts:
        JJ_j[pinned, :], JJ_j[:, pinned], JG_j[pinned] = 0.0, 0.0, 0.0
    JJ = np.sum([x[0] for x in parts], axis=0) + known_JJ
    JG = np.sum([x[1] for x in parts], axis=0)
    absorbed = np.linalg.pinv(JJ, rcond=1e-12, hermitian=True) @ JG if p else np.zeros((0, len(probes)))
    gram = np.sum([x[2] for x in parts], axis=0) - JG.T @ absorbed
    scores = units[:, p:] - units[:, :p] @ absorbed
    trial_scores = np.array([x[3][:, p:].sum(axis=0) - x[3][:, :p].sum(axis=0) @ absorbed for x in parts])
    norm2 = np.array(
        [
            np.diag(x[2])
            - 2 * np.einsum("pm,pm->m", x[1], absorbed)
            + np.einsum("pm,pq,qm->m", absorbed, x[0], absorbed)
            for x in parts
        ]
    )
    bin_scores = np.concatenate([x[4] for x in parts])
    return Signatures(
        tuple(probes), scores, bin_scores, trial_scores, gram, np.sqrt(raw2), np.maximum(norm2, 0.0), absorbed
    )
