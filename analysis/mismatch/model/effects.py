"""What may be added to the baseline simulation: laws shared by all trials, and shapes of a trial's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.mismatch.model.rhythm import Rhythm
from analysis.simulation.cells import RIGID_STIFFNESS_MN_PER_MM, CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Mechanism, Parameter, Tissue, Tissues, Values

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Acts = Literal["surface", "share", "force", "value", "block"]

STIFFEST = 0.01
"""A block gives no less than this share of what it is said to give."""
TISSUE_SIZE = 5
TISSUE_NAMES = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")


@dataclass(frozen=True)
class Law:
    """A law of the library with the values of its parameters, the same in every trial; ``free`` are fitted."""

    mechanism: Mechanism
    values: Values
    free: tuple[str, ...]

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that are fitted."""
        return tuple(p for p in self.mechanism.parameters if p.name in self.free)

    @property
    def size(self) -> Parameter:
        """The parameter that tells how large the effect is."""
        whole = self.mechanism.parameter(self.mechanism.amplitude)
        return whole if whole.name in self.free else self.parameters[0]

    @property
    def of_site(self) -> tuple[Parameter, ...]:
        """Those of the fitted parameters that are the skin's, and differ between sites."""
        return tuple(p for p in self.parameters if p.name in self.mechanism.of_site)

    @property
    def is_nothing(self) -> bool:
        """Whether the effect has no size: nothing follows from its being there."""
        p = self.size
        return p.to_fit(self.values[p.name]) == p.to_fit(self.mechanism.null[p.name])


@dataclass(frozen=True)
class OwnShape:
    """A shape (n,) with a coefficient of its own in one trial, drawn with variance ``prior`` about zero.

    It moves the ``surface`` (mm towards the arm), is a lost ``share`` of the contact force, or adds to
    the ``force`` that is read (mN). Of what acts on a ``value`` of a law, the coefficient is the logarithm of how much
    larger it is in this trial, and there is no shape; of a ``block`` it is the share by which that gives more.
    ``at`` is where: the time (s) of a step, the frequency (Hz) of an oscillation. ``kind`` marks what an effect may do
    besides (creep, harmonics, inexactness), or names the law's parameter; it is empty for the effect itself.
    """

    effect: str
    acts: Acts
    shape: FloatArray
    prior: float
    at: float = 0.0
    kind: str = ""

    @property
    def is_number(self) -> bool:
        """Whether it changes a number of the simulation, and has no shape."""
        return self.acts in ("value", "block")


class OwnShapes(tuple[OwnShape, ...]):
    """A trial's own shapes."""

    @cached_property
    def by_stage(self) -> dict[Acts, tuple[IntArray, FloatArray]]:
        """For each stage at which some act: their places (k,), and the shapes themselves, (k, n)."""
        places: dict[Acts, list[int]] = {}
        for k, shape in enumerate(self):
            if not shape.is_number:
                places.setdefault(shape.acts, []).append(k)
        return {
            acts: (np.array(at, dtype=np.int64), np.array([self[k].shape for k in at]))
            for acts, at in places.items()
        }

    def of(self, effect: str) -> list[int]:
        """Return where the shapes of an effect itself stand, without what it may do besides."""
        return [k for k, shape in enumerate(self) if shape.effect == effect and not shape.kind]

    @cached_property
    def block(self) -> int | None:
        """Where it stands how much more a block gives; None without one."""
        return next((k for k, shape in enumerate(self) if shape.acts == "block"), None)

    @cached_property
    def law_values(self) -> dict[tuple[str, str], int]:
        """For each law and parameter of it whose value is the trial's own: where its logarithm stands."""
        return {(shape.effect, shape.kind): k for k, shape in enumerate(self) if shape.acts == "value"}


@dataclass(frozen=True)
class TrialState:
    """What belongs to one trial: logarithms of five tissue constants, contact point, offset, own shapes, rhythms."""

    log_tissue: FloatArray
    z0_mm: float
    offset_mn: float
    shapes: OwnShapes = field(default_factory=OwnShapes)
    coefficients: FloatArray = field(default_factory=lambda: np.zeros(0))
    rhythms: tuple[Rhythm, ...] = ()

    @property
    def tissue(self) -> Tissue:
        """The tissue's constants; what never touches skin has the published ones, which nothing asks for."""
        return Tissue(*np.exp(self.log_tissue)) if self.has_tissue else Tissue(120.0, 44.0, 2.3, 35.0, 0.15)

    @property
    def has_tissue(self) -> bool:
        """Whether the trial presses skin."""
        return len(self.log_tissue) > 0

    def with_shapes(self, shapes: Sequence[OwnShape], first: float = 0.0) -> TrialState:
        """Return the state with more shapes, the first at a coefficient and the others at none."""
        start = np.zeros(len(shapes))
        start[:1] = first
        return replace(
            self,
            shapes=OwnShapes((*self.shapes, *shapes)),
            coefficients=np.append(self.coefficients, start),
        )

    def known_to(self, at: int, variance: float) -> TrialState:
        """Return the state with the coefficient of one of its shapes known to another variance beforehand."""
        there = replace(self.shapes[at], prior=variance)
        return replace(self, shapes=OwnShapes((*self.shapes[:at], there, *self.shapes[at + 1 :])))

    def larger(self, by: Mapping[str, float]) -> TrialState:
        """Return the state with surfaces that some effects move known to so many times their variance beforehand."""
        if not any(shape.effect in by for shape in self.shapes):
            return self
        moved = (by.get(shape.effect, 1.0) if shape.acts == "surface" else 1.0 for shape in self.shapes)
        known = (replace(s, prior=m * s.prior) for s, m in zip(self.shapes, moved, strict=True))
        return replace(self, shapes=OwnShapes(known))

    def without(self, effect: str) -> TrialState:
        """Return the state without the shapes and rhythms of one effect; itself where it has none."""
        there = self.with_only([k for k, shape in enumerate(self.shapes) if shape.effect != effect])
        rhythms = tuple(r for r in self.rhythms if r.effect != effect)
        return there if len(rhythms) == len(self.rhythms) else replace(there, rhythms=rhythms)

    def with_only(self, kept: Sequence[int]) -> TrialState:
        """Return the state with those of its shapes only that stand at the places ``kept``; itself with all."""
        if len(kept) == len(self.shapes):
            return self
        shapes = OwnShapes(self.shapes[k] for k in kept)
        return replace(self, shapes=shapes, coefficients=self.coefficients[list(kept)])


@dataclass(frozen=True)
class Shared:
    """What all trials share: the laws that were added, the stiffness of a block, the textbook's ideal step.

    ``delay_samples`` is how much later than the position the force is sampled: two converters are never quite at one.
    It is within a sample, but that the position comes ``late_samples`` late. More is none of two converters, however
    much recordings ask for it: an inertia looks like a delay.
    ``averaged``: where contact ends within a cell the force is the mean over it, as of a card that averages.
    """

    laws: tuple[Law, ...] = ()
    rigid_stiffness: float = 2.0 * RIGID_STIFFNESS_MN_PER_MM
    ideal_step: bool = False
    delay_samples: float = 0.0
    averaged: bool = False
    late_samples: float = 0.0

    @property
    def delay_ends(self) -> tuple[float, float]:
        """The least and the most that the force's delay may be, samples."""
        return -1.0 - self.late_samples, 1.0


def values_here(law: Law, state: TrialState) -> Values:
    """Return a law's values in a trial, in which some may be others."""
    values = dict(law.values)
    for (name, parameter), at in state.shapes.law_values.items():
        if name == law.name:
            values[parameter] *= float(np.exp(state.coefficients[at]))
    return values


def block_stiffness(trial: CellTrial, state: TrialState, shared: Shared) -> float:
    """Return the stiffness of the block that a trial presses, where it presses one, mN/mm.

    A lever that bends is in series with it: compliances add up.
    """
    known = trial.target_stiffness_mn_per_mm or shared.rigid_stiffness
    at = state.shapes.block
    return known if at is None else known / max(1.0 + float(state.coefficients[at]), STIFFEST)


def later(trial: CellTrial, force_mn: FloatArray, samples: float) -> FloatArray:
    """Return a force (..., n) as it is read so many samples later, or earlier if negative, along lines, mN.

    By a sample at a time, as no cell is shorter. A filter as slow would round the corners of a ramp, and go on straight
    beyond them where the force comes first: 1.2 samples at 10 mm/s were a dashpot.
    """
    steps, read = trial.steps, np.array(force_mn)
    left = abs(samples)
    while left > 0.0:
        part = np.minimum(min(left, 1.0) / trial.sample_rate_hz / steps.lengths_s, 1.0)
        _move_along(read.reshape(-1, read.shape[-1]), part, steps.index, samples > 0.0)
        left -= 1.0
    return read


@njit(cache=True)
def _move_along(rows: FloatArray, part: FloatArray, step: IntArray, later: bool) -> None:
    """Move rows (m, n) in place part of each step (of its kind) towards the point before, or after it if earlier."""
    m, n = rows.shape
    for row in range(m):
        if later:
            for i in range(n - 1, 0, -1):
                rows[row, i] -= part[step[i - 1]] * (rows[row, i] - rows[row, i - 1])
        else:
            for i in range(n - 1):
                rows[row, i] += part[step[i]] * (rows[row, i + 1] - rows[row, i])


def tissue_force(trial: CellTrial, state: TrialState, shared: Shared) -> FloatArray:
    """Return the force (n,) of a trial's tissue alone, without laws, own shapes and offset, mN."""
    bare = replace(state, offset_mn=0.0, shapes=OwnShapes(), coefficients=np.zeros(0), rhythms=())
    return simulate(trial, bare, replace(shared, laws=()))


def touches(trial: CellTrial, state: TrialState, shared: Shared) -> NDArray[np.bool_]:
    """Return where a trial's simulated force is that of a contact, (n,)."""
    unread: dict[Acts, FloatArray] = {
        acts: moved for acts, moved in own_effects(state).items() if acts != "force"
    }
    return simulate(trial, replace(state, offset_mn=0.0), shared, unread) > 0.0


def own_effects(state: TrialState) -> dict[Acts, FloatArray]:
    """Return what a trial's own shapes come to, (n,) for each stage at which some act.

    What rhythms do in a line is no part of the simulation, nor may it follow the surface where they were found: a
    stiffer tissue would explain a part of them, and the surface is known as well as that only by this tissue.
    """
    own = {acts: state.coefficients[at] @ shapes for acts, (at, shapes) in state.shapes.by_stage.items()}
    for rhythm in state.rhythms:
        own["force"] = own.get("force", 0.0) + rhythm.bent_mn
    return own


def simulate(
    trial: CellTrial,
    state: TrialState,
    shared: Shared,
    own: Mapping[Acts, FloatArray] | None = None,
    tissue: Tissue | Tissues | None = None,
) -> FloatArray:
    """Return the force (n,) of a trial, mN; ``own`` is what its own shapes come to, where that is known.

    Of m rows (m, n) at one stage or several, or of m tissues in place of the trial's, the force is (m, n).
    """
    added = own_effects(state) if own is None else own
    simulated = simulate_force(
        trial,
        tissue or state.tissue,
        PerTrial(state.z0_mm, state.offset_mn),
        [(a.mechanism, values_here(a, state)) for a in shared.laws],
        rigid_stiffness=block_stiffness(trial, state, shared),
        surface_mm=added.get("surface", 0.0),
        lost_share=added.get("share", 0.0),
        ideal_step=shared.ideal_step,
        averaged=shared.averaged,
    )
    if shared.delay_samples:
        simulated = later(trial, simulated, shared.delay_samples)
    return simulated + added.get("force", 0.0)
