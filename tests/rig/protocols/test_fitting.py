"""Plans that fit: refused with the figure, at once, before anything is made."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from analysis.errors import BadInputError
from rig.protocols.fitting import check_fits, check_number, needs_of
from rig.protocols.planning import plan_of
from rig.protocols.studying import number_of_trials, study_trials
from rig.settings.protocol_file import Study
from rig.settings.reading import parse_protocol
from rig.settings.rig_file import RigFile

DEPTHS = ", ".join(f"{0.1 + i * 1e-6:.6f}" for i in range(100_000))
ONE = 'kind = "ramp_hold_retract"\n[indentation]\ndepth_mm = 0.4\n'


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        (f'kind = "study"\n[study]\ndepths_mm = [{DEPTHS}]\nrepeats = 1000\n', "asks for 500000000 trials"),
        ('kind = "position_calibration"\nstep_um = 1e-6\n', "asks for 32"),
        (ONE + "hold_s = 86400.0\n", r"may record for 2\d(\.\d)? h"),
        (ONE + "ramp_speed_mm_s = 1e-9\n", "may record for|lasts"),
        (ONE + "[surface]\napproach_speed_mm_s = 1e-9\n", "may record for|lasts"),
        ('kind = "air_sweep"\nsweep_speeds_mm_s = [1e-6]\n', "may record for|lasts"),
        ('kind = "study"\n[study]\nrest_s = 86400.0\n', "lasts 2"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_with_the_figure(toml: str, words: str, tmp_path: Path) -> None:
    began = time.monotonic()
    with pytest.raises(BadInputError, match=rf"^p\.toml: .*({words})") as caught:
        protocol = parse_protocol(toml, "p.toml")
        check_number(protocol, "p.toml")
        check_fits(plan_of(protocol, 0.5), RigFile(), tmp_path, "p.toml")
    assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 10.0


def test_the_number_is_that_of_the_trials() -> None:
    toml = 'kind = "study"\n[study]\nrepeats = 3\nair_sweep_speeds_mm_s = [1.0, 2.0]\nrigid_target = true\n'
    study = parse_protocol(toml + "holds_s = [1.0, 2.0]\n", "p.toml")
    assert isinstance(study, Study)
    assert number_of_trials(study) == len(study_trials(study, 0.5, ""))


def test_the_published_study_fits(tmp_path: Path) -> None:
    protocol = parse_protocol('kind = "study"', "p.toml")
    check_number(protocol, "p.toml")
    plan = plan_of(protocol, 0.5)
    check_fits(plan, RigFile(), tmp_path / "not" / "made", "p.toml")
    needs = needs_of(plan, RigFile())
    assert needs.n_trials == 100
    assert 3 * 3600 < needs.duration_s < 6 * 3600
    assert 0.2e9 < needs.disk_bytes < 1e9


def test_a_full_disk_is_told_before_anything_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil
    from types import SimpleNamespace

    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1e6))
    with pytest.raises(BadInputError, match=r"GB of disk at"):
        check_fits(plan_of(parse_protocol(ONE, "p"), 0.5), RigFile(), tmp_path, "p.toml")
