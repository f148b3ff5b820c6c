"""From a protocol file and a folder to what is to be run; nothing is written before all is checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.engine.resuming import Standing, standing
from rig.protocols.fitting import check_fits, check_number
from rig.protocols.planning import plan_of
from rig.protocols.steps import Plan
from rig.settings.reading import check_protocol_on_rig, load_protocol
from rig.settings.rig_file import RigFile


@dataclass(frozen=True, slots=True)
class LoadedRun:
    """A protocol's plan, its text, and what is left of it in its folder."""

    plan: Plan
    toml: str
    left: Standing


def load_run(protocol: Path, rig: RigFile, out: Path) -> LoadedRun:
    """Read and check a protocol for a rig, and what its folder holds. Raises BadInputError."""
    asked = load_protocol(protocol)
    check_protocol_on_rig(asked, rig, str(protocol))
    check_number(asked, str(protocol))
    toml = protocol.read_text(encoding="utf-8")
    plan = plan_of(asked, rig.punch.diameter_mm, toml)
    check_fits(plan, rig, out, str(protocol))
    return LoadedRun(plan, toml, standing(plan, toml, out))
