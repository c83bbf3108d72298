"""Hexahedra, wedges and pyramids become tetrahedra that fill them and fit to one another."""

import re

import bars
import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.importing import ImportRefusedError
from palpate.validation.importing.model import cut_cells, cut_face

PRESSED = bars.PRESSED.replace(' lc="1"', "")
CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    dtype=float,
)
CELLS = {8: (range(8), 1.0), 6: ((0, 1, 2, 4, 5, 6), 0.5), 5: ((0, 1, 2, 3, 4), 1.0 / 3.0)}


@pytest.mark.parametrize("count", CELLS)
def test_a_cell_is_filled_however_its_nodes_are_numbered(count):
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


def hexahedra(counts, rng):
    """A box of bricks, its points numbered at random."""
    nx, ny, nz = counts
    grid = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    points = np.stack(np.meshgrid(*(np.arange(n + 1.0) for n in counts), indexing="ij"), axis=-1)
    corner = CUBE.astype(int)
    cells = np.stack(
        [grid[x : x + nx, y : y + ny, z : z + nz].ravel() for x, y, z in corner], axis=1
    )
    number = rng.permutation(grid.size)
    positions = np.empty((grid.size, 3))
    positions[number] = points.reshape(-1, 3)
    return positions, number[cells]


def test_neighbours_cut_the_face_between_them_alike():
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
def test_a_model_of_hexahedra_is_the_same_body(bring, version):
    points, cells = hexahedra((4, 2, 2), np.random.default_rng(7))
    points = points * [10.0, 5.0, 5.0]
    text = bars.febio(
        TetMesh(points, cut_cells(cells).astype(np.int32)), version=version, cells=cells,
        loads=PRESSED,
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
    assert any("16 cells of type hex8" in line for line in imported.notes)
    # Pulled with 4 kPa along x, E = 100 kPa: 4 % of 40 mm.
    moved = solve_static(problem).displacement[:, 0].max()
    assert moved == pytest.approx(1.6e-3, rel=0.1)


def abaqus_of(points, blocks, acts, axis=0):
    """Cells by type, fixed where x, or another coordinate, is 0; the set ALL is all of them."""
    nodes = [f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1)]
    cells, label = [], 0
    for kind, rows in blocks.items():
        cells.append(f"*ELEMENT, TYPE={kind}, ELSET=ALL")
        for row in (rows + 1).tolist():
            label += 1
            cells.append(", ".join(map(str, [label, *row])))
    fixed = ", \n".join(str(k + 1) for k in np.flatnonzero(points[:, axis] == 0.0))
    return "\n".join([
        "*NODE, NSET=EVERY", *nodes, *cells, "*NSET, NSET=HELD", fixed,
        "*MATERIAL, NAME=M", "*ELASTIC", "0.1, 0.3", "*DENSITY", "1e-9",
        "*SOLID SECTION, ELSET=ALL, MATERIAL=M", "*STEP, NLGEOM", "*STATIC", "1., 1.",
        "*BOUNDARY", "HELD, 1, 3", acts, "*END STEP", "",
    ])  # fmt: skip


@pytest.mark.parametrize("kind", ["C3D8", "C3D8I", "C3D6"])
def test_an_abaqus_model_of_other_cells_is_the_same_body(bring, kind):
    points, cells = hexahedra((4, 2, 2), np.random.default_rng(7))
    points = points * [10.0, 5.0, 5.0]
    last, most = [k for k, c in enumerate(cells.tolist(), 1) if points[c[1], 0] == 40.0], 16
    blocks = {kind: cells}
    faces = "".join(f"{k}, S4\n" for k in last)
    if kind == "C3D6":  # two wedges a hexahedron, along z; the second has no part of the end
        halves = [cells[:, [0, 1, 2, 4, 5, 6]], cells[:, [0, 2, 3, 4, 6, 7]]]
        blocks, most = {kind: np.stack(halves, axis=1).reshape(-1, 6)}, 32
        faces = "".join(f"{2 * k - 1}, S4\n" for k in last)
    acts = "*DSLOAD\nTIP, P, -4e-3"
    text = abaqus_of(points, blocks, acts).replace(
        "*MATERIAL", f"*SURFACE, NAME=TIP\n{faces}*MATERIAL"
    )
    case, imported = bring(text, ".inp")
    assert case.problem.mesh.volume == pytest.approx(4e-6, rel=1e-12)
    assert any(f"{most} cells of type {kind}" in line for line in imported.notes)
    (load,) = case.problem.loads
    assert isinstance(load, Pressure)
    assert len(load.facets) == 8
    # Pulled with 4 kPa along x, E = 100 kPa: 4 % of 40 mm.
    moved = solve_static(case.problem).displacement[:, 0].max()
    assert moved == pytest.approx(1.6e-3, rel=0.1)
    # A face that it does not have, and cells that cannot be cut.
    with pytest.raises(
        ImportRefusedError, match=f"'S6' is no face|S1 to S{5 if most == 32 else 6}"
    ):
        bring(text.replace("S4", "S6" if most == 32 else "S7"), ".inp")
    with pytest.raises(ImportRefusedError, match="TYPE=C3D20: a case has tetrahedra"):
        bring(text.replace(kind, "C3D20"), ".inp")


# By the nodes 1, 2, ... of a cell: CalculiX CrunchiX USER'S MANUAL 2.20, chapter 6.2, of C3D8 and
# C3D6; Abaqus Analysis User's Guide, "Three-dimensional solid element library", of C3D5 too.
FACES_OF = {
    "C3D8": (8, ["1234", "5876", "1562", "2673", "3784", "4851"]),
    "C3D6": (6, ["123", "465", "1452", "2563", "3641"]),
    "C3D5": (5, ["1234", "152", "253", "354", "451"]),
}


@pytest.mark.parametrize("kind", FACES_OF)
def test_pressed_faces_are_those_of_the_manual(bring, kind):
    count, faces = FACES_OF[kind]
    corners, _ = CELLS[count]
    points = 10.0 * CUBE[list(corners)]
    for number, nodes in enumerate(faces, 1):
        acts = f"*DLOAD\nALL, P{number}, 1e-4"
        case, _ = bring(abaqus_of(points, {kind: np.arange(count)[None]}, acts, axis=2), ".inp")
        (load,) = case.problem.loads
        pressed = case.problem.mesh.points[np.unique(load.facets)]
        asked = 1e-3 * points[[int(word) - 1 for word in nodes]]
        assert {tuple(row) for row in pressed.round(9)} == {tuple(row) for row in asked.round(9)}
        assert load.pressure == pytest.approx(100.0)  # it pushes: the facets look outwards
