"""What an effect is: its name, its parameters with units, where it acts and where it shows."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from sim_hardware.parts import Block, FloatArray, Parts

Stage = Literal["lever", "contact", "tissue", "specimen", "sensor"]

IN_CONTACT = ("approach", "dwell", "ramp", "hold", "retract")
IN_MOTION = ("approach", "ramp", "retract", "sweep")
ALWAYS = ("approach", "dwell", "ramp", "hold", "retract", "clear", "sweep")


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of an effect: unit, default and the range that makes sense on a bench."""

    name: str
    unit: str
    default: float
    low: float
    high: float
    words: str

    def check(self, effect: str, value: object) -> float:
        """Return the value as a float; ValueError with one line where it is none or far out of range."""
        where = f"effect {effect!r}: {self.name}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{where} = {value!r}: must be a number ({self.unit})")  # noqa: TRY004
        number = float(value)
        if not math.isfinite(number) or not self.low <= number <= self.high:
            raise ValueError(f"{where} = {value!r}: must be from {self.low:g} to {self.high:g} {self.unit}")
        return number


ROUGH = Parameter("rough", "1", 1.0, 0.0, 1.0, "0: the textbook law; 1: as it really happens")


class Effect:
    """Something that really happens on a bench and that a simulation may leave out.

    A subclass declares itself in class variables and overrides the hooks where it acts; the world calls
    only the hooks that a subclass overrides. Hooks that return nothing change the block they are given.
    All of an effect's signals are functions of time and state, never of the size of the blocks.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    in_library: ClassVar[bool]
    phases: ClassVar[tuple[str, ...]]
    """Phases of a trial whose recording differs from the same motion without the effect."""
    parameters: ClassVar[tuple[Parameter, ...]]
    order: ClassVar[int] = 0
    """Effects of one hook are called in this order."""

    def __init__(self, given: Mapping[str, object], *, seed: int = 0) -> None:
        known = {p.name: p for p in (*self.parameters, ROUGH)}
        unknown = sorted(set(given) - set(known))
        if unknown:
            raise ValueError(
                f"effect {self.name!r}: unknown parameter {unknown[0]!r}; it has {', '.join(known)}"
            )
        values = {name: p.check(self.name, given.get(name, p.default)) for name, p in known.items()}
        self.rough = values.pop("rough")
        self.values: Mapping[str, float] = values
        self.random = np.random.default_rng([seed, zlib.crc32(self.name.encode())])

    def __getitem__(self, parameter: str) -> float:
        """Value of a parameter in its declared unit."""
        return self.values[parameter]

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Return the parts with this effect in them; ``skin`` is False for a block or free air."""
        return parts

    def begin_trial(self, trial: int) -> None:
        """Draw what differs from trial to trial; ``trial`` counts from 0."""

    def drawn(self) -> dict[str, float]:
        """Return what was drawn for the present trial, by name with unit; for tests and scoring."""
        return {}

    def drive_mm(self, block: Block) -> FloatArray:
        """What adds to the command on its way to the motor, (n,), mm."""
        return np.zeros_like(block.time_s)

    def tip(self, block: Block) -> None:
        """Change ``fine_tip_mm``: how the punch follows the motor without load."""

    def surface_mm(self, block: Block) -> FloatArray:
        """Displacement of the specimen's surface towards the lever, (n,), mm."""
        return np.zeros_like(block.time_s)

    def touch(self, block: Block) -> None:
        """Change ``fine_force_mn``, the force on the punch, after contact was worked out."""

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Return what the sensor feels, (n * m,), mN, from what it felt so far."""
        return force_mn

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Return what the sensor reports at the samples, (n,), mN."""
        return force_mn

    def digitise(self, block: Block, codes: FloatArray) -> FloatArray:
        """Return the converter's codes of the force channel, (n,), whole numbers."""
        return codes

    def rest(self, duration_s: float) -> None:
        """Let time pass for what the effect remembers while the bench is idle."""


def overrides(effect: Effect, hook: str) -> bool:
    """Whether the effect's class has a hook of its own."""
    return getattr(type(effect), hook) is not getattr(Effect, hook)
