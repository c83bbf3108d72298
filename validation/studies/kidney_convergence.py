"""The kidney case on its mesh and on that mesh cut in eight, twice: numbers, order, error bar.

All three meshes have the same faceted shape, so what converges is the discretisation alone. Where
the held part of the surface meets the free one, stress is singular: displacement behaves like the
square root of the distance (a crack front, or a punch that sticks), so that linear functionals of
P1 converge with order 1 on uniform meshes once that edge dominates, and with 2 before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.case import Case
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.metrics.pairs import make_state
from palpate.validation.references.stored import load_stored

# Once the edge of the support dominates; before, up to 2.
EXPECTED_ORDER = 1.0
# fastsim's relative tolerance is 1e-10 of the forces.
_NOISE = 1e-8
QUANTITIES = {
    "volume change": ("volume_change", "mm3", 1e9),
    "area change": ("area_change", "mm2", 1e6),
    "largest displacement": ("largest_displacement", "mm", 1e3),
    "probe displacement": ("probe_displacement", "mm", 1e3),
}


@dataclass(frozen=True)
class Response:
    """What is asked of a loaded body.

    Attributes:
        volume_change: [m3].
        area_change: [m2].
        largest_displacement: Of all points [m].
        probe_displacement: Of the point farthest from the support [m], the same on all meshes.
    """

    volume_change: float
    area_change: float
    largest_displacement: float
    probe_displacement: float


def measure_response(problem: Problem, displacement: Points, probe: int) -> Response:
    """Measure a displacement by geometry alone."""
    state = make_state(problem.mesh, displacement, label="", simulator="", strain=Strain.GREEN)
    return Response(
        volume_change=state.volume - problem.mesh.volume,
        area_change=state.surface_area - problem.mesh.surface_area,
        largest_displacement=state.max_displacement,
        probe_displacement=float(np.linalg.norm(displacement[probe])),
    )


def probe_of(problem: Problem) -> int:
    """The point farthest from the middle of the held ones; refinement keeps its number."""
    held = np.unique(np.concatenate([s.points for s in problem.supports]))
    middle = problem.mesh.points[held].mean(axis=0)
    return int(np.linalg.norm(problem.mesh.points - middle, axis=1).argmax())


@dataclass(frozen=True)
class MeshFamily:
    """Responses on a mesh and its refinements, coarsest first.

    Attributes:
        cells: Of each mesh.
        responses: On each mesh.
    """

    cells: tuple[int, ...]
    responses: tuple[Response, ...]

    def assess(self, quantity: str) -> GridConvergence:
        """Order, Richardson's value and error bar of one quantity, in its unit of QUANTITIES."""
        name, _, factor = QUANTITIES[quantity]
        values = [factor * getattr(r, name) for r in self.responses[:-4:-1]]
        return assess_grid_convergence(
            values,
            [1.0, 2.0, 4.0],
            expected_order=EXPECTED_ORDER,
            noise=_NOISE * abs(values[0]),
        )


@dataclass(frozen=True)
class StoredTruth:
    """A stored reference's number and its error bar, in the unit of QUANTITIES."""

    value: float
    bar: float


def stored_truth(case: Case) -> dict[str, StoredTruth]:
    """What the stored P2 on the refined mesh says of each quantity.

    Raises:
        InputError: The stored reference is missing or belongs to another case.
    """
    stored = load_stored(case.name, case.problem)
    state = stored.truth(Strain.GREEN)
    assert state is not None, "a stored reference holds its truth"
    mesh, probe = case.problem.mesh, probe_of(case.problem)
    place = float(np.linalg.norm(state.displacement[probe]))
    # Bars are relative to what is measured; the probe, near the largest, takes its bar.
    found = {
        "volume change": (state.volume - mesh.volume, "volume"),
        "area change": (state.surface_area - mesh.surface_area, "surface_area"),
        "largest displacement": (state.max_displacement, "max_displacement"),
        "probe displacement": (place, "max_displacement"),
    }
    return {
        quantity: StoredTruth(
            QUANTITIES[quantity][2] * value,
            QUANTITIES[quantity][2] * abs(value) * stored.bars[metric, Strain.GREEN],
        )
        for quantity, (value, metric) in found.items()
    }


def follow_meshes(
    problem: Problem, progress: Callable[[str], None], *, refinements: int = 2
) -> MeshFamily:
    """Solve on the mesh and its refinements by fastsim, Green strain, each from the one before."""
    probe = probe_of(problem)
    cells, responses = [], []
    for level in range(refinements + 1):
        if level:
            problem = refine_problem(problem)
        progress(f"linear tetrahedra, {problem.mesh.num_cells} cells")
        found = solve_static(problem).displacement
        cells.append(problem.mesh.num_cells)
        responses.append(measure_response(problem, found, probe))
    return MeshFamily(tuple(cells), tuple(responses))
