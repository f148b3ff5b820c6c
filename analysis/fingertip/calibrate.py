"""Calibrate pads on measured relaxation: modulus and Prony terms for any ratio of layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.fingertip.fits_file import MeasuredTrial
from analysis.fingertip.reduced import PunchPad
from analysis.fingertip.viscoelastic import Prony, Relaxation, relaxation
from analysis.recordings.trial import FloatArray
from analysis.relaxation.published import CURVES, RESULTS, STIFFNESS_MN_PER_UM

Kind = Literal["homogeneous", "layered"]
SCAN_RATIOS = tuple(float(r) for r in np.geomspace(0.01, 1.0, 13))
"""Relaxed modulus of the core over that of the elastic epidermis."""
LAYERED_RATIO = 0.1  # Kumar et al. 2015: the core a tenth of the epidermis
_POINTS = 240


@dataclass(frozen=True, slots=True)
class Target:
    """What a pad is fitted to: force for 1 mm (N,) mN at times (N,) s since the ramp began.

    ``derivatives`` (N, P) are by the parameters of ``measured``; ``weights`` (N,) give each point the time it
    stands for.
    """

    measured: MeasuredTrial
    time_s: FloatArray
    force_mn_per_mm: FloatArray
    derivatives: FloatArray
    weights: FloatArray

    @property
    def relaxed_mn_per_mm(self) -> float:
        """The measured stiffness once all has relaxed."""
        return float(self.measured.stiffness_mn_per_mm[0])


@dataclass(frozen=True, slots=True)
class CalibratedPad:
    """A pad that presses as the trials did.

    Attributes:
        kind: ``homogeneous`` (every layer relaxes alike) or ``layered`` (elastic epidermis, core that relaxes).
        ratio: relaxed modulus of the core over that of the epidermis.
        epidermis, core: their materials; dermis and fat have the core's times their relative moduli.
        errors: standard errors of log(relaxed modulus of the core), then of the logs of every arm's modulus,
            then of the logs of the times (1 + 2 n,), and in ``covariance`` their covariance.
        rms_share: residual of the fit, rms over the trial, as a share of A0.
        force: the calibrated force's relaxation.
    """

    kind: Kind
    ratio: float
    epidermis: Prony
    core: Prony
    covariance: FloatArray
    rms_share: float
    worst_share: float
    force: Relaxation

    def materials(self, relative: FloatArray) -> list[Prony]:
        """Return the materials of the layers, in order."""
        return [self.epidermis, *(self.core.scaled(float(share)) for share in relative[1:])]

    def errors(self) -> FloatArray:
        """Return the standard errors of the logarithms, in the order of ``covariance``."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def published_trial() -> MeasuredTrial:
    """Return the published mean constants as a step fit of 0.4 mm, with the errors of their means."""
    names = ("t1_s", "t2_s", "A1_over_A0", "A2_over_A0")
    (t1, t2, a1, a2), errors = ([getattr(RESULTS[name], field) for name in names] for field in ("mean", "sd"))
    k0 = 1e3 * STIFFNESS_MN_PER_UM
    t1_se, t2_se, a1_se, a2_se = (error / np.sqrt(CURVES) for error in errors)
    # the spread of k0 is not published: its error is left at nothing
    deviations = np.array([0.0, k0 * a1_se, k0 * a2_se, t1_se / t1, t2_se / t2])
    return MeasuredTrial(
        "published", "", "step", 0.4, 0.08, 7.0, np.array([k0, k0 * a1, k0 * a2]), np.array([t1, t2]),
        np.diag(deviations**2),
    )  # fmt: skip


def target_of(mean: MeasuredTrial) -> Target:
    """Return a measured relaxation as the curve of its ramp and hold, with its derivatives."""
    parameters, ramp_s = mean.parameters(), mean.ramp_s
    # close together where the force changes fast: through the ramp, and just after it ends
    in_ramp = np.linspace(0, ramp_s, _POINTS // 4, endpoint=False)[1:]
    after = ramp_s + np.concatenate([[0.0], np.geomspace(ramp_s / 100, mean.hold_s, _POINTS)])
    time_s = after if mean.model == "step" else np.concatenate([in_ramp, after])
    derivatives = np.empty((len(time_s), len(parameters)))
    for i, step in enumerate(1e-5 * np.maximum(np.abs(parameters), 1e-3)):
        moved = step * (np.arange(len(parameters)) == i)
        above, below = (mean.curve_mn_per_mm(parameters + sign * moved, time_s) for sign in (1, -1))
        derivatives[:, i] = (above - below) / (2 * step)
    return Target(
        mean,
        time_s,
        mean.curve_mn_per_mm(parameters, time_s),
        derivatives,
        np.sqrt(np.gradient(time_s)),
    )


def calibrate(pad: PunchPad, target: Target, kind: Kind, ratio: float, terms: int) -> CalibratedPad:
    """Fit relaxed modulus and ``terms`` arms of the core (all layers if homogeneous) to the target.

    ``ratio`` is held. Least squares over the trial's time, ramp included; the errors are the target's,
    carried through the fit.
    """
    from scipy.optimize import least_squares

    if kind == "homogeneous":
        ratio = 1.0
    scale = target.relaxed_mn_per_mm / pad.stiffness(pad.layer_moduli(ratio)) * ratio
    start = np.concatenate([[np.log(scale)], _starting_arms(target, terms, scale)])

    def answer(logs: FloatArray) -> Relaxation:
        epidermis, core = _materials(kind, ratio, logs)
        return relaxation(pad.layers, [epidermis, *(core.scaled(float(s)) for s in pad.relative[1:])])

    def off(logs: FloatArray) -> FloatArray:
        found = answer(logs).after_ramp(target.time_s, target.measured.ramp_s)
        return (found - target.force_mn_per_mm) * target.weights / target.relaxed_mn_per_mm

    # twenty powers of e either way: far outside of what is physical, near enough for exp()
    solved = least_squares(
        off, start, bounds=(start - 20, start + 20), x_scale=1.0, xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    by_target = np.linalg.pinv(np.asarray(solved.jac)) @ (
        target.derivatives * target.weights[:, None] / target.relaxed_mn_per_mm
    )
    residual = off(solved.x)
    span = float(np.sum(target.weights**2))
    epidermis, core = _materials(kind, ratio, solved.x)
    return CalibratedPad(
        kind, ratio, epidermis, core, by_target @ target.measured.covariance @ by_target.T,
        float(np.sqrt(np.sum(residual**2) / span)), float(np.abs(residual / target.weights).max()),
        answer(solved.x),
    )  # fmt: skip


def _materials(kind: Kind, ratio: float, logs: FloatArray) -> tuple[Prony, Prony]:
    arms = (len(logs) - 1) // 2
    relaxed, moduli, times = np.exp(logs[0]), np.exp(logs[1 : 1 + arms]), np.exp(logs[1 + arms :])
    order = np.argsort(-times)
    core = Prony(float(relaxed), tuple((float(moduli[i]), float(times[i])) for i in order))
    return (core if kind == "homogeneous" else Prony(float(relaxed / ratio))), core


def _starting_arms(target: Target, terms: int, relaxed_kpa: float) -> FloatArray:
    """Return logs of moduli and times: the measured arms, or spread over the same times if more or fewer."""
    stiffness, times = target.measured.stiffness_mn_per_mm[1:], target.measured.times_s
    moduli = np.maximum(stiffness, 1e-3 * target.relaxed_mn_per_mm) / target.relaxed_mn_per_mm * relaxed_kpa
    if terms != len(times):
        longest, shortest = times.max(), times.min()
        spread = (
            np.geomspace(longest, shortest, terms) if terms > 1 else np.array([np.sqrt(longest * shortest)])
        )
        moduli, times = np.full(terms, moduli.sum() / terms), spread
    return np.concatenate([np.log(moduli), np.log(times)])


def scan(
    pad: PunchPad, target: Target, terms: int, ratios: Sequence[float] = SCAN_RATIOS
) -> list[CalibratedPad]:
    """Calibrate the layered pad at every ratio: how well force tells them apart."""
    return [calibrate(pad, target, "layered", ratio, terms) for ratio in ratios]
