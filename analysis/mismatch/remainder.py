"""What is left over after everything that was named, and whether it is small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch import located
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.places import Places
from analysis.mismatch.report import Remainder, Window
from analysis.mismatch.strays import Stray

SMALL = 0.10
"""A remainder below this share of the mismatch, both as rms, is that of a law which is never the whole truth."""


def is_small(remainder: Remainder, tolerance_mn: float) -> bool:
    """Tell whether a remainder is small beside the mismatch, and in every window below ``tolerance_mn`` rms."""
    return remainder.share < SMALL and remainder.rms_mn < tolerance_mn


def remainder_of(places: Places) -> Remainder | None:
    """Return what is left after everything named, if any window of it is significant."""
    if not places.after:
        return None
    # what repeats is a remainder wherever it lies; only some of it need stand out of a window by itself
    energy = max(sum(w.share_of_mismatch for w in places.after), places.left / max(places.total, 1e-12))
    return Remainder(
        share=float(np.sqrt(energy)),
        rms_mn=float(max(w.rms_mn or 0.0 for w in places.after)),
        where=places.after,
    )


def remainder_first(places: Places, mismatch: tuple[Window, ...]) -> tuple[Window, ...]:
    """Put the windows of what remains unexplained before those of what was found."""
    remaining = {(w.phase, round(w.start_s, 3)) for w in places.after}
    return (
        *(
            replace(w, conditions=f"{w.conditions}; left after what was found")
            for w in sorted(places.after, key=lambda w: -w.share_of_mismatch)[: located.MOST_WINDOWS]
        ),
        *(w for w in mismatch if (w.phase, round(w.start_s, 3)) not in remaining),
    )


def large_strays(diagnosis: Diagnosis) -> tuple[Stray, ...]:
    """Return the strays that are no small remainder beside what was named."""
    named = sum(max(c.total_gain, 0.0) for c in diagnosis.named.chosen)
    samples = sum(float(t.counts.sum()) for t in diagnosis.problem.trials)
    noise = {"force": diagnosis.problem.white_mn}
    if diagnosis.position is not None:
        noise["position"] = diagnosis.position.noise_mm
    return tuple(
        s for s in diagnosis.strays if samples * (s.rms / noise.get(s.signal, 1.0)) ** 2 >= SMALL**2 * named
    )


def stray_windows(diagnosis: Diagnosis) -> tuple[Window, ...]:
    """Return the large strays as places in which simulation and recordings differ."""
    return tuple(
        Window(
            signal=s.signal,
            phase=s.phase,
            start_s=s.start_s,
            stop_s=s.stop_s,
            mean_residual_mn=0.0 if s.signal == "force" else None,
            p_value=s.p_value,
            share_of_mismatch=0.0,
            conditions=s.words,
            rms_mn=s.rms if s.signal == "force" else None,
            mean_residual_um=0.0 if s.signal == "position" else None,
        )
        for s in large_strays(diagnosis)
    )
