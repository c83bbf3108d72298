"""What is known of a problem: the displacement at its points, its volume, its area.

Volume and area of a deformed body follow from where its surface goes: the boundary facets are cut
in four again and again, their corners moved by the exact displacement, and what the flat pieces
miss, which falls by four with every cut where the displacement is smooth, is extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.difference import make_state, measures_of
from palpate.validation.states import State

# u at places, shape (n, 3) for (n, 3).
Field = Callable[[Points], Points]
_CUTS = (1, 2, 3)


@dataclass(frozen=True)
class Answer:
    """A known answer.

    Attributes:
        state: At the points of the problem's mesh.
        doubts: How well each metric is known, relative; those not named as "" is.
        field: The displacement everywhere, where it is known so.
        surface: What the curved sides lie on, "spheres" or "cylinders"; "" of a polyhedron, whose
            answer it is.
        radii: Of those [m].
        cauchy: Means of Cauchy's stress over the cells [Pa], (num_cells, 3, 3), where known.
    """

    state: State
    doubts: Mapping[str, float]
    field: Field | None = None
    surface: str = ""
    radii: Sequence[float] = ()
    cauchy: Floats | None = None


def answer_of(mesh: TetMesh, exact: Field, strain: Strain, origin: str, doubt: float) -> Answer:
    """The answer of a displacement that is known everywhere, to a relative `doubt`."""
    sizes = np.array([_sizes(mesh, exact, cuts) for cuts in _CUTS])
    once = sizes[1:] + (sizes[1:] - sizes[:-1]) / 3.0
    volume, area = once[1]
    state = make_state(mesh, exact(mesh.points), label=origin, simulator="known", strain=strain)
    left = np.abs(once[1] - once[0]) / np.abs(once[1] - (mesh.volume, mesh.surface_area))
    doubts = dict.fromkeys(("displacement_l2", "displacement_max", "max_displacement"), doubt)
    doubts |= {"volume": doubt + float(left[0]), "surface_area": doubt + float(left[1])}
    return Answer(replace(state, volume=float(volume), surface_area=float(area)), doubts, exact)


def reported(
    mesh: TetMesh,
    displacement: Points,
    sizes: tuple[float, float],
    strain: Strain,
    doubts: Mapping[str, float],
) -> Answer:
    """An answer from elsewhere: displacement at the points, deformed volume and area."""
    measures = measures_of(mesh, displacement) | {"volume": sizes[0], "surface_area": sizes[1]}
    state = State(label="known", simulator="known", strain=strain, degree=3, **measures)
    return Answer(state, doubts)


def _sizes(mesh: TetMesh, exact: Field, cuts: int) -> tuple[float, float]:
    """Volume and area inside the moved boundary, each facet cut in 4^cuts flat pieces."""
    n = 2**cuts
    rows = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)])
    number = {(int(i), int(j)): k for k, (i, j) in enumerate(rows)}
    pieces = [
        (number[i, j], number[i + 1, j], number[i, j + 1]) for i in range(n) for j in range(n - i)
    ]
    pieces += [
        (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
        for i in range(n)
        for j in range(n - i - 1)
    ]
    weights = np.column_stack([n - rows.sum(axis=1), rows]) / n
    positions = np.einsum("wa,fai->fwi", weights, mesh.points[mesh.boundary_facets])
    flat = positions.reshape(-1, 3)
    moved = (flat + exact(flat)).reshape(positions.shape)[:, np.array(pieces)].reshape(-1, 3, 3)
    a, b, c = moved.transpose(1, 0, 2)
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0
    return float(volume), float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
