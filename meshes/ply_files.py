"""Polygons of PLY files, in text and both binary orders, with any elements and properties.

By G. Turk, "The PLY Polygon File Format" (1994): points are the element `vertex` with x, y and z,
polygons the list `vertex_indices` or `vertex_index` of the element `face`; triangle strips are the
same list of `tristrips`, ended by -1. Everything else is read over.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError
from palpate.meshes.polygons import Indices
from palpate.meshes.text_tables import Done, nobody, polygons_by_corners, scaled, table

_NUMBERS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_MOST_HEADER_LINES = 1000
# Records after which a slow reader says how far it is.
_OFTEN = 20_000


@dataclass
class _Element:
    """So many records of properties: name, kind, and of lists the kind of their lengths."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def indices(self) -> str:
        """Name of the list of points."""
        return next(
            (name for name, _, length in self.properties if length and name in _INDICES), ""
        )


def read_ply(path: Path, done: Done = nobody) -> tuple[NDArray[np.float64], list[Indices]]:
    """Points, (n, 3), and polygons in blocks of as many corners each.

    Raises:
        FileFormatError: Damaged, cut off, or without points.
    """
    with path.open("rb") as stream:
        try:
            order, elements = _header(stream)
            start = stream.tell()
            room = stream.seek(0, io.SEEK_END) - start
            if any(e.count > room for e in elements):  # a record takes a byte at least
                raise ValueError("its header states more than it holds: cut off")
            stream.seek(start)
            body = stream.read()
            tables = dict(_tables(order, elements, body, done))
        except (ValueError, OverflowError, IndexError, KeyError) as error:
            raise FileFormatError(path, f"cannot be read as ply ({error})") from error
    if "vertex" not in tables:
        raise FileFormatError(path, "cannot be read as ply (no points)")
    polygons = tables.get("face", [])
    for strip in tables.get("tristrips", []):
        polygons += [_triangles_of_strips(row) for row in strip]
    return tables["vertex"][0].astype(float), polygons


def _header(stream: io.BufferedReader) -> tuple[str, list[_Element]]:
    if stream.readline(16).strip() != b"ply":
        raise ValueError("it does not begin with ply")
    order, elements = None, list[_Element]()
    for _ in range(_MOST_HEADER_LINES):
        line = stream.readline(4096)
        words = line.decode("ascii", "replace").split()
        match words:
            case ["end_header"]:
                if order is None:
                    raise ValueError("no format is stated")
                return order, elements
            case ["format", kind, _] if kind in _ORDERS:
                order = _ORDERS[kind]
            case ["element", name, count] if len(count) <= 18:
                elements.append(_Element(name, int(count)))
                if elements[-1].count < 0:
                    raise ValueError(f"{count} of {name}")
            case ["property", "list", length, kind, name] if elements:
                elements[-1].properties.append((name, _NUMBERS[kind], _NUMBERS[length]))
            case ["property", kind, name] if elements:
                elements[-1].properties.append((name, _NUMBERS[kind], ""))
            case [] | ["comment", *_] | ["obj_info", *_] if line:
                continue
            case _:
                said = " ".join(words)[:60]
                raise ValueError(f"its header has {said!r}" if line else "its header is cut off")
    raise ValueError(f"its header has more than {_MOST_HEADER_LINES} lines")


def _tables(
    order: str, elements: list[_Element], body: bytes, done: Done
) -> Iterator[tuple[str, list[NDArray[Any]]]]:
    """Coordinates of points, or lists of points by their lengths, of each element with them."""
    lines = iter(()) if order else iter(line for line in body.splitlines() if line.strip())
    at = 0
    for number, element in enumerate(elements):
        part = scaled(done, number / len(elements), (number + 1) / len(elements))
        if order:
            found, at = _binary(element, order, body, at)
        else:
            found = _text(element, lines, part)
        if element.name == "vertex":
            yield element.name, [np.column_stack([found[axis][0] for axis in "xyz"])]
        elif element.indices:
            yield element.name, [block.astype(np.int64) for block in found[element.indices]]


_Columns = dict[str, list[NDArray[Any]]]


def _text(element: _Element, lines: Iterator[bytes], done: Done) -> _Columns:
    """Of scalars a column, of lists blocks of as many entries each."""
    given = list(itertools.islice(lines, element.count))
    if len(given) < element.count:
        raise ValueError(f"{len(given)} of {element.count} {element.name}: cut off")
    names = [name for name, _, _ in element.properties]
    if not any(length for _, _, length in element.properties):
        plain = table(given, range(len(names)), np.float64, done) if names else None
        if plain is not None:
            return {name: [plain[:, k]] for k, name in enumerate(names)}
    elif names[0] == element.indices and element.properties[0][1][0] in "iu":
        blocks = polygons_by_corners(given, done)
        if blocks is not None and len(names) == 1:
            return {names[0]: list(blocks.values())}
    rows = [line.split() for line in given]
    if not any(length for _, _, length in element.properties):
        words = np.array([row[: len(names)] for row in rows], dtype=np.bytes_)
        numbers = words.reshape(len(rows), len(names)).astype(np.float64)
        return {name: [numbers[:, k]] for k, name in enumerate(names)}
    lists: dict[str, dict[int, list[list[float]]]] = {}
    for number, row in enumerate(rows):
        if number % _OFTEN == 0:
            done(number / len(rows))
        at = 0
        for name, kind, length in element.properties:
            count = int(row[at]) if length else 1
            at += bool(length)
            if count < 0 or at + count > len(row):
                raise ValueError(f"a {element.name} ends early: {b' '.join(row)[:60].decode()!r}")
            if name == element.indices:
                read = int if kind[0] in "iu" else float
                entries = [read(word) for word in row[at : at + count]]
                lists.setdefault(name, {}).setdefault(count, []).append(entries)
            at += count
    return {name: _blocks(by_count) for name, by_count in lists.items()} | (
        {element.indices: []} if element.indices and not lists else {}
    )


def _binary(element: _Element, order: str, body: bytes, at: int) -> tuple[_Columns, int]:
    """The same, and where the next element begins; in one go while all lists are of one length."""
    by_length: dict[int, list[NDArray[Any]]] = {}
    columns: _Columns = {}
    left, most = element.count, element.count
    while left:
        lengths = _lengths(element, order, body, at)
        kind = _record(element, order, lengths)
        rows = np.frombuffer(body, kind, min(left, most, (len(body) - at) // kind.itemsize), at)
        is_alike = np.ones(len(rows), dtype=bool)
        for name, length in lengths.items():
            is_alike &= rows[f"{name} length"] == length
        alike = len(rows) if is_alike.all() else int(is_alike.argmin())
        if alike == 0:
            raise ValueError(f"{element.count - left} of {element.count} {element.name}: cut off")
        rows = rows[:alike]
        if not lengths:
            columns = {name: [rows[name]] for name, _, _ in element.properties}
        elif element.indices:
            block = rows[element.indices].reshape(alike, lengths[element.indices])
            by_length.setdefault(lengths[element.indices], []).append(block)
        at += alike * kind.itemsize
        left -= alike
        most = 2 * alike + 16  # looked at once more, where lengths change often
    if element.indices:
        columns[element.indices] = [np.concatenate(of) for _, of in sorted(by_length.items())]
    elif not columns and not any(length for _, _, length in element.properties):
        columns = {name: [np.zeros(0)] for name, _, _ in element.properties}
    return columns, at


def _lengths(element: _Element, order: str, body: bytes, at: int) -> dict[str, int]:
    """How long the lists of the record are that begins there."""
    found: dict[str, int] = {}
    for name, kind, length in element.properties:
        if length:
            found[name] = int(np.frombuffer(body, order + length, 1, at)[0])
            at += np.dtype(length).itemsize
            if found[name] < 0 or found[name] > len(body):
                raise ValueError(f"a list of {found[name]} in {element.name}")
        at += np.dtype(kind).itemsize * found.get(name, 1)
    return found


def _record(element: _Element, order: str, lengths: dict[str, int]) -> np.dtype[np.void]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for name, kind, length in element.properties:
        if length:
            fields += [(f"{name} length", order + length), (name, order + kind, (lengths[name],))]
        else:
            fields.append((name, order + kind))
    return np.dtype(fields)


def _triangles_of_strips(row: NDArray[Any]) -> Indices:
    """Triangles of strips that end by -1, every second one turned; (n, 3)."""
    found = []
    for strip in np.split(row, np.flatnonzero(row == -1) + 1):
        corners = strip[strip != -1]
        each = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        each[1::2] = each[1::2, ::-1]
        found.append(each)
    every = np.concatenate(found).astype(np.int64)
    a, b, c = every.T
    triangles: Indices = every[(a != b) & (b != c) & (c != a)]
    return triangles


def _blocks(by_count: dict[int, list[list[float]]]) -> list[NDArray[Any]]:
    blocks = [(count, np.array(by_count[count], dtype=np.int64)) for count in sorted(by_count)]
    return [block.reshape(-1, count) for count, block in blocks]
