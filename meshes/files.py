"""Surfaces and meshes in files, read and written by meshio, with the checks that it lacks.

meshio 5 lets NaN and out-of-range indices pass, raises SystemExit on damaged XML, asks for any
amount of memory a header claims and reads on for ever past the end of a file that is cut off. Here
all of that is a FileFormatError of one line.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points, equal_points
from palpate.meshes.errors import FileFormatError, InputError, MeshError
from palpate.meshes.group_files import groups_in, with_groups, without_lower_points
from palpate.meshes.own_files import own_path
from palpate.meshes.percent import Percent
from palpate.meshes.ply_files import read_ply
from palpate.meshes.surface_checks import find_near_duplicates, merge_of
from palpate.meshes.surface_files import (
    Polygons,
    is_binary_stl,
    made_by_vtk,
    read_binary_stl,
    read_by_vtk,
    read_obj,
    read_off,
    read_text_stl,
    refuse_impossible_counts,
    triangles_of,
)
from palpate.meshes.temporaries import atomic_path, scratch_folder
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.text_tables import Done
from palpate.meshes.tri_surface import TriSurface
from palpate.meshes.untrusted import limited_memory, open_plain, unpacked_bytes

SURFACE_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".msh", ".vtk", ".vtu")
# Read with VTK's help, and not written.
_BY_VTK = (".vtp", ".glb", ".gltf")
READ_SURFACE_SUFFIXES = (*SURFACE_SUFFIXES, *_BY_VTK)
MESH_SUFFIXES = (".msh", ".vtk", ".vtu")

# Memory that the arrays of a file may take: five million cells with some fields.
MOST_BYTES = 512 * 1024**2
# Memory for the reader besides: it makes Python lists of text and copies arrays several times.
_SPARE_BYTES, _PER_FILE_BYTE, _PER_UNPACKED_BYTE = 256 * 1024**2, 64, 6

# Reads past the end of a file after which it counts as cut off: a reader that stops makes few.
_MOST_PAST_END = 1000

# meshio with numpy 2 writes the fields of an ASCII .msh as np.float64(0.5), and cannot read them.
_TEXT_MSH = re.compile(rb"\$MeshFormat\s+\S+\s+0\s")
_NUMPY_NUMBER = re.compile(rb"\bnp\.float\d+\(([^()\s]*)\)")

# Cells of lower dimension that may stand beside the wanted ones.
_HARMLESS = {"vertex", "line", "triangle", "tetra"}
_POLYGONS = {"triangle", "quad"}
_HEADER_BYTES = 1000
_IS_GRID = re.compile(rb"^DATASET\s+UNSTRUCTURED_GRID\b", re.MULTILINE | re.IGNORECASE)
_POLY_DATA = re.compile(rb"^DATASET\s+POLYDATA\b", re.MULTILINE | re.IGNORECASE)


def read_surface(
    path: str | Path,
    *,
    scale: float = 1.0,
    tell: Callable[[str], None] | None = None,
    given: Callable[[Points], None] | None = None,
    progress: Callable[[str], None] | None = None,
) -> TriSurface:
    """Read a surface of polygons; points that are equal bit for bit are merged.

    Points without a facet are left out.

    Args:
        path: STL, OBJ, PLY, OFF, MSH, VTK, VTU, or with VTK installed VTP, GLB or GLTF; of a
            volume mesh, its facets are read. Polygons are cut into triangles.
        scale: Metres per unit of the file (0.001 for millimetres).
        tell: Called with one line of text for each remark: points left out, pairs of points that
            nearly coincide.
        given: Called with the merged points as they are in the file, for `in_file_unit`.
        progress: Called with lines on a text file that takes more than two seconds to read.

    Returns:
        The surface [m], equal points merged.

    Raises:
        FileFormatError: Missing, damaged, of another kind, without polygons, or with one that
            crosses itself.
        MeshError: Coordinates or indices that cannot be used.
    """
    points, polygons = _polygons_of(path, Percent(progress))
    facets = triangles_of(path, points, polygons)
    if len(facets) == 0:
        raise FileFormatError(path, "holds no triangles or other polygons")
    with _named(path):
        surface = TriSurface(_scaled(points, scale), facets)
        merged, rows = merge_of(surface)
        if tell:
            others = sum(len(block) for block in polygons if block.shape[1] > 3)
            if others:
                tell(f"{others} polygon(s) of more than three corners cut into triangles")
            _tell_about_points(surface, merged, tell)
        if given:
            given(points[rows])
        return merged


def _polygons_of(path: str | Path, percent: Percent) -> Polygons:
    """Points and polygons, by the reader of its kind."""
    file = Path(path)
    suffix = _known_suffix(file, READ_SURFACE_SUFFIXES)
    with open_plain(file, most_bytes=4 * MOST_BYTES) as stream:
        start = stream.read(_HEADER_BYTES)
        size = stream.seek(0, io.SEEK_END)
    own: Callable[[Path, Done], Polygons] | None
    own = {".obj": read_obj, ".off": read_off, ".ply": read_ply}.get(suffix)
    if suffix == ".stl":
        own = read_binary_stl if is_binary_stl(file) else read_text_stl
    if suffix in _BY_VTK or (suffix == ".vtk" and _POLY_DATA.search(start)):
        own = read_by_vtk
    if own is not None:
        try:
            with limited_memory(_SPARE_BYTES + _PER_FILE_BYTE * size):
                points, polygons = own(file, partial(percent, f"reading {file.name}"))
        except MemoryError as error:
            raise FileFormatError(path, "needs more memory than a file of its size may") from error
        if len(points) == 0:
            raise FileFormatError(path, "holds no points (empty or cut off)")
        return points, polygons
    data = _read(path, SURFACE_SUFFIXES)
    _refuse_other_cells(path, data, {"tetra"})
    blocks = [
        np.asarray(block.data, dtype=np.int64)
        for block in data.cells
        if block.type in _POLYGONS or block.type.startswith("polygon")
    ]
    return np.asarray(data.points, dtype=np.float64), blocks


def in_file_unit(points: Points, given: Points | None, scale: float) -> Points:
    """Coordinates in the unit of a file that was read; its own points come back bit for bit.

    Args:
        points: [m], shape (num_points, 3).
        given: Points as they were in the file, shape (num_given, 3); None without a file.
        scale: Metres per unit of the file.
    """
    own: Points = points / scale
    if given is None or scale == 1.0 or not len(given):
        return own
    # Of equal points the first is the file's, where it has one.
    first, same = equal_points(np.vstack([_scaled(given, scale), points]))
    source = first[same[len(given) :]]
    is_given = source < len(given)
    own[is_given] = given[source[is_given]]
    return own


def _tell_about_points(
    surface: TriSurface, merged: TriSurface, tell: Callable[[str], None]
) -> None:
    unused = len(surface.points) - len(surface.used_points)
    if unused:
        tell(f"{unused} point(s) without a facet left out")
    pairs = find_near_duplicates(merged.points)
    if len(pairs):
        at = ", ".join(f"{x:.6g}" for x in merged.points[pairs[0, 0]])
        tell(f"{len(pairs)} pair(s) of points nearly in one place, the first at ({at}) m")


def read_mesh(path: str | Path, *, scale: float = 1.0) -> TetMesh:
    """Read a tetrahedral mesh with its named groups of facets, points and cells.

    Args:
        path: MSH, VTK or VTU with four-node tetrahedra.
        scale: Metres per unit of the file.

    Returns:
        The mesh [m], cells in the file's order.

    Raises:
        FileFormatError: Missing, damaged, of another kind, or without tetrahedra.
        MeshError: Inverted cells, unused points, NaN, indices out of range.
    """
    data = _read(path, MESH_SUFFIXES)
    cells = _cells_of(data, "tetra")
    if len(cells) == 0:
        kinds = sorted({block.type for block in data.cells}) or ["nothing"]
        raise FileFormatError(
            path, f"holds no four-node tetrahedra (it holds: {', '.join(kinds)}); mesh it first"
        )
    _refuse_other_cells(path, data, set())
    with _named(path):
        points, cells, groups = without_lower_points(data, cells, groups_in(data))
        return TetMesh(_scaled(points, scale), cells, groups.facets, groups.points, groups.cells)


def write_surface(path: str | Path, surface: TriSurface) -> None:
    """Write a surface, whole or not at all; STL keeps single precision only.

    Args:
        path: STL, OBJ, PLY, OFF, MSH, VTK or VTU.
        surface: The surface [m].
    """
    suffix = _known_suffix(path, SURFACE_SUFFIXES)
    _write(path, suffix, meshio.Mesh(np.array(surface.points), [("triangle", surface.facets)]))


def write_mesh(
    path: str | Path,
    mesh: TetMesh,
    *,
    point_data: Mapping[str, NDArray[Any]] | None = None,
    cell_data: Mapping[str, NDArray[Any]] | None = None,
    groups: bool = False,
) -> None:
    """Write a tetrahedral mesh with fields, whole or not at all.

    VTU is binary and compressed, float64: exact.

    Args:
        path: MSH, VTK or VTU.
        mesh: The mesh.
        point_data: Fields by name, first dimension num_points.
        cell_data: Fields by name, first dimension num_cells.
        groups: Whether its groups are written too, instead of the fields; `read_mesh` restores
            them.

    Raises:
        InputError: Two groups of one name, or, in MSH, a cell in two groups.
    """
    suffix = _known_suffix(path, MESH_SUFFIXES)
    out = meshio.Mesh(
        np.array(mesh.points),
        [("tetra", np.array(mesh.cells))],
        point_data={name: np.array(field) for name, field in (point_data or {}).items()},
        cell_data={name: [np.array(field)] for name, field in (cell_data or {}).items()},
    )
    if groups and (mesh.facet_groups or mesh.point_groups or mesh.cell_groups):
        out = with_groups(out, mesh, suffix=suffix)
    _write(path, suffix, out)


def read_result_arrays(
    path: str | Path, *, most_bytes: int = MOST_BYTES
) -> tuple[Points, NDArray[Any], dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Points, tetrahedra and fields on both, as in the file: only the kind of file is checked.

    Args:
        path: VTU, VTK or MSH.
        most_bytes: Most memory of the arrays of a VTU file when unpacked [bytes].

    Returns:
        Points, (num_points, 3); tetrahedra, (num_cells, 4), or (0, 0) where there are none;
        fields of points by name, first dimension num_points; fields of the tetrahedra, first
        dimension num_cells.

    Raises:
        FileFormatError: Missing, damaged, of another kind, or too large.
    """
    data = _read(path, MESH_SUFFIXES, most_bytes)
    points: Points = np.asarray(data.points, dtype=np.float64)
    fields = {name: np.asarray(field) for name, field in data.point_data.items()}
    of_cells = {
        name: np.concatenate([np.asarray(values) for values in blocks])
        for name, of_blocks in data.cell_data.items()
        if (blocks := [v for v, b in zip(of_blocks, data.cells, strict=True) if b.type == "tetra"])
    }
    return points, _cells_of(data, "tetra"), fields, of_cells


def _known_suffix(path: str | Path, known: tuple[str, ...]) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise FileFormatError(path, f"unknown kind {suffix or '(none)'!r}; use {', '.join(known)}")
    return suffix


def _read(path: str | Path, known: tuple[str, ...], most_bytes: int = MOST_BYTES) -> Any:
    """Read by meshio, and legacy VTK that it does not know (normals, metadata) by VTK."""
    file, is_grid = Path(path), None
    if _known_suffix(file, known) == ".vtk":
        with open_plain(file, most_bytes=4 * most_bytes) as stream:
            is_grid = _IS_GRID.search(stream.read(_HEADER_BYTES))
    if is_grid:
        # Before anybody reads: both readers go on past the end of the file.
        refuse_impossible_counts(file)
    try:
        return _read_at_once(file, known, most_bytes)
    except FileFormatError as error:
        if is_grid and importlib.util.find_spec("vtkmodules") is not None:
            with contextlib.suppress(FileFormatError), made_by_vtk(file, "grid.vtu") as found:
                return _read_at_once(found, known, most_bytes)
        elif is_grid:
            error.args = (f"{error}; VTK may read it: pip install 'palpate[pyvista]'",)
        raise


def _read_at_once(path: str | Path, known: tuple[str, ...], most_bytes: int = MOST_BYTES) -> Any:
    """Read by meshio; every kind of failure becomes a FileFormatError."""
    file = Path(path)
    suffix = _known_suffix(file, known)
    with open_plain(file, most_bytes=4 * most_bytes) as stream:
        size = stream.seek(0, io.SEEK_END)
    unpacked = unpacked_bytes(file, most_bytes=most_bytes) if suffix == ".vtu" else 0
    room = _SPARE_BYTES + _PER_FILE_BYTE * size + _PER_UNPACKED_BYTE * unpacked
    try:
        # The readers print on stdout and stderr, and end the process on damaged XML.
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            limited_memory(room),
        ):
            data = _read_by_meshio(file, suffix)
    except (SystemExit, Exception) as error:
        reason = str(error) if str(error) and not isinstance(error, SystemExit) else "damaged"
        first_line = reason.strip().splitlines()[0][:200]
        raise FileFormatError(path, f"cannot be read as {suffix[1:]} ({first_line})") from error
    if len(data.points) == 0:
        raise FileFormatError(path, "holds no points (empty or cut off)")
    points = np.asarray(data.points)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype.kind not in "fiu":
        raise FileFormatError(path, f"holds points of shape {points.shape}, not (n, 3)")
    if points.shape[1] == 2:
        raise FileFormatError(path, "is two-dimensional; points need three coordinates")
    return data


class _Ending(io.BufferedReader):
    """A file with an end: whoever reads on past it again and again gets an EOFError."""

    _num_past_end = 0

    def readline(self, size: int | None = -1, /) -> bytes:
        return self._counted(super().readline(size))

    def read1(self, size: int = -1, /) -> bytes:
        return self._counted(super().read1(size))

    def _counted(self, found: bytes) -> bytes:
        self._num_past_end = 0 if found else self._num_past_end + 1
        if self._num_past_end > _MOST_PAST_END:
            raise EOFError("cut off")
        return found


def _read_by_meshio(file: Path, suffix: str) -> Any:
    if suffix != ".msh":
        return meshio.read(file)
    # Its reader asks for lines until one comes that it knows; the others stop by themselves.
    with _with_plain_numbers(file) as plain, _Ending(io.FileIO(plain)) as stream:
        return meshio.gmsh.main.read_buffer(stream)


@contextlib.contextmanager
def _with_plain_numbers(file: Path) -> Iterator[Path]:
    """An ASCII .msh itself, or a copy without the names of numpy's types around its numbers."""
    text = file.read_bytes()
    if not (_TEXT_MSH.search(text[:1000]) and _NUMPY_NUMBER.search(text)):
        yield file
        return
    with scratch_folder("msh") as folder:
        copy = folder / "plain.msh"
        copy.write_bytes(_NUMPY_NUMBER.sub(rb"\1", text))
        yield copy


def _cells_of(data: Any, kind: str) -> NDArray[Any]:
    blocks = [np.asarray(block.data) for block in data.cells if block.type == kind]
    return np.vstack(blocks) if blocks else np.zeros((0, 0), dtype=np.int64)


def _refuse_other_cells(path: str | Path, data: Any, allowed: set[str]) -> None:
    """Refuse quads or hexahedra: a part of the body must not be left out without an error."""
    other = {block.type for block in data.cells} - _HARMLESS - allowed
    if other:
        raise FileFormatError(
            path, f"holds cells of kind {', '.join(sorted(other))}; split them into simplices"
        )


def _scaled(points: NDArray[Any], scale: float) -> Points:
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"scale = {scale:g}: needs a finite value above 0")
    scaled: Points = np.asarray(points, dtype=np.float64) * scale
    return scaled


@contextlib.contextmanager
def _named(path: str | Path) -> Any:
    """Put the file's name in front of the messages of the mesh classes."""
    try:
        yield
    except MeshError as error:
        error.args = (f"{path}: {error}",)
        raise


def _write(path: str | Path, suffix: str, mesh: Any) -> None:
    new = own_path if suffix in MESH_SUFFIXES else atomic_path
    with new(path) as temporary, contextlib.redirect_stdout(io.StringIO()):
        if suffix == ".msh":
            # Only version 2.2 has physical groups without entities of a geometry.
            version = "2.2" if mesh.field_data else "4.1"
            meshio.gmsh.write(temporary, mesh, version, binary=True)
        elif suffix in (".vtu", ".vtk", ".ply", ".stl"):
            with _fast_zlib():
                meshio.write(temporary, mesh, binary=True)
        else:
            # OBJ and OFF are text; the default formats drop digits.
            _write_text(temporary, suffix, mesh)


@contextlib.contextmanager
def _fast_zlib() -> Iterator[None]:
    """Meshio's VTU compressed at zlib's first level: a fifth of the time, 1 % larger.

    meshio has no option for it, and its default takes a tenth of what meshing takes.
    """
    module = meshio.vtu._vtu
    own = module.zlib
    module.zlib = SimpleNamespace(
        compress=partial(zlib.compress, level=1), decompress=zlib.decompress
    )
    try:
        yield
    finally:
        module.zlib = own


def _write_text(path: Path, suffix: str, mesh: Any) -> None:
    """OBJ and OFF with all 17 digits, so that a round trip is exact."""
    facets = mesh.cells[0].data
    is_obj = suffix == ".obj"
    # One format for all rows: a third of the time of a text for each.
    rows = "v %.17g %.17g %.17g\n" if is_obj else "%.17g %.17g %.17g\n"
    text = rows * len(mesh.points) % tuple(mesh.points.ravel().tolist())
    rows = "f %d %d %d\n" if is_obj else "3 %d %d %d\n"
    text += rows * len(facets) % tuple((facets + is_obj).ravel().tolist())
    header = "" if is_obj else f"OFF\n{len(mesh.points)} {len(facets)} 0\n"
    path.write_text(header + text, encoding="ascii")
