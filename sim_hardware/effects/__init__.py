"""Effects that the simulated bench can conceal, one file each; this table lists the folder.

A new effect is a new file with a subclass of ``Effect``; nothing else names it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping

from sim_hardware.effects.base import Effect, Parameter, Stage

__all__ = ["EFFECTS", "Effect", "Parameter", "Stage", "make_effect"]


def _listed() -> dict[str, type[Effect]]:
    """Effect classes by name, from every file of this folder."""
    found: dict[str, type[Effect]] = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name != "base"):
        names = vars(importlib.import_module(f"{__name__}.{module}"))
        for value in names.values():
            if (
                isinstance(value, type)
                and issubclass(value, Effect)
                and value.__module__ == f"{__name__}.{module}"
            ):
                found[value.name] = value
    return found


EFFECTS: Mapping[str, type[Effect]] = _listed()
"""Every effect's class by its name; it tells stage, parameters, phases, and whether the library has it."""


def make_effect(name: str, given: Mapping[str, object], *, seed: int = 0) -> Effect:
    """Make an effect from its name and parameters; ValueError with one line where either is wrong."""
    if name not in EFFECTS:
        raise ValueError(f"effects: unknown effect {name!r}; known are {', '.join(EFFECTS)}")
    return EFFECTS[name](given, seed=seed)
