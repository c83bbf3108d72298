"""Size fields on halved cubes, and meshes that follow them."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.grading.size_fields import (
    TooManyCellsError,
    distance_to_points,
    grow_with_distance,
    mean_edges,
    sample_sizes,
)
from palpate.fastsim.mesher import Boundary, Lattice, MeshingReport, mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.quality import measure_quality
from palpate.meshes.shapes import shape_box

LOW, HIGH = np.zeros(3), np.array([1.0, 0.7, 0.5])
CORNER = np.array([1.0, 0.7, 0.5])
TO_CORNER = grow_with_distance(distance_to_points(CORNER), smallest=0.01, growth=0.4)


def test_sampled_sizes_are_those_of_the_field() -> None:
    sizes = sample_sizes(TO_CORNER, LOW, HIGH, largest=0.3, max_cells=10**6)
    positions = np.random.default_rng(3).uniform(LOW, HIGH, (2000, 3))
    asked, found = np.minimum(TO_CORNER(positions), 0.3), sizes.at(positions)
    # A cube is no larger than the size in it, which grows by 0.4 over a length; half its diagonal.
    assert np.abs(found / asked - 1.0).max() < 0.4 * np.sqrt(3.0)
    assert abs(np.log(found / asked).mean()) < 0.1
    # Outside, the nearest cube's.
    assert sizes.at(np.array([CORNER, [-5.0, 0.0, 0.0]])) == pytest.approx([0.01, 0.3], rel=0.5)


def test_fields_that_ask_for_nonsense_or_too_much_are_refused() -> None:
    with pytest.raises(InputError, match="above 0"):
        sample_sizes(lambda p: 0.0 * p[:, 0], LOW, HIGH, largest=0.3, max_cells=10**6)
    with pytest.raises(InputError, match="one edge length"):
        sample_sizes(lambda p: p, LOW, HIGH, largest=0.3, max_cells=10**6)
    with pytest.raises(TooManyCellsError):
        sample_sizes(lambda p: 0.0 * p[:, 0] + 1e-4, LOW, HIGH, largest=0.3, max_cells=10**6)
    with pytest.raises(InputError, match="body-centred"):
        mesh_surface(
            shape_box((1.0, 1.0, 1.0), edge_length=0.5), lattice=Lattice.PAPER, size_field=TO_CORNER
        )


@pytest.mark.parametrize("boundary", list(Boundary))
@pytest.mark.long
def test_a_mesh_follows_the_field(boundary: Boundary) -> None:
    box = shape_box((1.0, 0.7, 0.5), edge_length=0.2)
    position = CORNER if boundary is Boundary.FREE else 0.5 * CORNER
    field = grow_with_distance(distance_to_points(position), smallest=0.01, growth=0.4)
    reports: list[MeshingReport] = []
    mesh = mesh_surface(
        box,
        edge_length=0.2,
        size_field=field,
        boundary=boundary,
        boundary_distance=0.005 if boundary is Boundary.FREE else None,
        report=reports.append,
    )
    assert mesh.volume == pytest.approx(box.volume, rel=1e-12)
    assert (reports[0].remesh is None) == (boundary is Boundary.KEPT)
    asked = np.minimum(field(mesh.points[mesh.cells].mean(axis=1)), 0.2)
    share = mean_edges(mesh.points, mesh.cells) / asked
    # Cubes go by octaves, so sizes scatter by one about what is asked.
    assert 0.6 < np.median(share) < 1.2
    assert np.percentile(share, 99) < 2.0
    assert np.percentile(share, 1) > 0.3
    uniform = mesh_surface(box, edge_length=0.2)
    assert mesh.num_cells > 3 * uniform.num_cells
    assert measure_quality(mesh).smallest_dihedral_deg > 8.0
    again = mesh_surface(
        box,
        edge_length=0.2,
        size_field=field,
        boundary=boundary,
        boundary_distance=0.005 if boundary is Boundary.FREE else None,
    )
    assert np.array_equal(again.points, mesh.points)
