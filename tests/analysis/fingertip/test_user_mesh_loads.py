"""Line and plate on a mesh of the user's own against the parametric pad that the file was written of.

Elements of order 1 have flat faces, so a file of corners says all of such a mesh: forces agree to rounding. What is
read at a point agrees within 1 %: the parametric pad's points go through the map, and may land in the next element.
"""

from __future__ import annotations

import json
from dataclasses import replace

import meshio
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.calibrate import calibrate, target_of
from analysis.fingertip.calibration_file import Calibration, write_calibration
from analysis.fingertip.compare import locate
from analysis.fingertip.contact import press
from analysis.fingertip.contact_pad import reduce_contact
from analysis.fingertip.line_load import LineMotion, answer_lines
from analysis.fingertip.meshing import mesh_pad
from analysis.fingertip.page import write_comparison_page
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.reduced import chebyshev_ratios
from analysis.fingertip.surface_file import MeasuredSurface
from analysis.fingertip.viscoelastic import Prony
from rig.cli import main

_RATIOS = np.array([0.1])
_MATERIALS = [Prony(600.0), Prony(60.0, ((50.0, 2.0),)), Prony(60.0, ((50.0, 2.0),))]
_SIDES = ("skin", "border", "inside", "end")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, flat_pad, written):
    """A mesh file for each load, with the boundaries that are needed and no others."""
    folder = tmp_path_factory.mktemp("meshes")
    for load in ("punch", "line", "plate"):
        written.write_mesh(mesh_pad(flat_pad, load), folder / f"{load}.msh", without=_SIDES)
    return folder


def _on_files(pad, folder):
    files = {
        "file": folder / "punch.msh",
        "line_file": folder / "line.msh",
        "plate_file": folder / "plate.msh",
    }
    return pad.model_copy(update={"mesh": pad.mesh.model_copy(update=files)})


def _pressed(pad):
    return press(pad, _MATERIALS, np.array([0.5, 1.0]), np.array([0.3, 0.5]))


@pytest.mark.parametrize("load", ["line", "plate"])
def test_a_file_answers_as_the_pad_it_was_written_of(flat_pad, folder, load):
    own, parametric = (reduce_contact(pad, load, _RATIOS) for pad in (_on_files(flat_pad, folder), flat_pad))
    assert own.unknowns == parametric.unknowns
    pressed, wanted = _pressed(own), _pressed(parametric)
    assert pressed.force_mn == pytest.approx(wanted.force_mn, rel=1e-9)
    assert own.borders_mm == pytest.approx(parametric.borders_mm, abs=1e-9)
    # corners to look at outlive the mesh they were read from
    np.testing.assert_allclose(own.view.corners_mm, parametric.view.corners_mm, atol=1e-6)
    both = np.intersect1d(np.round(own.position_mm, 9), np.round(parametric.position_mm, 9))
    assert both[0] < -5
    assert both[-1] > 4
    deflection, other = (
        np.interp(both, pad.position_mm, pad.deflection @ one.weights[-1])
        for pad, one in ((own, pressed), (parametric, wanted))
    )
    assert np.abs(deflection - other).max() < 0.01 * other.max()
    strain, other = (pad.strain @ one.weights[-1] for pad, one in ((own, pressed), (parametric, wanted)))
    assert np.abs(strain - other).max() < 0.01 * np.abs(other).max()


# under a plate a flat element of order 1 holds fewer pressures than faces, and elements of order 2 take a minute
@pytest.mark.parametrize(("load", "order"), [("line", 1), pytest.param("plate", 2, marks=pytest.mark.slow)])
def test_a_whole_pad_is_two_halves(flat_pad, folder, tmp_path, load, order):
    half = _on_files(flat_pad.with_order(order), folder)
    path = tmp_path / "whole.msh"
    _mirror(meshio.read(folder / f"{load}.msh")).write(path, file_format="gmsh22", binary=False)
    files = {"file": path, "line_file": None, "plate_file": None}
    whole = half.model_copy(update={"mesh": half.mesh.model_copy(update=files)})
    one, two = (reduce_contact(pad, load, _RATIOS) for pad in (half, whole))
    assert two.area_mm2.sum() == pytest.approx(one.area_mm2.sum(), rel=1e-9)
    pressed, wanted = _pressed(two), _pressed(one)
    assert pressed.force_mn == pytest.approx(wanted.force_mn, rel=1e-8)
    assert two.deflection @ pressed.weights[-1] == pytest.approx(
        one.deflection @ wanted.weights[-1], abs=1e-5
    )
    assert two.strain @ pressed.weights[-1] == pytest.approx(one.strain @ wanted.weights[-1], abs=1e-4)


def _mirror(mesh):
    """Both halves of a pad that was cut at x = 0, without the cut."""
    points = mesh.points
    off = points[:, 0] > 1e-9
    other = np.where(off, len(points) + np.cumsum(off) - 1, np.arange(len(points)))
    cut = mesh.field_data.pop("symmetry")[0]
    cells, tags = [], []
    for block, physical in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        kept = physical != cut
        cells.append((block.type, np.concatenate([block.data[kept], other[block.data[kept]]])))
        tags.append(np.concatenate([physical[kept], physical[kept]]))
    points = np.concatenate([points, points[off] * [-1.0, 1.0, 1.0]])
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    return meshio.Mesh(points, cells, cell_data=data, field_data=mesh.field_data)


def test_a_surface_is_set_beside_a_mesh_of_one_thickness(flat_pad, folder, measured, tmp_path):
    """The surface is the pad's own at a ratio of 0.1, with 5 um of noise, seed fixed: the ratio comes back."""
    pad = _on_files(flat_pad, folder)
    target, punch = target_of(measured), punch_pad(pad, tmp_path)
    pads = (calibrate(punch, target, "homogeneous", 1.0, 2), calibrate(punch, target, "layered", 0.1, 2))
    found = Calibration(pad, measured, pads, ())
    ratios, snapshots = (0.03, 0.08, 0.3, 1.0), chebyshev_ratios(0.02, 2.0, 2)
    answers = answer_lines(found, LineMotion(), tmp_path, ratios, snapshots)
    assert answers.thickness_mm == pytest.approx([0.3], abs=1e-9)
    places = np.concatenate([-np.arange(0.2, 3, 0.2)[::-1], np.arange(0.2, 3, 0.2)])
    noise = 0.005 * np.random.default_rng(8).standard_normal(len(places))
    deflection = answers.layered_at(places)(np.log(0.1), 0.3) + noise
    surface = MeasuredSurface("s.csv", places, deflection, np.full(len(places), 0.005))
    located = locate(surface, answers)
    assert located.ratio_low < 0.1 < located.ratio_high
    assert located.thickness_se_mm is None
    assert [one.name.split()[0] for one in located.pads] == ["homogeneous", "elastic"]
    assert located.pads[1].rms_mm == pytest.approx(0.005, rel=0.5)
    # order 2 and order 1 differ a lot, which the interval knows
    assert np.sqrt(np.mean(located.mesh_mm**2)) > 0.005
    blind = locate(replace(surface, error_mm=np.full(len(places), np.nan)), answers)
    assert blind.ratio == pytest.approx(0.1, rel=0.1)
    # a surface without noise or errors, as the pad's own answer is, is no division by nothing
    exact = replace(surface, deflection_mm=deflection - noise, error_mm=np.full(len(places), np.nan))
    assert locate(exact, answers).ratio == pytest.approx(0.1, rel=1e-3)
    page = write_comparison_page(tmp_path, located, answers).read_text()
    assert "were the epidermis of 0.300 mm as it is in the mesh" in page
    assert json.loads((tmp_path / "compare.json").read_text())["epidermis_mm"]["se"] is None


def _surface(folder):
    rows = "".join(f"{p / 5},{0.45 * np.exp(-abs(p) / 5):.4f},0.01\n" for p in range(-14, 15))
    path = folder / "surface.csv"
    path.write_text("position_mm,deflection_mm,deflection_se_mm\n" + rows)
    return str(path)


def test_a_missing_boundary_is_told(coarse_pad, punch, folder, measured, tmp_path, capsys):
    """One file for all loads, made for the punch alone."""
    pad = _on_files(coarse_pad, folder)
    pad = pad.model_copy(update={"mesh": pad.mesh.model_copy(update={"line_file": None, "plate_file": None})})
    pads = tuple(calibrate(punch, target_of(measured), kind, 0.1, 2) for kind in ("homogeneous", "layered"))
    write_calibration(tmp_path, Calibration(pad, measured, pads, ()))
    folders = ["--out", str(tmp_path), "--cache", str(tmp_path / "cache")]
    for command, name in ((["compare", _surface(tmp_path)], "strip"), (["receptor"], "plate")):
        assert main(["fingertip", *command, *folders]) == 2
        error = capsys.readouterr().err
        assert error.splitlines()[-1].startswith("indenter: ")
        assert "Traceback" not in error
        assert f"punch.msh: has no boundary of triangles named '{name}': there are bone" in error


@pytest.mark.slow
def test_the_commands_take_files(coarse_pad, folder, tmp_path, fits_of, pad_text, measured):
    files = 'file = "punch.msh"\nline_file = "line.msh"\nplate_file = "plate.msh"\n'
    (folder / "pad.toml").write_text(pad_text(coarse_pad) + files)
    folders = ["--out", str(tmp_path), "--cache", str(tmp_path / "cache")]
    fits = str(fits_of(tmp_path, measured))
    assert main(["fingertip", "calibrate", fits, "--pad", str(folder / "pad.toml"), *folders]) == 0
    assert main(["fingertip", "receptor", *folders]) == 0
    assert main(["fingertip", "compare", _surface(tmp_path), *folders]) == 0
    assert (tmp_path / "receptor.html").is_file()
    assert json.loads((tmp_path / "compare.json").read_text())["epidermis_mm"]["se"] is None


def test_layers_have_to_lie_under_the_load(flat_pad, folder, tmp_path):
    mesh = meshio.read(folder / "plate.msh")
    mesh.field_data["epidermis"], mesh.field_data["fat"] = (
        mesh.field_data["fat"],
        mesh.field_data["epidermis"],
    )
    mesh.write(tmp_path / "swapped.msh", file_format="gmsh22", binary=False)
    files = {"file": tmp_path / "swapped.msh"}
    pad = flat_pad.model_copy(update={"mesh": flat_pad.mesh.model_copy(update=files)})
    with pytest.raises(
        BadInputError, match="epidermis, dermis, fat must lie one below the other under the middle"
    ):
        reduce_contact(pad, "plate", _RATIOS)
