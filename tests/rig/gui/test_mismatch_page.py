from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

from analysis.errors import BadInputError
from analysis.recordings import write_trial
from rig.gui.findings_view import parameter_words, window_words
from rig.gui.habits import Habits
from rig.gui.jobs.comparing import compare_trial
from rig.gui.jobs.report_file import Quantity, Report, Window, read_diagnosis
from rig.gui.pages.mismatch import MismatchPage
from rig.gui.theme import DARK
from rig.gui.worker import Worker

LONG_MS = 180_000
Made = Callable[..., Path]


@pytest.fixture(scope="module")
def clinging(_bench_trials: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two trials of skin that clings, all of the published tissue."""
    from sim_hardware.concealment.offline import study_plans

    folder = tmp_path_factory.mktemp("clinging")
    bench = """
seed = 5
[specimens]
published_tissue = true
[[effects]]
name = "adhesion"
pull_off_mn = 6.0
rough = 0.0
"""
    plans = study_plans(("index",), (0.6,), 2, hold_s=2.0, dwell_s=0.5, rest_s=10.0)
    for trial in _bench_trials.bench_trials(bench, plans):
        write_trial(folder / f"{trial.specimen.repeat}.h5", trial)
    return folder


def test_a_diagnosis_is_read_by_its_contract(diagnosis: Made, tmp_path: Path) -> None:
    found = read_diagnosis(diagnosis(tmp_path / "d", something_new={"in": "a later version"}))
    assert found.report.mechanisms[0].parameters["pull_off_mn"].value == 6.0
    assert found.next_protocol == tmp_path / "d" / "next.toml"
    assert found.twin == tmp_path / "d" / "twin.toml"
    (tmp_path / "d" / "next.toml").unlink()
    assert read_diagnosis(tmp_path / "d").next_protocol is None
    assert read_diagnosis(diagnosis(tmp_path / "e", next_experiment=None)).next_protocol is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"verdict": "perhaps"}, "verdict"), ({"format": "else"}, "format"), ({"mismatch": [{}]}, "mismatch.0")],
)
def test_a_report_of_another_kind_is_told(
    diagnosis: Made, tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(BadInputError, match=said):
        read_diagnosis(diagnosis(tmp_path, **changes))
    with pytest.raises(BadInputError, match="can't be read"):
        read_diagnosis(tmp_path / "none")


def test_the_simulation_after_explains_what_the_one_before_leaves(
    clinging: Path, report: dict[str, Any]
) -> None:
    adhesion = Report.model_validate(report)
    found = compare_trial(str(clinging / "1.h5"), adhesion)
    assert found.left_out == ("heartbeat: it has a time or phase of its own in every trial",)
    before = found.recorded_mn - found.before_mn
    after = found.recorded_mn - found.after_mn
    at = int(np.argmin(before))
    assert before[at] < -4.0  # the pull of the skin
    assert abs(after[at]) < 2.0
    assert found.rms_after_mn < found.rms_before_mn
    same = compare_trial(str(clinging / "1.h5"), adhesion.model_copy(update={"mechanisms": ()}))
    np.testing.assert_array_equal(same.before_mn, same.after_mn)


def test_a_step_baseline_speaks_of_the_hold_alone(clinging: Path, report: dict[str, Any]) -> None:
    step = Report.model_validate(report | {"baseline": "step", "mechanisms": []})
    found = compare_trial(str(clinging / "1.h5"), step)
    inside = np.isfinite(found.before_mn)
    assert 0 < inside.sum() < len(found.time_s)
    assert np.ptp(found.time_s[inside]) == pytest.approx(2.0, rel=0.05)


def test_words() -> None:
    assert (
        parameter_words("pull_off_mn", Quantity(value=4.196, se=0.131, unit="mN"))
        == "pull off: 4.20 ± 0.13 mN"
    )
    assert parameter_words("k0_mn_per_mm", Quantity(value=120, se=None, unit="mN/mm")) == "k0: 120 mN/mm"
    assert (
        parameter_words("natural_frequency_rad_s", Quantity(value=5000, se=20, unit="rad/s"))
        == "natural frequency: 5000 ± 20 rad/s"
    )
    window = Window(
        signal="force", phase="hold", start_s=1, stop_s=2.5, mean_residual_mn=0.5, share_of_mismatch=0.8
    )
    assert window_words(window) == "force, hold, 1.00 to 2.50 s, +0.50 mN, 80 % of the mismatch"


@pytest.fixture
def page(worker: Worker, habits: Habits, qtbot: QtBot) -> Iterator[MismatchPage]:
    page = MismatchPage(worker, habits)
    qtbot.addWidget(page)
    page.resize(1276, 690)
    with qtbot.waitExposed(page):
        page.show()
    yield page
    page.hide()


def _said(page: MismatchPage) -> str:
    return "\n".join(label.text() for label in page.findings.widget().findChildren(QLabel))


def _press(page: MismatchPage, text: str) -> None:
    buttons = page.findings.widget().findChildren(QPushButton)
    next(one for one in buttons if text in one.text().replace("&", "")).click()


def test_an_empty_page_says_what_to_do(page: MismatchPage) -> None:
    assert "choose a folder of trials" in _said(page)
    assert not page._run_button.isEnabled()
    page.diagnose()
    assert "Choose a folder" in page._state.text()


def test_a_diagnosis_is_shown(
    page: MismatchPage, diagnosis: Made, clinging: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    folder = diagnosis(tmp_path / "d")
    page.open_diagnosis(folder, clinging)
    qtbot.waitUntil(lambda: page.comparison.shown is not None, timeout=LONG_MS)
    words = _said(page)
    for text in (
        "The missing physics is one of several",
        "1. Adhesion   (75 % sure)",
        "pull off: 6.00 ± 0.10 mN",
        "Could as well be: slip (20 %).",
        "120.0 ± 1.2",
        "0.920",
        "Lever compliance: it hides. To see it: rigid target.",
    ):
        assert text in words
    with qtbot.waitSignal(page.run_asked) as asked:
        _press(page, "Run the next experiment")
    assert asked.args == [folder / "next.toml"]
    with qtbot.waitSignal(page.twin_asked) as asked:
        _press(page, "Use as simulated rig")
    assert asked.args == [folder / "twin.toml"]
    _press(page, "1. force, retract")
    usual, own = page.comparison._offer.phase_starts_s, page.comparison.shown.phase_starts_s  # type: ignore[union-attr]
    shift_s = own["retract"] - usual["retract"]  # the report's times are the median trial's
    assert shift_s != 0.0
    low, high = page.comparison.force.getPlotItem().vb.viewRange()[0]
    assert (low, high) == pytest.approx((2.8 + shift_s, 3.6 + shift_s))
    page.comparison._which.setCurrentIndex(1)
    qtbot.waitUntil(lambda: page.comparison.shown.path.endswith("2.h5"), timeout=LONG_MS)  # type: ignore[union-attr]
    page.comparison._after_box.setChecked(False)
    page.restyle(DARK)


def test_diagnose_stop_and_failure(
    clinging: Path,
    report: dict[str, Any],
    habits: Habits,
    tmp_path: Path,
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The whole way round a diagnosis that is made up: it takes as long as is asked, or fails."""
    (tmp_path / "made_up_diagnosis.py").write_text(
        f"""
import time
from pathlib import Path
from analysis.errors import BadInputError

def run(paths, out, baseline):
    if baseline == "step":
        time.sleep(600)
    if not out.parent.exists():
        raise BadInputError(f"{{out.parent}}: no such folder")
    out.mkdir()
    (out / "report.json").write_text({json.dumps(report)!r})
    return out
"""
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("rig.gui.pages.mismatch.run_diagnosis", import_module("made_up_diagnosis").run)
    worker = Worker()
    page = MismatchPage(worker, habits)
    qtbot.addWidget(page)
    study = tmp_path / "study"
    study.mkdir()
    (study / "1.h5").write_bytes((clinging / "1.h5").read_bytes())
    page.use_trials(study)
    page._baseline.setCurrentIndex(1)
    page.diagnose()
    assert "so far" in page._state.text()
    assert not page._run_button.isEnabled()
    page.stop()
    assert page._run_button.isEnabled()
    page._baseline.setCurrentIndex(0)
    page.diagnose()
    qtbot.waitUntil(lambda: page.comparison.shown is not None, timeout=LONG_MS)
    assert page.found is not None
    assert page.found.folder == study / "diagnosis"
    assert page._run_button.isEnabled()
    page.use_trials(tmp_path / "gone")
    page.diagnose()
    qtbot.waitUntil(lambda: "no such folder" in page._state.text(), timeout=LONG_MS)
    assert page.found.folder == study / "diagnosis"  # what was open stays
    worker.close()


@pytest.mark.slow
def test_a_real_diagnosis(
    simulated_trial: Callable[..., Any], habits: Habits, tmp_path: Path, qtbot: QtBot
) -> None:
    for depth_mm in (0.3, 0.6):
        for trial in simulated_trial(7, "index", depth_mm, 2):
            write_trial(tmp_path / f"{depth_mm}_{trial.specimen.repeat}.h5", trial)
    worker = Worker()
    page = MismatchPage(worker, habits)
    qtbot.addWidget(page)
    page.use_trials(tmp_path)
    page.diagnose()
    qtbot.waitUntil(lambda: page.comparison.shown is not None, timeout=600_000)
    assert page.found is not None
    assert page.found.report.n_trials == 4
    assert page.found.twin is not None
    assert page.found.figures
    worker.close()
