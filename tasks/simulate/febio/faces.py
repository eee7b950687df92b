"""The outer faces of a mesh, which are what one sees of it."""

import numpy as np

from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.plot_mesh import Mesh

_HEX = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_TET = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))
_PENTA = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
_PYRA = ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))
#: The faces of each shape by its corners; nodes in the middle of edges and faces are left out.
_FACES = {"hex": _HEX, "tet": _TET, "penta": _PENTA, "pyra": _PYRA, "quad": ((0, 1, 2, 3),), "tri": ((0, 1, 2),)}


def outer_faces(mesh: Mesh) -> tuple[Array, Array]:
    """Nodes ``[f, 4]`` of shells and of faces of a single solid element, and the position ``[f]`` of that element.

    Nodes are positions in the mesh; the fourth of a triangle is -1. Elements of all domains are numbered through.
    Shapes that are lines have no faces.
    """
    faces, cells, first = [np.zeros((0, 4), np.int64)], [np.zeros(0, np.int64)], 0
    shells = [np.zeros(0, dtype=bool)]
    for region in mesh.domains:
        count = len(region.corners)
        for face in _FACES.get(region.shape.rstrip("0123456789"), ()):
            nodes = region.corners[:, face].astype(np.int64)
            faces.append(np.pad(nodes, ((0, 0), (0, 4 - len(face))), constant_values=-1))
            cells.append(first + np.arange(count))
            shells.append(np.full(count, region.shape.startswith(("quad", "tri"))))
        first += count
    every, of = np.concatenate(faces), np.concatenate(cells)
    shell = np.concatenate(shells)
    _, place = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True)
    solids = np.bincount(place.ravel(), ~shell, minlength=1)
    under = np.bincount(place.ravel(), shell, minlength=1) > 0  # a shell lies on it
    outer = shell | ((solids[place.ravel()] == 1) & ~under[place.ravel()])
    return every[outer], of[outer]
