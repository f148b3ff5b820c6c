"""One solid for many trials: stiffnesses and times shared, contact point and offset of each trial its own.

A Gauss-Newton search in which every trial's own parameters are eliminated first, so that the cost grows
with the number of trials and not with its square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.reading import read_trial
from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation.block_response import BlockAnswer, block_answer
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.contact_law import FLAT, ContactLaw
from analysis.relaxation.convex_response import ConvexAnswer, convex_answer, law_knots
from analysis.relaxation.noise import NoiseSpectrum, noise_covariance, widened
from analysis.relaxation.ramp_fit import RampSolution, fit_ramp
from analysis.relaxation.result import Estimate, TrialFit
from analysis.relaxation.windows import CannotFitError, cut_window

_MOST_STEPS = 60
_SETTLED = 1e-11


@dataclass(frozen=True, slots=True)
class JointFit:
    """The shared solid and what belongs to each trial.

    ``estimates`` by the names k0_mn_per_mm, A1_over_A0.., t1_s..; standard errors from the trials' own
    noise. ``repeat_se`` by the same names: from how much the trials disagree (each trial's pull on the
    estimate taken as one draw), which also counts what differs from trial to trial. ``contact_mm``,
    ``offset_mn`` (T,) of the trials used; ``left_out`` (index, reason) of the others. ``law`` is the contact
    law that all are held to, the middle one of their own; stiffnesses are those at its reference depth.
    """

    estimates: dict[str, Estimate]
    repeat_se: dict[str, float]
    contact_mm: FloatArray
    offset_mn: FloatArray
    used: tuple[int, ...]
    left_out: tuple[tuple[int, str], ...]
    law: ContactLaw = FLAT


@dataclass(frozen=True, slots=True)
class _One:
    """A trial within a joint fit."""

    blocks: Blocks
    noise: NoiseSpectrum
    contact_seen: bool
    own: FloatArray  # offset, and contact where it was seen
    contact_mm: float
    law: ContactLaw


def fit_joint(trials: Sequence[Trial], n_arms: int = 2) -> JointFit:
    """Fit one solid to all trials; CannotFitError where fewer than two can be used.

    Trials that can't be fitted alone are left out, with their reason.
    """
    singles: list[tuple[int, RampSolution]] = []
    left_out: list[tuple[int, str]] = []
    with np.errstate(all="ignore"):
        for index, trial in enumerate(trials):
            try:
                singles.append((index, fit_ramp(cut_window(trial), n_arms)))
            except (CannotFitError, np.linalg.LinAlgError) as reason:
                left_out.append((index, str(reason)))
        if len(singles) < 2:
            raise CannotFitError(f"a joint fit needs two trials that can be fitted, not {len(singles)}")
        law = _middle_law([single for _, single in singles])
        members = [_member(single, law) for _, single in singles]
        shared = np.median([_logs(single, law) for _, single in singles], axis=0)
        shared, members = _search(shared, members, n_arms)
        return _result(shared, members, n_arms, tuple(i for i, _ in singles), tuple(left_out))


@dataclass(frozen=True, slots=True)
class FingerSolid:
    """One solid for all trials of a finger: ``joint`` is None where ``failure`` says why there is none.

    ``left_out`` are (file, reason) of trials that could not be fitted.
    """

    subject: str
    finger: str
    n: int
    joint: JointFit | None
    left_out: tuple[tuple[str, str], ...]
    failure: str = ""


def fit_fingers(files: Sequence[Path], rows: Sequence[TrialFit]) -> list[FingerSolid]:
    """Return one solid a finger from all its trials, of whatever depth, that were fitted and not discarded."""
    groups: dict[tuple[str, str], list[tuple[Path, TrialFit]]] = {}
    for file, row in zip(files, rows, strict=True):
        if row.fitted and not row.discarded:
            groups.setdefault((row.subject, row.finger), []).append((file, row))
    found = []
    for (subject, finger), group in groups.items():
        try:
            joint = fit_joint([read_trial(file) for file, _ in group])
        except (CannotFitError, np.linalg.LinAlgError) as reason:
            found.append(FingerSolid(subject, finger, 0, None, (), str(reason)))
            continue
        left_out = tuple((group[index][1].file, reason) for index, reason in joint.left_out)
        found.append(FingerSolid(subject, finger, len(joint.used), joint, left_out))
    return found


def _middle_law(singles: Sequence[RampSolution]) -> ContactLaw:
    """Return the contact law that stands in the middle of the trials' own."""
    exponent = float(np.median([single.law.exponent for single in singles]))
    depth_mm = float(np.median([np.max(single.blocks.position_mm) - single.contact_mm for single in singles]))
    return FLAT if exponent == 1.0 else ContactLaw(exponent, max(depth_mm, 1e-9))


def _logs(single: RampSolution, law: ContactLaw) -> FloatArray:
    """Return the logarithms of a trial's stiffnesses, as they are at the shared reference, and times."""
    own = single.law
    scale = (law.reference_mm / own.reference_mm) ** (own.exponent - 1.0)
    return np.asarray(
        np.log(np.concatenate([single.stiffness_mn_per_mm * scale, single.times_s])), dtype=float
    )


def _member(single: RampSolution, law: ContactLaw) -> _One:
    own = [single.offset_mn, single.contact_mm] if single.contact_seen else [single.offset_mn]
    blocks = single.blocks
    if law.exponent != 1.0:
        blocks = law_knots(blocks, single.contact_mm, law.reference_mm)
    return _One(blocks, single.noise, single.contact_seen, np.array(own), single.contact_mm, law)


def _linearised(shared: FloatArray, one: _One, n_arms: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residual (K,), derivatives by the shared logs (P, K) and by the trial's own (Q, K)."""
    stiffness, times_s = np.exp(shared[: 1 + n_arms]), np.exp(shared[1 + n_arms :])
    contact_mm = float(one.own[1]) if one.contact_seen else one.contact_mm
    if one.law.exponent == 1.0:
        answer: BlockAnswer | ConvexAnswer = block_answer(one.blocks, contact_mm, times_s.tolist())
    else:
        answer = convex_answer(one.blocks, contact_mm, times_s.tolist(), one.law)
    residual = one.blocks.force_mn - stiffness @ answer.rows - one.own[0]
    by_shared = np.concatenate(
        [stiffness[:, None] * answer.rows, stiffness[1:, None] * answer.tau_slopes * times_s[:, None]]
    )
    by_own = [np.ones(answer.rows.shape[1])]
    if one.contact_seen:
        by_own.append(stiffness @ answer.contact_slopes)
    return residual, by_shared, np.stack(by_own)


def _search(shared: FloatArray, members: list[_One], n_arms: int) -> tuple[FloatArray, list[_One]]:
    """Return the least-squares solution; stiffnesses and times are searched as logarithms, hence positive."""
    squares, system = _system(shared, members, n_arms)
    damping = 1e-4
    for _ in range(_MOST_STEPS):
        normal = sum(part[0] for part in system)
        gradient = sum(part[1] for part in system)
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.linalg.solve(damped, gradient)
        proposed = shared + np.clip(step, -1.0, 1.0)
        moved = [
            replace(one, own=one.own + own - back @ step)
            for one, (_, _, own, back) in zip(members, system, strict=True)
        ]
        new_squares, new_system = _system(proposed, moved, n_arms)
        if not new_squares <= squares:
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        settled = squares - new_squares <= _SETTLED * squares
        shared, members, squares, system = proposed, moved, new_squares, new_system
        damping = max(damping / 10.0, 1e-10)
        if settled:
            break
    return shared, members


_Part = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _system(shared: FloatArray, members: list[_One], n_arms: int) -> tuple[float, list[_Part]]:
    """Return the sum of squares and, a trial, the reduced normal matrix, its right side, and the way back.

    With own parameters eliminated: own step = own - back @ shared step.
    """
    squares, parts = 0.0, []
    for one in members:
        residual, by_shared, by_own = _linearised(shared, one, n_arms)
        weights = one.blocks.counts
        squares += float(weights @ residual**2)
        own_normal = (by_own * weights) @ by_own.T
        cross = (by_own * weights) @ by_shared.T
        own_right = (by_own * weights) @ residual
        back = np.asarray(np.linalg.solve(own_normal, cross), dtype=float)
        own = np.asarray(np.linalg.solve(own_normal, own_right), dtype=float)
        normal = (by_shared * weights) @ by_shared.T - cross.T @ back
        right = (by_shared * weights) @ residual - cross.T @ own
        parts.append((normal, right, own, back))
    return squares, parts


def _result(
    shared: FloatArray,
    members: list[_One],
    n_arms: int,
    used: tuple[int, ...],
    left_out: tuple[tuple[int, str], ...],
) -> JointFit:
    _, system = _system(shared, members, n_arms)
    inverse = np.linalg.inv(sum(part[0] for part in system))
    within, doubt = np.zeros_like(inverse), np.zeros(len(inverse))
    pulls = []
    for one, (_, right, _, back) in zip(members, system, strict=True):
        _, by_shared, by_own = _linearised(shared, one, n_arms)
        influence = inverse @ (by_shared - back.T @ by_own)
        covariance, its_doubt = noise_covariance(influence, one.blocks.edges, one.noise)
        within += covariance
        doubt += its_doubt
        pulls.append(inverse @ right)
    within = widened(within, doubt)
    drawn = np.stack(pulls)
    among = drawn.T @ drawn * len(members) / (len(members) - 1)
    names = (
        "k0_mn_per_mm",
        *(f"A{i + 1}_over_A0" for i in range(n_arms)),
        *(f"t{i + 1}_s" for i in range(n_arms)),
    )
    order = np.argsort(-shared[1 + n_arms :]).astype(np.int64)
    values, errors, repeats = {}, {}, {}
    for name, (value, by) in zip(names, _quantities(shared, n_arms, order), strict=True):
        values[name] = value
        errors[name] = float(np.sqrt(by @ within @ by))
        repeats[name] = float(np.sqrt(by @ among @ by))
    return JointFit(
        estimates={name: Estimate(values[name], errors[name]) for name in names},
        repeat_se=repeats,
        contact_mm=np.array([one.own[1] if one.contact_seen else one.contact_mm for one in members]),
        offset_mn=np.array([one.own[0] for one in members]),
        used=used,
        left_out=left_out,
        law=members[0].law,
    )


def _quantities(shared: FloatArray, n_arms: int, order: NDArray[np.int64]) -> list[tuple[float, FloatArray]]:
    """Return k0, ratios and times, each with its derivatives by the shared logarithms, longest time first."""
    n = len(shared)
    k0 = float(np.exp(shared[0]))
    found = [(k0, k0 * np.eye(n)[0])]
    for arm in order:
        ratio = float(np.exp(shared[1 + arm] - shared[0]))
        found.append((ratio, ratio * (np.eye(n)[1 + arm] - np.eye(n)[0])))
    for arm in order:
        tau_s = float(np.exp(shared[1 + n_arms + arm]))
        found.append((tau_s, tau_s * np.eye(n)[1 + n_arms + arm]))
    return found
