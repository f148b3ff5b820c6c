from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLineEdit
from pytestqt.qtbot import QtBot

from analysis.errors import BadInputError
from rig.commands.run import load_rig_or_simulated
from rig.gui.form_fields import example, fields_of, kinds
from rig.gui.habits import Habits
from rig.gui.jobs.planning import preview_protocol
from rig.gui.pages import protocol as protocol_page
from rig.gui.pages.protocol import ProtocolPage
from rig.gui.protocol_draft import ProtocolDraft
from rig.gui.theme import DARK
from rig.gui.worker import Worker
from rig.settings.reading import load_protocol, parse_protocol
from rig.settings.rig_file import LeverSettings, RigFile

LONG_MS = 180_000


@pytest.mark.parametrize("kind", kinds())
def test_every_value_has_help_and_a_place_in_the_definition(kind: str) -> None:
    """What the form offers is what the definition has, no more and no less, each explained."""
    fields = fields_of(kind)
    protocol = parse_protocol(example(kind), kind)
    stated = {
        f"{name}.{key}" if table else name
        for name, value in protocol
        if name != "kind"
        for table in [hasattr(type(value), "model_fields")]
        for key in (type(value).model_fields if table else [""])
    }
    assert {field.key for field in fields} == stated
    for field in fields:
        assert field.help, f"{kind}.toml says nothing of {field.key}"
        assert field.label


def test_units_limits_and_editors_come_from_the_definition() -> None:
    fields = {field.key: field for field in fields_of("study")}
    speed = fields["surface.approach_speed_mm_s"]
    assert (speed.label, speed.unit, speed.editor) == ("approach speed", "mm/s", "number")
    assert speed.limits == "above 0, at most 1000"
    assert fields["study.fingers"].editor == "several"
    assert fields["study.rest_s"].editor == "number or two"
    assert fields["study.rigid_target"].editor == "yes or no"
    assert "Without the key: 10 mN" in fields["surface.contact_threshold_mn"].tip
    assert next(f for f in fields_of("ramp_hold_retract") if f.key == "indentation.depth_mm").required


@pytest.mark.parametrize("kind", kinds())
def test_a_draft_that_is_not_changed_is_the_file(kind: str) -> None:
    draft = ProtocolDraft.example(kind)
    assert draft.text == example(kind)
    assert draft.faults(RigFile()) == {}
    for field in draft.fields:
        draft.put(field, draft.value(field))
    assert draft.text == example(kind)
    assert not draft.changed


def test_comments_and_order_stay(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(example("study"))
    draft = ProtocolDraft.load(path)
    fields = {field.key: field for field in draft.fields}
    draft.put(fields["study.depths_mm"], [0.3, 0.5])
    draft.put(fields["surface.start_mm"], 2.5)
    draft.put(fields["study.seed"], None)
    assert draft.changed
    draft.save(path)
    assert not draft.changed
    before, after = example("study").splitlines(), path.read_text().splitlines()
    assert next(line for line in after if line.startswith("depths_mm")).split() == [
        "depths_mm",
        "=",
        "[0.3,",
        "0.5]",
        "#",
        "below",
        "the",
        "detected",
        "surface",
    ]
    changed = [line for line in before if line not in after]
    assert {line.split()[0] for line in changed} == {"depths_mm", "seed"}
    protocol = load_protocol(path)
    assert protocol.study.depths_mm == (0.3, 0.5)  # type: ignore[union-attr]
    assert protocol.surface.start_mm == 2.5  # type: ignore[union-attr]


def test_a_table_that_the_file_lacks_is_made() -> None:
    draft = ProtocolDraft('kind = "surface_detection"\n', None)
    fields = {field.key: field for field in draft.fields}
    draft.put(fields["specimen.finger"], None)
    assert draft.text == 'kind = "surface_detection"\n'
    draft.put(fields["specimen.finger"], "ring")
    assert parse_protocol(draft.text, "").specimen.finger == "ring"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("text", "said"),
    [("kind = ", "not valid TOML"), ("a = 1", "unknown; use one of study"), ("", "kind = None")],
)
def test_what_is_no_protocol_is_told(text: str, said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        ProtocolDraft(text, None)


def test_the_preview_is_the_plan() -> None:
    rig = load_rig_or_simulated(None)
    preview = preview_protocol(example("study"), rig, 4.5)
    assert preview.n_trials == 100
    assert {motion.n_trials for motion in preview.motions} == {25}
    assert preview.hands == (("place finger", 100),)
    deepest = max(preview.motions, key=lambda motion: motion.path[1].max())
    times, places = deepest.path
    assert places.max() == pytest.approx(4.5 + 0.8)
    assert np.all(np.diff(times) >= 0)
    ramp = next(leg for leg in deepest.legs if leg.phase == "ramp")
    assert ramp.speed_mm_s == pytest.approx(5.0)
    assert not deepest.beyond


def test_a_motion_beyond_the_rig_is_told_with_where_the_skin_must_lie() -> None:
    rig = RigFile(lever=LeverSettings(travel_max_mm=9.5, speed_max_mm_s=50.0))
    preview = preview_protocol(example("study"), rig, 9.2)
    told = {motion.title: motion.beyond for motion in preview.motions}
    assert told["ramp hold retract, 0.2 mm, at 5 mm/s, hold 7 s"] == ()
    (line,) = told["ramp hold retract, 0.8 mm, at 5 mm/s, hold 7 s"]
    assert line == "reaches 10.00 mm, the travel ends at 9.5 mm: the skin must lie above 8.70 mm"
    shallow = RigFile(lever=LeverSettings(depth_max_mm=0.5))
    deep = preview_protocol(example("study"), shallow, 4.0).motions[-1].beyond
    assert deep == ("presses 0.8 mm deep: this rig allows 0.5 mm",)
    slow = RigFile(lever=LeverSettings(speed_max_mm_s=2.0, retreat_speed_mm_s=2.0))
    assert any(
        "this rig allows 2 mm/s" in line
        for m in preview_protocol(example("study"), slow, 4.0).motions
        for line in m.beyond
    )


@pytest.mark.parametrize("kind", kinds())
def test_every_kind_has_a_preview(kind: str) -> None:
    preview = preview_protocol(example(kind), load_rig_or_simulated(None), 4.5)
    assert preview.n_trials >= 1
    assert preview.expected_s > 0
    assert all(len(motion.path[0]) > 1 for motion in preview.motions)


@pytest.fixture
def page(worker: Worker, habits: Habits, qtbot: QtBot) -> Iterator[ProtocolPage]:
    page = ProtocolPage(worker, habits)
    qtbot.addWidget(page)
    page.resize(1276, 690)
    page.set_rig(load_rig_or_simulated(None))
    with qtbot.waitExposed(page):
        page.show()
    yield page
    page.hide()


def _type(page: ProtocolPage, key: str, text: str, qtbot: QtBot) -> None:
    editor = page.form.lines[key].editor
    assert isinstance(editor, QLineEdit)
    editor.setFocus()
    editor.selectAll()
    if text:
        qtbot.keyClicks(editor, text)
    else:
        qtbot.keyClick(editor, Qt.Key.Key_Delete)
    qtbot.waitUntil(lambda: not page._settle.isActive(), timeout=LONG_MS)


def test_type_see_save_run(
    page: ProtocolPage, habits: Habits, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    qtbot.waitUntil(lambda: page.preview._preview is not None, timeout=LONG_MS)
    _type(page, "study.depths_mm", "0.3; 0.55", qtbot)
    _type(page, "study.rest_s", "10", qtbot)
    page.form.lines["study.fingers"]._boxes[0].click()
    page.form.lines["study.order"].editor.setCurrentText("shuffled")  # type: ignore[attr-defined]

    def planned() -> None:
        assert page.preview._preview is not None
        assert page.preview._preview.n_trials == 4 * 2 * 5

    qtbot.waitUntil(planned, timeout=LONG_MS)
    target = tmp_path / "mine.toml"
    monkeypatch.setattr(protocol_page, "ask_new_file", lambda *given: given[-1](target))
    page.run_protocol()
    assert "no file yet" in page.banner.text
    with qtbot.waitSignal(page.run_asked) as asked:
        page.banner.answer("Save and run")
    assert asked.args == [target]
    protocol = load_protocol(target)
    assert protocol.study.depths_mm == (0.3, 0.55)  # type: ignore[union-attr]
    assert protocol.study.rest_s == 10.0  # type: ignore[union-attr]
    assert protocol.study.fingers == ("index", "middle", "ring", "little")  # type: ignore[union-attr]
    assert "# whose fingers" in target.read_text()
    assert habits.recent_protocols[0] == target
    with qtbot.waitSignal(page.run_asked):
        page.run_protocol()  # as it was saved: nothing is asked


def test_each_fault_stands_at_its_value(page: ProtocolPage, qtbot: QtBot) -> None:
    _type(page, "study.depths_mm", "0.2, -1", qtbot)
    _type(page, "study.repeats", "two", qtbot)
    _type(page, "study.rest_s", "3, 1", qtbot)
    _type(page, "surface.samples_above", "20", qtbot)
    page.check()

    def said(key: str) -> str:
        return page.form.lines[key].fault.text()

    assert said("study.depths_mm") == "should be greater than 0; change it"
    assert said("study.repeats") == "should be a valid integer; write a whole number"
    assert said("surface.samples_above") == "samples_above = 20 exceeds samples_watched = 10; lower it"
    assert said("study.seed") == ""
    assert not page._run_button.isEnabled()
    page.run_protocol()
    assert page.focusWidget() is page.form.lines["study.depths_mm"].editor
    _type(page, "study.depths_mm", "0.2", qtbot)
    _type(page, "study.repeats", "2", qtbot)
    _type(page, "surface.samples_above", "5", qtbot)
    page.check()
    assert said("study.rest_s") == "rest_s = [3, 1] runs backwards; give the shortest first"
    _type(page, "study.rest_s", "1, 3", qtbot)
    page.check()
    assert page.faults == {}


def test_the_rigs_limits_count(page: ProtocolPage, qtbot: QtBot) -> None:
    page.set_rig(RigFile(lever=LeverSettings(speed_max_mm_s=4.0, retreat_speed_mm_s=4.0)))
    fault = page.form.lines["indentation.ramp_speed_mm_s"].fault.text()
    assert fault == "faster than this rig's lever.speed_max_mm_s = 4; lower it"
    _type(page, "indentation.ramp_speed_mm_s", "3", qtbot)
    _type(page, "indentation.retract_speed_mm_s", "3,5", qtbot)  # as a German keypad has it
    page.check()
    assert page.faults == {}


def test_changes_are_not_lost_unasked(page: ProtocolPage, tmp_path: Path, qtbot: QtBot) -> None:
    other = tmp_path / "other.toml"
    other.write_text(example("air_sweep"))
    _type(page, "study.repeats", "2", qtbot)
    page.open_protocol(other)
    assert "not saved" in page.banner.text
    page.banner.answer("Cancel")
    assert page.draft.kind == "study"
    page.open_protocol(other)
    page.banner.answer("Drop the changes")
    assert page.draft.kind == "air_sweep"
    assert page.draft.path == other
    (tmp_path / "bad.toml").write_text("kind = ")
    page.open_protocol(tmp_path / "bad.toml")
    assert "not valid TOML" in page.banner.text
    assert page.draft.path == other


def test_every_kind_fits_the_form(page: ProtocolPage, qtbot: QtBot, asked: Callable[..., Any]) -> None:
    for kind in kinds():
        page.new_protocol(kind)
        assert set(page.form.lines) == {field.key for field in fields_of(kind)}
        for line in page.form.lines.values():  # nothing changes by being shown
            page.draft.put(line.field, line.value())
        assert not page.draft.changed, page.draft.text
    page.restyle(DARK)


def test_the_skin_can_be_moved(page: ProtocolPage, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: page.preview._preview is not None, timeout=LONG_MS)
    page.preview._skin.setValue(9.3)
    page.preview._skin.sigPositionChangeFinished.emit(page.preview._skin)
    qtbot.waitUntil(lambda: page.preview._preview.surface_mm == pytest.approx(9.3), timeout=LONG_MS)  # type: ignore[union-attr]
    page.preview._which.setCurrentIndex(3)
    assert "the skin must lie above" in page.preview._beyond.text()
