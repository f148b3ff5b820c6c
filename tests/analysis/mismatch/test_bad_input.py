from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.mismatch.diagnose import diagnose_paths
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.report.contents import Report
from analysis.mismatch.study.intake import take_in
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from sim_hardware.concealment.offline import study_plans


@pytest.fixture(scope="module")
def pair(record: Callable[..., list[Trial]]) -> list[Trial]:
    return record(31, plans=study_plans(depths_mm=(0.4,), repeats=2, hold_s=0.5, dwell_s=0.2))


@pytest.fixture
def refusal(tmp_path: Path, as_files: Callable[..., Path]) -> Callable[..., str]:
    """Function (trials, options) -> the one line with which they are refused; nothing may be written."""

    def refused(trials: list[Trial], **options: object) -> str:
        files, out = as_files(tmp_path / "trials", trials), tmp_path / "out"
        with pytest.raises(BadInputError) as caught:
            diagnose_paths([files], out=out, **options)  # type: ignore[arg-type]
        assert not out.exists()
        message = str(caught.value)
        assert "\n" not in message
        return message

    return refused


def test_all_discarded(refusal: Callable[..., str], pair: list[Trial]) -> None:
    message = refusal([replace(t, discarded="the finger moved") for t in pair])
    assert "nothing to diagnose" in message
    assert "the finger moved" in message


def test_other_kinds_only(refusal: Callable[..., str], pair: list[Trial]) -> None:
    assert "surface detection" in refusal([replace(t, kind="surface_detection") for t in pair])


def test_mixed_rigs_by_calibration(refusal: Callable[..., str], pair: list[Trial]) -> None:
    other = replace(pair[1], calibration=replace(pair[1].calibration, volts_per_mn=0.03))
    message = refusal([pair[0], other])
    assert "different rigs" in message
    assert "volts_per_mn" in message
    assert "trial_00.h5" in message
    assert "trial_01.h5" in message


def test_mixed_rigs_by_rate(refusal: Callable[..., str], pair: list[Trial]) -> None:
    message = refusal([pair[0], replace(pair[1], sample_rate_hz=4000.0)])
    assert "8000 and 4000 Hz" in message


def test_missing_phase(refusal: Callable[..., str], pair: list[Trial]) -> None:
    without = replace(pair[0], phases=tuple(p for p in pair[0].phases if p.name != "hold"))
    message = refusal([without])
    assert "phase hold missing" in message
    assert "trial_00.h5" in message


def test_a_bad_file_stops_no_other(tmp_path: Path, as_files: Callable[..., Path], pair: list[Trial]) -> None:
    dead = replace(pair[1], force_v=np.zeros(pair[1].n_samples))
    folder = as_files(tmp_path / "trials", [pair[0], dead])
    (folder / "broken.h5").write_bytes(b"no trial")
    taken = take_in(sorted(folder.iterdir()))
    assert [Path(trial.label).name for trial in taken.trials] == ["trial_00.h5"]
    broken, zero = taken.left_out
    assert broken.startswith("broken.h5: ")
    assert zero.startswith("trial_01.h5: the force is the same")
    assert "\n" not in broken


def test_a_trial_that_defeats_the_arithmetic_is_left_out(
    tmp_path: Path, as_files: Callable[..., Path], pair: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    from analysis.mismatch import diagnosis
    from analysis.mismatch.fit import baseline

    def fails(trials: Sequence[CellTrial], **_: object) -> StudyFit:
        if any(trial.label.endswith("trial_01.h5") for trial in trials):
            raise np.linalg.LinAlgError("Singular matrix")
        return fit(trials)

    fit = baseline.fit_baseline
    monkeypatch.setattr(baseline, "fit_baseline", fails)
    monkeypatch.setattr(diagnosis, "fit_baseline", fails)
    shown: list[Report] = []
    diagnose_paths([as_files(tmp_path / "trials", pair)], out=tmp_path / "out", show=shown.append)
    assert shown[0].n_trials == 1
    assert shown[0].left_out == ("trial_01.h5: the simulation can't be fitted to it (Singular matrix)",)


def test_arithmetic_that_fails_over_all_is_one_line(
    refusal: Callable[..., str], pair: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    from analysis.mismatch import diagnosis

    def fails(*_: object, **__: object) -> None:
        raise FloatingPointError("overflow\nin exp")

    monkeypatch.setattr(diagnosis, "diagnose", fails)
    message = refusal(pair)
    assert "trial_00.h5 and 1 more" in message
    assert "overflow in exp" in message


def test_all_zero_force(refusal: Callable[..., str], pair: list[Trial]) -> None:
    message = refusal([replace(pair[0], force_v=np.zeros(pair[0].n_samples))])
    assert "force is the same in every sample" in message


def test_position_that_never_moves(refusal: Callable[..., str], pair: list[Trial]) -> None:
    still = np.full(pair[0].n_samples, pair[0].position_v[0])
    assert "never moves" in refusal([replace(pair[0], position_v=still)])


def test_nothing_there(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no such file"):
        diagnose_paths([tmp_path / "nowhere"], out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"), [({"baseline": "wave"}, "use ramp or step"), ({"tolerance_mn": 0.0}, "above 0")]
)
def test_options_that_mean_nothing(
    refusal: Callable[..., str], pair: list[Trial], options: dict[str, object], words: str
) -> None:
    assert words in refusal(pair, **options)


def test_out_that_is_a_file(tmp_path: Path, as_files: Callable[..., Path], pair: list[Trial]) -> None:
    files = as_files(tmp_path / "trials", pair)
    target = tmp_path / "notes.txt"
    target.write_text("mine", encoding="utf-8")
    with pytest.raises(BadInputError, match="is a file"):
        diagnose_paths([files], out=target)
    assert target.read_text(encoding="utf-8") == "mine"


def test_a_failure_half_way_leaves_an_earlier_report_as_it_was(
    tmp_path: Path, as_files: Callable[..., Path], pair: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    from analysis.mismatch import diagnose as module

    def fails(folder: Path, *_: object, **__: object) -> None:
        (folder / "report.json").write_text("half", encoding="utf-8")
        raise RuntimeError("power cut")

    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("earlier", encoding="utf-8")
    monkeypatch.setattr(module, "_write", fails)
    with pytest.raises(RuntimeError, match="power cut"):
        diagnose_paths([as_files(tmp_path / "trials", pair)], out=out)
    assert [p.name for p in out.iterdir()] == ["report.json"]
    assert (out / "report.json").read_text(encoding="utf-8") == "earlier"
