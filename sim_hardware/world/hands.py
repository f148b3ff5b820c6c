"""The operator's hands: put a finger, turn the micrometer, hang a weight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sim_hardware.world import specimens

if TYPE_CHECKING:
    from sim_hardware.world.bench import World

KINDS = {
    "place_finger": ("finger", "site", "repeat", "surface_mm"),
    "remove_finger": (),
    "place_block": (),
    "turn_micrometer": ("position_um",),
    "hang_weight": ("mass_g",),
    "invert_arm": ("inverted",),
    "clear_air": (),
}
"""What can be asked of the hands, and the details of each."""


def do(world: World, kind: str, details: Mapping[str, object]) -> str:
    """Do it; ValueError with one line for a request that is unknown, incomplete or can't be done now."""
    if kind not in KINDS:
        raise ValueError(f"request {kind!r}: unknown; known are {', '.join(KINDS)}")
    odd = sorted(set(details) - set(KINDS[kind]))
    if odd:
        raise ValueError(f"request {kind!r}: unknown detail {odd[0]!r}")
    if kind == "place_finger":
        return _place_finger(world, details)
    if kind in ("remove_finger", "clear_air"):
        world.place(specimens.nothing(world.settings))
        return "nothing lies under the arm"
    if kind == "place_block":
        _put(world, specimens.block(world.settings, world.micrometer_um))
        return f"the block is on the stage, micrometer at {world.micrometer_um:g} um"
    if kind == "turn_micrometer":
        return _turn(world, _number(kind, details, "position_um", (-5000, 5000), "um"))
    if kind == "hang_weight":
        mass_g = _number(kind, details, "mass_g", (0, 200), "g")
        if mass_g and not world.inverted:
            raise ValueError("request 'hang_weight': the arm is not inverted, nothing can hang from it")
        world.hung_mass_g = mass_g
        return f"{mass_g:g} g hang from the arm" if mass_g else "nothing hangs from the arm"
    inverted = details.get("inverted", True)
    if not isinstance(inverted, bool):
        raise ValueError(f"request 'invert_arm': inverted = {inverted!r}: must be true or false")  # noqa: TRY004
    world.place(specimens.nothing(world.settings))
    world.inverted = inverted
    world.hung_mass_g = 0.0
    return "the arm is inverted" if inverted else "the arm is upright"


def _place_finger(world: World, details: Mapping[str, object]) -> str:
    finger = details.get("finger", "index")
    if finger not in specimens.FINGERS:
        raise ValueError(
            f"request 'place_finger': finger = {finger!r}: must be one of {', '.join(specimens.FINGERS)}"
        )
    repeat = int(_number("place_finger", {"repeat": 1, **details}, "repeat", (0, 1e6)))
    surface_mm = None
    if "surface_mm" in details:
        surface_mm = _number("place_finger", details, "surface_mm", (0.5, 9.0), "mm")
    part = specimens.finger(world.settings, str(finger), str(details.get("site", "")), repeat, surface_mm)
    _put(world, part)
    return f"the {finger} finger is under the punch, site {details.get('site', '')!s}"


def _put(world: World, part: specimens.SpecimenPart) -> None:
    if world.inverted:
        raise ValueError("the arm is inverted: turn it back before anything is placed under it")
    if world.tip_mm > part.surface_mm - 0.05:
        raise ValueError(
            f"the punch is at {world.tip_mm:.2f} mm, in the way of a surface at {part.surface_mm:.2f} mm: "
            "move the arm away first"
        )
    world.place(part)


def _turn(world: World, position_um: float) -> str:
    world.micrometer_um = position_um
    if world.specimen.label == "block":
        world.place(specimens.block(world.settings, position_um), new_trial=False)
    return f"the micrometer is at {position_um:g} um"


def _number(
    kind: str, details: Mapping[str, object], name: str, limits: tuple[float, float], unit: str = ""
) -> float:
    value = details.get(name)
    low, high = limits
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        must = f"must be from {low:g} to {high:g} {unit}".rstrip()
        raise ValueError(f"request {kind!r}: {name} = {value!r}: {must}")
    return float(value)
