"""Fit every trial of a folder, and say how the times depend on depth.

python -m analysis.examples.fit_a_folder my-study
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from analysis import BadInputError, find_trials, fit_trial, read_trial


def main(folder: Path) -> None:
    """Print one line a trial, then the mean of t1 at every depth."""
    by_depth: dict[float, list[float]] = defaultdict(list)
    for path in find_trials([folder]):
        try:
            trial = read_trial(path)
        except BadInputError as error:
            print(error)
            continue
        fit = fit_trial(trial)
        if not fit.fitted:
            print(f"{path.name}: {fit.failure}")
            continue
        told = ", ".join(f"{name} = {e.value:.4g} +- {e.se:.2g}" for name, e in fit.estimates.items())
        print(f"{path.name}: {told}{f'  [{fit.flags}]' if fit.flags else ''}")
        if "t1_s" in fit.estimates:
            by_depth[round(fit.depth_mm or 0.0, 2)].append(fit.estimates["t1_s"].value)
    for depth_mm, times_s in sorted(by_depth.items()):
        print(f"{depth_mm:g} mm: t1 is {np.mean(times_s):.3f} s, mean of {len(times_s)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
