"""The operator's hands: asked at the console, or through a control service in their place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from rig.hardware.errors import OperatorError
from rig.hardware.remote import ControlService

Details = Mapping[str, str | float | int | bool]


class Operator(Protocol):
    """Whoever places fingers, hangs weights and turns the micrometer."""

    def request(self, kind: str, details: Details) -> str:
        """Have something done; returns a short text that says it is done. Raises OperatorError."""


class RemoteOperator:
    """Hands reached through a control service."""

    def __init__(self, service: ControlService) -> None:
        self._service = service

    def request(self, kind: str, details: Details) -> str:
        """Ask the service."""
        return str(self._service.call("request", kind, dict(details)))


class ConsoleOperator:
    """A person at this terminal."""

    def request(self, kind: str, details: Details) -> str:
        """Say what is to be done and wait for Enter; `s` and Enter stops the run."""
        from rich.prompt import Prompt

        try:
            answer = Prompt.ask(
                f"{words_for(kind, details)} [dim](Enter when done, s to stop)[/dim]",
                default="",
                show_default=False,
            )
        except EOFError:
            raise OperatorError(
                f"{kind}: nobody is at the console to answer; run in a terminal, or name a service under "
                "[operator] in rig.toml"
            ) from None
        if answer.strip().lower() in {"s", "stop"}:
            raise OperatorError(f"{kind}: the operator stopped the run; start it again to go on where it was")
        return "done by hand"


class ConsoleAnswers:
    """What a person reads off where a device is missing."""

    def read_mass_g(self, nominal_g: float) -> float:
        """Ask for the mass of a weight, g; its nominal value when only Enter is pressed."""
        from rich.prompt import FloatPrompt

        try:
            return float(FloatPrompt.ask("Mass of the weight as weighed, in grams", default=nominal_g))
        except EOFError:
            raise OperatorError(
                "mass of a weight: nobody is at the console to answer; run in a terminal, or name a balance "
                "in rig.toml"
            ) from None


_WORDS = {
    "place_finger": "Place the {finger} finger on the block, site {site}, repeat {repeat}",
    "remove_finger": "Take the finger off the block",
    "place_block": "Put the stiff block under the arm",
    "turn_micrometer": "Turn the micrometer to {position_um} um",
    "place_on_balance": "Put {mass_g} g on the balance (0 g: clear the pan)",
    "hang_weight": "Hang {mass_g} g from the arm by a rubber band (0 g: take all weights off)",
    "invert_arm": "Turn the arm over (inverted: {inverted})",
    "clear_air": "Clear everything from below the arm",
}


def words_for(kind: str, details: Details) -> str:
    """What a person is asked to do, in plain words."""
    try:
        words = _WORDS[kind].format_map(details)
        if "surface_mm" in details:
            words += f", so high that the arm meets the skin at {details['surface_mm']:g} mm of its travel"
    except KeyError:
        shown = ", ".join(f"{key} {value}" for key, value in details.items())
        words = f"{kind.replace('_', ' ')}: {shown}" if shown else kind.replace("_", " ")
    return words
