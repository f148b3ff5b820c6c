"""The parametric pad's mesh as a file of the user's own: corners where the map puts them, names and all."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import meshio
import numpy as np

from analysis.fingertip.meshing import PadMesh
from analysis.fingertip.pad_file import LAYERS, PadFile


def write_mesh(made: PadMesh, path: Path, without: Collection[str] = ()) -> meshio.Mesh:
    """Write a mesh as a Gmsh file of physical groups, some boundaries left out."""
    from ngsolve import BND, VOL

    netgen = made.mesh.ngmesh.Coordinates()
    values, count = made.keep.vec.FV().NumPy(), len(netgen)
    corners = netgen + np.stack([values[made.keep.space.Range(i).start :][:count] for i in range(3)], axis=1)
    volumes = list(made.mesh.Elements(VOL))
    faces = [e for e in made.mesh.Elements(BND) if e.mat not in {"default", *without}]
    names = [*LAYERS, *sorted({e.mat for e in faces})]
    tag = {name: number for number, name in enumerate(names, start=1)}
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


def on_file(pad: PadFile, path: Path) -> PadFile:
    """Return the pad on the mesh of a file."""
    return pad.model_copy(update={"mesh": pad.mesh.model_copy(update={"file": path})})
