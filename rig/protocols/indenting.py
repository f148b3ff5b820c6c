"""Trials that press: into skin, into a stiff block, or just far enough to find the surface."""

from __future__ import annotations

from dataclasses import replace

from analysis.recordings.trial import Kind, ProtocolSummary, Specimen
from rig.protocols.steps import Approach, Ask, Motion, PlannedTrial, Preparation, RampTo, Retract, Stay
from rig.settings.protocol_file import StudyIndentation, SurfaceDetection

FREE_S = 0.1
"""Recorded at rest before the approach: the force of the free arm, from which the threshold counts."""

BLOCK_SPEED_MM_S = 0.2
"""Approach to a stiff block, at most: 1 um too deep is 10 to 20 mN."""

SKIN_MARGIN_MN = 12.0
"""Force above the threshold that an approach to skin never adds: 60 um, twice what the output plays by itself."""

NEAR_MM = 0.05
"""How far short of a surface found before, the next approach to the same block begins."""

_HAND_S = 10.0


def place_finger(finger: str, site: str, repeat: int, surface_position_mm: float | None) -> Ask:
    """Ask for a finger at a place not yet pressed, where given at a height that meets the arm there."""
    details: dict[str, str | float | int | bool] = {"finger": finger, "site": site, "repeat": repeat}
    if surface_position_mm is not None:
        details["surface_mm"] = surface_position_mm
    return Ask("place_finger", details, _HAND_S)


def place_block(*, first: bool = True) -> Ask:
    """Ask for the stiff block in place of the finger; `first` is where it is expected to take time."""
    return Ask("place_block", {}, _HAND_S if first else 0.0)


def clear_air(*, first: bool = True) -> Ask:
    """Ask for nothing at all below the arm."""
    return Ask("clear_air", {}, _HAND_S if first else 0.0)


def approach(surface: SurfaceDetection, *, speed_mm_s: float | None = None) -> Approach:
    """Return the approach that the file's [surface] describes."""
    return Approach(
        speed_mm_s=speed_mm_s or surface.approach_speed_mm_s,
        threshold_mn=surface.contact_threshold_mn,
        samples_above=surface.samples_above,
        samples_watched=surface.samples_watched,
        samples_per_read=surface.samples_per_read,
        force_margin_mn=SKIN_MARGIN_MN,
        start_mm=surface.start_mm,
    )


def indentation(
    name: str,
    before: tuple[Preparation, ...],
    surface: SurfaceDetection,
    motion: StudyIndentation,
    *,
    depth_mm: float,
    specimen: Specimen,
    toml: str,
    rigid: bool = False,
) -> PlannedTrial:
    """Return one ramp-hold-retract trial, of skin or (`rigid`) of a block."""
    towards = approach(surface)
    if rigid:
        speed_mm_s = min(surface.approach_speed_mm_s, BLOCK_SPEED_MM_S)
        towards = replace(towards, speed_mm_s=speed_mm_s, short_of_previous_mm=NEAR_MM, force_margin_mn=None)
    motions: tuple[Motion, ...] = (
        towards,
        Stay("dwell", motion.dwell_s),
        RampTo(depth_mm, motion.ramp_speed_mm_s),
        Stay("hold", motion.hold_s),
        Retract(motion.retract_speed_mm_s, motion.retract_max_mm),
        Stay("clear", motion.clear_s),
    )
    summary = ProtocolSummary(
        depth_mm=depth_mm,
        ramp_speed_mm_s=motion.ramp_speed_mm_s,
        hold_s=motion.hold_s,
        dwell_s=motion.dwell_s,
        approach_speed_mm_s=towards.speed_mm_s,
        retract_speed_mm_s=motion.retract_speed_mm_s,
        contact_threshold_mn=surface.contact_threshold_mn,
        toml=toml,
    )
    kind: Kind = "rigid_target" if rigid else "ramp_hold_retract"
    return PlannedTrial(name, kind, before, motions, specimen, summary)


def detection(
    name: str, before: tuple[Preparation, ...], towards: Approach, specimen: Specimen, toml: str
) -> PlannedTrial:
    """Return a trial that finds the surface and leaves it again."""
    summary = ProtocolSummary(
        approach_speed_mm_s=towards.speed_mm_s,
        retract_speed_mm_s=AWAY_MM_S,
        contact_threshold_mn=towards.threshold_mn,
        toml=toml,
    )
    motions: tuple[Motion, ...] = (towards, Retract(AWAY_MM_S, AWAY_MM), Stay("clear", 0.1))
    return PlannedTrial(name, "surface_detection", before, motions, specimen, summary)


AWAY_MM_S = 5.0
"""Speed away from a surface that was only to be found."""
AWAY_MM = 2.0
"""How far away at most."""
