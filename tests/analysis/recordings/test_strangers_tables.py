"""Tables of other laboratories: columns and units as stated or as said, folders, wide tables, what is found."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from analysis.recordings.importers.findings import look_at
from analysis.recordings.importers.headers import quantity_of, split_unit
from analysis.recordings.importers.instructions import (
    NOTHING_SAID,
    Instructions,
    factor,
    read_mapping,
    said_on_command_line,
)
from analysis.recordings.importing import import_recordings
from analysis.recordings.picture import draw_trial
from analysis.recordings.trial import Trial

HEAD = ["Time (s)", "Extension (mm)", "Load (N)", "Temperature"]


def press(rate_hz: float = 50.0, hold_s: float = 6.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (s), position (mm), force (mN): rest, ramp of 2 mm in 0.5 s, a hold that relaxes."""
    time_s = np.arange(int((1.5 + hold_s) * rate_hz)) / rate_hz
    position_mm = np.interp(time_s, [0, 1, 1.5], [0, 0, 2])
    force_mn = 400 * position_mm * np.where(time_s < 1.5, 1.0, 0.6 + 0.4 * np.exp(-(time_s - 1.5)))
    return time_s, position_mm, force_mn


def rows_of(
    head: Sequence[object] | None = HEAD, *, above: Sequence[Sequence[object]] = ()
) -> list[list[object]]:
    rows: list[list[object]] = [*map(list, above), *([list(head)] if head else [])]
    rows += [[t, x, f / 1e3, 21.5] for t, x, f in zip(*press(), strict=True)]
    return rows


def write_csv(path: Path, rows: Sequence[Sequence[object]], mark: str = ",", *, comma: bool = False) -> Path:
    lines = (mark.join(f"{c:.6f}" if isinstance(c, float) else str(c) for c in row) for row in rows)
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace(".", ",") if comma else text, encoding="utf-8")
    return path


def write_xlsx(path: Path, sheets: dict[str, Sequence[Sequence[object]]]) -> Path:
    """Write the smallest workbook that spreadsheet programs open."""

    def cell(value: object) -> str:
        if isinstance(value, int | float):
            return f"<c><v>{float(value)!r}</v></c>"
        return f'<c t="inlineStr"><is><t>{escape(str(value))}</t></is></c>'

    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kinds = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    numbered = list(enumerate(sheets.items(), start=1))
    with zipfile.ZipFile(path, "w") as file:
        overrides = "".join(
            f'<Override PartName="/xl/worksheets/sheet{i}.xml" ContentType="{kinds}.worksheet+xml"/>'
            for i, _ in numbered
        )
        file.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{package}/content-types"><Default Extension="rels" '
            'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{kinds}.sheet.main+xml"/>{overrides}</Types>',
        )
        file.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
            f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        )
        listed = "".join(f'<sheet name="{n}" sheetId="{i}" r:id="r{i}"/>' for i, (n, _) in numbered)
        file.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>{listed}</sheets></workbook>',
        )
        relations = "".join(
            f'<Relationship Id="r{i}" Type="{office}/worksheet" Target="worksheets/sheet{i}.xml"/>'
            for i, _ in numbered
        )
        file.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{package}/relationships">{relations}</Relationships>',
        )
        for i, (_, rows) in numbered:
            body = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            file.writestr(
                f"xl/worksheets/sheet{i}.xml",
                f'<worksheet xmlns="{main}"><sheetData>{body}</sheetData></worksheet>',
            )
    return path


def imported(path: Path, said: Instructions = NOTHING_SAID) -> Trial:
    made, refused = import_recordings([path], path.parent / "out", said=said)
    assert not refused, refused
    return read_trial(made[0].path)


def refused(path: Path, said: Instructions = NOTHING_SAID) -> str:
    made, bad = import_recordings([path], path.parent / "out", said=said)
    assert not made
    assert "\n" not in bad[0].reason
    return bad[0].reason


def same_press(trial: Trial) -> None:
    time_s, position_mm, force_mn = press()
    np.testing.assert_allclose(trial.position_mm, position_mm, atol=1e-5)
    np.testing.assert_allclose(trial.force_mn, force_mn, atol=1e-2)
    assert trial.sample_rate_hz == 50.0
    assert trial.n_samples == len(time_s)
    assert [phase.name for phase in trial.phases] == ["approach", "ramp", "hold"]


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_headers_with_units_are_understood(tmp_path, mark):
    trial = imported(write_csv(tmp_path / "a.csv", rows_of(above=[["Tester", 3, "", ""]]), mark))
    same_press(trial)
    log = "\n".join(trial.log)
    assert "force is 'Load (N)' in N" in log
    assert "columns ignored: Temperature" in log
    assert "1 row(s) above the header" in log


def test_decimal_commas(tmp_path):
    same_press(imported(write_csv(tmp_path / "a.csv", rows_of(), ";", comma=True)))


def test_a_spreadsheet_with_a_row_of_units(tmp_path):
    head = [["Gel 7"], ["Elapsed Time", "Distance", "Load", "T"], ["s", "mm", "N", "C"]]
    same_press(imported(write_xlsx(tmp_path / "a.xlsx", {"Data": rows_of(None, above=head)})))


def test_a_spreadsheet_of_several_sheets_asks_which(tmp_path):
    path = write_xlsx(tmp_path / "a.xlsx", {"About": [["by", "me"]], "Run 1": rows_of()})
    assert "--sheet 'About'" in refused(path)
    same_press(imported(path, Instructions(sheet="Run 1")))
    assert "no sheet named 'Run 2'" in refused(path, Instructions(sheet="Run 2"))


def test_a_file_that_is_no_spreadsheet(tmp_path):
    (tmp_path / "a.xlsx").write_bytes(b"PK\x03\x04 no more")
    assert "can't be read as a spreadsheet" in refused(tmp_path / "a.xlsx")


def test_what_is_missing_is_asked_for_in_options(tmp_path):
    path = write_csv(tmp_path / "a.txt", rows_of(["Time", "Distance", "Force", "T"]))
    words = refused(path)
    assert "--column time=Time --unit time=..." in words
    said = said_on_command_line(units=["time=s", "position=mm", "force=N"])
    same_press(imported(path, said))


def test_columns_by_number_and_a_turned_sign(tmp_path):
    rows = [[t, x, -f, 0] for t, x, f, _ in rows_of(None)]
    path = write_csv(tmp_path / "a.dat", rows, "\t")
    said = said_on_command_line(
        columns=["time=1", "position=2", "force=3"],
        units=["time=s", "position=mm", "force=-N"],
        finger="index",
        depth_mm=2.0,
        ramp_speed_mm_s=4.0,
        punch_diameter_mm=0.5,
    )
    trial = imported(path, said)
    same_press(trial)
    assert (trial.specimen.finger, trial.specimen.punch_diameter_mm) == ("index", 0.5)
    assert (trial.protocol.depth_mm, trial.protocol.ramp_speed_mm_s) == (2.0, 4.0)


def test_a_force_that_falls_on_loading_and_a_unit_a_thousandfold_off_are_warned_of(tmp_path):
    rows = [[t, x, -f, 0] for t, x, f, _ in rows_of(None)]
    falling = imported(write_csv(tmp_path / "a.csv", [HEAD, *rows]))
    assert any("falls by" in one and "--unit force=-mN" in one for one in look_at(falling).warnings)
    assert any(line.startswith("WARNING: the force falls") for line in falling.log)
    rows = [[t, x, f / 1e6, 0] for t, x, f, _ in rows_of(None)]
    small = write_csv(tmp_path / "b.csv", [HEAD, *([r[0], r[1], f"{r[2]:.9f}", r[3]] for r in rows)])
    assert any("thousandfold" in one for one in look_at(imported(small)).warnings)
    good = imported(write_csv(tmp_path / "c.csv", rows_of()))
    assert look_at(good).warnings == ()


def test_what_was_found_stands_in_the_log(tmp_path):
    trial = imported(write_csv(tmp_path / "a.csv", rows_of()))
    log = "\n".join(trial.log)
    assert "ramp: 1 to 1.5 s: 2 mm at 4 mm/s, 25 samples" in log
    assert "hold: 1.5 to 7.5 s: 2 mm" in log


def test_missing_and_doubled_samples_are_counted(tmp_path):
    rows = rows_of(None)
    spoiled = [HEAD, *rows[:200], rows[199], *rows[205:]]
    log = "\n".join(imported(write_csv(tmp_path / "a.csv", spoiled)).log)
    assert "samples missing: 5 in 1 place(s)" in log
    assert "samples doubled: 1 row(s)" in log
    repeated = [HEAD, *(row for row in rows for _ in range(2))]
    assert "equal to the one before" in refused(write_csv(tmp_path / "b.csv", repeated))


def test_a_bad_row_is_named(tmp_path):
    rows = rows_of()
    rows[30] = [rows[30][0], "broken", rows[30][2], 0]
    assert "line 31: position is 'broken'" in refused(write_csv(tmp_path / "a.csv", rows))


def test_one_bad_file_stops_no_other_and_a_folder_is_taken_whole(tmp_path):
    folder = tmp_path / "in"
    (folder / "deeper").mkdir(parents=True)
    write_csv(folder / "good.csv", rows_of())
    write_csv(folder / "deeper" / "other.txt", rows_of())
    (folder / "bad.csv").write_text("nonsense\n1\n")
    (folder / "notes.md").write_text("not a recording")
    made, bad = import_recordings([folder], tmp_path / "out")
    assert sorted(one.path.name for one in made) == ["good.h5", "other.h5"]
    assert [one.source.name for one in bad] == ["bad.csv"]
    again, bad = import_recordings([folder], tmp_path / "out")
    assert not again
    assert sum("exists already" in one.reason for one in bad) == 2
    with pytest.raises(BadInputError, match="nothing to import"):
        import_recordings([tmp_path / "out" / "none"], tmp_path / "out") if False else import_recordings(
            [], tmp_path / "out"
        )


def test_a_wide_table_and_a_mapping_file(tmp_path):
    time_s, position_mm, force_mn = press()
    head = ["t", "x", "F left", "F right"]
    rows = [[a, b * 1e3, c, 2 * c] for a, b, c in zip(time_s, position_mm, force_mn, strict=True)]
    path = write_csv(tmp_path / "wide.csv", [head, *rows])
    (tmp_path / "map.toml").write_text(
        """
[columns]
time = "t"
position = "x"
[units]
time = "s"
position = "um"
force = "mN"
[specimen]
punch_diameter_mm = 3.0
[[trials]]
name = "left"
force = "F left"
specimen = { finger = "index" }
[[trials]]
name = "right"
force = "F right"
specimen = { finger = "ring" }
[files."other.csv".specimen]
finger = "thumb"
"""
    )
    made, bad = import_recordings([path], tmp_path / "out", said=read_mapping(tmp_path / "map.toml"))
    assert not bad
    left, right = (read_trial(one.path) for one in made)
    assert (left.specimen.finger, right.specimen.finger) == ("index", "ring")
    assert left.specimen.punch_diameter_mm == 3.0
    same_press(left)
    np.testing.assert_allclose(right.force_mn, 2 * left.force_mn, atol=1e-4)
    assert [one.path.name for one in made] == ["left.h5", "right.h5"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("colums = 1", "'colums' is not known"),
        ("[units]\nforce = 'pounds'", "'pounds' is not known"),
        ("[columns]\nweight = 'F'", "'weight' is no quantity"),
        ("[specimen]\nfinger = 'toe'", "must be one of"),
        ("[protocol]\ndepth_mm = 'deep'", "depth_mm is 'deep'"),
        ("[[trials]]\nforces = 'x'", "'forces'"),
        ("= nonsense", "is no TOML"),
        ("[specimen]\nage = 3", "'age' is not known"),
    ],
)
def test_a_mapping_that_is_wrong_is_refused(tmp_path, text, words):
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(BadInputError) as caught:
        read_mapping(tmp_path / "map.toml")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("Force (N)", "force", "N"),
        ("Kraft [mN]", "force", "mN"),
        ("Load/N", "force", "N"),
        ("Crosshead displacement in mm", "position", "mm"),
        ("Zeit", "time", ""),
        ("commanded position (mm)", "command", "mm"),
        ("Temperature (C)", None, "C"),
        ("force time", None, ""),
    ],
)
def test_what_a_header_says(name, quantity, unit):
    assert quantity_of(name) == quantity
    assert split_unit(name)[1] == unit


def test_units():
    assert factor("force", "mN") == 1.0
    assert factor("force", "MN") is None
    assert factor("force", "-N") == -1e3
    assert factor("position", "µm") == 1e-3
    assert factor("time", "mm") is None


def test_a_held_force_is_a_creep_and_no_hold(tmp_path):
    time_s, _, _ = press(200.0)
    loading = np.interp(time_s, [0, 1, 1.5], [0, 0, 1])
    creep = np.where(time_s > 1.5, 0.3 * (1 - np.exp(-(time_s - 1.5) / 2)), 0.0)
    rows = [[t, 2 * a + c, 0.4 * a, 0] for t, a, c in zip(time_s, loading, creep, strict=True)]
    trial = imported(write_csv(tmp_path / "a.csv", [HEAD, *rows]))
    assert trial.phase("hold") is None
    assert any(event.kind == "force_held" for event in trial.events)


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 50.0, 1e4])
def test_phases_at_any_rate(tmp_path, rate_hz):
    time_s, position_mm, force_mn = press(rate_hz, hold_s=10.0 if rate_hz < 100 else 1.0)
    rows = [[t, x, f / 1e3, 0] for t, x, f in zip(time_s, position_mm, force_mn, strict=True)]
    trial = imported(write_csv(tmp_path / "a.csv", [HEAD, *rows]))
    ramp = trial.phase("ramp")
    assert ramp is not None
    assert ramp.start / rate_hz == pytest.approx(1.0, abs=1.5 / rate_hz + 0.005)
    assert ramp.stop / rate_hz == pytest.approx(1.5, abs=1.5 / rate_hz + 0.005)


def test_a_picture_shows_the_trial(tmp_path):
    trial = imported(write_csv(tmp_path / "a.csv", rows_of()))
    picture = draw_trial(trial, tmp_path, "a")
    from matplotlib.image import imread

    pixels = imread(picture)
    assert pixels.shape[0] > 400
    assert pixels[..., :3].std() > 0.02
