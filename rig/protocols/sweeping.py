"""Air sweeps: there and back with nothing below the arm, one speed a trial."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.recordings.trial import ProtocolSummary, Specimen
from rig.protocols.indenting import clear_air
from rig.protocols.steps import PlannedTrial, Preparation, Rest, Sweep


def air_sweeps(
    speeds_mm_s: Sequence[float],
    from_mm: float,
    to_mm: float,
    *,
    specimen: Specimen,
    toml: str,
    rest_s: float = 0.0,
) -> tuple[PlannedTrial, ...]:
    """Return one sweep a speed, from `from_mm` to `to_mm` and back, in lever coordinates."""
    trials = []
    for i, speed_mm_s in enumerate(speeds_mm_s):
        cleared = clear_air(first=i == 0)
        before: tuple[Preparation, ...] = (cleared, Rest(rest_s)) if i and rest_s else (cleared,)
        name = f"air_sweep_{i + 1:02d}_{speed_mm_s:g}mm_s"
        summary = ProtocolSummary(ramp_speed_mm_s=speed_mm_s, toml=toml)
        sweep = Sweep(from_mm, to_mm, speed_mm_s)
        trials.append(PlannedTrial(name, "air_sweep", before, (sweep,), specimen, summary))
    return tuple(trials)
