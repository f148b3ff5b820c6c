"""What the hardware can answer instead of obeying; each message is one line with what to do."""

from __future__ import annotations

from rig.errors import RigError


class HardwareError(RigError):
    """A device did not do what it was asked."""


class CardError(HardwareError):
    """The card or its driver refused.

    ``code`` is NI's error code, ``samples_done`` how many samples went through before.
    """

    def __init__(self, message: str, code: int | None = None, samples_done: int | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.samples_done = samples_done


class CardMissingError(CardError):
    """No driver, no such device, or its server does not answer."""


class CardBusyError(CardError):
    """Another program holds the card."""


class SamplesLostError(CardError):
    """Samples were overwritten before they were read."""


class OutputStarvedError(CardError):
    """The output ran dry and stopped."""


class SamplesLateError(CardError):
    """The samples asked for did not come in time."""


class RateCoercedError(CardError):
    """The card runs at another sample rate than asked for."""


class LimitRefusedError(HardwareError):
    """A motion was refused before anything was sent: it leaves the travel, is too fast, or is no number."""


class LimitHit(HardwareError):  # noqa: N818 - an event at the bench, named as the bench calls it
    """A limit was hit while the arm moved; the retract has begun.

    ``limit``: "force", "travel", "depth", "following error", "saturation", "force noise" or "not a number";
    ``sample`` since recording began; ``value`` in ``unit``; ``position_mm`` of the arm there.
    """

    def __init__(
        self, limit: str, *, sample: int, value: float, unit: str, allowed: float, position_mm: float
    ) -> None:
        what = f"{limit} limit hit: {value:.4g} {unit} where {allowed:.4g} {unit} is allowed"
        todo = "check the finger, then the limits in rig.toml"
        if limit == "force noise":
            live = f"less than the {allowed:.2g} of a live one"
            what = f"the force signal went dead: its noise is {value:.2g} {unit}, {live}"
            todo = "check the force output and its wire, then run again"
        super().__init__(f"{what}, at sample {sample}, {position_mm:.3f} mm; the arm is retracting; {todo}")
        self.limit = limit
        self.sample = sample
        self.value = value
        self.unit = unit
        self.allowed = allowed
        self.position_mm = position_mm


class NotWiredError(HardwareError):
    """The rig file declares a wire that is not there."""


class ArmNotProvenError(HardwareError):
    """What the signals say contradicts the rig file or the constants, so the arm is not moved."""


class RetreatFailedError(HardwareError):
    """The arm could not be moved to the safe position; lift it by hand."""


class GuardError(HardwareError):
    """The guard process did not start, or is gone."""


class SerialDeviceError(HardwareError):
    """The stage or the balance did not answer, or answered something else."""


class CompanionError(HardwareError):
    """The companion program did not start, or ended early."""


class OperatorError(HardwareError):
    """The operator refused, or the control service did not answer."""
