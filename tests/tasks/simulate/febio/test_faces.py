"""The outer faces of a mesh are those of a single element."""

import numpy as np
import pytest

from sinew.tasks.simulate.febio.faces import outer_faces
from sinew.tasks.simulate.febio.plot_mesh import Mesh, Region


def mesh(*regions):
    count = 1 + max(corners.max() for _, corners in regions)
    domains = tuple(Region("d", shape, 1, np.arange(len(c)), np.asarray(c)) for shape, c in regions)
    return Mesh(np.arange(count), np.zeros((count, 3), np.float32), domains)


HEX = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]])


def test_two_bricks_share_a_face():
    faces, elements = outer_faces(mesh(("hex8", HEX)))
    assert len(faces) == 10
    assert {4, 5, 6, 7} not in map(set, faces.tolist())
    assert np.bincount(elements).tolist() == [5, 5]


def test_domains_share_faces_too():
    faces, elements = outer_faces(mesh(("hex8", HEX[:1]), ("hex8", HEX[1:])))
    assert len(faces) == 10
    assert np.bincount(elements).tolist() == [5, 5]


@pytest.mark.parametrize(
    ("shape", "corners", "count"),
    [
        ("tet4", 4, 4),
        ("tet10", 10, 4),
        ("penta6", 6, 5),
        ("pyra5", 5, 5),
        ("hex20", 20, 6),
        ("quad4", 4, 1),
        ("tri3", 3, 1),
    ],
)
def test_a_single_element_has_all_its_faces(shape, corners, count):
    faces, elements = outer_faces(mesh((shape, np.arange(corners)[np.newaxis])))
    assert len(faces) == count and not elements.any()
    of_corners = {"hex20": 8, "tet10": 4}.get(shape, corners)
    assert set(faces[faces >= 0].tolist()) == set(range(of_corners))


def test_every_face_of_a_brick_is_a_loop_of_neighbours():
    """Corners in any other order would cross."""
    neighbours = {(a, b) for a in range(8) for b in range(8) if (a ^ b) in (1, 2, 4)}
    place = [0, 1, 3, 2, 4, 5, 7, 6]  # of FEBio's corners in a cube whose bits are x, y and z
    faces, _ = outer_faces(mesh(("hex8", HEX[:1])))
    for face in faces.tolist():
        assert all((place[a], place[b]) in neighbours for a, b in zip(face, face[1:] + face[:1], strict=True))


def test_a_shell_hides_the_face_below_it():
    faces, elements = outer_faces(mesh(("hex8", HEX[:1]), ("quad4", HEX[:1, :4])))
    assert len(faces) == 6
    assert elements.tolist() == [0, 0, 0, 0, 0, 1]


def test_lines_have_no_faces():
    faces, elements = outer_faces(mesh(("line2", np.array([[0, 1]]))))
    assert faces.shape == (0, 4) and not elements.size
