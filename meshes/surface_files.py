"""Surfaces as other programs write them: OBJ, OFF and STL as text, and what VTK alone reads.

OBJ by "Advanced Visualizer Manual", appendix B1, Wavefront Technologies 1991; OFF by the Geomview
manual, "OFF: Object File Format". What is no polygon (lines, texture, normals, groups, colours) is
left out; curves and surfaces by equations are refused: a part of a body would be missing.
"""

from __future__ import annotations

import contextlib
import importlib.util
import mmap
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import FileFormatError
from palpate.meshes.polygons import Indices, PolygonError, cut_into_triangles
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.meshes.text_tables import Done, nobody, polygons_by_corners, scaled, table

# Points, and polygons in blocks of as many corners each.
Polygons = tuple[Points, list[Indices]]

# Statements of OBJ that draw nothing: lines and points, names, texture and shading.
_OBJ_HARMLESS = {
    *("vt", "vn", "l", "p", "o", "g", "s", "mg", "mtllib", "usemtl", "usemap", "maplib"),
    *("shadow_obj", "trace_obj", "lod", "bevel", "c_interp", "d_interp"),
}  # fmt: skip
_OFF_HEADER = re.compile(r"\A(ST)?(C)?(N)?OFF\b")
_STL_HEADER, _STL_RECORD = 84, 50
# Lines after which a slow reader says how far it is: a few hundredths of a second.
_OFTEN = 20_000
_SECONDS = 300.0  # a surface of ten million triangles
# What a legacy VTK file says of its own size, at the start of a line.
_VTK_COUNTS = re.compile(
    rb"^(?:(?:POINTS|CELLS|CELL_TYPES|POLYGONS|LINES|VERTICES|TRIANGLE_STRIPS|POINT_DATA|CELL_DATA"
    rb"|FIELD +\S+|LOOKUP_TABLE +\S+) +(\d+)(?: +(\d+))?|[^\s]+ +(\d+) +(\d+) +[a-z]\w* *$)",
    re.MULTILINE,
)
_AS_VTK = Path(__file__).with_name("vtk_surfaces.py")


def triangles_of(path: str | Path, points: Points, polygons: list[Indices]) -> NDArray[np.int32]:
    """All polygons as triangles, (n, 3); see `cut_into_triangles`.

    Raises:
        FileFormatError: A corner that is no point, or a polygon that cannot be cut.
    """
    for block in polygons:
        if block.size and not (block.min() >= 0 and block.max() < len(points)):
            worst = block[((block < 0) | (block >= len(points))).any(axis=1)][0]
            reason = f"a facet names the points {worst.tolist()}, of {len(points)} (from 0)"
            raise FileFormatError(path, reason)
    try:
        return cut_into_triangles(points, polygons).astype(np.int32)
    except PolygonError as error:
        raise FileFormatError(path, str(error)) from error


def read_obj(path: Path, done: Done = nobody) -> Polygons:
    """Points and polygons of an OBJ file, whatever texture and normals go with them.

    Raises:
        FileFormatError: Damaged, or with surfaces that are no polygons.
    """
    lines = path.read_bytes().replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    plain = _plain_obj(lines, done)
    if plain is not None:
        return plain
    points: list[list[bytes]] = []
    by_corners: dict[int, list[list[int]]] = {}
    for number, line in enumerate(lines, 1):
        if number % _OFTEN == 0:
            done(number / len(lines))
        word, *fields = line.split(b"#", 1)[0].split() or [b""]
        if word == b"v":
            points.append(fields[:3])
        elif word in (b"f", b"fo"):
            try:
                corners = [int(field.split(b"/", 1)[0]) for field in fields]
            except ValueError:
                corners = []
            if len(corners) < 3 or 0 in corners:
                reason = f"line {number}: a facet needs three or more numbers of points, from 1"
                raise FileFormatError(path, reason)
            # Below 0 they count back from the last point so far.
            rows = [k - 1 if k > 0 else len(points) + k for k in corners]
            by_corners.setdefault(len(rows), []).append(rows)
        elif word and (name := word.decode("ascii", "replace")) not in _OBJ_HARMLESS:
            raise FileFormatError(path, f"line {number}: {name[:40]!r} is no polygon; export those")
    return _numbers(path, points), _blocks(path, by_corners)


def _plain_obj(lines: list[bytes], done: Done) -> Polygons | None:
    """The same of lines `v x y z`, `f a b c` with indices above 0, and harmless ones."""
    of_points, of_facets, others = list[bytes](), list[bytes](), set[bytes]()
    for line in lines:
        start = line[:2]
        if start == b"v ":
            of_points.append(line[2:])
        elif start == b"f ":
            of_facets.append(line[2:])
        elif line:
            others.add(line.split(b" ", 1)[0])
    if any(w[:1] != b"#" and w.decode("ascii", "replace") not in _OBJ_HARMLESS for w in others):
        return None
    if any(b"/" in line for line in of_facets):
        of_facets = re.sub(rb"/\S*", b"", b"\n".join(of_facets)).split(b"\n")
    points = table(of_points, range(3), np.float64, scaled(done, 0.0, 0.6))
    counts = np.array([len(line.split()) for line in of_facets], dtype=np.int64)
    blocks = []
    for count in np.unique(counts):
        chosen = [of_facets[k] for k in np.flatnonzero(counts == count)]
        rows = table(chosen, None, np.int64, scaled(done, 0.6, 1.0))
        if rows is None or count < 3 or rows.min() < 1:
            return None
        blocks.append(rows - 1)
    return None if points is None else (points, blocks)


def read_off(path: Path, done: Done = nobody) -> Polygons:
    """Points and polygons of an OFF file in text, whatever colours and normals go with them.

    Raises:
        FileFormatError: Damaged, cut off, binary, or of other than three dimensions.
    """
    whole = path.read_bytes()
    plain = _plain_off(whole, done)
    if plain is not None:
        return plain
    lines = whole.decode("latin-1").splitlines()
    rows = [words for line in lines if (words := line.split("#", 1)[0].split())]
    header = _OFF_HEADER.match(rows[0][0]) if rows else None
    if header is None or header.end() != len(rows[0][0]) or "BINARY" in rows[0]:
        raise FileFormatError(path, "does not begin with OFF in text, in three dimensions")
    rows = [rows[0][1:], *rows[1:]] if len(rows[0]) > 1 else rows[1:]
    try:
        num_points, num_facets = (int(word) for word in rows[0][:2])
        body = rows[1 : 1 + num_points + num_facets]
        if min(num_points, num_facets) < 0 or len(body) < num_points + num_facets:
            raise ValueError(f"{len(rows) - 1} lines of {num_points} points, {num_facets} facets")
        by_corners: dict[int, list[list[int]]] = {}
        for number, row in enumerate(body[num_points:]):
            if number % _OFTEN == 0:
                done(number / num_facets)
            count = int(row[0])
            if count < 1 or len(row) <= count:
                raise ValueError(f"a facet of {count} corners in {' '.join(row)[:60]!r}")
            if count > 2:  # else a point or an edge
                by_corners.setdefault(count, []).append([int(k) for k in row[1 : count + 1]])
    except (ValueError, IndexError) as error:
        raise FileFormatError(path, f"cannot be read as off ({error})") from error
    points = [[word.encode() for word in row[:3]] for row in body[:num_points]]
    return _numbers(path, points), _blocks(path, by_corners)


def _plain_off(whole: bytes, done: Done) -> Polygons | None:
    """The same of a header and two numbers on lines of their own, then a line each."""
    lines = [line for line in whole.splitlines() if line and line[:1] != b"#"]
    counts = lines[1].split()[:2] if len(lines) > 2 else []
    header = _OFF_HEADER.fullmatch(lines[0].decode("latin-1").strip()) if counts else None
    if header is None or len(counts) < 2 or not all(w.isdigit() and len(w) < 10 for w in counts):
        return None
    num_points, num_facets = map(int, counts)
    body = lines[2 : 2 + num_points + num_facets]
    if len(body) < num_points + num_facets:
        return None
    points = table(body[:num_points], range(3), np.float64, scaled(done, 0.0, 0.6))
    blocks = polygons_by_corners(body[num_points:], scaled(done, 0.6, 1.0))
    if points is None or blocks is None:
        return None
    return points, [rows for count, rows in blocks.items() if count > 2]


def is_binary_stl(path: Path) -> bool:
    """Whether an STL file is binary: of the size that its number of facets makes it.

    Binary ones may begin with "solid" as well, which is how text ones are told by some readers;
    those that do not may have more behind their facets.
    """
    with path.open("rb") as stream:
        start = stream.read(_STL_HEADER)
        size = stream.seek(0, 2)
    stated = _STL_HEADER + _STL_RECORD * _num_stl_facets(start)
    return len(start) == _STL_HEADER and (
        size == stated or (size > stated and not start.lstrip().lower().startswith(b"solid"))
    )


def _num_stl_facets(start: bytes) -> int:
    return int.from_bytes(start[80:84], "little")


def read_text_stl(path: Path, done: Done = nobody) -> Polygons:
    """Three points for each facet, in capitals or not.

    Raises:
        FileFormatError: Damaged or cut off: facets without three corners each, or without an end.
    """
    whole = path.read_bytes().lower()
    plain = _plain_stl(whole, done)
    if plain is not None:
        return plain
    words = whole.split()
    marks = np.flatnonzero(np.array(words, dtype="S6") == b"vertex")
    num_facets = words.count(b"facet")
    if not words or words[0] != b"solid" or b"endsolid" not in words[-20:]:
        raise FileFormatError(path, "is no STL, or cut off: text from solid to endsolid")
    if 3 * num_facets != len(marks) or words.count(b"endloop") != num_facets:
        reason = f"is damaged or cut off: {len(marks)} corners of {num_facets} facets of three each"
        raise FileFormatError(path, reason)
    points = _numbers(path, [words[at + 1 : at + 4] for at in marks])
    return points, [np.arange(len(points)).reshape(-1, 3)]


def _plain_stl(whole: bytes, done: Done) -> Polygons | None:
    """The same where every corner is a line of its own, seven lines to a facet."""
    lines = [stripped for line in whole.splitlines() if (stripped := line.strip())]
    body = lines[1:-1]
    if not body or len(body) % 7 or not (lines[0][:5] == b"solid" and lines[-1][:8] == b"endsolid"):
        return None
    starts = (b"facet", b"outer loop", b"vertex ", b"vertex ", b"vertex ", b"endloop", b"endfacet")
    for k, start in enumerate(starts):
        if not all(line.startswith(start) for line in body[k::7]):
            return None
        done(0.05 * (k + 1) / 7)
    corners = []
    for k in (2, 3, 4):
        part = scaled(done, 0.05 + 0.31 * (k - 2), 0.05 + 0.31 * (k - 1))
        found = table([line[7:] for line in body[k::7]], range(3), np.float64, part)
        if found is None:
            return None
        corners.append(found)
    points = np.stack(corners, axis=1).reshape(-1, 3)
    return points, [np.arange(len(points)).reshape(-1, 3)]


def read_binary_stl(path: Path, _done: Done = nobody) -> Polygons:
    """Three points for each facet; its stated normal and attributes are left out."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    whole = path.read_bytes()
    corners = np.frombuffer(whole, kind, _num_stl_facets(whole), _STL_HEADER)["corners"]
    return corners.reshape(-1, 3).astype(float), [np.arange(3 * len(corners)).reshape(-1, 3)]


def read_by_vtk(path: Path, _done: Done = nobody) -> Polygons:
    """Points and polygons that VTK finds in a file, in a process of its own.

    Raises:
        FileFormatError: VTK is not installed, finds an error, or does not end in time.
    """
    if path.suffix.lower() == ".vtk":
        refuse_impossible_counts(path)
    with made_by_vtk(path, "surface.npz") as found, np.load(found, allow_pickle=False) as arrays:
        points, offsets, corners = (arrays[n] for n in ("points", "offsets", "corners"))
    counts = np.diff(offsets)
    blocks = [
        corners[offsets[:-1][counts == count][:, None] + np.arange(count)]
        for count in np.unique(counts)
        if count > 2
    ]
    return points.astype(float), blocks


@contextlib.contextmanager
def made_by_vtk(path: Path, name: str) -> Iterator[Path]:
    """What VTK makes of a file, for the time of the context: polygons (.npz) or cells (.vtu).

    Raises:
        FileFormatError: VTK is not installed, finds an error, or does not end in time.
    """
    kind = path.suffix[1:].lower()
    if importlib.util.find_spec("vtkmodules") is None:
        reason = f"is read as {kind} by VTK alone: pip install 'palpate[pyvista]'"
        raise FileFormatError(path, reason)
    with scratch_folder("vtk") as folder:
        found = folder / name
        try:
            done = run_supervised(
                [sys.executable, str(_AS_VTK), str(path), str(found)], time_limit=_SECONDS
            )
        except subprocess.TimeoutExpired as error:
            raise FileFormatError(path, f"was not read in {_SECONDS:g} s") from error
        if done.returncode or not found.is_file():
            said = [line for line in done.stderr.splitlines() if line.strip()]
            reason = said[-1][:200] if said else f"VTK ended with {done.returncode}"
            raise FileFormatError(path, f"cannot be read as {kind} ({reason})")
        yield found


def refuse_impossible_counts(path: Path) -> None:
    """Refuse a legacy VTK file of more values than bits: memory would be filled with them.

    Raises:
        FileFormatError: A line states such a number.
    """
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        for found in _VTK_COUNTS.finditer(whole):
            if any(n and (len(n) > 18 or int(n) > 8 * len(whole)) for n in found.groups()):
                line = found.group().decode("ascii", "replace")[:60]
                reason = f"is damaged: {line!r} is more than can be in {len(whole)} bytes"
                raise FileFormatError(path, reason)


def _numbers(path: Path, rows: list[list[bytes]]) -> Points:
    """Three coordinates of each point."""
    with contextlib.suppress(ValueError):
        found: NDArray[np.float64] = np.array(rows, dtype=np.bytes_).astype(np.float64)
        if found.shape == (len(rows), 3):
            return found
    for number, row in enumerate(rows):
        try:
            good = len([float(word) for word in row]) == 3
        except ValueError:
            good = False
        if not good:
            said = b" ".join(row).decode("ascii", "replace")[:60]
            raise FileFormatError(path, f"point {number} (from 0) is {said!r}, not three numbers")
    return np.zeros((0, 3))


def _blocks(path: Path, by_corners: dict[int, list[list[int]]]) -> list[Indices]:
    try:
        return [np.array(by_corners[count], dtype=np.int64) for count in sorted(by_corners)]
    except OverflowError as error:
        raise FileFormatError(path, "a facet names a point beyond 2^63") from error
