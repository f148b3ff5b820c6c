"""A protocol becomes a plan of frozen steps: every combination once, new sites, rests, a seeded order."""

from __future__ import annotations

from collections import Counter
from dataclasses import FrozenInstanceError
from itertools import pairwise
from pathlib import Path

import pytest

import rig.examples
from rig.protocols.planning import plan_of
from rig.protocols.steps import Approach, Ask, Plan, RampTo, Rest, Retract, Stay, Sweep
from rig.protocols.studying import design
from rig.settings.protocol_file import Study
from rig.settings.reading import load_protocol, parse_protocol

EXAMPLES = [p for p in sorted(Path(rig.examples.__file__).parent.glob("*.toml")) if "rig" not in p.stem]


def plan(toml: str) -> Plan:
    return plan_of(parse_protocol(toml, "test.toml"), 0.5, toml)


def study(toml: str) -> Study:
    protocol = parse_protocol(f'kind = "study"\n[study]\n{toml}', "test.toml")
    assert isinstance(protocol, Study)
    return protocol


@pytest.mark.parametrize("path", [*EXAMPLES], ids=lambda path: path.stem)
def test_every_example_becomes_a_plan(path: Path) -> None:
    made = plan_of(load_protocol(path), 0.5, path.read_text())
    assert made.trials
    assert made.expected_s > 1
    assert all(trial.summary.toml == path.read_text() for trial in made.trials)
    assert len({trial.name for trial in made.trials}) == len(made.trials)


def test_the_published_study() -> None:
    made = plan('kind = "study"')
    assert len(made.trials) == 100
    sites = [(t.specimen.finger, t.specimen.site) for t in made.trials]
    assert len(set(sites)) == 100, "never twice at the same place"
    rests = [step.since_last_s for t in made.trials for step in t.preparations if isinstance(step, Rest)]
    assert len(rests) == 99, "the first has none before it"
    assert min(rests) >= 120
    assert max(rests) <= 180
    assert len(set(rests)) > 50
    trial = made.trials[0]
    kinds = [type(motion) for motion in trial.motions]
    assert kinds == [Approach, Stay, RampTo, Stay, Retract, Stay]
    assert [m.duration_s for m in trial.motions if isinstance(m, Stay)] == [2.0, 7.0, 0.5]
    assert trial.motions[0] == Approach(1.0, 10.0, 8, 10, 24, force_margin_mn=12.0)
    assert trial.motions[2] == RampTo(0.2, 5.0)


def test_a_design_holds_every_combination_as_often_as_repeats_say() -> None:
    toml = (
        'fingers = ["index", "ring"]\ndepths_mm = [0.2, 0.8]\nrepeats = 3\nramp_speeds_mm_s = [2.0, 5.0]\n'
        "holds_s = [7.0, 20.0]\nsurface_positions_mm = [3.0, 7.0]\n"
    )
    fixed = design(study(toml))
    shuffled = design(study(toml + 'order = "shuffled"\nseed = 4'))
    assert len(fixed) == 2 * 2 * 2 * 2 * 2 * 3
    assert Counter(fixed) == Counter(shuffled)
    assert max(Counter(fixed).values()) == 1
    assert fixed != shuffled
    assert design(study(toml + 'order = "shuffled"\nseed = 4')) == shuffled
    assert design(study(toml + 'order = "shuffled"\nseed = 5')) != shuffled
    changes = sum(a.finger != b.finger for a, b in pairwise(shuffled))
    assert changes == 1, "a finger is placed once"


def test_sweeps_and_block_come_before_the_fingers() -> None:
    made = plan('kind = "study"\n[study]\nair_sweep_speeds_mm_s = [1.0, 5.0]\nrigid_target = true')
    kinds = [t.kind for t in made.trials]
    assert kinds[:5] == ["air_sweep"] * 2 + ["rigid_target"] * 3
    assert set(kinds[5:]) == {"ramp_hold_retract"}
    approach = made.trials[2].motions[0]
    assert isinstance(approach, Approach)
    assert approach.speed_mm_s <= 0.2, "a block is approached slowly"


def test_a_height_is_asked_of_the_hands() -> None:
    made = plan('kind = "study"\n[study]\nsurface_positions_mm = [3.0]')
    asked = made.trials[0].preparations[0]
    assert isinstance(asked, Ask)
    assert asked.details["surface_mm"] == 3.0


def test_air_sweeps_one_speed_a_trial() -> None:
    made = plan('kind = "air_sweep"\nsweep_speeds_mm_s = [1.0, 5.0]\nstart_mm = 2.0\nstop_mm = 6.0')
    assert [t.motions for t in made.trials] == [(Sweep(2.0, 6.0, 1.0),), (Sweep(2.0, 6.0, 5.0),)]


def test_a_plan_cannot_be_changed() -> None:
    made = plan('kind = "surface_detection"')
    with pytest.raises(FrozenInstanceError):
        made.trials[0].name = "other"  # type: ignore[misc]
