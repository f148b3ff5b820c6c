"""What an import found, for the eye that knows the experiment: a table, and warnings where something looks wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray, Trial

_SOFTEST, _STIFFEST = 0.3, 3e6  # mN/mm; from a jelly under a needle to a steel block: beyond, a unit is wrong
_FALLS = 0.5  # of the force's range, by which it may fall on loading before its sign is doubted


@dataclass(frozen=True, slots=True)
class Findings:
    """``rows`` are (what, words) pairs; ``warnings`` whole sentences."""

    rows: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]

    def lines(self) -> tuple[str, ...]:
        """Return the findings as lines of a log."""
        return (
            *(f"{what}: {words}" for what, words in self.rows),
            *(f"WARNING: {one}" for one in self.warnings),
        )


def look_at(trial: Trial, *, of_cells: bool = False) -> Findings:
    """Return what a person would ask of an imported trial before believing it.

    ``of_cells``: forces of nanonewtons are to be expected (an AFM).
    """
    native = trial.native
    rate = f"{trial.sample_rate_hz:g} Hz, {trial.n_samples} samples, {trial.n_samples / trial.sample_rate_hz:.4g} s"
    if native is not None:
        rate = f"uneven: {len(native.time_s)} samples, put onto {rate}"
    rows = [
        ("channels", "position, force, command" if trial.command_v is not None else "position, force"),
        ("sampling", rate),
        ("position", _range(trial.position_mm, "mm")),
        ("force", _range(trial.force_mn, "mN")),
    ]
    for phase in trial.phases:
        start_s, stop_s = phase.start / trial.sample_rate_hz, phase.stop / trial.sample_rate_hz
        rows.append((phase.name, f"{start_s:.4g} to {stop_s:.4g} s{_of_phase(trial, phase.name)}"))
    rows.extend((event.kind.replace("_", " "), event.message) for event in trial.events)
    rows.extend(_said(trial))
    return Findings(tuple(rows), tuple(_warnings(trial, of_cells=of_cells)))


def in_short(trial: Trial) -> tuple[str, str, str, str, str]:
    """Return rate (Hz), depth (mm), length of ramp and hold (s) and peak force (mN) as short texts, "" for none."""
    ramp, hold = trial.phase("ramp"), trial.phase("hold")
    seconds = ["" if p is None else f"{(p.stop - p.start) / trial.sample_rate_hz:.3g}" for p in (ramp, hold)]
    depth = "" if ramp is None else f"{_travel_mm(trial):.3g}"
    return f"{trial.sample_rate_hz:g}", depth, seconds[0], seconds[1], f"{float(trial.force_mn.max()):.3g}"


def _range(values: FloatArray, unit: str) -> str:
    return f"{float(values.min()):.4g} to {float(values.max()):.4g} {unit}"


def _of_phase(trial: Trial, name: str) -> str:
    phase = trial.phase(name)
    if phase is None or phase.stop - phase.start < 2:
        return ""
    position_mm, force_mn = trial.position_mm[phase.samples], trial.force_mn[phase.samples]
    if name == "ramp":
        travel_mm, seconds = _travel_mm(trial), (phase.stop - phase.start) / trial.sample_rate_hz
        return f": {travel_mm:.4g} mm at {travel_mm / seconds:.3g} mm/s, {phase.stop - phase.start} samples"
    if name == "hold":
        peak, end = float(np.max(force_mn)), float(np.mean(force_mn[-max(1, len(force_mn) // 20) :]))
        return f": {float(np.median(position_mm)):.4g} mm, force from {peak:.4g} to {end:.4g} mN"
    return ""


def _travel_mm(trial: Trial) -> float:
    ramp = trial.phase("ramp")
    if ramp is None:
        return 0.0
    stop = min(ramp.stop, trial.n_samples - 1)
    return float(trial.position_mm[stop] - trial.position_mm[ramp.start])


def _said(trial: Trial) -> list[tuple[str, str]]:
    known = [trial.specimen.subject, trial.specimen.finger, trial.specimen.site]
    rows = [("specimen", " ".join(filter(None, known)))] if any(known) else []
    if trial.specimen.punch_diameter_mm is not None:
        rows.append(("punch", f"{trial.specimen.punch_diameter_mm:g} mm"))
    return rows


def _warnings(trial: Trial, *, of_cells: bool) -> list[str]:
    ramp = trial.phase("ramp")
    if trial.kind not in {"ramp_hold_retract", "rigid_target"}:
        return []
    if ramp is None:
        return ["no phases were found: nothing to fit, unless --kind says what was done"]
    found = []
    force_mn = trial.force_mn[ramp.start : ramp.stop + 1]
    before_mn = float(np.median(trial.force_mn[max(0, ramp.start - 20) : ramp.start + 1]))
    rise_mn, span_mn = float(force_mn[-1]) - before_mn, float(np.ptp(trial.force_mn))
    if rise_mn < -_FALLS * span_mn:
        found.append(
            f"the force falls by {-rise_mn:.4g} mN on loading: is compression negative here? say so by a unit with "
            "a minus, as in --unit force=-mN"
        )
    travel_mm = _travel_mm(trial)
    stiffness = abs(rise_mn) / travel_mm if travel_mm > 0 else 0.0
    if not of_cells and stiffness and not _SOFTEST < stiffness < _STIFFEST:
        much = "little" if stiffness < _SOFTEST else "much"
        found.append(
            f"{abs(rise_mn):.3g} mN over {travel_mm:.3g} mm is {much} for any specimen: is a unit a thousandfold off? "
            "say it by --unit"
        )
    depth_mm = trial.protocol.depth_mm
    if depth_mm and travel_mm > 0 and not 0.1 < travel_mm / depth_mm < 10.0:
        found.append(f"the ramp is {travel_mm:.3g} mm deep, and {depth_mm:g} mm was said: is a unit wrong?")
    return found
