from __future__ import annotations

import meshio
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.fingertip.meshing import PUNCH, mesh_pad
from analysis.fingertip.pad_file import LAYERS
from analysis.fingertip.punch import punch_pad
from analysis.fingertip.user_mesh import read_mesh


def _exported(pad, path):
    """The parametric pad as a Gmsh file: corners where the map puts them, physical groups by name."""
    from ngsolve import BND, VOL

    made = mesh_pad(pad, "punch")
    netgen = made.mesh.ngmesh.Coordinates()
    values, count = made.keep.vec.FV().NumPy(), len(netgen)
    corners = netgen + np.stack([values[made.keep.space.Range(i).start :][:count] for i in range(3)], axis=1)
    names = [*LAYERS, *sorted({e.mat for e in made.mesh.Elements(BND)} - {"default"})]
    tag = {name: number for number, name in enumerate(names, start=1)}
    volumes, faces = list(made.mesh.Elements(VOL)), list(made.mesh.Elements(BND))
    cells = [
        (kind, [[v.nr for v in e.vertices] for e in of])
        for kind, of in (("tetra", volumes), ("triangle", faces))
    ]
    tags = [[tag[e.mat] for e in of] for of in (volumes, faces)]
    mesh = meshio.Mesh(
        corners,
        cells,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([number, 3 if name in LAYERS else 2]) for name, number in tag.items()},
    )
    mesh.write(path, file_format="gmsh22", binary=False)
    return mesh


def test_a_mesh_of_the_users_own_presses_as_the_pad_it_was_made_of(coarse_pad, punch, tmp_path):
    """The same corners with flat faces in place of bent ones: the same stiffness but for that."""
    _exported(coarse_pad, tmp_path / "pad.msh")
    settings = coarse_pad.mesh.model_copy(update={"file": tmp_path / "pad.msh"})
    found = punch_pad(coarse_pad.model_copy(update={"mesh": settings}), tmp_path)
    for ratio in (0.1, 1.0):
        mine, theirs = (pad.stiffness(pad.layer_moduli(ratio)) for pad in (found, punch))
        assert mine == pytest.approx(theirs, rel=0.05)
    assert found.view.section.shape == punch.view.section.shape


def test_sets_of_cells_name_regions_as_well(coarse_pad, tmp_path):
    mesh = _exported(coarse_pad, tmp_path / "pad.msh")
    physical = [np.asarray(tags) for tags in mesh.cell_data["gmsh:physical"]]
    sets = {
        name: [np.flatnonzero(tags == number) for tags in physical]
        for name, (number, _) in mesh.field_data.items()
    }
    meshio.Mesh(mesh.points, mesh.cells, cell_sets=sets).write(tmp_path / "pad.inp")
    found = read_mesh(tmp_path / "pad.inp", "punch", 2)
    assert set(found.mesh.GetMaterials()) == set(LAYERS)
    assert {PUNCH, "bone", "symmetry"} <= set(found.mesh.GetBoundaries())


def test_what_a_mesh_must_have(coarse_pad, tmp_path):
    path = tmp_path / "pad.msh"
    mesh = _exported(coarse_pad, path)
    with pytest.raises(BadInputError, match="no boundary of triangles named 'strip': there are bone"):
        read_mesh(path, "line", 2)
    mesh.field_data["hide"] = mesh.field_data.pop("epidermis")
    mesh.write(path, file_format="gmsh22", binary=False)
    with pytest.raises(
        BadInputError, match="no region of tetrahedra named 'epidermis': there are dermis, fat, hide"
    ):
        read_mesh(path, "punch", 2)
    mesh.field_data["epidermis"] = mesh.field_data.pop("hide")
    mesh.points *= 1e-3
    mesh.write(path, file_format="gmsh22", binary=False)
    with pytest.raises(BadInputError, match="give the points in mm"):
        read_mesh(path, "punch", 2)
    path.write_text("no mesh\n")
    with pytest.raises(BadInputError, match="can't be read as a mesh"):
        read_mesh(path, "punch", 2)
    with pytest.raises(BadInputError, match="there is no such mesh"):
        read_mesh(tmp_path / "none.msh", "punch", 2)
