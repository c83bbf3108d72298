"""Surfaces as modellers, scanners and viewers write them."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import FileFormatError
from palpate.meshes.files import read_mesh, read_surface, write_surface
from palpate.meshes.polygons import MOST_CORNERS, PolygonError, cut_into_triangles
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface

# The unit cube, its faces outwards as quadrilaterals, 0-based.
CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
V = "\n".join("v " + " ".join(map(str, x)) for x in CORNERS)


def is_the_cube(surface: TriSurface) -> bool:
    return (
        len(surface.points) == 8
        and len(surface.facets) == 12
        and surface.volume == pytest.approx(1.0, rel=1e-14)
        and len(require_closed(surface)) == 1
    )


def faces(corner: str, quads: list[list[int]] = QUADS) -> str:
    """Statements with the number of a point, 1-based, and of the statement in each corner."""
    lines = ("f " + " ".join(corner.format(k + 1, n + 1) for k in q) for n, q in enumerate(quads))
    return "\n".join(lines)


@pytest.mark.parametrize(
    "text",
    [
        f"{V}\n{faces('{0}')}",
        # Other numbers of texture coordinates and normals than of points: the usual textured OBJ.
        f"mtllib a.mtl\n{V}\nvt 0 0\nvt 1 0\nvn 0 0 1\nusemtl skin\n{faces('{0}/1/1')}",
        f"{V}\nvn 0 0 1\n{faces('{0}//1')}",
        f"{V}\n{faces('{0}/{1}')}\n" + "vt 0 0\n" * 6,
        # Counted back from the last point, in capitals' absence, with a line that goes on.
        f"# a comment\n{V}\n" + faces("{0}", [[k - 9 for k in q] for q in QUADS]),
        f"{V} 0.1 0.2 0.3\ng one\n{faces('{0}')}".replace("0.0 1.0\n", "0.0 \\\n1.0\n", 1),
        f"{V}\ns off\nl 1 2\np 3\n{faces('{0}')}\r\n".replace("\n", "\r\n"),
    ],
)
def test_obj_files_of_all_sorts_are_the_cube(tmp_path: Path, text: str) -> None:
    path = tmp_path / "cube.obj"
    path.write_bytes(text.encode() + "\n# Grün\n".encode("latin-1"))
    told: list[str] = []
    assert is_the_cube(read_surface(path, tell=told.append))
    assert told == ["6 polygon(s) of more than three corners cut into triangles"]


@pytest.mark.parametrize(
    ("header", "more"), [("OFF", ""), ("OFF # cube", ""), ("COFF", " 1 0 0 1"), ("NOFF", " 0 0 1")]
)
def test_off_files_with_colours_normals_and_comments_are_the_cube(
    tmp_path: Path, header: str, more: str
) -> None:
    rows = [" ".join(map(str, x)) + more for x in CORNERS]
    rows += ["4 " + " ".join(map(str, q)) + " 0.2 0.3 0.4" for q in QUADS]
    path = tmp_path / "cube.off"
    for start in (f"{header}\n8 6 0\n", f"{header.split()[0]} 8 6 12\n"):
        path.write_text(f"{start}# points\n\n" + "\n".join(rows) + "\n", encoding="ascii")
        assert is_the_cube(read_surface(path))


def ply(order: str, elements: str, body: bytes) -> bytes:
    return f"ply\nformat {order} 1.0\ncomment by hand\n{elements}end_header\n".encode() + body


XYZ = "".join(f"property {{0}} {axis}\n" for axis in "xyz")


@pytest.mark.parametrize("sign", ["<", ">"])
@pytest.mark.parametrize("number", ["d", "f"])
def test_binary_ply_files_of_mixed_polygons_and_other_elements(
    tmp_path: Path, sign: str, number: str
) -> None:
    """Two faces are cut in two already; each has a colour before its list and a list after it."""
    name = {"d": "double", "f": "float"}[number]
    mixed = [QUADS[0], QUADS[1][:3], [QUADS[1][0], *QUADS[1][2:]], *QUADS[2:]]
    elements = (
        "element camera 2\nproperty uchar on\nproperty list uchar short lens\n"
        f"element vertex 8\nproperty uchar red\n{XYZ.format(name)}"
        f"element face {len(mixed)}\nproperty uchar red\nproperty list uchar int vertex_indices\n"
        "property list uchar float texcoord\n"
    )
    body = struct.pack(f"{sign}BBhBBhh", 1, 1, 7, 0, 2, 8, 9)
    for x in CORNERS:
        body += struct.pack(f"{sign}B3{number}", 200, *x)
    for k, q in enumerate(mixed):
        body += struct.pack(f"{sign}BB{len(q)}iB", 3, len(q), *q, k % 2)
        body += struct.pack(f"{sign}{k % 2}f", *[0.5] * (k % 2))
    path = tmp_path / "cube.ply"
    order = {"<": "binary_little_endian", ">": "binary_big_endian"}[sign]
    path.write_bytes(ply(order, elements, body))
    assert is_the_cube(read_surface(path))
    path.write_bytes(ply(order, elements, body[:-3]))
    with pytest.raises(FileFormatError, match=r"cut off|buffer"):
        read_surface(path)


def test_text_ply_with_normals_strips_and_comments(tmp_path: Path) -> None:
    """A tetrahedron is one strip of four triangles: 0 1 2 3 0 1."""
    elements = f"element vertex 4\n{XYZ.format('float32')}property float nx\n"
    elements += "element tristrips 1\nproperty list int int vertex_indices\n"
    body = "0 0 0 9\n0 0 1 9\n0 1 0 9\n1 0 0 9\n7 0 1 2 3 0 1 -1\n"
    path = tmp_path / "strip.ply"
    path.write_bytes(ply("ascii", elements, body.encode()))
    surface = read_surface(path)
    assert len(surface.facets) == 4
    assert abs(surface.volume) == pytest.approx(1.0 / 6.0, rel=1e-14)
    assert len(require_closed(surface)) == 1


@pytest.mark.parametrize(
    ("start", "more"), [(b"solid by a scanner", b""), (b"\x00binary", b""), (b"COLOR=", b"\0" * 7)]
)
def test_binary_stl_is_told_by_its_size(tmp_path: Path, start: bytes, more: bytes) -> None:
    sphere = shape_sphere(1.0, edge_length=0.5)
    path = tmp_path / "sphere.stl"
    write_surface(path, sphere)
    whole = path.read_bytes()
    path.write_bytes(start.ljust(80, b" ") + whole[80:] + more)
    assert read_surface(path).volume == pytest.approx(sphere.volume, rel=1e-6)


def test_text_stl_is_read_with_any_spacing(tmp_path: Path) -> None:
    lines = ["solid cube"]
    for a, b, c in cut_into_triangles(CORNERS, [np.array(QUADS)]):
        lines += ["  FACET normal 0 0 0", "OUTER LOOP"]
        lines += [f"\tvertex {' '.join(f'{x:e}' for x in CORNERS[k])}" for k in (a, b, c)]
        lines += ["endloop", "endfacet"]
    path = tmp_path / "cube.stl"
    for newline in ("\n", "\r\n"):
        text = newline.join([*lines, "endsolid cube", ""])
        path.write_bytes(text.encode())
        assert is_the_cube(read_surface(path))


@pytest.mark.parametrize("suffix", [".vtk", ".vtp", ".glb"])
@pytest.mark.parametrize("is_binary", [False, True])
def test_what_vtk_writes_is_the_cube(tmp_path: Path, suffix: str, is_binary: bool) -> None:
    vtk = pytest.importorskip("vtkmodules.all")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    pyvista = pytest.importorskip("pyvista")
    cube = pyvista.PolyData(CORNERS, np.hstack([[4, *q] for q in QUADS]))
    path = tmp_path / f"cube{suffix}"
    assert numpy_support
    if suffix == ".glb":
        plotter = pyvista.Plotter(off_screen=True)
        plotter.add_mesh(cube.triangulate())
        exporter = vtk.vtkGLTFExporter()
        exporter.SetRenderWindow(plotter.render_window)
        exporter.SetInlineData(True)
        path = path.with_suffix(".gltf")
        exporter.SetFileName(str(path))
        exporter.Write()
    else:
        cube.save(path, binary=is_binary)
    assert is_the_cube(read_surface(path))
    if suffix == ".vtp":
        path.write_bytes(path.read_bytes()[:-200])
        with pytest.raises(FileFormatError, match=r"cube\.vtp: cannot be read as vtp"):
            read_surface(path)


def test_a_quadrilateral_is_cut_inside_and_along_the_shorter_diagonal() -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [2.2, 1, 0], [0, 1, 0], [0.5, 0.3, 0]])
    assert cut_into_triangles(points, [np.array([[0, 1, 2, 3]])]).tolist() == [[0, 1, 3], [1, 2, 3]]
    # Concave at its last corner: the longer one is the only one inside.
    arrow = cut_into_triangles(points, [np.array([[0, 1, 4, 3]])])
    assert arrow.tolist() == [[0, 1, 4], [0, 4, 3]]


@pytest.mark.parametrize("number", [5, 12, 101])
@pytest.mark.parametrize("turn", [0.0, 1.0])
def test_a_star_is_filled_exactly_once(number: int, turn: float) -> None:
    """Corners on two circles by turns; area by the shoelace formula."""
    angles = 2.0 * np.pi * np.arange(2 * number) / (2 * number)
    radii = np.where(np.arange(2 * number) % 2, 0.4, 1.0)
    flat = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    u, w = np.array([1.0, 0.0, 0.0]), np.array([0.0, np.cos(turn), np.sin(turn)])
    points = flat[:, :1] * u + flat[:, 1:] * w
    found = cut_into_triangles(points, [np.arange(2 * number)[None]])
    assert len(found) == 2 * number - 2
    a, b, c = flat[found].transpose(1, 0, 2)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    x, y = flat.T
    area = 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(area, rel=1e-12)


def test_polygons_that_cannot_be_cut_are_named() -> None:
    pentagram = np.array([[np.cos(k), np.sin(k), 0.0] for k in 4.0 * np.pi / 5.0 * np.arange(5)])
    for polygon, words in (
        ([0, 1, 2, 3, 4], "crosses itself"),
        ([0, 1, 0, 1, 0, 1], "has no area"),
        ([0, 1, 3, 4], "crosses itself or has no area"),
        (list(range(5)) * (MOST_CORNERS // 5 + 1), "more than"),
    ):
        with pytest.raises(PolygonError, match=words) as caught:
            cut_into_triangles(pentagram, [np.array([polygon])])
        assert caught.value.polygon[:4] == tuple(polygon[:4])
    # A corner twice in a row is one corner; two corners are no triangle.
    twice = cut_into_triangles(pentagram, [np.array([[0, 0, 1, 2], [3, 3, 4, 4]])])
    assert twice.tolist() == [[0, 1, 2]]


# Legacy VTK as VTK 9 writes it: offsets and connectivity instead of counts, and normals.
GRID = """# vtk DataFile Version 5.1
vtk output
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 double
0 0 0 1 0 0 0 1 0 0 0 1
CELLS {offsets} {corners}
OFFSETS vtktypeint64
{starts}
CONNECTIVITY vtktypeint64
{cells}
CELL_TYPES {count}
{types}
POINT_DATA 4
NORMALS Normals double
0 0 1 0 0 1 0 0 1 0 0 1
"""


def test_legacy_vtk_5_1_grids_are_read(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules")
    tets, faces = tmp_path / "tets.vtk", tmp_path / "faces.vtk"
    tets.write_text(
        GRID.format(offsets=2, corners=4, starts="0 4", cells="0 1 2 3", count=1, types="10")
    )
    faces.write_text(
        GRID.format(
            offsets=5,
            corners=12,
            starts="0 3 6 9 12",
            cells="0 2 1 0 1 3 0 3 2 1 2 3",
            count=4,
            types="5 5 5 5",
        )
    )
    mesh = read_mesh(tets)
    assert mesh.cells.tolist() == [[0, 1, 2, 3]]
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert read_surface(faces).volume == pytest.approx(1.0 / 6.0, rel=1e-14)
    tets.write_text(tets.read_text().replace("0 1 2 3\n", "0 1\n"))
    with pytest.raises(FileFormatError, match=r"tets\.vtk: cannot be read as vtk"):
        read_mesh(tets)
