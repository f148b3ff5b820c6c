"""The whole bench, from volts of the card's output to volts of its inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim_hardware.effects import Effect, make_effect
from sim_hardware.effects.base import overrides
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray, Parts
from sim_hardware.settings import BenchSettings
from sim_hardware.world import hands, specimens
from sim_hardware.world.clock import TrialClock
from sim_hardware.world.constants import draw_constants
from sim_hardware.world.contact import Contact
from sim_hardware.world.converters import Converter
from sim_hardware.world.lever import Servo
from sim_hardware.world.noise import SensorNoise
from sim_hardware.world.truth import truth

_CHUNK = 4000
"""Samples integrated at a time, so that fine arrays stay in the cache."""
_G_M_S2 = 9.80665
"""Also the weight of a gram, mN."""


class Readings(NamedTuple):
    """Volts of both inputs, (n,) each, noise and conversion included."""

    position_v: FloatArray
    force_v: FloatArray


@dataclass(frozen=True, slots=True)
class ArmState:
    """What the arm truly does at this moment (no noise)."""

    position_mm: float
    tip_mm: float
    force_mn: float
    in_contact: bool
    command_v: float
    time_s: float


class World:
    """A bench: feed it volts, get volts.

    Time moves in samples of 1/8000 s with ``advance`` and jumps with ``rest``. The same seed and the same
    commands give the same volts to the last bit, whatever the size of the blocks.
    """

    def __init__(self, settings: BenchSettings) -> None:
        self.settings = settings
        self.constants = draw_constants(settings)
        self.effects: tuple[Effect, ...] = tuple(
            make_effect(e.name, e.given, seed=settings.seed + i) for i, e in enumerate(settings.effects)
        )
        self._hook = {
            name: sorted((e for e in self.effects if overrides(e, name)), key=lambda e: e.order)
            for name in ("drive_mm", "tip", "surface_mm", "touch", "sense_fine", "sense", "digitise", "rest")
        }
        self._substeps = settings.substeps
        self._step_s = 1.0 / (SAMPLE_RATE_HZ * self._substeps)
        self._converter = Converter(settings.converters)
        self.noise = SensorNoise(settings.noise, settings.seed)
        self._index = 0
        self._trial = -1
        self.clock = TrialClock()
        self._command_v = settings.initial_command_v
        self._memory: dict[str, tuple[float, int]] = {}
        self._specimen = specimens.nothing(settings)
        parts = self._fitted(self._specimen)
        start_mm = float(self._command_mm(self._command_v))
        stepwise = settings.converters.stepwise_output
        self._servo = Servo(parts, self._step_s, self._substeps, start_mm, stepwise=stepwise)
        self._contact = Contact(parts, self._step_s)
        self._tip_mm = self._servo.position_mm
        self._force_mn = 0.0
        self._largest_force_mn = 0.0
        self._surface_before = self._specimen.surface_mm
        self.inverted = False
        self.hung_mass_g = 0.0
        self.micrometer_um = 0.0
        self._new_trial()

    # --- time -----------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since the bench was switched on, s."""
        return self._index / SAMPLE_RATE_HZ

    def advance(self, command_v: FloatArray) -> Readings:
        """Play n samples of the command (V, linear between samples or held) and return what the inputs read, n each.

        Reading i is taken at the instant at which the command reaches command_v[i]. ValueError where the
        command is not a line of finite numbers.
        """
        command = np.ascontiguousarray(command_v, dtype=np.float64)
        if command.ndim != 1 or not np.isfinite(command).all():
            raise ValueError("the command must be one line of finite volts")
        position_v, force_v = np.empty_like(command), np.empty_like(command)
        for chunk in range(0, len(command), _CHUNK):
            end = min(chunk + _CHUNK, len(command))
            cuts = self.clock.cut(self._index, command[chunk:end], self._command_v)
            stops = [chunk + c for c, _ in cuts[1:]] + [end]
            for (cut, sets_off), stop in zip(cuts, stops, strict=True):
                if sets_off and self.clock.waiting:
                    self.clock.start = self._index
                part = slice(chunk + cut, stop)
                position_v[part], force_v[part] = self._read(self._move(command[part]))
        return Readings(position_v, force_v)

    def rest(self, duration_s: float) -> None:
        """Let time pass with the output held, in one jump; the tissue relaxes or recovers meanwhile."""
        if not (math.isfinite(duration_s) and duration_s >= 0):
            raise ValueError(f"duration_s = {duration_s!r}: must be 0 or more seconds")
        n = round(duration_s * SAMPLE_RATE_HZ)
        if n == 0:
            return
        first = min(n, math.ceil(self._servo.settling_s * SAMPLE_RATE_HZ))  # as at any other time
        self._move(np.full(first, self._command_v))
        left_s = (n - first) / SAMPLE_RATE_HZ
        if left_s > 0:
            self._servo.settle()
            self._contact.rest(self._tip_mm - self._surface_before, left_s)
            self._force_mn = self._contact.force_mn
            self._index += n - first
            self._surface_before = self._surface_now()
        self.noise.rest(duration_s)
        for effect in self._hook["rest"]:
            effect.rest(duration_s)

    def begin_trial(self) -> None:
        """Start a trial's clock now; without this the clock goes by when the arm sets off."""
        if self.clock.start is not None and not self.clock.waiting:
            self._new_trial()
        self.clock.begin(self._index)

    # --- hands and looks ------------------------------------------------------------------------------

    def request(self, kind: str, details: Mapping[str, object] | None = None) -> str:
        """Do what the operator's hands are asked to; return what was done in a few words.

        ValueError with one line for a request that is unknown, incomplete or can't be done now.
        """
        return hands.do(self, kind, dict(details or {}))

    def arm(self) -> ArmState:
        """Return where the arm truly is."""
        return ArmState(
            position_mm=self._servo.position_mm,
            tip_mm=self._tip_mm - self._contact.give_mm,
            force_mn=self._force_mn,
            in_contact=self._contact.touching,
            command_v=self._command_v,
            time_s=self.time_s,
        )

    def largest_force_mn(self) -> float:
        """Return the largest true force on the punch since the last call, mN; counting begins anew."""
        largest_mn, self._largest_force_mn = self._largest_force_mn, self._force_mn
        return largest_mn

    def truth(self) -> dict[str, object]:
        """Return what was drawn and what is under the arm, for tests and scoring only."""
        return truth(self)

    @property
    def specimen(self) -> specimens.SpecimenPart:
        """What lies under the arm, without effects."""
        return self._specimen

    def place(self, specimen: specimens.SpecimenPart, *, new_trial: bool = True) -> None:
        """Put a specimen under the arm; fresh tissue but for what neighbouring sites have not forgotten."""
        parts = self._fitted(specimen)
        if self._specimen.finger:
            self._memory[self._specimen.finger] = (self._contact.load_to_keep_mn, self._index)
        load_mn = 0.0
        if parts.memory and specimen.finger in self._memory:
            load_mn, since = self._memory[specimen.finger]
            asleep_s = (self._index - since) / SAMPLE_RATE_HZ
            load_mn *= parts.memory.neighbour * math.exp(-asleep_s / parts.memory.time_s)
        self._specimen = specimen
        self._contact = Contact(parts, self._step_s, load_mn)
        self._force_mn = 0.0
        self._servo.fit(parts)
        self._surface_before = self._surface_now()
        if new_trial:
            self._new_trial()

    @property
    def trial(self) -> int:
        """Number of the present trial: a trial begins when something is placed."""
        return self._trial

    @property
    def tip_mm(self) -> float:
        """Where the unloaded punch is, mm."""
        return self._tip_mm

    # --- inside ---------------------------------------------------------------------------------------

    def _new_trial(self) -> None:
        self._trial += 1
        self.clock.reset()
        self.noise.begin_trial()
        for effect in self.effects:
            effect.begin_trial(self._trial)

    def _fitted(self, specimen: specimens.SpecimenPart) -> Parts:
        parts = specimen.parts
        for effect in self.effects:
            parts = effect.fit(parts, skin=specimen.skin)
        return parts

    def _command_mm(self, volts: FloatArray | float) -> FloatArray:
        played = self._converter.convert(np.asarray(volts, dtype=np.float64))
        return (played - self.constants.command_zero_v) / self.constants.command_volts_per_mm

    def _block(self, first: int, command_mm: FloatArray) -> Block:
        """Return a block that begins at a sample's index, its motor not yet moved."""
        index = np.arange(first, first + len(command_mm))
        trial = np.full(len(index), -1.0)
        if self.clock.start is not None:
            trial = (index - self.clock.start) / SAMPLE_RATE_HZ
        empty = np.empty(0)
        return Block(
            time_s=index / SAMPLE_RATE_HZ,
            trial_time_s=trial,
            step_s=self._step_s,
            substeps=self._substeps,
            touched_s=self.clock.touched_s,
            skin=self._specimen.skin,
            command_mm=command_mm,
            fine_position_mm=empty,
            fine_velocity_mm_s=empty,
            fine_acceleration_mm_s2=empty,
        )

    def _surface(self, block: Block) -> FloatArray:
        """Return where the specimen's undisturbed surface is, (n,), mm."""
        surface = np.full(len(block.time_s), self._specimen.surface_mm)
        if self._specimen.skin:
            for effect in self._hook["surface_mm"]:
                surface -= effect.surface_mm(block)
        return surface

    def _surface_now(self) -> float:
        return float(self._surface(self._block(self._index - 1, np.zeros(1)))[0])

    def _move(self, command_v: FloatArray) -> Block:
        """Move lever, punch and specimen through a block of the command."""
        command_mm = self._command_mm(command_v)
        block = self._block(self._index, command_mm)
        for effect in self._hook["drive_mm"]:
            command_mm = command_mm + effect.drive_mm(block)
        motion = self._servo.advance(command_mm)
        block.fine_position_mm, block.fine_velocity_mm_s, block.fine_acceleration_mm_s2 = motion
        block.fine_tip_mm = block.fine_position_mm
        for effect in self._hook["tip"]:
            effect.tip(block)
        surface = np.empty(len(command_v) + 1)
        surface[0] = self._surface_before
        surface[1:] = self._surface(block)
        block.fine_force_mn, block.fine_gap_mm = self._contact.advance(block.fine_tip_mm, surface)
        if self.clock.touch is None and block.fine_force_mn.any():
            self.clock.touched(self._index + int(np.flatnonzero(block.fine_force_mn)[0]) // self._substeps)
        for effect in self._hook["touch"]:
            effect.touch(block)
        if len(command_v):
            self._index += len(command_v)
            self._surface_before = float(surface[-1])
            self._tip_mm = float(block.fine_tip_mm[-1])
            self._force_mn = float(block.fine_force_mn[-1])
            self._largest_force_mn = max(self._largest_force_mn, float(block.fine_force_mn.max()))
            self._command_v = float(command_v[-1])
        return block

    def _read(self, block: Block) -> Readings:
        """Return what both inputs read of a block; the sensor's gain comes before what the electronics do."""
        n = len(block.time_s)
        block.fine_force_mn = self.noise.gain * block.fine_force_mn
        force_mn = block.contact_force_mn
        if self._hook["sense_fine"]:
            fine = block.fine_force_mn
            for effect in self._hook["sense_fine"]:
                fine = effect.sense_fine(block, fine)
            force_mn = fine[self._substeps - 1 :: self._substeps]
        for effect in self._hook["sense"]:
            force_mn = effect.sense(block, force_mn)
        c = self.constants
        felt_mn = force_mn + self.noise.gain * self._hanging_mn() + self.noise.force_mn(n)
        codes = self._converter.codes(c.force_zero_v + c.volts_per_mn * felt_mn)
        for effect in self._hook["digitise"]:
            codes = effect.digitise(block, codes)
        position_mm = block.position_mm + self.noise.position_mm(n)
        position_v = self._converter.convert(c.position_zero_v + c.volts_per_mm * position_mm)
        return Readings(position_v, self._converter.volts(codes))

    def _hanging_mn(self) -> float:
        """Force of the arm's own weight and of what hangs from it: W + m g / 2 when it is inverted."""
        if not self.inverted:
            return 0.0
        mass_g = self.hung_mass_g + self.settings.lever.arm_mass_g / 2
        return mass_g * _G_M_S2 * math.cos(self.constants.hang_angle_error_rad)
