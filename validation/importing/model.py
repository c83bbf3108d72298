"""What the readers of other simulators' files have in common: a model as it stands in its file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain

# A tetrahedron's middle nodes 5 to 10 lie between these corners, in Abaqus, CalculiX and FEBio.
MIDDLES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])


class ImportRefusedError(InputError):
    """Something in a file that a case cannot say; the message names file, line and reason."""

    def __init__(self, path: str | Path, line: int | None, reason: str) -> None:
        self.path, self.line, self.reason = str(path), line, reason
        where = Path(path).name if line is None else f"{Path(path).name}:{line}"
        super().__init__(f"{where}: {reason}")


@dataclass(frozen=True)
class Place:
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
    place: Place


@dataclass(frozen=True)
class Hold:
    """Nodes that are held: by component (0, 1, 2) the displacement there."""

    name: str
    nodes: NDArray[np.int64]
    components: dict[int, float]
    place: Place


@dataclass(frozen=True)
class Face:
    """Facets by their corner nodes, (n, 3), with a pressure or a dead traction."""

    name: str
    facets: NDArray[np.int64]
    place: Place
    pressure: float | None = None
    traction: tuple[float, float, float] | None = None


@dataclass(eq=False)
class Model:
    """Nodes are numbered from 0 in the order of the file; all in the units of the file.

    Args:
        path: The file.
        program: "FEBio 4.0": for people.
        nodes: (num_nodes, 3).
        corners: Of tetrahedra, (num_cells, 4).
        middles: Of quadratic ones, (num_cells, 6); -1 where a cell has none.
        bodies: Materials.
        body_of: Of each cell, the index of its material.
        labels: The file's own number of each node: for messages.
        holds: Supports.
        faces: Pressures and tractions.
        forces: On each node, (num_nodes, 3).
        acceleration: Of gravity, or None.
        body_force: By volume, where the file gives it so.
        told: What a reader has to know: what was read into something else than it says.
        ignored: What was left out because it changes no mechanics, with its line.
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
    holds: list[Hold] = field(default_factory=list)
    faces: list[Face] = field(default_factory=list)
    forces: Points = field(default_factory=lambda: np.zeros((0, 3)))
    acceleration: tuple[float, float, float] | None = None
    body_force: tuple[float, float, float] | None = None
    told: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not len(self.forces):
            self.forces = np.zeros_like(self.nodes)


def finite(text: str, place: Place, what: str) -> float:
    """A number, also one written by Fortran (1.5D-3).

    Raises:
        ImportRefusedError: No number, or one that is not finite.
    """
    try:
        value = float(text.strip().replace("D", "E").replace("d", "e"))
    except ValueError:
        value = float("nan")
    if not np.isfinite(value) or abs(value) > 1e100 or "_" in text:
        raise place.refuse(f"{what}: {text.strip()[:40]!r} is no number that can be used")
    return value


def whole(text: str, place: Place, what: str) -> int:
    """A whole number.

    Raises:
        ImportRefusedError: No whole number, or one beyond 18 digits.
    """
    word = text.strip()
    digits = word.removeprefix("+").removeprefix("-")
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 18):
        raise place.refuse(f"{what}: {word[:40]!r} is no whole number")
    return int(word)
