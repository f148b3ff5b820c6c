"""What scripts call that the commands of the shell call with paths: the diagnosis, and its report as data."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal


def diagnose(
    paths: Path | str | Sequence[Path | str],
    *,
    out: Path | str,
    baseline: Literal["ramp", "step"] = "ramp",
    seed: int = 0,
    tolerance_mn: float = 0.3,
) -> dict[str, Any]:
    """Compare simulation and recordings (trial files, or folders of them), and return the report.

    The report is that of `indenter diagnose`: keys `verdict`, `summary`, `mechanisms`, `mismatch`, `heldout` and
    more; it is also written into ``out`` as report.json beside a page, figures, the twin and the next protocol.
    ``tolerance_mn`` (mN rms) is what a law may leave over without being called unknown. Raises BadInputError for
    trials that can't be diagnosed.
    """
    from analysis.mismatch.diagnose import diagnose_paths

    given = [paths] if isinstance(paths, Path | str) else list(paths)
    page = diagnose_paths(
        [Path(path) for path in given], baseline=baseline, out=Path(out), seed=seed, tolerance_mn=tolerance_mn
    )
    report: dict[str, Any] = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    return report
