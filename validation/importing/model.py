"""What the readers of other simulators' files have in common: a model as it stands in its file.

Their files have no units. Length, force and stress are chosen together; time is in seconds, so
that mass follows: tonnes for mm and N. Cells that are no tetrahedra are cut into some.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.case.units import FORCE, LENGTH

# A tetrahedron's middle nodes 5 to 10 lie between these corners, in Abaqus, CalculiX and FEBio.
MIDDLES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])


class ImportRefusedError(InputError):
    """Something in a file that a case cannot say; the message names file, line and reason."""

    def __init__(self, path: str | Path, line: int | None, reason: str) -> None:
        self.path, self.line, self.reason = str(path), line, reason
        where = Path(path).name if line is None else f"{Path(path).name}:{line}"
        super().__init__(f"{where}: {reason}")


@dataclass(frozen=True)
class Source:
    """A line of a file."""

    path: Path
    line: int

    def refuse(self, reason: str) -> ImportRefusedError:
        """The error that names the line."""
        return ImportRefusedError(self.path, self.line, reason)


@dataclass(frozen=True)
class Body:
    """A material as a table of a case, in the model's units; density None where none is given."""

    constants: dict[str, Any]
    density: float | None
    source: Source


@dataclass(frozen=True)
class FixedNodes:
    """Nodes that are fixed or moved: by component (0, 1, 2) the displacement there."""

    name: str
    nodes: NDArray[np.int64]
    components: dict[int, float]
    source: Source


@dataclass(frozen=True)
class Face:
    """Facets by their corner nodes, (n, 3), with a pressure or a dead traction."""

    name: str
    facets: NDArray[np.int64]
    source: Source
    pressure: float | None = None
    traction: tuple[float, float, float] | None = None


@dataclass(eq=False)
class Model:
    """Nodes are numbered from 0 in the order of the file; all in the units of the file.

    Args:
        path: The file.
        program: "FEBio 4.0": for people.
        nodes: (num_nodes, 3).
        corners: Corners of tetrahedra, (num_cells, 4).
        middles: Middle nodes of quadratic ones, (num_cells, 6); -1 where a cell has none.
        bodies: Materials.
        body_of: Index of each cell's material, (num_cells,).
        labels: The file's own number of each node: for messages.
        supports: What is fixed or moved.
        faces: Pressures and tractions.
        forces: Force on each node, (num_nodes, 3).
        acceleration: Acceleration of gravity, or None.
        body_force: Force by volume, where the file gives it so.
        notes: What a reader has to know: what was read into something else than it says.
        ignored: What was left out because it changes no mechanics, with its line.
        units: The system that the file states, and where.
        pushed_at: Where the first force on a node stands.
    """

    path: Path
    program: str
    nodes: Points
    corners: NDArray[np.int64]
    middles: NDArray[np.int64]
    bodies: list[Body]
    body_of: NDArray[np.int64]
    labels: NDArray[np.int64]
    title: str = ""
    strain: Strain = Strain.GREEN
    supports: list[FixedNodes] = field(default_factory=list)
    faces: list[Face] = field(default_factory=list)
    forces: Points = field(default_factory=lambda: np.zeros((0, 3)))
    acceleration: tuple[float, float, float] | None = None
    body_force: tuple[float, float, float] | None = None
    notes: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    units: tuple[UnitSystem, Source] | None = None
    pushed_at: Source | None = None

    def __post_init__(self) -> None:
        if not len(self.forces):
            self.forces = np.zeros_like(self.nodes)

    @property
    def is_quadratic(self) -> NDArray[np.bool_]:
        """Which cells have middle nodes, (num_cells,)."""
        quadratic: NDArray[np.bool_] = (self.middles >= 0).all(axis=1)
        return quadratic


def added(
    known: tuple[float, float, float] | None, more: Sequence[float] | NDArray[np.float64]
) -> tuple[float, float, float]:
    """The sum of two vectors, of which the first may not be there."""
    x, y, z = (np.array(known or (0.0, 0.0, 0.0)) + more).tolist()
    return x, y, z


def finite(text: str, source: Source, what: str) -> float:
    """A number.

    Raises:
        ImportRefusedError: No number, or one that is not finite.
    """
    try:
        value = float(text if text.isascii() else "none")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value) or abs(value) > 1e100 or "_" in text:
        raise source.refuse(f"{what}: {text.strip()[:40]!r} is no number that can be used")
    return value


def whole(text: str, source: Source, what: str) -> int:
    """A whole number.

    Raises:
        ImportRefusedError: No whole number, or one beyond 10 digits.
    """
    word = text.strip()
    digits = word.removeprefix("+").removeprefix("-")
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 10):
        raise source.refuse(f"{what}: {word[:40]!r} is no whole number")
    return int(word)


class UnitSystem(StrEnum):
    """Length, force and stress of a model, which fit together; time in seconds."""

    METRE_NEWTON = "m-N-Pa"
    MILLIMETRE_NEWTON = "mm-N-MPa"
    MILLIMETRE_MILLINEWTON = "mm-mN-kPa"
    METRE_KILONEWTON = "m-kN-kPa"

    @property
    def table(self) -> dict[str, str]:
        """The table [units] of a case: lengths, forces and stresses stay as they are."""
        length, force, stress = self.value.split("-")
        return {"length": length, "force": force, "stress": stress, "density": "kg/m3"}

    def kilograms_per_cubic_metre(self, density: float) -> float:
        """Turn a density in force time^2 / length^4; to 15 digits, so that 1e-9 t/mm3 is 1000."""
        table = self.table
        return float(f"{density * FORCE[table['force']] / LENGTH[table['length']] ** 4:.15g}")

    def metres_per_second_squared(self, acceleration: float) -> float:
        """Turn an acceleration in length / s2 into m/s2."""
        return acceleration * LENGTH[self.table["length"]]


# Faces by corners, seen from outside counter-clockwise, of cells of so many nodes in FEBio's,
# Abaqus' and VTK's numbering. They stand in the order of Abaqus' and CalculiX' faces S1, S2, ...:
# Abaqus Analysis User's Guide, "Three-dimensional solid element library"; CalculiX's manual, "Four-
# node tetrahedral element".
_TETRAHEDRON = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
FACES: dict[int, tuple[tuple[int, ...], ...]] = {
    4: _TETRAHEDRON,
    10: _TETRAHEDRON,
    8: (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
    6: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    5: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def cut_cell(nodes: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """Tetrahedra of a cell of 8, 6 or 5 nodes: six, three or two.

    >>> cut_cell([0, 1, 2, 3, 4, 5])
    [(0, 3, 4, 5), (0, 1, 2, 5), (0, 1, 5, 4)]
    """
    first = min(nodes)
    found = []
    for face in FACES[len(nodes)]:
        corners = [nodes[k] for k in face]
        if first not in corners:
            found += [(first, *triangle) for triangle in cut_face(corners)]
    return found


def cut_face(nodes: Sequence[int]) -> list[tuple[int, int, int]]:
    """Triangles of a face of three or four corners, as its cell is cut there.

    >>> cut_face([3, 1, 2, 4])
    [(1, 2, 4), (1, 4, 3)]
    """
    start = int(np.argmin(nodes))
    a, *others = [*nodes[start:], *nodes[:start]]
    return [(a, b, c) for b, c in itertools.pairwise(others)]


def cut_cells(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Tetrahedra of cells of one kind, (num_cells, 8, 6 or 5): those of a cell stand together."""
    cut = [tetrahedron for row in rows.tolist() for tetrahedron in cut_cell(row)]
    return np.array(cut, dtype=np.int64).reshape(-1, 4)
