"""What a receptor feels: strain energy density over time at depths under a plate that is pressed and held."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import CalibratedPad
from analysis.fingertip.contact import Pressed, press, ramp_and_hold
from analysis.fingertip.contact_pad import ContactPad, contact_pad
from analysis.fingertip.elastic import nus_of
from analysis.fingertip.pad_file import PadFile
from analysis.recordings.trial import FloatArray

_RAMP_STEPS, _HOLD_STEPS = 20, 30
_SNAPSHOTS = 2
"""At both ends of what the core's modulus goes through: one ratio for a pad that relaxes alike all over."""


@dataclass(frozen=True, slots=True)
class PlateMotion:
    """How the plate is pressed and held."""

    depth_mm: float = 0.5  # Kumar et al. 2015, as the rest
    speed_mm_s: float = 5.0
    hold_s: float = 2.3

    @property
    def ramp_s(self) -> float:
        """How long the ramp takes."""
        return self.depth_mm / self.speed_mm_s


@dataclass(frozen=True, slots=True)
class Felt:
    """Strain energy density (kPa, which is kJ/m3) of a pad at depths (d,) mm and instants (N,) s.

    Attributes:
        stored: in the springs of all arms, (d, N).
        half_stress_strain: half of stress times strain, (d, N): more than is stored while arms relax, since
            their stress counts against the whole strain.
        force_mn: on the plate, (N,).
    """

    pad: CalibratedPad
    time_s: FloatArray
    depth_mm: FloatArray
    stored: FloatArray
    half_stress_strain: FloatArray
    force_mn: FloatArray
    pressed: Pressed
    model: ContactPad


@dataclass(frozen=True, slots=True)
class SpikeRate:
    """A receptor's measured rate: (N,) s since the plate touched, (N,) Hz."""

    file: str
    time_s: FloatArray
    rate_hz: FloatArray


def plate_pad(pad: PadFile, calibrated: CalibratedPad, cache: Path) -> ContactPad:
    """Return the pad under the plate, its shapes taken where the calibrated pad's ratio goes."""
    at_once = calibrated.core.instantaneous_kpa / calibrated.epidermis.instantaneous_kpa
    if math.isclose(at_once, calibrated.ratio, rel_tol=1e-6):
        ratios = np.array([calibrated.ratio])
    else:
        ratios = np.geomspace(calibrated.ratio, at_once, _SNAPSHOTS)
    # to three digits, so that a calibration that moves a little finds its pad again
    return contact_pad(pad, "plate", np.array([float(f"{ratio:.3g}") for ratio in ratios]), cache)


def feel(settings: PadFile, model: ContactPad, calibrated: CalibratedPad, motion: PlateMotion) -> Felt:
    """Press the plate and return the strain energy at every depth of the model."""
    time_s, tool_mm = ramp_and_hold(motion.depth_mm, motion.ramp_s, motion.hold_s, _RAMP_STEPS, _HOLD_STEPS)
    materials = calibrated.materials(model.relative)
    pressed = press(model, materials, time_s, tool_mm)
    arms_before = np.cumsum([0, *(len(m.arms) for m in materials)])
    stored, half = (np.empty((len(model.depth_mm), len(time_s))) for _ in range(2))
    for number, (depth, shapes) in enumerate(zip(model.depth_mm, model.strain, strict=True)):
        layer = int(np.searchsorted(model.borders_mm, depth))
        material, nu = materials[layer], nus_of(settings)[layer]
        strain = np.einsum("ijn,tn->tij", shapes, pressed.weights)
        stress = material.relaxed_kpa * _stress(strain, nu)
        energy = _energy(stress, strain)
        for arm, (modulus, _) in enumerate(material.arms):
            stretch = np.einsum("ijn,tn->tij", shapes, pressed.stretches[:, arms_before[layer] + arm])
            arm_stress = modulus * _stress(stretch, nu)
            energy = energy + _energy(arm_stress, stretch)
            stress = stress + arm_stress
        stored[number], half[number] = energy, _energy(stress, strain)
    return Felt(calibrated, time_s, model.depth_mm, stored, half, pressed.force_mn, pressed, model)


def _stress(strain: FloatArray, nu: float) -> FloatArray:
    """Return the stress (N, 3, 3) of a modulus of 1."""
    volume = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    stress: FloatArray = strain / (1 + nu) + nu / ((1 + nu) * (1 - 2 * nu)) * volume
    return stress


def _energy(stress: FloatArray, strain: FloatArray) -> FloatArray:
    energy: FloatArray = np.einsum("tij,tij->t", stress, strain) / 2
    return energy


def drop(values: FloatArray, time_s: FloatArray, motion: PlateMotion) -> FloatArray:
    """Return values (..., N) at the end of the ramp over those at the end of the hold."""
    at_end = int(np.argmin(np.abs(time_s - motion.ramp_s)))
    ratio: FloatArray = values[..., at_end] / values[..., -1]
    return ratio


def read_rates(path: Path) -> SpikeRate:
    """Read a receptor's rate: columns ``time_s`` (since the plate touched) and ``rate_hz``.

    Raises BadInputError in one line where the file can't be used.
    """
    try:
        reader = csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines())
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(
            f"{path}: can't be read: {getattr(error, 'strerror', None) or 'not text'}"
        ) from error
    there = [name.strip() for name in reader.fieldnames or ()]
    for name in ("time_s", "rate_hz"):
        if name not in there:
            raise BadInputError(f"{path}: column {name!r} is missing: give time_s and rate_hz")
    reader.fieldnames = there
    rows = []
    for number, row in enumerate(reader, start=2):
        try:
            values = float(row["time_s"]), float(row["rate_hz"])
        except (TypeError, ValueError) as error:
            raise BadInputError(f"{path}: line {number}: not a number: {error}") from error
        if not all(map(math.isfinite, values)) or values[1] < 0:
            raise BadInputError(f"{path}: line {number}: a rate must be a finite number and not negative")
        rows.append(values)
    if len(rows) < 2:
        raise BadInputError(f"{path}: holds fewer than 2 rows")
    if max(row[0] for row in rows) > 1000:
        raise BadInputError(f"{path}: column 'time_s' reaches {max(r[0] for r in rows):g}: give seconds")
    time_s, rate_hz = np.array(sorted(rows)).T
    return SpikeRate(path.name, time_s, rate_hz)


def write_energies(path: Path, felt: Sequence[Felt]) -> None:
    """Write every pad's energies over time and depth as a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["pad", "depth_mm", "time_s", "stored_kpa", "half_stress_strain_kpa", "force_mn"])
        for one in felt:
            for number, depth in enumerate(one.depth_mm):
                columns = zip(
                    one.time_s, one.stored[number], one.half_stress_strain[number], one.force_mn, strict=True
                )
                writer.writerows(
                    [one.pad.kind, f"{depth:.4g}", *(f"{value:.7g}" for value in values)]
                    for values in columns
                )
