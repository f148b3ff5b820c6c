"""From a checked protocol file to the plan of a run."""

from __future__ import annotations

from analysis.recordings.trial import Specimen
from rig.protocols.calibrating import force_trials, position_trials, upright_again
from rig.protocols.indenting import approach, detection, indentation, place_block, place_finger
from rig.protocols.steps import Plan
from rig.protocols.studying import study_trials
from rig.protocols.sweeping import air_sweeps
from rig.settings.protocol_file import (
    AirSweep,
    ForceCalibration,
    PositionCalibration,
    Protocol,
    SpecimenSettings,
    Study,
    SurfaceOnly,
    TrialProtocol,
)


def plan_of(protocol: Protocol, punch_diameter_mm: float, toml: str = "") -> Plan:
    """Return the plan of a protocol; `toml` is its text, which every trial file keeps."""
    match protocol:
        case Study():
            plan = Plan("study", study_trials(protocol, punch_diameter_mm, toml))
        case TrialProtocol():
            plan = _one_trial(protocol, punch_diameter_mm, toml)
        case SurfaceOnly():
            specimen = _specimen(protocol.specimen, punch_diameter_mm)
            placed = place_finger(specimen.finger, specimen.site, specimen.repeat or 1, None)
            found = detection("surface", (placed,), approach(protocol.surface), specimen, toml)
            plan = Plan("surface detection", (found,))
        case AirSweep():
            sweeps = air_sweeps(
                protocol.sweep_speeds_mm_s,
                protocol.start_mm,
                protocol.stop_mm,
                specimen=Specimen(punch_diameter_mm=punch_diameter_mm),
                toml=toml,
                rest_s=protocol.rest_s,
            )
            plan = Plan("air sweep", sweeps)
        case PositionCalibration():
            plan = Plan("position calibration", position_trials(protocol, toml))
        case ForceCalibration():
            plan = Plan("force calibration", force_trials(protocol, toml), upright_again())
    return plan


def _one_trial(protocol: TrialProtocol, punch_diameter_mm: float, toml: str) -> Plan:
    rigid = protocol.kind == "rigid_target"
    specimen = _specimen(protocol.specimen, punch_diameter_mm, finger="" if rigid else "index")
    placed = (
        place_block() if rigid else place_finger(specimen.finger, specimen.site, specimen.repeat or 1, None)
    )
    motion = protocol.indentation
    name = "block" if rigid else f"{specimen.finger}_{motion.depth_mm:.2f}mm"
    trial = indentation(
        name,
        (placed,),
        protocol.surface,
        motion,
        depth_mm=motion.depth_mm,
        specimen=specimen,
        toml=toml,
        rigid=rigid,
    )
    return Plan("rigid target" if rigid else "ramp, hold, retract", (trial,))


def _specimen(said: SpecimenSettings, punch_diameter_mm: float, finger: str = "index") -> Specimen:
    """Return the specimen that the file names; an index finger at site 1 where it does not."""
    return Specimen(
        subject=said.subject,
        finger=said.finger or finger,
        site=said.site or "1",
        repeat=said.repeat,
        punch_diameter_mm=punch_diameter_mm,
        notes=said.notes,
        target_stiffness_mn_per_mm=said.target_stiffness_mn_per_mm,
    )
