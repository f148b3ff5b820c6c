"""The operator's hands: what they are asked for, and the control service that stands in their place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

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


_WORDS_FOR_NOTHING = {
    ("place_on_balance", "mass_g"): "Clear the pan of the balance",
    ("hang_weight", "mass_g"): "Take all weights off the arm",
    ("invert_arm", "inverted"): "Turn the arm back, upright",
}
_WORDS = {
    "place_finger": "Place the {finger} finger on the block, site {site}, repeat {repeat}",
    "remove_finger": "Take the finger off the block",
    "place_block": "Put the stiff block under the arm",
    "turn_micrometer": "Turn the micrometer to {position_um} um",
    "place_on_balance": "Put {mass_g:g} g on the balance",
    "hang_weight": "Hang {mass_g:g} g from the arm by a rubber band",
    "invert_arm": "Turn the arm over",
    "clear_air": "Clear everything from below the arm",
}


def words_for(kind: str, details: Details) -> str:
    """What a person is asked to do, in plain words."""
    for (request, key), words in _WORDS_FOR_NOTHING.items():
        if request == kind and key in details and not details[key]:
            return words
    try:
        words = _WORDS[kind].format_map(details)
        if "surface_mm" in details:
            words += f", so high that the arm meets the skin at {details['surface_mm']:g} mm of its travel"
    except KeyError:
        shown = ", ".join(f"{key} {value}" for key, value in details.items())
        words = f"{kind.replace('_', ' ')}: {shown}" if shown else kind.replace("_", " ")
    return words
