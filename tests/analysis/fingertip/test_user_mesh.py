from __future__ import annotations

import meshio
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.meshing import PUNCH
from analysis.fingertip.pad_file import LAYERS
from analysis.fingertip.punch import full_punch_pad
from analysis.fingertip.user_mesh import read_mesh


def test_a_mesh_of_the_users_own_presses_as_the_pad_it_was_made_of(
    coarse_pad, punch, punch_mesh, written, tmp_path
):
    """The same corners with flat faces in place of bent ones: the same stiffness but for that, within 5 %."""
    written.write_mesh(punch_mesh, tmp_path / "pad.msh")
    full = full_punch_pad(written.on_file(coarse_pad, tmp_path / "pad.msh"))
    _, force = full.pressed(PUNCH, np.array([0.1, 1.0]), np.ones(3))
    assert force == pytest.approx([punch.stiffness(punch.layer_moduli(r)) for r in (0.1, 1.0)], rel=0.05)


def test_sets_of_cells_name_regions_as_well(coarse_pad, punch_mesh, written, tmp_path):
    mesh = written.write_mesh(punch_mesh, tmp_path / "pad.msh")
    physical = [np.asarray(tags) for tags in mesh.cell_data["gmsh:physical"]]
    sets = {
        name: [np.flatnonzero(tags == number) for tags in physical]
        for name, (number, _) in mesh.field_data.items()
    }
    meshio.Mesh(mesh.points, mesh.cells, cell_sets=sets).write(tmp_path / "pad.inp")
    found = read_mesh(coarse_pad, "punch", tmp_path / "pad.inp")
    assert set(found.mesh.GetMaterials()) == set(LAYERS)
    assert {PUNCH, "bone", "symmetry"} <= set(found.mesh.GetBoundaries())


def test_what_a_mesh_must_have(coarse_pad, punch_mesh, written, tmp_path):
    path = tmp_path / "pad.msh"
    mesh = written.write_mesh(punch_mesh, path)
    with pytest.raises(BadInputError, match="no boundary of triangles named 'strip': there are bone"):
        read_mesh(coarse_pad, "line", path)
    mesh.field_data["hide"] = mesh.field_data.pop("epidermis")
    mesh.write(path, file_format="gmsh22", binary=False)
    with pytest.raises(
        BadInputError, match="no region of tetrahedra named 'epidermis': there are dermis, fat, hide"
    ):
        read_mesh(coarse_pad, "punch", path)
    mesh.field_data["epidermis"] = mesh.field_data.pop("hide")
    mesh.points *= 1e-3
    mesh.write(path, file_format="gmsh22", binary=False)
    with pytest.raises(BadInputError, match="give the points in mm"):
        read_mesh(coarse_pad, "punch", path)
    path.write_text("no mesh\n")
    with pytest.raises(BadInputError, match="can't be read as a mesh"):
        read_mesh(coarse_pad, "punch", path)
    with pytest.raises(BadInputError, match="there is no such mesh"):
        read_mesh(coarse_pad, "punch", tmp_path / "none.msh")


def test_a_tool_of_another_size_is_told(coarse_pad, punch_mesh, written, tmp_path):
    path = tmp_path / "pad.msh"
    mesh = written.write_mesh(punch_mesh, path)
    wide = coarse_pad.model_copy(update={"punch": coarse_pad.punch.model_copy(update={"diameter_mm": 0.6})})
    with pytest.raises(BadInputError, match=r"has 0\.19\d mm2, a punch of 0.6 mm has 0.283: mark the skin"):
        read_mesh(wide, "punch", path)
    mesh.field_data["strip"] = mesh.field_data.pop("punch")
    mesh.write(path, file_format="gmsh22", binary=False)
    with pytest.raises(
        BadInputError, match=r"'strip' reaches over 0.5 mm along x and 0.5 along z, the line load"
    ):
        read_mesh(coarse_pad, "line", path)


def test_a_mesh_too_coarse_under_the_load_is_refined_there(coarse_pad, punch_mesh, written, tmp_path):
    path = tmp_path / "pad.msh"
    written.write_mesh(punch_mesh, path)
    sizes = {"contact_size_mm": 0.02}
    finer = coarse_pad.model_copy(update={"mesh": coarse_pad.mesh.model_copy(update=sizes)})
    coarse, fine = (written.on_file(pad, path) for pad in (coarse_pad, finer))
    before, after = (read_mesh(pad, "punch", path).mesh for pad in (coarse, fine))
    assert before.ne == punch_mesh.mesh.ne  # fine enough for what it was made for
    assert before.ne < after.ne < 3 * before.ne
    lengths = _rim_mm(after)
    assert max(lengths) <= 2 * 0.02
    # a rim that is followed more closely presses more softly: the stress there has no bound
    forces = [full_punch_pad(pad).pressed(PUNCH, np.array([1.0]), np.ones(3))[1][0] for pad in (coarse, fine)]
    assert forces[1] < 0.95 * forces[0]
    never = {"contact_size_mm": 1e-5}
    with pytest.raises(
        BadInputError, match=r"refine boundary 'punch' to 4e-05 mm, its rim to 1e-05 mm, or make mesh"
    ):
        read_mesh(
            coarse_pad.model_copy(update={"mesh": coarse_pad.mesh.model_copy(update=never)}), "punch", path
        )


def _rim_mm(mesh):
    """Lengths of the punch's edges on its circle of 0.5 mm."""
    points = mesh.ngmesh.Coordinates()
    faces = [[v.nr for v in e.vertices] for e in mesh.Boundaries(PUNCH).Elements()]
    ends = {(a, b) for f in faces for a in f for b in f if a < b}
    middle = points[[v for f in faces for v in f]]
    centre = (middle[:, 2].min() + middle[:, 2].max()) / 2
    on_rim = np.hypot(points[:, 0], points[:, 2] - centre) > 0.25 * 0.97
    return [float(np.linalg.norm(points[a] - points[b])) for a, b in ends if on_rim[a] and on_rim[b]]


def test_a_triangle_has_one_boundary(coarse_pad, punch_mesh, written, tmp_path):
    mesh = written.write_mesh(punch_mesh, tmp_path / "pad.msh")
    kinds = [block.type for block in mesh.cells]
    faces = mesh.cell_data["gmsh:physical"][kinds.index("triangle")]
    nail = np.flatnonzero(np.asarray(faces) == mesh.field_data["nail"][0])
    sets = {
        name: [np.flatnonzero(np.asarray(tags) == number) for tags in mesh.cell_data["gmsh:physical"]]
        for name, (number, _) in mesh.field_data.items()
    }
    at = kinds.index("triangle")
    sets["bone"][at] = np.concatenate([sets["bone"][at], nail[:1]])
    meshio.Mesh(mesh.points, mesh.cells, cell_sets=sets).write(tmp_path / "pad.inp")
    with pytest.raises(BadInputError, match="boundaries 'bone' and 'nail' share a triangle"):
        read_mesh(coarse_pad, "punch", tmp_path / "pad.inp")
