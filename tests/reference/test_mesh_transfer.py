"""The maps that undo dolfinx's renumbering."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference import fenicsx
    from palpate.reference.fenicsx import fem, ufl
    from palpate.reference.mesh_transfer import create_space, transfer

pytestmark = pytest.mark.dolfinx


@pytest.fixture
def shuffled(box):
    """A ragged box in a random numbering, so that dolfinx has something to reorder."""
    mesh = box((4, 3, 2), (1.0, 0.7, 0.4), jitter=0.2)
    random = np.random.default_rng(11)
    new = random.permutation(mesh.num_points)
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    cells = new[mesh.cells][random.permutation(mesh.num_cells)]
    groups = {name: new[rows] for name, rows in mesh.facet_groups.items()}
    return TetMesh(points, cells, groups)


def test_nodes_and_cells_arrive_with_their_maps(shuffled):
    arrived = transfer(shuffled)
    nodes = arrived.mesh.geometry.x
    assert np.array_equal(nodes, shuffled.points[arrived.point_of_node])
    assert not np.array_equal(arrived.point_of_node, np.arange(shuffled.num_points))
    received = arrived.point_of_node[fenicsx.cell_nodes(arrived.mesh)]
    sent = shuffled.cells[arrived.cell_of_cell]
    assert np.array_equal(np.sort(received, axis=1), np.sort(sent, axis=1))


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_dofs_of_points_sit_at_the_points(shuffled, degree):
    space = create_space(transfer(shuffled), degree)
    coordinates = space.space.tabulate_dof_coordinates()[space.dof_of_point]
    assert np.abs(coordinates - shuffled.points).max() <= 4 * np.finfo(float).eps
    there = space.at_points(space.from_points(shuffled.points))
    assert np.array_equal(there, shuffled.points) or degree > 1
    assert np.abs(there - shuffled.points).max() <= 10 * np.finfo(float).eps


def test_facets_are_found_by_their_points(shuffled):
    arrived = transfer(shuffled)
    for name, (axis, value) in {"x1": (0, 1.0), "z0": (2, 0.0)}.items():
        measure = arrived.facet_measure(shuffled.facet_groups[name], name, degree=2)
        area = fenicsx.assemble_scalar(fenicsx.form(fem.Constant(arrived.mesh, 1.0) * measure))
        assert area == pytest.approx({"x1": 0.28, "z0": 0.7}[name], rel=1e-14)
        x = ufl.SpatialCoordinate(arrived.mesh)
        off = fenicsx.assemble_scalar(fenicsx.form((x[axis] - value) ** 2 * measure))
        assert abs(off) <= np.finfo(float).eps
