"""A recorded command freed of its converter's steps: straight lines as they were commanded.

The servo's answer to steps of 0.15 um has accelerations of a metre per second squared. Where the recorder's converter
made the steps these never were, and the arm followed lines that are smoother than the codes; whose the steps were the
position tells (`motion.fit_servo`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NEVER_A_STEP_MM = 1e-7
LARGEST_STEP_MM = 2e-3
SHORTEST = 8
"""Samples of the shortest stretch, and over which its departures from a line are averaged: a recorder's own noise now
and then is two steps off for a sample."""
DEEPEST = 6


def straightened(command_mm: FloatArray, kinks: Sequence[int]) -> FloatArray:
    """Return a command (N,) with every stretch that stays on a line to within one converter step made that line.

    ``kinks`` are samples at which stretches may begin or end; a stretch that is no line is split where it is
    furthest off. A command without steps comes back as it is.
    """
    bends = np.abs(np.diff(command_mm, 2))
    steps = bends[(bends > NEVER_A_STEP_MM) & (bends < LARGEST_STEP_MM)]
    if len(steps) <= len(command_mm) // 200:
        return command_mm
    step = float(np.quantile(steps, 0.1))
    out = command_mm.copy()
    edges = sorted({0, len(command_mm), *(int(k) for k in kinks)})
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        _straighten(out, a, b, step, DEEPEST)
    return out


def _straighten(command_mm: FloatArray, a: int, b: int, step_mm: float, depth: int) -> None:
    if b - a < SHORTEST:
        return
    part = command_mm[a:b]
    x = np.arange(b - a) - 0.5 * (b - a - 1)
    mean = float(part.mean())
    line = mean + x * float(x @ (part - mean)) / float(x @ x)
    off = np.abs(np.convolve(part - line, np.full(SHORTEST, 1.0 / SHORTEST), mode="valid"))
    if float(off.max()) <= 1.05 * step_mm:
        command_mm[a:b] = line
        return
    if depth == 0:
        return
    chord = part[0] + (part[-1] - part[0]) * np.arange(b - a) / max(b - a - 1, 1)
    at = a + min(max(int(np.argmax(np.abs(part - chord))), 1), b - a - 1)
    _straighten(command_mm, a, at, step_mm, depth - 1)
    _straighten(command_mm, at, b, step_mm, depth - 1)
