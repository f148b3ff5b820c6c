"""Starting values of the times: the best of all combinations on a grid, found without a search."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from analysis.recordings.trial import FloatArray

GRID_TIMES = 24


def best_of_grid(
    decaying: FloatArray,
    always: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    *,
    grid_s: FloatArray,
    n_times: int,
) -> FloatArray:
    """Return the ``n_times`` times of the grid that explain the target best, longest first, s.

    ``decaying`` (G, K) are the rows of the grid's times, ``always`` (L, K) the rows that every
    combination has; combinations whose decaying amplitudes are positive go before all others.
    """
    n_grid = len(grid_s)
    rows = np.concatenate([decaying, always, target[None]])
    gram = (rows * weights) @ rows.T
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram = gram / np.outer(scale, scale)
    choices = np.array(list(combinations(range(n_grid), n_times)))
    fixed = np.broadcast_to(np.arange(n_grid, n_grid + len(always)), (len(choices), len(always)))
    columns = np.concatenate([choices, fixed], axis=1)
    normal = gram[columns[:, :, None], columns[:, None, :]] + 1e-13 * np.eye(columns.shape[1])
    right = gram[columns, -1]
    amplitudes = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    explained = np.sum(amplitudes * right, axis=1)
    positive = np.all(amplitudes[:, :n_times] > 0, axis=1)
    score = np.where(np.isfinite(explained), explained - 10.0 * ~positive, -np.inf)
    return np.asarray(grid_s[choices[int(np.argmax(score))]][::-1], dtype=float)
