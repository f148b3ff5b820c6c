"""How large what was found is: parameters of tissue and mechanisms with their standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.event_at import EventAt
from analysis.mismatch.joint import JointFit, fit_jointly
from analysis.mismatch.linearised import linearise
from analysis.mismatch.problem import Problem
from analysis.mismatch.report import Quantity
from analysis.mismatch.shared import Addition, Hum
from analysis.mismatch.surface_motion import in_contact
from analysis.mismatch.surface_oscillation import SurfaceOscillation, hat_functions
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

SERVO = "servo_bandwidth"
HUM_GRID_HZ = 0.05
FINE_PERIODS, FINE_ABOVE_HZ = 1.5, 4.0
HUM_STRETCH_S = 1.0
FREQUENCY_GRID = 0.028
CLOCK_S = 1e-3


@dataclass(frozen=True)
class OwnCoefficients:
    """What is latent of one addition in one trial: coefficients (q,), covariance (q, q), columns (n, q)."""

    index: int
    coefficients: FloatArray
    covariance: FloatArray
    columns: FloatArray


def shared_quantities(
    problem: Problem, fit: JointFit
) -> tuple[dict[str, Quantity], list[dict[str, Quantity]]]:
    """Return the tissue's quantities by name, and those of each addition's shared parameters, in order."""
    parameters = fit.simulation.parameters(problem.trials)
    fitted = fit.simulation.vector(problem.trials)
    spread = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)) if len(fitted) else np.zeros(0)
    found = []
    for p, v, s in zip(parameters, fitted, spread, strict=True):
        value = p.from_fit(float(v))
        found.append((p, Quantity(value, float(abs(p.derivative(value)) * s), p.unit)))
    of_laws = sum(len(a.mechanism.parameters) for a in fit.simulation.additions if a.mechanism.form == "law")
    at = len(found) - of_laws
    tissue = {p.name: q for p, q in found[:at]}
    additions: list[dict[str, Quantity]] = []
    for a in fit.simulation.additions:
        if a.mechanism.form != "law":
            additions.append({})
            continue
        own = found[at : at + len(a.mechanism.parameters)]
        at += len(own)
        additions.append({p.name: q for p, q in own if not p.inner})
    return _longer_time_first(tissue), additions


def _longer_time_first(tissue: dict[str, Quantity]) -> dict[str, Quantity]:
    """Return the tissue with tau1 the longer time, as the report's names have it."""
    if not {"tau1_s", "tau2_s"} <= set(tissue) or tissue["tau1_s"].value >= tissue["tau2_s"].value:
        return tissue
    swapped = {
        "tau1_s": "tau2_s",
        "tau2_s": "tau1_s",
        "k1_mn_per_mm": "k2_mn_per_mm",
        "k2_mn_per_mm": "k1_mn_per_mm",
    }
    return {name: tissue[swapped.get(name, name)] for name in tissue}


def own_coefficients(problem: Problem, fit: JointFit, k: int) -> list[OwnCoefficients]:
    """Return what is latent of the k-th addition, one entry for each trial that has any."""
    found = []
    for j, trial in enumerate(problem.trials):
        start = 0
        for a in fit.simulation.additions[:k]:
            if a.latent is not None:
                start += a.latent(trial, fit.simulation.tissue, fit.own[j]).shape[1]
        addition = fit.simulation.additions[k]
        if addition.latent is None:
            continue
        columns = addition.latent(trial, fit.simulation.tissue, fit.own[j])
        q = columns.shape[1]
        if not q:
            continue
        line = linearise(
            trial,
            problem.whiteners[j],
            fit.simulation,
            fit.own[j],
            problem.trials,
            fit.latents[j],
            frozen=True,
        )
        own = line.A.shape[1] - len(fit.latents[j]) + start
        everything_else = np.linalg.pinv(line.A.T @ line.A, rcond=1e-10, hermitian=True)
        covariance = np.asarray(everything_else[own : own + q, own : own + q], dtype=np.float64)
        found.append(OwnCoefficients(j, fit.latents[j][start : start + q], covariance, columns))
    return found


def effect_of(problem: Problem, fit: JointFit, k: int) -> list[FloatArray]:
    """Return the force (n_j,) mN of the k-th addition's latent part in every trial."""
    hum = fit.simulation.additions[k].hum
    if hum is not None:
        return [hum.at(t.label, t.time_s) for t in problem.trials]
    effects = [np.zeros(len(t.time_s)) for t in problem.trials]
    for own in own_coefficients(problem, fit, k):
        effects[own.index] = own.columns @ own.coefficients
    return effects


def latent_quantities(problem: Problem, fit: JointFit, k: int) -> dict[str, Quantity]:
    """Return the quantities of an oscillation or an event from each trial's own coefficients."""
    addition = fit.simulation.additions[k]
    if addition.hum is not None:
        return _hum_quantities(problem, fit, addition.mechanism, addition.hum)
    own = own_coefficients(problem, fit, k)
    if not own:
        return {}
    if addition.mechanism.form == "event":
        return _event_quantities(problem, addition, own)
    fine = _finely(problem, fit, k)
    by_trial = own if fine is fit else own_coefficients(problem, fine, k)
    of_fine = fine.simulation.additions[k]
    sizes = np.array([_surface_power(problem, fine, of_fine, o) for o in by_trial])
    amplitude = _mean_of(np.sqrt(np.maximum(sizes, 0.0)))
    frequency = _frequency(problem, addition, own)
    m = addition.mechanism
    return {
        m.amplitude: _quantity(m, m.amplitude, *amplitude),
        "frequency_hz": _quantity(m, "frequency_hz", *frequency),
    }


def _finely(problem: Problem, fit: JointFit, k: int) -> JointFit:
    """Return a fit whose k-th addition, an oscillation, may change within a period and a half.

    An amplitude and a phase for the whole trial explain a wandering oscillation well enough to name it, but miss part
    of its power. Slow ones are left as they are: a contact point and a tissue imitate what so few periods may do.
    """
    addition = fit.simulation.additions[k]
    shape = addition.latent
    if not isinstance(shape, SurfaceOscillation):
        return fit
    frequency_hz = float(np.median(list(shape.frequencies_hz.values())))
    knot_s = FINE_PERIODS / frequency_hz
    if frequency_hz < FINE_ABOVE_HZ or knot_s >= shape.knot_s:
        return fit
    additions = list(fit.simulation.additions)
    additions[k] = replace(addition, latent=replace(shape, knot_s=knot_s))
    simulation = replace(fit.simulation, additions=tuple(additions))
    return fit_jointly(problem.trials, problem.whiteners, simulation, fit.own, rounds=3, frozen=True)


def _hum_quantities(problem: Problem, fit: JointFit, mechanism: Mechanism, hum: Hum) -> dict[str, Quantity]:
    """Return amplitude and frequency of a line, from its power in stretches of ``HUM_STRETCH_S``.

    In a whole trial a line that wanders by a fraction of a hertz loses some of its amplitude to itself. Noise adds
    4 sigma^2 / N to the amplitude's square in N samples.
    """
    powers = []
    for j, t in enumerate(problem.trials):
        n = max(round(HUM_STRETCH_S * t.sample_rate_hz), 8)
        line_and_noise = problem.full_residual(fit, j)
        first = int(t.starts[np.argmax(t.fitted)])
        time_s = (first + np.arange(len(line_and_noise))) / t.sample_rate_hz
        line_and_noise = line_and_noise + hum.at(t.label, time_s)
        turning = np.exp(-2j * np.pi * hum.frequency_hz * time_s)
        whole = len(time_s) // n * n
        stretches = (line_and_noise * turning)[:whole].reshape(-1, n)
        of_line = np.abs(2.0 * stretches.mean(axis=1)) ** 2
        powers.append(float(of_line.mean()) - 4.0 * problem.white_mn**2 / n)
    power, error = _mean_of(np.array(powers))
    size = float(np.sqrt(max(power, error)))
    amplitude = size, error / (2.0 * size)
    return {
        "amplitude_mn": _quantity(mechanism, "amplitude_mn", *amplitude),
        "frequency_hz": _quantity(
            mechanism, "frequency_hz", hum.frequency_hz, HUM_GRID_HZ / float(np.sqrt(12.0))
        ),
    }


def _surface_power(problem: Problem, fit: JointFit, addition: Addition, own: OwnCoefficients) -> float:
    """Return the square of the fundamental's amplitude (um^2), averaged over contact, noise taken off.

    The amplitude wanders between knots: a(t) = sum of hats (c + i s); noise adds the trace of its covariance.
    """
    trial = problem.trials[own.index]
    shape = addition.latent
    hats = hat_functions(trial, shape.knot_s if isinstance(shape, SurfaceOscillation) else np.inf)
    inside = in_contact(trial, fit.own[own.index])
    weight = trial.counts * inside
    M = (hats * weight) @ hats.T / max(float(weight.sum()), 1e-12)
    m = len(hats)
    c, s = own.coefficients[: 2 * m : 2], own.coefficients[1 : 2 * m : 2]
    noise = own.covariance[: 2 * m : 2, : 2 * m : 2] + own.covariance[1 : 2 * m : 2, 1 : 2 * m : 2]
    return float(c @ M @ c + s @ M @ s - np.sum(M * noise))


def _frequency(problem: Problem, addition: Addition, own: Sequence[OwnCoefficients]) -> tuple[float, float]:
    shape = addition.latent
    each = shape.frequencies_hz if isinstance(shape, SurfaceOscillation) else {}
    values = np.array([each[problem.trials[o.index].label] for o in own])
    # a grid's cell is as unsure as its width; the median costs a quarter over the mean
    grid = FREQUENCY_GRID * float(np.median(values)) / np.sqrt(12.0)
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return float(np.median(values)), float(1.25 * np.hypot(spread, grid) / np.sqrt(len(values)))


def event_times(problem: Problem, addition: Addition) -> dict[int, float]:
    """Return the time (s) of an event by the index of its trial."""
    each = addition.latent.times_s if isinstance(addition.latent, EventAt) else {}
    return {j: float(each[t.label]) for j, t in enumerate(problem.trials) if t.label in each}


def _event_quantities(
    problem: Problem, addition: Addition, own: Sequence[OwnCoefficients]
) -> dict[str, Quantity]:
    # a punch that slips loses its force at once, of which the tissue may win some back: what is left soon after is the
    # drop. A surface that swings back by some part has shifted by what lasts.
    lasting = np.array([1.0, 0.0, 1.0] if addition.mechanism.stage == "contact" else [1.0, 0.0, 0.0])
    sizes = np.array([float(lasting @ o.coefficients) for o in own])
    errors = np.array([float(np.sqrt(max(lasting @ o.covariance @ lasting, 0.0))) for o in own])
    sign = float(np.sign(sizes[0]))
    alike = bool(np.all(np.sign(sizes) == sign))
    size = _mean_of(np.abs(sizes), errors)
    times = np.array(list(event_times(problem, addition).values()))
    spread = float(np.std(times, ddof=1) / np.sqrt(len(times))) if len(times) > 1 else 0.0
    m = addition.mechanism
    return {
        m.amplitude: _quantity(m, m.amplitude, (sign if alike else 1.0) * size[0], size[1]),
        "time_s": _quantity(m, "time_s", float(np.median(times)), float(np.hypot(1.25 * spread, CLOCK_S))),
    }


def _mean_of(values: FloatArray, errors: FloatArray | None = None) -> tuple[float, float]:
    """Return mean and standard error: from the spread over trials, but never below the fit's."""
    n = len(values)
    fitted = float(np.sqrt(np.sum(errors**2))) / n if errors is not None else 0.0
    spread = float(np.std(values, ddof=1) / np.sqrt(n)) if n > 1 else 0.0
    return float(np.mean(values)), max(spread, fitted)


def _quantity(mechanism: Mechanism, name: str, value: float, se: float) -> Quantity:
    return Quantity(value, se, mechanism.parameter(name).unit)


def servo_quantities(diagnosis: Diagnosis) -> dict[str, Quantity]:
    """Return natural frequency and damping of the servo as the recordings show it."""
    m = library()[SERVO]
    wn, zeta = diagnosis.intake.servo
    errors = diagnosis.position.standard_errors if diagnosis.position is not None else (0.0, 0.0)
    return {
        "natural_frequency_rad_s": _quantity(m, "natural_frequency_rad_s", wn, wn * errors[0]),
        "damping_ratio": _quantity(m, "damping_ratio", zeta, zeta * errors[1]),
    }
