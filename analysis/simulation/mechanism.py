"""What a mechanism is: a law that changes one stage of the simulated trial, and the words for it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

OTHER_TIMES = (0.5, 2.0)
"""Times its own, at which a part of what takes time may act."""
TIME_UNITS = ("s", "ms")

Values = Mapping[str, float]
Stage = Literal["lever", "contact", "tissue", "sensor", "specimen"]
Form = Literal["law", "oscillation", "event", "servo", "ramp"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A mechanism's parameter: name with unit, bounds, and the scale on which it is fitted.

    An ``inner`` parameter gives a law the play that real effects need; it is fitted, but not part of the
    library's contract and not reported.
    """

    name: str
    unit: str
    lower: float
    upper: float
    scale: Literal["linear", "log", "inverse_square"] = "linear"
    inner: bool = False

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end of the range, on the scale of the fit."""
        lower, upper = sorted((self.to_fit(self.lower), self.to_fit(self.upper)))
        return lower, upper

    def to_fit(self, value: float) -> float:
        """Return the value on the scale of the fit."""
        if self.scale == "log":
            return float(np.log(value))
        return 1e3 / value**2 if self.scale == "inverse_square" else value

    def from_fit(self, fitted: float) -> float:
        """Return the value from the scale of the fit, kept within the bounds."""
        if self.scale == "log":
            value = float(np.exp(min(fitted, 700.0)))
        elif self.scale == "inverse_square":
            value = float(np.sqrt(1e3 / max(fitted, 1e-9)))
        else:
            value = fitted
        return min(max(value, self.lower), self.upper)

    def derivative(self, value: float) -> float:
        """Return d(value)/d(fitted) at a value, for carrying standard errors back."""
        if self.scale == "log":
            return value
        return -0.5 * value**3 / 1e3 if self.scale == "inverse_square" else 1.0


@dataclass(frozen=True, slots=True)
class Tissue:
    """The Maxwell-Weichert solid: k0 and two arms, tau1 the longer; mN/mm and s."""

    k0: float
    k1: float
    tau1: float
    k2: float
    tau2: float

    @property
    def logarithms(self) -> FloatArray:
        """Natural logarithms (5,) of the constants, in their order."""
        return np.log([self.k0, self.k1, self.tau1, self.k2, self.tau2])

    @property
    def stiffness(self) -> float:
        """Stiffness at once, k0 + k1 + k2, mN/mm."""
        return self.k0 + self.k1 + self.k2

    @property
    def arms(self) -> tuple[FloatArray, FloatArray]:
        """Times (2,) s and stiffnesses (2,) mN/mm of the arms."""
        return np.array([self.tau1, self.tau2]), np.array([self.k1, self.k2])

    def stiffness_after(self, since_s: FloatArray) -> FloatArray:
        """Return what is left of the stiffness (n,) some time after a step, k0 + sum k_i exp(-t / tau_i), mN/mm."""
        return self.k0 + self.k1 * np.exp(-since_s / self.tau1) + self.k2 * np.exp(-since_s / self.tau2)


@dataclass(frozen=True, slots=True)
class Tissues:
    """Several tissues side by side, each constant (m, 1): a force is (m, n) of them, and costs less than one by one."""

    k0: FloatArray
    k1: FloatArray
    tau1: FloatArray
    k2: FloatArray
    tau2: FloatArray

    @classmethod
    def at(cls, logarithms: FloatArray) -> Tissues:
        """Return the tissues with logarithms (m, 5) of their constants."""
        return cls(*np.exp(logarithms).T[:, :, None])

    @property
    def stiffness(self) -> FloatArray:
        """Stiffness at once (m, 1), mN/mm."""
        return self.k0 + self.k1 + self.k2

    @property
    def arms(self) -> tuple[FloatArray, FloatArray]:
        """Times (m, 2) s and stiffnesses (m, 2) mN/mm of the arms."""
        return np.hstack([self.tau1, self.tau2]), np.hstack([self.k1, self.k2])


class Mechanism:
    """A mechanism of the library; a subclass sets the words and overrides the stages it changes.

    Every method gets the trial, the present value of what it changes, (..., n), and its own parameters by name, and
    returns the changed value. ``null`` are the parameters at which the mechanism is absent; ``probes`` the
    settings at which its signature is taken (several where its shape depends on them). ``amplitude`` names the
    parameter that scales the effect: it is what a report says the size of.

    ``of_site`` are the parameters that are the skin's where it was pressed, and differ between sites as the tissue's
    constants do.

    ``inseparable`` names mechanisms of the same shape to the eye of any experiment with one punch; they are listed
    as alternatives however well one of the two laws fits. ``separated_by`` says what tells them apart.

    One that is ``like_a_quick_arm`` of the tissue is taken up by it whole where an arm has ended at its shortest.

    One that ``relaxes`` adds to the times in which the tissue does. Beside it another says how rough it is, no more.

    ``form`` tells how its unknowns are found: a ``law`` shares all parameters over trials, an ``oscillation``
    has a phase of its own in every trial, an ``event`` a time (and maybe size) of its own in every trial, the
    ``servo`` is seen in the position, the ``ramp`` is the step of the textbook baseline undone.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    form: ClassVar[Form] = "law"
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    amplitude: ClassVar[str] = ""
    null: ClassVar[Values] = {}
    probes: ClassVar[tuple[Values, ...]] = ()
    typical: ClassVar[Values] = {}
    one_sided: ClassVar[bool] = True
    needs_contact: ClassVar[bool] = True
    of_site: ClassVar[tuple[str, ...]] = ()
    sensor_rank: ClassVar[int] = 0
    words: ClassVar[str] = ""
    source: ClassVar[str] = ""
    separated_by: ClassVar[str] = ""
    inseparable: ClassVar[tuple[str, ...]] = ()
    relaxes: ClassVar[bool] = False
    like_a_quick_arm: ClassVar[bool] = False

    def holds(self, p: Values, depth_mm: float) -> bool:
        """Whether the law is what its source says of it, in a study of this largest depth."""
        return True

    def otherwise(self, p: Values) -> tuple[Values, ...]:
        """Settings by which a part of it may act instead: what takes time, at other times than its own.

        No skin has one time only, and no filter one pole.
        """
        times = [q for q in self.parameters if q.unit in TIME_UNITS and not q.inner and q.name in p]
        return tuple(
            {**p, **{q.name: min(max(by * p[q.name], q.lower), q.upper) for q in times}}
            for by in OTHER_TIMES
            if times
        )

    def surface_mm(self, trial: CellTrial, tissue: Tissue | Tissues, p: Values) -> FloatArray | float:
        """How far the surface has moved towards the arm, (n,), mm."""
        return 0.0

    def tip_mm(self, trial: CellTrial, tip_mm: FloatArray, force_mn: FloatArray, p: Values) -> FloatArray:
        """Where the tip is, given the arm's position so far and the force on it."""
        return tip_mm

    def indentation_mm(self, trial: CellTrial, depth_mm: FloatArray, p: Values) -> FloatArray:
        """The indentation that the tissue's law answers to."""
        return depth_mm

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray | float:
        """Force that the tissue adds, before contact is judged."""
        return 0.0

    def contact_force_mn(
        self, trial: CellTrial, free_force_mn: FloatArray, contact_force_mn: FloatArray, p: Values
    ) -> FloatArray:
        """The force across the contact, given what the tissue would do if it stuck, and what it does so far."""
        return contact_force_mn

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """The force that the sensor makes of it."""
        return force_mn

    def unread_mn(self, force_mn: FloatArray, offset_mn: float, p: Values) -> FloatArray | float:
        """What is not recorded of the sensor's force and the trial's offset."""
        return 0.0

    @property
    def bends_reading(self) -> bool:
        """Whether an offset may add anything but itself to what is recorded."""
        return type(self).unread_mn is not Mechanism.unread_mn

    def exchanged(self, tissue: Tissue, p: Values, arm: int) -> tuple[Tissue, Values] | None:
        """Return the same solid with the law's part of it for one of the tissue's arms, 1 or 2; None for most laws."""
        return None

    def probe_settings(self, peak_force_mn: float, depth_mm: float) -> tuple[Values, ...]:
        """Return the settings at which the signature is taken, given a study's largest force and depth.

        Each names the parameters that are free in this form of the law; all others stay at ``null``.
        """
        return self.probes

    @property
    def needs_force(self) -> bool:
        """Whether the tip's position depends on the force (a compliant lever)."""
        return False

    def applies(self, trial: CellTrial) -> bool:
        """Whether the mechanism could show in this trial at all."""
        return trial.touches or not self.needs_contact

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name."""
        return next(p for p in self.parameters if p.name == name)


@cache
def library() -> dict[str, Mechanism]:
    """Return every mechanism of the library by name, found by listing the folder `mechanisms`."""
    package = importlib.import_module("analysis.simulation.mechanisms")
    found: dict[str, Mechanism] = {}
    for info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{info.name}")
        for item in vars(module).values():
            if isinstance(item, type) and issubclass(item, Mechanism) and item.__module__ == module.__name__:
                found[item.name] = item()
    return found
