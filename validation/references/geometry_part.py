"""What the true surface of a case's body would change: the geometry part of its error bars.

A case's truth solves the polyhedron that the case gives. Beside it the true body is solved: the
same cells cut in eight, once as they are and once with the boundary on the true surface, with the
same supports and loads (a force or a moment keeps its size, a pressure or traction its pascals).
All else is alike in the two, so that what they differ by is the surface, however coarse the cells.
Chords leave a gap of second order in the length of an edge, and of the finer body's a quarter is
left, so that the whole is 4/3 of the difference, and 5/3 of it a bound.

Tools keep their paths in space, as somebody who places a probe by coordinates would: where the
true surface is nearer it is pressed deeper, and that is geometry too. A motion is solved implicitly
with few steps, and but for small bodies with linear tetrahedra, the same in both: two more runs of
about the cost of one of the truth's, which fall short by up to 15 per cent of the part.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import at_refined_points
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case import Case
from palpate.validation.metrics import Part, measure
from palpate.validation.references.adaptive_truth import ENERGY, TruthRequest, whole_metrics
from palpate.validation.references.bar_parts import GEOMETRY, PARTS, BarParts, as_record
from palpate.validation.references.geometry_of_stress import compare_stresses
from palpate.validation.references.motion_runs import TIME_LIMIT, solve_implicit
from palpate.validation.references.motion_sequences import difference, truth_metrics
from palpate.validation.references.sequences import at_points_of
from palpate.validation.references.sets import ReferenceSet, solve_state
from palpate.validation.references.true_bodies import (
    TrueBody,
    name_of_body,
    on_moved,
    surface_key,
    true_body,
)
from palpate.validation.states import Progress, State

# Cells of the pair that are still quadratic; of linear ones the relative difference is as good as
# they are stiff, some ten per cent of the part.
_LARGEST_QUADRATIC = 12_000
# Of a motion, which takes hundreds of solves; and its steps from output to output.
_LARGEST_QUADRATIC_MOVING = 1_500
_STEPS = 2
# What the pair may take where nobody waits for a stored truth [s], for each strain measure.
LIVE_SECONDS = 300.0

Found = dict[str, float]


@dataclass(frozen=True, eq=False)
class _Pair:
    """How the two bodies are solved, for one strain measure.

    Attributes:
        case: The case.
        body: Its true body.
        degree: Of the elements.
        strain: Strain measure.
        near: The truth at the case's points.
        progress: Called with one line for each solve.
        end: When to give up, by `time.monotonic`.
    """

    case: Case
    body: TrueBody
    degree: int
    strain: Strain
    near: State
    progress: Progress
    end: float

    @property
    def left(self) -> float:
        """Time for the next solve [s]."""
        return max(1.0, self.end - time.monotonic())

    def problems(self) -> list[tuple[TetMesh, Problem]]:
        """The true bodies with their loads."""
        spec, base = self.case.spec, self.body.base
        return [(mesh, on_moved(spec.load, spec.units, base, mesh)) for mesh in self.body.others]


def with_geometry(
    case: Case,
    references: ReferenceSet,
    progress: Progress,
    *,
    strains: Collection[Strain],
    request: TruthRequest | None = None,
    is_for_storing: bool = False,
    seconds: float = TIME_LIMIT,
) -> ReferenceSet:
    """References whose bars have a geometry part, where the case's body has a true surface.

    Args:
        case: The case.
        references: Of the case, with a truth and bars.
        progress: Called with one line for each solve.
        strains: Of the truths that are told of.
        request: Which parts of the body, and whether the energy, are told of besides.
        is_for_storing: Nothing is told of what has no bar: a file knows of nothing else.
        seconds: That the solves of one strain measure may take [s].

    Raises:
        InputError: A surface of `[truth]` that cannot be used, or a mesh too coarse for it.
    """
    of = name_of_body(case)
    truths = {s: t for s in Strain if s in strains and (t := references.truth(s)) is not None}
    if not of or not truths:
        return references
    told: dict[str, Any] = {"of": of}
    if key := surface_key(case):
        told["surface"] = key
    found: dict[Strain, Found] = {}
    failures: dict[str, str] = {}
    body: TrueBody | None = None
    try:
        body = true_body(case)
    except InputError as error:
        # Nobody who takes a built-in shape has another surface at hand.
        if case.spec.geometry.shape is None:
            raise
        failures = {strain.value: str(error) for strain in truths}
    if body is not None:
        told |= _how(case, body)
    for strain, truth in truths.items():
        named = {} if request is None else request.named_parts(strain)
        if body is not None:
            end = time.monotonic() + seconds
            pair = _Pair(case, body, told["degree"], strain, truth, progress, end)
            try:
                found[strain] = _differences(pair, named)
                continue
            except ReferenceUnavailableError:
                raise
            except (ReferenceFailedError, InputError) as error:
                failures[strain.value] = str(error)
        found[strain] = dict.fromkeys((*_metrics(case.problem), *named), math.inf)
    if failures:
        told["failures"] = failures
    rows: dict[tuple[str, Strain], BarParts] = {
        (name, strain): dataclasses.replace(references.bar_parts(name, strain), geometry=apart)
        for strain, numbers in found.items()
        for name, apart in numbers.items()
        if not is_for_storing or (name, strain) in references.bars
    }
    table = {**dict(references.provenance.get(PARTS, {})), **as_record(rows)}
    provenance = {**references.provenance, PARTS: table, GEOMETRY: told}
    return dataclasses.replace(references, provenance=provenance)


def _metrics(problem: Problem) -> tuple[str, ...]:
    if problem.time is not None:
        return truth_metrics(problem)
    return (*whole_metrics(problem), ENERGY)


def _how(case: Case, body: TrueBody) -> dict[str, Any]:
    """What the pair is solved with, for the file."""
    cells = body.base.mesh.num_cells
    if case.problem.time is None:
        return {"cells": cells, "degree": 2 if cells <= _LARGEST_QUADRATIC else 1}
    # Linear tetrahedra on cells cut in eight have the unknowns of quadratic ones on the case's.
    is_small = cells <= max(_LARGEST_QUADRATIC_MOVING, case.problem.mesh.num_cells)
    return {"cells": cells, "degree": 2 if is_small else 1, "steps_per_output": _STEPS}


def _differences(pair: _Pair, named: Mapping[str, Part]) -> Found:
    """By metric, or part of the body, how far the true body is from the polyhedron.

    In units of the metric's scale.
    """
    if pair.case.problem.time is not None:
        return _of_motion(pair)
    return _of_statics(pair, named)


def _of_statics(pair: _Pair, named: Mapping[str, Part]) -> Found:
    problem, base = pair.case.problem, pair.body.base
    near = pair.near.displacement
    start = near if base is problem else at_refined_points(problem.mesh, near)
    # Linear tetrahedra would take forces of tools from the kinks of that.
    is_start_good = pair.degree > 1 or not problem.tools

    def solve(of: Problem) -> State:
        return solve_state(
            of,
            pair.strain,
            pair.degree,
            pair.progress,
            start=start if is_start_good else None,
            time_limit=pair.left,
        )

    def at_points(state: State) -> State:
        return at_points_of(problem.mesh, state, state.label)

    first = solve(base)
    found = dict.fromkeys(_metrics(problem), 0.0) | dict.fromkeys(named, 0.0)
    for mesh, moved in pair.problems():
        second = solve(moved)
        apart = compare_stresses(problem, (base, first), (moved, second), named)
        ours = as_changes(at_points(second), mesh, base.mesh)
        for metric in whole_metrics(problem):
            apart[metric] = measure(metric, problem, ours, at_points(first)).value
        found = {name: max(most, pair.body.factor * apart[name]) for name, most in found.items()}
    return found


def _of_motion(pair: _Pair) -> Found:
    problem = pair.case.problem

    def solve(of: Problem) -> State:
        return solve_implicit(
            of,
            pair.strain,
            _STEPS,
            pair.progress,
            degree=pair.degree,
            at=problem.mesh,
            time_limit=pair.left,
        )

    first = solve(pair.body.base)
    found = dict.fromkeys(truth_metrics(problem), 0.0)
    for _, moved in pair.problems():
        second = solve(moved)
        for metric, most in found.items():
            apart = pair.body.factor * difference(metric, problem, second, first)
            found[metric] = max(most, apart)
    # Of two swings that are out of step one number may agree by chance.
    found["max_displacement"] = max(found["max_displacement"], found["displacement_max"])
    return found


def as_changes(state: State, own: TetMesh, base: TetMesh) -> State:
    """A state whose changes of volume and area are from its own rest, on another body's rest."""
    return dataclasses.replace(
        state,
        volume=base.volume + (state.volume - own.volume),
        surface_area=base.surface_area + (state.surface_area - own.surface_area),
    )
