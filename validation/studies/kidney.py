"""Fig. 5 and Table I: the kidney, original, with linear and with Green strain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.case import Case
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics.difference import make_state
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.references.stored import load_stored
from palpate.validation.states import Progress, State
from palpate.validation.studies.study import findings_of, judge_live, page_of

TITLE = "The kidney"

# The kidney case on its mesh and on that mesh cut in eight, twice: numbers, order, error bar.
#
# All three meshes have the same faceted shape, so what converges is the discretisation alone. Where
# the held part of the surface meets the free one, stress is singular: displacement behaves like the
# square root of the distance (a crack front, or a punch that sticks), so that linear functionals of
# P1 converge with order 1 on uniform meshes once that edge dominates, and with 2 before.

# Once the edge of the support dominates; before, up to 2.
EXPECTED_ORDER = 1.0
# fastsim's relative tolerance is 1e-10 of the forces.
_NOISE = 1e-8
# What is asked of a loaded body, its unit, and what one of SI's is in it. The probe is the point
# farthest from the support, the same on all meshes.
QUANTITIES = {
    "volume change": ("mm3", 1e9),
    "area change": ("mm2", 1e6),
    "largest displacement": ("mm", 1e3),
    "probe displacement": ("mm", 1e3),
}
# Each of these, in its unit.
Response = Mapping[str, float]


def measure_response(problem: Problem, displacement: Points) -> Response:
    """Measure a displacement by geometry alone."""
    state = make_state(problem.mesh, displacement, label="", simulator="", strain=Strain.GREEN)
    return _response(problem, state)


def _response(problem: Problem, state: State) -> Response:
    mesh = problem.mesh
    values = (
        state.volume - mesh.volume,
        state.surface_area - mesh.surface_area,
        state.max_displacement,
        float(np.linalg.norm(state.displacement[probe_of(problem)])),
    )
    named = zip(QUANTITIES.items(), values, strict=True)
    return {quantity: factor * value for (quantity, (_, factor)), value in named}


def probe_of(problem: Problem) -> int:
    """The point farthest from the middle of the held ones; refinement keeps its number."""
    fixed = np.unique(np.concatenate([s.points for s in problem.supports]))
    middle = problem.mesh.points[fixed].mean(axis=0)
    return int(np.linalg.norm(problem.mesh.points - middle, axis=1).argmax())


class MeshFamily(NamedTuple):
    """Responses on a mesh and its refinements, coarsest first."""

    cells: tuple[int, ...]
    responses: tuple[Response, ...]

    def assess(self, quantity: str) -> GridConvergence:
        """Order, Richardson's value and error bar of one quantity, in its unit."""
        values = [response[quantity] for response in self.responses[:-4:-1]]
        noise = _NOISE * abs(values[0])
        return assess_grid_convergence(
            values, [1.0, 2.0, 4.0], expected_order=EXPECTED_ORDER, noise=noise
        )


class StoredTruth(NamedTuple):
    """A stored reference's number and its error bar, in the quantity's unit."""

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
    # Bars are relative to what is measured; the probe, near the largest, takes its bar.
    metrics = ("volume", "surface_area", "max_displacement", "max_displacement")
    named = zip(_response(case.problem, state).items(), metrics, strict=True)
    return {
        quantity: StoredTruth(value, abs(value) * stored.bars[metric, Strain.GREEN])
        for (quantity, value), metric in named
    }


def follow_meshes(problem: Problem, progress: Progress, *, refinements: int = 2) -> MeshFamily:
    """Solve on the mesh and its refinements by fastsim, Green strain, each from the one before."""
    cells, responses = [], []
    for level in range(refinements + 1):
        if level:
            problem = refine_problem(problem)
        progress(f"linear tetrahedra, {problem.mesh.num_cells} cells")
        cells.append(problem.mesh.num_cells)
        responses.append(measure_response(problem, solve_static(problem).displacement))
    return MeshFamily(tuple(cells), tuple(responses))


def compute(progress: Progress) -> CaseResult:
    """Judge the case."""
    return judge_live("kidney", progress)


judge, present = findings_of, page_of
