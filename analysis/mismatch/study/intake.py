"""From trial files to cells: what can be diagnosed together, and what is said of what can't."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np

from analysis.errors import BadInputError
from analysis.mismatch.study.held_force import held_for, held_note, with_readings
from analysis.mismatch.study.loudness import with_loudness
from analysis.mismatch.study.repeats import with_conditions
from analysis.recordings import read_trial
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from analysis.simulation.motion import FoundServo, estimate_motion, fit_servo
from analysis.simulation.reduction import reduce_trial

Setting = Literal["finger", "lever", "other"]
"""A finger under a lever, another specimen under a lever, or another instrument."""
DIAGNOSED = ("ramp_hold_retract", "air_sweep", "rigid_target")
SERVO_TRIALS = 12
SLOPE_TOLERANCE = 0.2
MOVES_MM = 0.002
UNCOMPUTABLE = (ArithmeticError, ValueError, IndexError)
"""What arithmetic ends in on samples that nobody foresaw; numpy's LinAlgError is a ValueError."""


@dataclass(frozen=True)
class Intake:
    """Trials in cells, in the order they were recorded; what was left out, and what to know of the rest (sentences)."""

    trials: tuple[CellTrial, ...]
    left_out: tuple[str, ...]
    servo: FoundServo
    punch_diameter_mm: float | None
    notes: tuple[str, ...] = ()
    setting: Setting = "finger"
    imports: tuple[tuple[str, tuple[str, ...]], ...] = ()
    """File and log of every trial that was imported."""


def take_in(paths: Sequence[Path], *, hold_only: bool = False) -> Intake:
    """Read and reduce trial files one by one, so that memory holds cells and not recordings.

    A file that can't be compared is left out with its reason, and stops no other. Raises BadInputError, one line,
    where none is left, or where the trials are of different rigs.
    """
    heads: list[Trial] = []
    left_out: list[str] = []
    for path in paths:
        try:
            trial = read_trial(path)
            reason = _not_diagnosed(trial)
            if not reason:
                check_trial(trial)
                heads.append(_without_signals(trial, path))
        except BadInputError as error:
            reason = str(error).removeprefix(f"{path}: ").removeprefix(f"{path.name}: ")
        if reason:
            left_out.append(f"{path.name}: {reason}")
    if not heads:
        raise BadInputError(_nothing(left_out))
    check_together(heads)
    return _reduce(
        heads, left_out, lambda head: replace(read_trial(Path(head.path)), path=head.path), hold_only
    )


def without_trials(taken: Intake, reasons: Mapping[int, str]) -> Intake:
    """Return what was taken in without some trials, by their place, each with its reason."""
    said = [f"{Path(taken.trials[j].label).name}: {why}" for j, why in reasons.items()]
    kept = tuple(t for j, t in enumerate(taken.trials) if j not in reasons)
    return replace(taken, trials=kept, left_out=(*taken.left_out, *said))


def _nothing(left_out: Sequence[str]) -> str:
    more = f"; and {len(left_out) - 1} more" if len(left_out) > 1 else ""
    why = f" ({left_out[0]}{more})" if left_out else ""
    return f"nothing to diagnose: no ramp-and-hold, air sweep or rigid target that can be compared{why}"


def take_in_memory(trials: Sequence[Trial], *, hold_only: bool = False) -> Intake:
    """Reduce trials that are in memory already (for campaigns); checks as for files."""
    used = [t for t in trials if not _not_diagnosed(t)]
    for t in used:
        check_trial(t)
    if not used:
        raise BadInputError(_nothing(()))
    check_together(used)
    return _reduce(used, [], lambda trial: trial, hold_only)


def _reduce(
    heads: Sequence[Trial], left_out: list[str], load: Callable[[Trial], Trial], hold_only: bool
) -> Intake:
    if hold_only and any(h.kind != "ramp_hold_retract" for h in heads):
        raise BadInputError(
            "the step baseline compares holds on skin only; leave out air sweeps and rigid targets, "
            "or use --baseline ramp"
        )
    heads = sorted(heads, key=lambda t: (t.started, t.path))
    punches_mm = _punches_mm(heads)
    with_command = [h for h in heads if h.command_v is not None]
    driven = [load(h) for h in with_command[:SERVO_TRIALS]]
    servo = fit_servo(driven)
    undriven = [h for h in heads[:SERVO_TRIALS] if h.command_v is None]
    held = held_for(chain(driven[: SERVO_TRIALS - len(undriven)], map(load, undriven)))
    del driven
    cells: list[CellTrial] = []
    before_mm: float | None = None
    for order, head in enumerate(heads):
        rest_s = head.specimen.rest_s
        # where the rest is not known, nobody knows how much is left
        felt = (before_mm, rest_s) if before_mm is not None and rest_s is not None else None
        try:
            whole = load(head)
            trial, motion = with_readings(whole, estimate_motion(whole, servo), held)
            reduced = reduce_trial(trial, motion, order=order, pressed_before=felt, hold_only=hold_only)
            late_samples = servo.late_s * trial.sample_rate_hz
            cells.append(_under(replace(reduced, late_samples=late_samples), head, punches_mm))
        except UNCOMPUTABLE as error:
            left_out.append(
                f"{Path(head.path).name}: motion and contact can't be told from its samples ({error})"
            )
            continue
        if head.kind == "ramp_hold_retract":
            before_mm = cells[-1].depth_mm
    if not cells:
        raise BadInputError(_nothing(left_out))
    setting = _setting(heads)
    cells = [replace(c, lever=setting != "other") for c in with_loudness(with_conditions(cells))]
    skin = [c.study_depth_mm for c in cells if c.kind == "ramp_hold_retract"]
    if skin:
        cells = [replace(c, study_depth_mm=max(skin)) for c in cells]
    return Intake(
        tuple(cells),
        tuple(left_out),
        servo,
        punches_mm[0] if punches_mm else None,
        (*_notes(heads), *held_note(held)),
        setting,
        tuple((Path(h.path).name, h.log) for h in heads if h.source == "imported"),
    )


def _setting(heads: Sequence[Trial]) -> Setting:
    if any(h.specimen.finger or h.source != "imported" for h in heads):
        return "finger"
    return "lever" if all(any(".ddf" in line for line in h.log[:1]) for h in heads) else "other"


def _notes(heads: Sequence[Trial]) -> tuple[str, ...]:
    """Return what a reader must know of how the trials were sampled."""
    notes = []
    rates = sorted({round(h.sample_rate_hz, 3) for h in heads})
    if len(rates) > 1:
        told = ", ".join(f"{r:.3g}" for r in rates)
        notes.append(
            f"The trials were sampled differently ({told} Hz); each is compared at its own rate. Their noise is taken "
            "as white, and lines in their spectra were not looked for."
        )
    punches_mm = _punches_mm(heads)
    if len(punches_mm) > 1:
        told = " and ".join(f"{d:g}" for d in punches_mm)
        notes.append(
            f"The trials were recorded with punches of {told} mm. On one skin a flat punch's force is taken to grow "
            "with its diameter, and the time of a drainage with its square; what is told here of stiffness and times "
            f"is that of {punches_mm[0]:g} mm."
        )
    uneven = sum(h.native is not None for h in heads)
    if uneven:
        notes.append(
            f"{uneven} of {len(heads)} recordings were not evenly sampled. Their samples are compared as they were "
            "taken; all noise is taken as white, and lines in the spectra were not looked for."
        )
    return tuple(notes)


def _without_signals(trial: Trial, path: Path) -> Trial:
    nothing = np.zeros(0)
    command = None if trial.command_v is None else nothing
    return replace(trial, position_v=nothing, force_v=nothing, command_v=command, path=str(path))


def _not_diagnosed(trial: Trial) -> str:
    if trial.discarded:
        return f"discarded ({trial.discarded})"
    if trial.kind not in DIAGNOSED:
        return f"a {trial.kind.replace('_', ' ')}, which has no simulation to be compared with"
    return ""


def check_trial(trial: Trial) -> None:
    """Refuse a trial that says nothing: no motion, no force, no ramp or hold; raises BadInputError."""
    where = Path(trial.path).name if trial.path else trial.trial_id
    force, position = trial.force_mn, trial.position_mm
    if not np.any(trial.force_v) or float(np.ptp(force)) == 0.0:
        raise BadInputError(
            f"{where}: the force is the same in every sample; check the force channel and record again"
        )
    if float(np.ptp(position)) < MOVES_MM:
        raise BadInputError(
            f"{where}: the position never moves by more than {1e3 * np.ptp(position):.2g} um; "
            "record a trial with a ramp"
        )
    if trial.kind == "ramp_hold_retract":
        missing = [name for name in ("ramp", "hold") if trial.phase(name) is None]
        if missing:
            raise BadInputError(
                f"{where}: phase {' and '.join(missing)} missing; a ramp-and-hold needs both in /phases"
            )
    if trial.kind == "air_sweep" and trial.phase("sweep") is None:
        raise BadInputError(f"{where}: phase sweep missing; an air sweep needs it in /phases")


def check_together(trials: Sequence[Trial]) -> None:
    """Refuse trials of different rigs; raises BadInputError that names the two files that differ."""
    first = trials[0]
    for other in trials[1:]:
        pair = f"{Path(first.path).name} and {Path(other.path).name}"
        imported = first.source == other.source == "imported"
        if not imported and not np.isclose(first.sample_rate_hz, other.sample_rate_hz, rtol=1e-6):
            raise BadInputError(
                f"{pair}: recorded at {first.sample_rate_hz:g} and {other.sample_rate_hz:g} Hz, so on different rigs; "
                "diagnose each rig by itself"
            )
        for name in ("volts_per_mm", "volts_per_mn"):
            a, b = getattr(first.calibration, name), getattr(other.calibration, name)
            if abs(a - b) > SLOPE_TOLERANCE * abs(a):
                raise BadInputError(
                    f"{pair}: {name} is {a:.4g} and {b:.4g}, so on different rigs; diagnose each rig by itself"
                )
    punches_mm = _punches_mm(trials)
    unstated = [t for t in trials if t.specimen.punch_diameter_mm is None]
    if len(punches_mm) > 1 and unstated:
        told = " and ".join(f"{d:g}" for d in punches_mm)
        raise BadInputError(
            f"{Path(unstated[0].path).name}: no punch_diameter_mm in /specimen, and the others say {told} mm; "
            "state it, or diagnose each punch by itself"
        )


def _punches_mm(trials: Sequence[Trial]) -> list[float]:
    """Return the diameters of the punches that are stated, the commonest first, mm."""
    stated = [round(d, 3) for t in trials if (d := t.specimen.punch_diameter_mm) is not None]
    return [d for d, _ in Counter(stated).most_common()]


def _under(cells: CellTrial, head: Trial, punches_mm: Sequence[float]) -> CellTrial:
    """Return a trial under its punch, where there are several; under another it is no repeat."""
    own_mm = head.specimen.punch_diameter_mm
    if len(punches_mm) < 2 or own_mm is None:
        return cells
    condition = f"{cells.condition} under {own_mm:g} mm"
    return replace(cells, punch_ratio=own_mm / punches_mm[0], condition=condition)
