"""How strong a concealed effect is: the norm, over the noise, of what no baseline simulation could absorb.

A bench with the effect and one without it play the same study, both without noise. What differs in the force
given the recorded position, and in the position given the command, is made orthogonal to what a fit of the
baseline is free to choose: contact point and offset of each trial, and k0, k1, tau1, k2, tau2, of each trial
where sites differ or the gain does, else of all trials together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from sim_hardware.concealment.plans import TrialPlan
from sim_hardware.filters import LowPass
from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray
from sim_hardware.settings import BenchSettings, ConverterSettings, EffectSettings, NoiseSettings
from sim_hardware.world import World
from sim_hardware.world.specimens import site_scatter

_PARK_MM = 1.0
_STEP = 1e-4
_STEP_MM = 5e-5
_FORCE_NOISE_MN = 0.3
_POSITION_NOISE_MM = 2.5e-4
_STUDIES_KEPT = 4
"""A case asks for the same few benches again and again; a study takes 20 MB, and a campaign draws hundreds."""


@dataclass(frozen=True, slots=True)
class Quiet:
    """One trial without noise; arrays are (n,). ``surface_mm``: the contact position."""

    position_mm: FloatArray
    force_mn: FloatArray
    command_mm: FloatArray
    surface_mm: float
    tissue: tuple[float, ...]
    depth_mm: float
    phases: tuple[tuple[str, int, int], ...]


def strength(settings: BenchSettings, effects: Sequence[EffectSettings], plans: Sequence[TrialPlan]) -> float:
    """Return the strength of effects on a bench over a study, in units of the noise.

    The larger of two norms: of the force given the position over 0.3 mN a sample, and of the position given
    the command over 0.25 um a sample (or what the bench's settings say).
    """
    study = tuple(plans)
    # converters stay only where an effect is theirs: what they round off would pass for strength
    converting = any(e.name == "dropped_bit" for e in effects)
    without = _recorded(quiet_bench(settings, (), converting), study)
    with_them = record_quietly(quiet_bench(settings, tuple(effects), converting), study)
    force_mn = settings.noise.force_mn_rms or _FORCE_NOISE_MN
    position_mm = settings.noise.position_um_rms * 1e-3 or _POSITION_NOISE_MM
    one_tissue = settings.noise.gain_jitter == 0 and not any(site_scatter(settings.specimens).values())
    gram = np.zeros((5, 5))
    projected = np.zeros(5)
    force_power = position_power = 0.0
    for a, b in zip(without, with_them, strict=True):
        left, shared = _force_given_position(a, b)
        if one_tissue:
            gram += shared.T @ shared
            projected += shared.T @ left
        else:
            left = _without(shared, left)
        force_power += float(left @ left)
        command = np.column_stack([np.ones_like(a.command_mm), a.command_mm])
        moved = _without(command, b.position_mm - a.position_mm)
        position_power += float(moved @ moved)
    if one_tissue:
        scale = np.sqrt(np.diag(gram))
        solved = np.linalg.lstsq(gram / np.outer(scale, scale), projected / scale, rcond=1e-9)[0]
        force_power -= float(projected / scale @ solved)
    by_force = np.sqrt(max(force_power, 0.0)) / force_mn
    by_position = np.sqrt(position_power) / position_mm
    return float(max(by_force, by_position))


def explained(
    settings: BenchSettings, effect: EffectSettings, law: EffectSettings, plans: Sequence[TrialPlan]
) -> float:
    """Return the share of an effect's power that a law of another size would explain, tissue free in each trial."""
    study = tuple(plans)
    without = _recorded(quiet_bench(settings, (), False), study)
    own = of_both = of_law = 0.0
    benches = [record_quietly(quiet_bench(settings, (e,), False), study) for e in (effect, law)]
    for a, *with_them in zip(without, *benches, strict=True):
        left, other = (_without(shared, r) for r, shared in (_force_given_position(a, b) for b in with_them))
        own, of_law = own + float(left @ left), of_law + float(other @ other)
        of_both += float(left @ other)
    return float(of_both**2 / (own * of_law))


def _force_given_position(a: Quiet, b: Quiet) -> tuple[FloatArray, FloatArray]:
    """Return the mismatch (n,) of ``b`` beyond ``a``'s and the tissue's columns (n, 5), own columns out."""
    difference = (b.force_mn - _baseline(b, 0.0, b.tissue)) - (a.force_mn - _baseline(a, 0.0, a.tissue))
    shared = np.empty((len(difference), 5))
    for k in range(5):
        up, down = list(a.tissue), list(a.tissue)
        up[k] *= 1 + _STEP
        down[k] *= 1 - _STEP
        shared[:, k] = (_baseline(a, 0.0, tuple(up)) - _baseline(a, 0.0, tuple(down))) / (2 * _STEP)
    contact = (_baseline(a, _STEP_MM, a.tissue) - _baseline(a, -_STEP_MM, a.tissue)) / (2 * _STEP_MM)
    own = np.column_stack([np.ones_like(difference), contact])
    return _without(own, difference), _without(own, shared)


def _without(columns: FloatArray, of: FloatArray) -> FloatArray:
    """Return arrays (n,) or (n, m) made orthogonal to columns (n, q)."""
    basis, _ = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    left: FloatArray = of - basis @ (basis.T @ of)
    return left


def _baseline(trial: Quiet, shift_mm: float, tissue: tuple[float, ...]) -> FloatArray:
    """Return the force (n,) of the solid of two arms pressed by the recorded motion, never below 0."""
    k0, k1, tau1, k2, tau2 = tissue
    depth_mm = np.maximum(trial.position_mm - trial.surface_mm - shift_mm, 0.0)
    force: FloatArray = (k0 + k1 + k2) * depth_mm
    for k, tau in ((k1, tau1), (k2, tau2)):
        force = force - k * LowPass(tau, 1 / SAMPLE_RATE_HZ)(depth_mm)
    return np.maximum(force, 0.0)


def quiet_bench(
    settings: BenchSettings, effects: tuple[EffectSettings, ...], converting: bool
) -> BenchSettings:
    """Return the bench without noise, but for the gain that differs from trial to trial."""
    bits = settings.converters.bits if converting else 0
    return settings.model_copy(
        update={
            "effects": effects,
            "noise": NoiseSettings(
                force_mn_rms=0.0, position_um_rms=0.0, gain_jitter=settings.noise.gain_jitter
            ),
            "converters": ConverterSettings(
                bits=bits, offset_mv_rms=0.0, stepwise_output=settings.converters.stepwise_output
            ),
        }
    )


@lru_cache(maxsize=_STUDIES_KEPT)
def _recorded(settings: BenchSettings, plans: tuple[TrialPlan, ...]) -> tuple[Quiet, ...]:
    return record_quietly(settings, plans)


def record_quietly(settings: BenchSettings, plans: tuple[TrialPlan, ...]) -> tuple[Quiet, ...]:
    """Play a study on a fresh bench whose operator knows where the skin is; return what was recorded."""
    world = World(settings)
    c = world.constants
    found = []
    for i, plan in enumerate(plans):
        if i:
            world.rest(plan.rest_s)
        world.request("place_finger", {"finger": plan.finger, "site": plan.site, "repeat": plan.repeat})
        surface_mm = world.specimen.surface_mm
        parts = world.specimen.parts
        (k1, tau1), (k2, tau2) = ((arm.stiffness_mn_per_mm, arm.time_s) for arm in parts.arms)
        gain = world.noise.gain
        tissue = (gain * parts.k0_mn_per_mm, gain * k1, tau1, gain * k2, tau2)
        speed = plan.approach_speed_mm_s
        crossing_mm = surface_mm + _indented_at_mm(plan.contact_threshold_mn, speed, tissue)
        start_mm, touch_mm = surface_mm - plan.short_mm, crossing_mm + speed * float(np.mean(plan.latency_s))
        deep_mm = crossing_mm + plan.depth_mm
        world.advance(c.command_zero_v + c.command_volts_per_mm * _line(_PARK_MM, start_mm, 20.0))
        world.begin_trial()
        pieces = {
            "approach": np.concatenate([np.full(800, start_mm), _line(start_mm, touch_mm, speed)]),
            "dwell": np.full(round(plan.dwell_s * SAMPLE_RATE_HZ), touch_mm),
            "ramp": _line(touch_mm, deep_mm, plan.ramp_speed_mm_s),
            "hold": np.full(round(plan.hold_s * SAMPLE_RATE_HZ), deep_mm),
            "retract": _line(deep_mm, start_mm, plan.retract_speed_mm_s),
            "clear": np.full(round(plan.clear_s * SAMPLE_RATE_HZ), start_mm),
        }
        command_mm = np.concatenate(list(pieces.values()))
        stops = np.cumsum([len(piece) for piece in pieces.values()]).tolist()
        readings = world.advance(c.command_zero_v + c.command_volts_per_mm * command_mm)
        world.advance(c.command_zero_v + c.command_volts_per_mm * _line(start_mm, _PARK_MM, 20.0))
        found.append(
            Quiet(
                (readings.position_v - c.position_zero_v) / c.volts_per_mm,
                (readings.force_v - c.force_zero_v) / c.volts_per_mn,
                command_mm,
                surface_mm,
                tissue,
                plan.depth_mm,
                tuple(zip(pieces, [0, *stops[:-1]], stops, strict=True)),
            )
        )
    return tuple(found)


def peak_mn(settings: BenchSettings, plans: Sequence[TrialPlan]) -> float:
    """Return the largest force of a study without effects and noise."""
    return max(float(q.force_mn.max()) for q in _recorded(quiet_bench(settings, (), False), tuple(plans)))


def tissue_of(settings: BenchSettings, plans: Sequence[TrialPlan]) -> tuple[float, ...]:
    """Return k0, k1, tau1, k2, tau2 as the sensor shows them, geometric means over a study's trials."""
    quiet = _recorded(quiet_bench(settings, (), False), tuple(plans))
    return tuple(float(v) for v in np.exp(np.mean(np.log([q.tissue for q in quiet]), axis=0)))


def _indented_at_mm(force_mn: float, speed_mm_s: float, tissue: tuple[float, ...]) -> float:
    """Return how deep the solid of two arms is pressed, mm, when the force of a steady approach is reached."""
    k0, k1, tau1, k2, tau2 = tissue

    def missing_mn(depth_mm: float) -> float:
        t = depth_mm / speed_mm_s
        arms = sum(k * speed_mm_s * tau * -math.expm1(-t / tau) for k, tau in ((k1, tau1), (k2, tau2)))
        return k0 * depth_mm + arms - force_mn

    return float(brentq(missing_mn, 0.0, force_mn / k0))


def _line(from_mm: float, to_mm: float, speed_mm_s: float) -> FloatArray:
    n = max(round(abs(to_mm - from_mm) / speed_mm_s * SAMPLE_RATE_HZ), 1)
    return from_mm + (to_mm - from_mm) * np.arange(1, n + 1) / n
