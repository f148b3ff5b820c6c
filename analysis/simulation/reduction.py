"""A trial reduced to cells.

A hold of 7 s at 8 kHz needs no 56,000 points to be compared with a model that moves by microns in it. Cells are
single samples at kinks and longer ones about them, up to 2 ms in motion and 8 ms at rest; averages keep all of the
white noise's information.
What was interpolated between unevenly spaced samples is none: there a cell holds one sample or more as it was taken.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import PHASE_NAMES, Trial
from analysis.simulation.arm_path import ArmPath
from analysis.simulation.cells import CellPath, CellTrial, moves
from analysis.simulation.converter import levels_of
from analysis.simulation.motion import Motion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

REACHES_S = ((0.06, 1e-3), (0.012, 2.5e-4), (0.003, 0.0))
"""How far from a kink cells are no longer than what; at the kink itself each is a sample."""
RELEASE_S = 0.003
MOVING_CELL_S = 0.002
REST_CELL_S = 0.008
REST_CELLS = 8000
"""A recording of minutes is cut no finer at rest than into so many cells."""
LARGEST_STEP_MM = 0.005
"""Between cells motion is a line: at 10 mm/s a servo's corner of 3 ms departs from it by a tenth of a micron."""


def _cell_starts(trial: Trial, motion: Motion, z0_mm: float, offset_mn: float) -> IntArray:
    """Cut the samples into cells; return the first sample of each."""
    rate, n = trial.sample_rate_hz, trial.n_samples
    speed = np.abs(motion.velocity_mm_s)
    length = np.full(n, max(1, round(max(REST_CELL_S, n / rate / REST_CELLS) * rate)), dtype=np.int64)
    moving = moves(motion.velocity_mm_s)
    length[moving] = max(1, round(MOVING_CELL_S * rate))
    allowed = np.maximum(1, np.floor(LARGEST_STEP_MM * rate / np.maximum(speed, 1e-9)))
    near_skin = motion.position_mm > z0_mm - 0.1
    quick = near_skin & moving
    length[quick] = np.minimum(length[quick], np.minimum(allowed[quick], 1e6).astype(np.int64))
    for reach_s, cell_s in REACHES_S:
        reach, cell = max(1, round(reach_s * rate)), max(1, round(cell_s * rate))
        for k in motion.kinks:
            part = slice(max(0, k - reach // 2), k + reach)
            length[part] = np.minimum(length[part], cell)
    release = find_release(trial, offset_mn)
    if release is not None:
        around = round(RELEASE_S * rate)
        length[max(0, release - around) : release + around] = 1
    length = 2 ** np.floor(np.log2(length)).astype(np.int64)  # few distinct lengths: few stretches
    edges = [0, *(np.flatnonzero(np.diff(length)) + 1).tolist(), n]
    pieces = [np.arange(a, b, length[a], dtype=np.int64) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return np.concatenate(pieces)


def find_release(trial: Trial, offset_mn: float) -> int | None:
    """Return the sample at which the force of the retract has first come down to the offset; None if never.

    A skin that clings and lets go does so within a fraction of a millisecond of it.
    """
    retract = trial.phase("retract")
    if retract is None or trial.kind == "air_sweep":
        return None
    force_mn = trial.force_mn[retract.samples] - offset_mn
    w = max(1, round(0.0005 * trial.sample_rate_hz))
    if len(force_mn) < w:
        return None
    smooth = np.convolve(force_mn, np.full(w, 1.0 / w), mode="valid")
    below = np.flatnonzero(smooth <= 0.0)
    return retract.start + int(below[0]) + w // 2 if below.size else None


def find_contact(trial: Trial, motion: Motion) -> tuple[float, float]:
    """Return a first estimate of contact position (mm) and force offset (mN).

    The offset is the median force before contact, or after it is lost; contact is where the smoothed force
    first leaves the offset for good, carried back along the slope behind it, but not to before the trial began.
    """
    force, x, rate = trial.force_mn, motion.position_mm, trial.sample_rate_hz
    clear = trial.phase("clear")
    ramp = trial.phase("ramp")
    approach = trial.phase("approach")
    if clear is not None and clear.stop - clear.start >= 5:
        part = force[clear.samples]
        offset = float(np.median(part[len(part) // 2 :]))
    elif approach is not None:
        offset = float(
            np.median(force[approach.start : approach.start + max(3, (approach.stop - approach.start) // 5)])
        )
    else:
        offset = float(np.median(force[: max(3, min(len(force) // 50, round(0.05 * rate)))]))
    if trial.kind == "air_sweep":
        return float(x.max()) + 1.0, float(np.median(force))
    stop = ramp.stop if ramp is not None else int(np.argmax(force)) + 1
    w = max(1, round(0.004 * rate))
    padded = np.concatenate([np.full(w, force[0]), force[:stop]])
    total = np.cumsum(padded)
    smooth = (total[w:] - total[:-w])[:stop] / w
    peak = float(smooth.max()) - offset
    level = max(
        0.02 * peak,
        6.0 * float(np.std(force[: max(8, stop // 20)] - smooth[: max(8, stop // 20)])) / np.sqrt(w),
    )
    below = np.flatnonzero(smooth - offset < level)
    first = int(below[-1]) if below.size else 0
    twice = np.flatnonzero(smooth[first:] - offset > 3 * level)
    second = first + (int(twice[0]) if twice.size else 0)
    rise, way = smooth[second] - smooth[first], x[second] - x[first]
    back = (smooth[first] - offset) * way / rise if rise > 0 and way > 0 else 0.0
    return max(float(x[first] - max(0.0, min(back, 0.2))), float(x[0])), offset


def condition_of(trial: Trial) -> str:
    """Return what was stated of a trial: kind, depth, speed and hold, as far as the file says."""
    p = trial.protocol
    parts: list[str] = [trial.kind]
    for value, unit in ((p.depth_mm, "mm"), (p.ramp_speed_mm_s, "mm/s"), (p.hold_s, "s")):
        if value is not None:
            parts.append(f"{value:.4g} {unit}")
    return " ".join(parts)


def reduce_trial(
    trial: Trial,
    motion: Motion,
    *,
    order: int = 0,
    pressed_before: tuple[float, float] | None = None,
    hold_only: bool = False,
) -> CellTrial:
    """Reduce a trial to cells; ``hold_only`` marks nothing but the hold as to be fitted (step baseline)."""
    z0_mm, offset_mn = find_contact(trial, motion)
    starts = _cell_starts(trial, motion, z0_mm, offset_mn)
    samples_s, force_mn = trial.time_s, trial.force_mn
    if trial.native is not None:
        samples_s, force_mn = trial.native.time_s, trial.native.force_mn
        begin_s = trial.time_s[starts] - 0.5 / trial.sample_rate_hz
        starts = np.unique(np.minimum(np.searchsorted(samples_s, begin_s), len(samples_s) - 1))
    counts = np.diff(np.append(starts, len(samples_s))).astype(np.float64)
    last = np.append(starts[1:], len(samples_s)) - 1

    def taken(signal: FloatArray) -> FloatArray:
        return signal if trial.native is None else np.interp(samples_s, trial.time_s, signal)

    def mean(signal: FloatArray) -> FloatArray:
        return np.add.reduceat(taken(signal), starts) / counts

    def means(signals: FloatArray) -> FloatArray:
        return np.column_stack([mean(signal) for signal in signals.T])

    def path_in_cells(of: ArmPath) -> CellPath:
        return CellPath(
            position_mm=mean(of.position_mm),
            velocity_mm_s=mean(of.velocity_mm_s),
            acceleration_mm_s2=mean(of.acceleration_mm_s2),
            position_error_mm=mean(of.position_error_mm),
            position_noise_mm=of.noise_mm,
            beside_servo_mm=mean(of.beside_servo_mm),
        )

    phase = np.full(trial.n_samples, -1, dtype=np.int64)
    for p in trial.phases:
        phase[p.samples] = PHASE_NAMES.index(p.name)
    nearest = np.round(samples_s[starts] * trial.sample_rate_hz).astype(np.int64)
    cell_phase = phase[np.minimum(nearest, trial.n_samples - 1)]
    fitted = cell_phase == PHASE_NAMES.index("hold") if hold_only else np.ones(len(starts), dtype=bool)
    command = trial.command_mm
    hold = trial.phase("hold")
    reached = (
        float(np.median(motion.position_mm[hold.samples]))
        if hold is not None
        else float(motion.position_mm.max())
    )
    finger = f"{trial.specimen.subject} {trial.specimen.finger}".strip()
    path, if_noise_lasts = path_in_cells(motion), None
    if motion.if_noise_lasts is not None:
        calmer = path_in_cells(motion.if_noise_lasts)
        if_noise_lasts = None if np.array_equal(calmer.position_mm, path.position_mm) else calmer
    reduced = CellTrial(
        **vars(path),
        label=trial.path or trial.trial_id,
        kind=trial.kind,
        condition=condition_of(trial),
        order=order,
        sample_rate_hz=trial.sample_rate_hz,
        starts=starts,
        counts=counts,
        full_force_mn=force_mn.astype(np.float32),
        full_servo_residual_mm=taken(motion.servo_residual_mm).astype(np.float32),
        time_s=0.5 * (samples_s[starts] + samples_s[last]),
        shake_mm_s2=means(motion.shake_mm_s2),
        command_mm=mean(command) if command is not None else mean(motion.position_mm),
        force_mn=np.add.reduceat(force_mn, starts) / counts,
        servo_residual_mm=mean(motion.servo_residual_mm),
        servo_signature_mm=means(motion.servo_signature_mm),
        phase=cell_phase,
        z0_start_mm=z0_mm,
        offset_start_mn=offset_mn,
        depth_mm=reached - z0_mm,
        has_command=command is not None,
        pressed_before=pressed_before,
        target_stiffness_mn_per_mm=trial.specimen.target_stiffness_mn_per_mm,
        study_depth_mm=max(
            float(np.ptp(motion.position_mm)) if trial.kind == "air_sweep" else abs(reached - z0_mm), 1e-9
        ),
        finger=finger,
        site=f"{finger} {trial.specimen.site}" if trial.specimen.site else "",
        fitted=fitted,
        levels=levels_of(force_mn) if trial.native is None else None,
        if_noise_lasts=if_noise_lasts,
        uneven_s=None if trial.native is None else samples_s,
    )
    return replace(reduced, force_mn=reduced.cell_means(force_mn))
