"""Hexahedra, wedges and pyramids become tetrahedra that fill them and fit to one another."""

from __future__ import annotations

import re
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.importing.cutting import cut_cells, cut_face

Bring = Callable[..., Any]

HELD = {
    "2.5": '<fix bc="x,y,z" node_set="Held"/>',
    "4.0": '<bc name="root" type="zero displacement" node_set="Held">'
    "<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof></bc>",
}
PRESSED = (
    '<surface_load type="pressure" surface="EndFace"><pressure>-0.004</pressure></surface_load>'
)
CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    dtype=float,
)
CELLS = {8: (range(8), 1.0), 6: ((0, 1, 2, 4, 5, 6), 0.5), 5: ((0, 1, 2, 3, 4), 1.0 / 3.0)}


@pytest.mark.parametrize("count", CELLS)
def test_a_cell_is_filled_however_its_nodes_are_numbered(count: int) -> None:
    corners, volume = CELLS[count]
    rng = np.random.default_rng(count)
    for _ in range(30):
        number = rng.permutation(count)
        points = np.empty((count, 3))
        points[number] = CUBE[list(corners)]
        volumes = signed_volumes(points, cut_cells(number[None]))
        assert len(volumes) == {8: 6, 6: 3, 5: 2}[count]
        assert volumes.min() > 0.0
        assert volumes.sum() == pytest.approx(volume, rel=1e-12)


def hexahedra(counts: tuple[int, int, int], rng: np.random.Generator) -> tuple[Any, Any]:
    """A box of bricks, its points numbered at random."""
    nx, ny, nz = counts
    grid = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    points = np.stack(np.meshgrid(*(np.arange(n + 1.0) for n in counts), indexing="ij"), axis=-1)
    corner = CUBE.astype(int)
    cells = np.stack(
        [grid[x : x + nx, y : y + ny, z : z + nz].ravel() for x, y, z in corner], axis=1
    )
    number = rng.permutation(grid.size)
    places = np.empty((grid.size, 3))
    places[number] = points.reshape(-1, 3)
    return places, number[cells]


def test_neighbours_cut_the_face_between_them_alike() -> None:
    points, cells = hexahedra((3, 2, 2), np.random.default_rng(5))
    mesh = TetMesh(points, cut_cells(cells).astype(np.int32))
    # Inner faces that did not fit would be part of the boundary: its area is the box's alone.
    assert mesh.surface_area == pytest.approx(2.0 * (3 * 2 + 2 * 2 + 2 * 3), rel=1e-12)
    assert mesh.volume == pytest.approx(12.0, rel=1e-12)
    top = [tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()]
    for cell in cells.tolist():
        for face in ((4, 5, 6, 7), (0, 3, 2, 1)):
            nodes = [cell[k] for k in face]
            if points[nodes, 2].min() == 2.0 or points[nodes, 2].max() == 0.0:
                assert all(tuple(sorted(t)) in top for t in cut_face(nodes))


@pytest.mark.parametrize("version", ["2.5", "4.0"])
def test_a_model_of_hexahedra_is_the_same_body(
    bring: Bring, bars: ModuleType, version: str
) -> None:
    points, cells = hexahedra((4, 2, 2), np.random.default_rng(7))
    points = points * [10.0, 5.0, 5.0]
    text = bars.febio(
        TetMesh(points, cut_cells(cells).astype(np.int32)), version=version, cells=cells,
        boundary=HELD[version], loads=PRESSED,
    )  # fmt: skip
    text = text.replace('type="tet10"', 'type="hex8"').replace('type="tet4"', 'type="hex8"')
    quads = [[c[1], c[2], c[6], c[5]] for c in cells.tolist() if points[c[1], 0] == 40.0]
    face = "".join(
        f'<quad4 id="{k}">{", ".join(str(n + 1) for n in quad)}</quad4>'
        for k, quad in enumerate(quads, 1)
    )
    text = re.sub(r'(<Surface name="EndFace">).*?(</Surface>)', rf"\1{face}\2", text, flags=re.S)
    case, imported = bring(text, ".feb")
    problem = case.problem
    assert problem.mesh.num_cells == 6 * len(cells)
    assert problem.mesh.volume == pytest.approx(4e-6, rel=1e-12)
    assert any("16 cells of type hex8" in line for line in imported.told)
    # Pulled with 4 kPa along x, E = 100 kPa: 4 % of 40 mm.
    moved = solve_static(problem).displacement[:, 0].max()
    assert moved == pytest.approx(1.6e-3, rel=0.1)
