"""What the true surface of a case's body would change: the geometry part of its error bars.

A case's truth solves the polyhedron that the case gives. Beside it the true body is solved: the
same cells cut in eight, once as they are and once with the boundary on the true surface, with the
same supports and loads (a force or moment has the same size, a pressure or traction its pascals).
All else is alike in the two, so that what they differ by is the surface, however coarse the cells.
Chords leave a gap of second order in the length of an edge, and of the finer body's a quarter is
left, so that the whole is 4/3 of the difference, and 5/3 of it a bound.

Tools have the same paths in space, as a probe positioned by coordinates has: where the
true surface is nearer it is pressed deeper, and that is geometry too. A motion is solved implicitly
with few steps, and but for small bodies with linear tetrahedra, the same in both: two more runs of
about the cost of one of the truth's, which fall short by up to 15 per cent of the part.

Stress is compared by means over the case's cells, those of the true body over the cells that were
cut from them and moved; the force of a support, or through a cut, of each body by its own loads.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import at_refined_points, mean_over_parents, refine_problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.true_surfaces import CurvedPart, refine_along
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case import Case
from palpate.validation.metrics import Part, measure, stress_integrals
from palpate.validation.metrics.numbers import reaction, strain_energy
from palpate.validation.metrics.stress import resultant, scale_of_force
from palpate.validation.references.adaptive_truth import DEGREE, ENERGY, TruthRequest, whole_metrics
from palpate.validation.references.bars import GEOMETRY, PARTS, BarParts, as_record
from palpate.validation.references.motions import difference, truth_metrics
from palpate.validation.references.reference_set import ReferenceSet, StateKey
from palpate.validation.references.runs import (
    TIME_LIMIT,
    at_points_of,
    solve_implicit,
    solve_state,
)
from palpate.validation.references.true_bodies import (
    OF_CHORDS,
    TrueBody,
    name_of_body,
    on_moved,
    surface_key,
    true_body,
)
from palpate.validation.states import Progress, State, StressIntegrals

# Cells of the pair that are still quadratic; of linear ones the relative difference is as good as
# they are stiff, some ten per cent of the part.
_LARGEST_QUADRATIC = 12_000
# The same of a motion, which takes hundreds of solves; and its steps from output to output.
_LARGEST_QUADRATIC_MOVING = 1_500
_STEPS = 2
# Time limit of the pair where nobody waits for a stored truth [s], for each strain measure.
LIVE_SECONDS = 300.0

Found = dict[str, float]
_Solved = tuple[Problem, State]


@dataclass(frozen=True, eq=False)
class _Pair:
    """How the two bodies are solved, for one strain measure.

    Attributes:
        problem: The problem at whose points they are compared.
        body: Its true body.
        others: The true bodies' meshes with their problems.
        degree: Degree of the elements.
        strain: Strain measure.
        near: The truth at the case's points.
        progress: Called with one line for each solve.
        end: When to give up, by `time.monotonic`.
    """

    problem: Problem
    body: TrueBody
    others: Sequence[tuple[TetMesh, Problem]]
    degree: int
    strain: Strain
    near: State
    progress: Progress
    end: float

    @property
    def left(self) -> float:
        """Time for the next solve [s]."""
        return max(1.0, self.end - time.monotonic())


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
        references: The references of the case, with a truth and bars.
        progress: Called with one line for each solve.
        strains: Strain measures of the truths whose part is wanted.
        request: Which parts of the body, and whether the energy, are asked for besides.
        is_for_storing: Whether only metrics with a bar are measured: a file stores no others.
        seconds: Most time that the solves of one strain measure may take [s].

    Raises:
        InputError: A surface of `[truth]` that cannot be used, or a mesh too coarse for it.
    """
    of = name_of_body(case)
    truths = {s: t for s in Strain if s in strains and (t := references.truth(s)) is not None}
    if not of or not truths:
        return references
    record: dict[str, Any] = {"of": of}
    if key := surface_key(case):
        record["surface"] = key
    found: dict[Strain, Found] = {}
    failures: dict[str, str] = {}
    body: TrueBody | None = None
    try:
        body = true_body(case)
    except InputError as error:
        # A user of a built-in shape has no other surface to give.
        if case.spec.geometry.shape is None:
            raise
        failures = {strain.value: str(error) for strain in truths}
    if body is not None:
        record |= _how(case, body)
    for strain, truth in truths.items():
        named = {} if request is None else request.named_parts(strain)
        if body is not None:
            end = time.monotonic() + seconds
            problem, degree = case.problem, record["degree"]
            try:
                others = [
                    (mesh, on_moved(case.spec.load, case.spec.units, body.base, mesh))
                    for mesh in body.others
                ]
                pair = _Pair(problem, body, others, degree, strain, truth, progress, end)
                is_moving = problem.time is not None
                found[strain] = _of_motion(pair) if is_moving else _of_statics(pair, named)
                continue
            except ReferenceUnavailableError:
                raise
            except (ReferenceFailedError, InputError) as error:
                failures[strain.value] = str(error)
        found[strain] = dict.fromkeys((*_metrics(case.problem), *named), math.inf)
    if failures:
        record["failures"] = failures
    rows: dict[StateKey, BarParts] = {
        (name, strain): dataclasses.replace(references.bar_parts(name, strain), geometry=apart)
        for strain, numbers in found.items()
        for name, apart in numbers.items()
        if not is_for_storing or (name, strain) in references.bars
    }
    table = {**dict(references.provenance.get(PARTS, {})), **as_record(rows)}
    provenance = {**references.provenance, PARTS: table, GEOMETRY: record}
    return dataclasses.replace(references, provenance=provenance)


def geometry_part(
    problem: Problem, parts: Sequence[CurvedPart], near: State, progress: Progress
) -> Found:
    """The geometry part of the bars of a problem on known curved surfaces, by metric.

    Pressures stay in pascals, and so do tractions. `near` is the truth at the problem's points.

    Raises:
        InputError: The mesh is too coarse for its surface.
        ReferenceFailedError: One of the two bodies has no solution.
    """
    body = TrueBody("", refine_problem(problem), (refine_along(problem.mesh, parts),), OF_CHORDS)
    others = [(mesh, dataclasses.replace(body.base, mesh=mesh)) for mesh in body.others]
    end = time.monotonic() + TIME_LIMIT
    pair = _Pair(problem, body, others, DEGREE, near.strain, near, progress, end)
    return _of_motion(pair) if problem.time is not None else _of_statics(pair, {})


def _metrics(problem: Problem) -> tuple[str, ...]:
    if problem.time is not None:
        return truth_metrics(problem)
    return (*whole_metrics(problem), ENERGY)


def _how(case: Case, body: TrueBody) -> dict[str, Any]:
    """The settings that the pair is solved with, for the file."""
    cells = body.base.mesh.num_cells
    if case.problem.time is None:
        return {"cells": cells, "degree": 2 if cells <= _LARGEST_QUADRATIC else 1}
    # Linear tetrahedra on cells cut in eight have the unknowns of quadratic ones on the case's.
    is_small = cells <= max(_LARGEST_QUADRATIC_MOVING, case.problem.mesh.num_cells)
    return {"cells": cells, "degree": 2 if is_small else 1, "steps_per_output": _STEPS}


def _of_statics(pair: _Pair, named: Mapping[str, Part]) -> Found:
    """How far the true body is from the polyhedron, by metric or part of the body.

    The distance is in units of the metric's scale.
    """
    problem, base = pair.problem, pair.body.base
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

    first = solve(base)
    found = dict.fromkeys(_metrics(problem), 0.0) | dict.fromkeys(named, 0.0)
    for mesh, moved in pair.others:
        second = solve(moved)
        apart = _compare_stresses(problem, (base, first), (moved, second), named)
        ours = as_changes(at_points_of(problem.mesh, second), mesh, base.mesh)
        for metric in whole_metrics(problem):
            apart[metric] = measure(metric, problem, ours, at_points_of(problem.mesh, first)).value
        found = {name: max(most, pair.body.factor * apart[name]) for name, most in found.items()}
    return _without_chance(found)


def _of_motion(pair: _Pair) -> Found:
    """The same distances for a motion."""
    problem = pair.problem

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
    for _, moved in pair.others:
        second = solve(moved)
        for metric, most in found.items():
            apart = pair.body.factor * difference(metric, problem, second, first)
            found[metric] = max(most, apart)
    return _without_chance(found)


def _without_chance(found: Found) -> Found:
    """The same with the worst point's part for the largest displacement.

    That is a single number of two bodies, which may agree by chance, and it may be of another point
    on each: chords move the points between them more than those on the true surface.
    """
    return found | {"max_displacement": max(found["max_displacement"], found["displacement_max"])}


def as_changes(state: State, own: TetMesh, base: TetMesh) -> State:
    """A state whose changes of volume and area are from its own rest, on another body's rest."""
    return dataclasses.replace(
        state,
        volume=base.volume + (state.volume - own.volume),
        surface_area=base.surface_area + (state.surface_area - own.surface_area),
    )


def _compare_stresses(
    problem: Problem, base: _Solved, other: _Solved, named: Mapping[str, Part]
) -> dict[str, float]:
    """The difference over the metric's scale [-], by name of a part, and for the energy.

    Args:
        problem: The case's.
        base: The polyhedron, on the case's cells or on those cut in eight, and its state there.
        other: The true body on the same cells.
        named: Parts of the case's mesh by the name of their bar.
    """
    pair = [_with_integrals(*solved) for solved in (base, other)]
    energies = [_energy(*solved) for solved in pair]
    found = {ENERGY: _ratio(abs(energies[1] - energies[0]), energies[0])}
    for name, part in named.items():
        if len(part.cells):
            states = [_over_cells(problem, *solved) for solved in pair]
            found[name] = measure("stress_l2", problem, states[1], states[0], part).value
        else:
            forces = [_force(problem, *solved, part) for solved in pair]
            scale, _ = scale_of_force(*pair[0])
            found[name] = _ratio(float(np.linalg.norm(forces[1] - forces[0])), scale)
    return found


def _with_integrals(problem: Problem, state: State) -> _Solved:
    """The state, with integrals where it has stresses only."""
    if state.integrals is not None or state.stresses is None:
        return problem, state
    return problem, dataclasses.replace(
        state, integrals=stress_integrals(problem.mesh, state.stresses)
    )


def _energy(problem: Problem, state: State) -> float:
    of_cells = dataclasses.replace(state, integrals=None) if state.degree == 1 else state
    found = strain_energy(problem, of_cells, Part(np.zeros(0, np.int32), np.zeros((0, 3))), "")
    return 0.0 if found is None else found.value


def _over_cells(problem: Problem, own: Problem, state: State) -> State:
    """The state at the case's points, its stress by means over the case's cells."""
    assert state.integrals is not None
    sigma: Floats = state.integrals.cauchy
    if len(sigma) != problem.mesh.num_cells:
        volumes = signed_volumes(own.mesh.points, own.mesh.cells)[:, None, None]
        sigma = mean_over_parents(volumes * sigma) / mean_over_parents(volumes)
    integrals = StressIntegrals(sigma, np.zeros_like(problem.mesh.points))
    return dataclasses.replace(at_points_of(problem.mesh, state), integrals=integrals)


def _force(problem: Problem, own: Problem, state: State, part: Part) -> Floats:
    """Force of a support on the body, pressures on its points left out; or through a cut [N]."""
    assert state.integrals is not None
    if part.support is not None:
        return np.array([reaction(own, state, part, axis).value for axis in "xyz"])
    is_cut = len(part.weights) != own.mesh.num_points
    weights = at_refined_points(problem.mesh, part.weights) if is_cut else part.weights
    force: Floats = resultant(own, state.integrals, dataclasses.replace(part, weights=weights))
    return force


def _ratio(apart: float, scale: float) -> float:
    return apart / scale if scale > 0.0 else (0.0 if apart == 0.0 else float("inf"))


def shape_of(references: ReferenceSet) -> str:
    """The surface that the case's mesh approximates, in words; empty where none is stored."""
    return str(_record(references).get("of", ""))


def _record(references: ReferenceSet) -> Mapping[str, Any]:
    record = references.provenance.get(GEOMETRY)
    return record if isinstance(record, dict) else {}


def geometry_notes(case: Case, references: ReferenceSet) -> list[str]:
    """What a reader must know of the geometry part: where it is missing, and why.

    Args:
        case: The case.
        references: The references of the case, stored or solved here.
    """
    if not any(spec.against == "truth" for spec in case.checks):
        return []
    of, record, problem = name_of_body(case), _record(references), case.problem
    anew = f"`palpate reference build {case.name if case.is_builtin else case.path.name}`"
    notes = []
    if not of and case.spec.geometry.shape is None:
        notes.append(
            "The truth is that of this polyhedron: what its facets leave out of a curved body is "
            "in no bar; [truth] surface or geometry_distance in the case tells it."
        )
    elif of and "of" not in record and any(references.truth(strain) for strain in Strain):
        notes.append(
            f"This truth has no geometry part: what flat facets leave out of {of} is in no bar; "
            f"{anew} works it out."
        )
    elif of and "of" in record:
        if (record["of"], record.get("surface", "")) != (of, surface_key(case)):
            notes.append(
                f"The geometry part of this truth is of {record['of']} as it was when it was "
                f"built, and the case has {of} now: {anew} makes it anew."
            )
        notes += _notes_of_part(case, of, record)
    if problem.inclusions:
        notes.append(
            "Inclusions are the cells that the mesh gives them: how far those are from their true "
            "shape is in no bar."
        )
    return notes


def _notes_of_part(case: Case, of: str, record: Mapping[str, Any]) -> list[str]:
    failures, in_case_units = record.get("failures", {}), case.spec.units.in_case_units
    notes = [
        f"What {of} adds ({strain} strain) is not known: there {in_case_units(str(why))}"
        for strain, why in (failures.items() if isinstance(failures, dict) else ())
    ]
    notes = [note if note.endswith(".") else f"{note}." for note in notes]
    if case.problem.tools:
        notes.append(
            "Tools keep their paths in space: where the true surface is nearer, or farther, they "
            "press deeper or less, and that is in the geometry part."
        )
    if case.problem.time is not None and record.get("degree") == 1:
        notes.append(
            "The geometry part of this motion is from two runs of linear tetrahedra with "
            f"{record.get('steps_per_output')} steps from output to output: up to 15 % short, "
            "which its factor of safety makes good."
        )
    return notes
