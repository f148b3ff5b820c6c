"""The punch on the specimen: unilateral contact, tissue of many Maxwell arms, all that gives way between.

The tissue under the punch has a depression d of its own. While the punch presses, d follows the punch; when
the tissue cannot follow (F would fall below what the skin clings with) the punch leaves it, and the free
surface creeps back with F = 0, so the tissue remembers between contacts. Each fine step is implicit in d:
the arms take the step as linear in time (exactly, for elongations linear in time), so a punch that lands or
leaves within a step does so at its true instant to second order in the step.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_hardware.parts import FloatArray, Parts

# layout of the constants c
K0, STIFFENING, COMPLIANCE, CREEP, CREEP_TIME, SLACK, SLACK_FORCE, DASHPOT = range(8)
PULL_OFF, PEEL, PEEL_RATE, SUPPORT_MASS, SUPPORT, SUPPORT_DAMPING = range(8, 14)
CUBIC, QUARTIC, SETTING_TIME, RECOVERY_TIME, STEP, POWER, REFERENCE = range(14, 21)
# layout of the state
DEPRESSION, ELONGATION, CREPT, BONDED, OPENING, SUPPORT_SHIFT, SUPPORT_SPEED, FORCE, TOUCHING, SET = range(10)
# rows of the arms: stiffness, time, exp(-h / tau), k (tau / h) (1 - exp(-h / tau)), force
STIFFNESS, TIME, DECAY, GAIN, LOAD = range(5)
# what one step knows of F(d) = fixed + gain e(d) + dash (d - old), and what gives at once under it
FIXED, TOTAL_GAIN, DASH, OLD, GIVE = range(5)

_CLOSE_MM = 1e-13
_SOFT_MM = 5e-4
_TRIES = 60
_PEELED = 40
"""A bond opened to so many times the opening at which it grips hardest is gone."""


@njit(cache=True, error_model="numpy")
def _elongation(d: float, c: FloatArray) -> tuple[float, float]:
    """Return e(d) = d + b d^2 + cubic d^3 + quartic d^4, or a power of d, and its slope.

    The power is r ((d + s) / r)^p - r (s / r)^p with s of 0.5 um, and a line where d is below zero, so that
    its slope is nowhere zero.
    """
    if c[POWER] != 1.0:
        r, p = c[REFERENCE], c[POWER]
        steep = p * (_SOFT_MM / r) ** (p - 1)
        if d <= 0.0:
            return steep * d, steep
        at = (d + _SOFT_MM) / r
        return r * (at**p - (_SOFT_MM / r) ** p), p * at ** (p - 1)
    e = d * (1 + d * (c[STIFFENING] + d * (c[CUBIC] + d * c[QUARTIC])))
    return e, 1 + d * (2 * c[STIFFENING] + d * (3 * c[CUBIC] + d * 4 * c[QUARTIC]))


@njit(cache=True, error_model="numpy")
def _force(d: float, c: FloatArray, step: FloatArray) -> tuple[float, float]:
    """Return F(d) and its slope."""
    e, slope = _elongation(d, c)
    force = step[FIXED] + step[TOTAL_GAIN] * e + step[DASH] * (d - step[OLD])
    return force, step[TOTAL_GAIN] * slope + step[DASH]


@njit(cache=True, error_model="numpy")
def _give_way(c: FloatArray, state: FloatArray, step: FloatArray) -> None:
    """Move what gives way slowly: glue under the mean force of the step, the support under the last.

    The glue's share of the force still to come is left in ``step[GIVE]`` beside the spring of the tip.
    """
    force, h = state[FORCE], c[STEP]
    step[GIVE] = c[COMPLIANCE]
    if c[CREEP] > 0.0:
        keep = math.exp(-h / c[CREEP_TIME])
        half = (1 - keep) * c[CREEP] / 2
        state[CREPT] = state[CREPT] * keep + half * force
        step[GIVE] += half
    if c[SUPPORT_MASS] > 0.0:
        if h * math.sqrt(c[SUPPORT] / c[SUPPORT_MASS]) < 0.5:
            pull = force - c[SUPPORT] * state[SUPPORT_SHIFT] - c[SUPPORT_DAMPING] * state[SUPPORT_SPEED]
            state[SUPPORT_SPEED] += h * pull / c[SUPPORT_MASS]
            state[SUPPORT_SHIFT] += h * state[SUPPORT_SPEED]
        else:  # a step too long to follow its ringing, which has died down
            state[SUPPORT_SHIFT] = force / c[SUPPORT]
            state[SUPPORT_SPEED] = 0.0


@njit(cache=True, error_model="numpy")
def _pressed(w: float, c: FloatArray, step: FloatArray, free: float) -> tuple[float, float]:
    """Return d and F of a punch that presses: d + give(F(d)) = w, give = C F + slack F / (F + F_s).

    ``free`` is where F = 0, from where the search starts.
    """
    C, slack, slack_force = step[GIVE], c[SLACK], c[SLACK_FORCE]
    d = free
    for _ in range(_TRIES):
        force, slope = _force(d, c, step)
        taut = max(force, 0.0) + slack_force
        off = d + C * force + slack * force / taut - w
        move = -off / (1 + (C + slack * slack_force / taut**2) * slope)
        d += min(max(move, -0.05), 0.05)
        if abs(move) < _CLOSE_MM:
            break
    return d, _force(d, c, step)[0]


@njit(cache=True, error_model="numpy")
def _peeling(w: float, c: FloatArray, step: FloatArray, state: FloatArray) -> tuple[float, float, float]:
    """Return d, F and opening o of a bond that peels.

    F = -(P (o/a) exp(1 - o/a) + rate do/dt), o = d + C F - w: it grips harder up to o = a, then lets go.
    """
    a, C = c[PEEL], step[GIVE]
    rate = c[PEEL_RATE] / c[STEP]
    d = float(step[OLD])
    for _ in range(_TRIES):
        force, slope = _force(d, c, step)
        opening = d + C * force - w
        part = max(opening, -a) / a
        grip = c[PULL_OFF] * math.exp(1 - part)
        off = force + grip * part + rate * (opening - state[OPENING])
        move = -off / (slope + (grip / a * (1 - part) + rate) * (1 + C * slope))
        d += min(max(move, -0.01), 0.01)
        if abs(move) < _CLOSE_MM:
            break
    force, _ = _force(d, c, step)
    return d, force, d + C * force - w


@njit(cache=True, error_model="numpy")
def _free(c: FloatArray, step: FloatArray) -> float:
    """Return d of a surface that nothing touches: F(d) = 0."""
    d = float(step[OLD])
    for _ in range(_TRIES):
        force, slope = _force(d, c, step)
        move = -force / slope
        d += move
        if abs(move) < _CLOSE_MM:
            break
    return d


@njit(cache=True, error_model="numpy")
def contact_step(
    approach: float, c: FloatArray, arms: FloatArray, state: FloatArray, step: FloatArray
) -> None:
    """Take one step to an approach (unloaded punch below the undisturbed surface, mm).

    ``step`` (5,) is scratch room.
    """
    step[GIVE] = c[COMPLIANCE]
    if c[CREEP] > 0.0 or c[SUPPORT_MASS] > 0.0:
        _give_way(c, state, step)
    w = approach - state[CREPT] - state[SUPPORT_SHIFT]
    d_old, e_old = state[DEPRESSION], state[ELONGATION]
    dash = c[DASHPOT] / c[STEP] if c[DASHPOT] > 0.0 else 0.0
    fixed, gain = 0.0, c[K0]
    for i in range(arms.shape[1]):
        fixed += arms[DECAY, i] * arms[LOAD, i] - arms[GAIN, i] * e_old
        gain += arms[GAIN, i]
    step[FIXED], step[TOTAL_GAIN], step[DASH], step[OLD] = fixed, gain, dash, d_old

    proportional = c[STIFFENING] == 0.0 and c[POWER] == 1.0
    linear = proportional and c[SLACK] == 0.0  # most benches: no search
    free = (dash * d_old - fixed) / (gain + dash) if linear else _free(c, step)
    d, force, opening = free, 0.0, 0.0
    touching = w > free
    if touching and linear:
        force = (w - free) / (step[GIVE] + 1 / (gain + dash))
        d = w - step[GIVE] * force
    elif touching:
        d, force = _pressed(w, c, step, free)
    elif state[BONDED] > 0.0 and c[PULL_OFF] > 0.0:
        if c[PEEL] == 0.0:  # textbook: rigid until it snaps
            d, force = _pressed(w, c, step, free)
            touching = force >= -c[PULL_OFF]
        else:
            d, force, opening = _peeling(w, c, step, state)
            touching = opening < _PEELED * c[PEEL]
        if not touching:
            d, force, opening = free, 0.0, 0.0

    e = d if proportional else _elongation(d, c)[0]
    for i in range(arms.shape[1]):
        arms[LOAD, i] = arms[DECAY, i] * arms[LOAD, i] + arms[GAIN, i] * (e - e_old)
    if c[SETTING_TIME] > 0.0:
        pressed = d if touching else 0.0
        keep = math.exp(-c[STEP] / (c[SETTING_TIME] if pressed > state[SET] else c[RECOVERY_TIME]))
        state[SET] = pressed + (state[SET] - pressed) * keep
    state[DEPRESSION], state[ELONGATION], state[FORCE] = d, e, force
    state[CREPT] += (step[GIVE] - c[COMPLIANCE]) * force
    state[BONDED] = state[TOUCHING] = 1.0 if touching else 0.0
    state[OPENING] = max(opening, 0.0)


@njit(cache=True, error_model="numpy")
def contact_steps(
    tip: FloatArray, surface: FloatArray, c: FloatArray, arms: FloatArray, state: FloatArray
) -> FloatArray:
    """Step through a block; return force and approach, (2, n * m).

    ``tip`` (n * m,) is the unloaded punch, ``surface`` (n + 1,) the surface at the sample before and the
    block's n samples, linear between them.
    """
    out = np.empty((2, tip.shape[0]))
    step = np.empty(5)
    substeps = tip.shape[0] // max(surface.shape[0] - 1, 1)
    j = 0
    for i in range(surface.shape[0] - 1):
        for s in range(substeps):
            out[1, j] = tip[j] - (surface[i] + (surface[i + 1] - surface[i]) * ((s + 1) / substeps))
            contact_step(out[1, j], c, arms, state, step)
            out[0, j] = state[FORCE]
            j += 1
    return out


@njit(cache=True, error_model="numpy")
def contact_rest(
    approach: float, duration_s: float, c: FloatArray, arms: FloatArray, state: FloatArray
) -> None:
    """Let time pass with the punch held, in steps that grow by 1 % each: relaxation slows as it goes."""
    c, own, step = c.copy(), arms.copy(), np.empty(5)
    left = duration_s
    while left > 0.0:
        h = min(c[STEP] * 1.01, left)
        c[STEP] = h
        for i in range(own.shape[1]):
            own[DECAY, i] = math.exp(-h / own[TIME, i])
            own[GAIN, i] = -own[STIFFNESS, i] * (own[TIME, i] / h) * math.expm1(-h / own[TIME, i])
        contact_step(approach, c, own, state, step)
        left -= h
    arms[LOAD] = own[LOAD]


class Contact:
    """The contact's constants and state for one specimen at one site."""

    def __init__(self, parts: Parts, step_s: float, load_mn: float = 0.0) -> None:
        arms = [(a.stiffness_mn_per_mm, a.time_s) for a in parts.arms]
        self._memory = parts.memory
        if parts.memory:  # an arm without a spring: it only carries what is left of an old load
            arms.append((0.0, parts.memory.time_s))
        self._arms = np.zeros((5, len(arms)))
        self._arms[[STIFFNESS, TIME]] = np.array(arms, dtype=np.float64).reshape(-1, 2).T
        ratio = step_s / self._arms[TIME]
        self._arms[DECAY] = np.exp(-ratio)
        self._arms[GAIN] = -self._arms[STIFFNESS] * np.expm1(-ratio) / ratio
        if parts.memory:
            self._arms[LOAD, -1] = load_mn
        self._state = np.zeros(10)
        b, growth = parts.stiffening_per_mm, parts.stiffening_growth
        support = parts.support_mn_per_mm
        mass = parts.support_mass_g * 1e-3  # 1 g = 1e-3 mN s2 / mm
        self._constants = np.array(
            [
                parts.k0_mn_per_mm,
                b,
                parts.compliance_mm_per_mn,
                parts.creep_compliance_mm_per_mn,
                parts.creep_time_s,
                parts.slack_mm,
                parts.slack_force_mn,
                parts.dashpot_mn_s_per_mm,
                parts.pull_off_mn,
                parts.peel_mm,
                parts.peel_mn_s_per_mm,
                mass,
                support,
                2 * parts.support_damping_ratio * math.sqrt(support * mass),
                growth * 2 / 3 * b**2,
                growth / 3 * b**3,
                parts.memory.setting_s if parts.memory else 0.0,
                parts.memory.time_s if parts.memory else 1.0,
                step_s,
                parts.exponent,
                parts.reference_mm,
            ]
        )

    def advance(self, tip_mm: FloatArray, surface_mm: FloatArray) -> FloatArray:
        """Return force on the punch (mN) and its unloaded approach (mm), (2, n * m).

        ``surface_mm`` (n + 1,) begins with the surface one sample before the block.
        """
        out: FloatArray = contact_steps(tip_mm, surface_mm, self._constants, self._arms, self._state)
        return out

    def rest(self, approach_mm: float, duration_s: float) -> None:
        """Let time pass with the unloaded punch held ``approach_mm`` below the undisturbed surface."""
        contact_rest(approach_mm, duration_s, self._constants, self._arms, self._state)

    @property
    def force_mn(self) -> float:
        """Force on the punch, mN."""
        return float(self._state[FORCE])

    @property
    def touching(self) -> bool:
        """Whether the punch touches the specimen."""
        return bool(self._state[TOUCHING])

    @property
    def give_mm(self) -> float:
        """How far the loaded tip lies behind the unloaded one, mm."""
        force, c = self.force_mn, self._constants
        slack = c[SLACK] * force / (max(force, 0.0) + c[SLACK_FORCE])
        return float(c[COMPLIANCE] * force + self._state[CREPT] + slack)

    @property
    def load_to_keep_mn(self) -> float:
        """Load that the tissue keeps when the punch goes elsewhere, mN: the old one and this contact's."""
        if self._memory is None:
            return 0.0
        return float(self._arms[LOAD, -1] - self._memory.mn_per_mm * self._state[SET])
