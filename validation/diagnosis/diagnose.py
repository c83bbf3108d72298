"""Try every explanation of a wrong result and keep those that fit.

1. Mistakes of the result itself, compared with the reference on the same mesh.
2. Mistakes of the problem, by the judge's own equations with that mistake in them, at the
   candidate's result: no reference is needed for these.
3. Families that take in simpler ones, only where none of those fits.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.conversions import LENGTH
from palpate.validation.diagnosis.explanation import (
    CONVERGED,
    DOUBLE,
    LENGTH_UNITS,
    OF_DISPLACEMENT,
    OF_FORCE,
    SINGLE,
    Cause,
    Diagnosis,
    Explanation,
    choose,
    displacement_words,
)
from palpate.validation.diagnosis.material_hypotheses import (
    anisotropy_hypotheses,
    law_hypotheses,
    material_hypotheses,
)
from palpate.validation.diagnosis.motion_hypotheses import (
    motion_hypotheses,
    own_steps_of,
    stepper_of,
)
from palpate.validation.diagnosis.result_hypotheses import (
    Ask,
    Fields,
    distance,
    isotropy_hypotheses,
    plain_hypotheses,
    result_hypotheses,
)
from palpate.validation.diagnosis.static_hypotheses import (
    StaticResult,
    each_load_apart,
    load_hypotheses,
    support_hypotheses,
    tool_force_hypotheses,
    tool_hypotheses,
    turned_loads,
)
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.laws import OTHER_STRAIN
from palpate.validation.states import CandidateFailedError, State

_OWN_MESH = "The result is on a mesh of its own: only units were tried"
# Mistakes of units in a result on a mesh of its own: what that mesh may be off at most.
_MESH_ERROR = 0.2
# Equations that fail at so small a part of the points fail there, and not everywhere.
_FEW = 0.1


def diagnose(
    problem: Problem,
    candidate: State,
    reference: State | None,
    *,
    other_strain: State | None = None,
    ask: Ask | None = None,
    length_unit: str = "mm",
) -> Diagnosis:
    """What explains the result of a candidate that a gate has failed, the simplest first.

    Args:
        problem: The case's problem.
        candidate: The candidate's state; its `strain` is what it was asked for.
        reference: The reference's on the same mesh with that strain, if there is one.
        other_strain: The reference's on the same mesh with the other.
        ask: The candidate's displacement of other problems, where it can be asked again.
        length_unit: Unit in which positions are given: m, cm or mm.
    """
    body = Body(problem, candidate.strain, candidate.element)
    mine, theirs = candidate.displacements, None if reference is None else reference.displacements
    if theirs is not None and theirs.shape != mine.shape:
        theirs = None
    tried: list[Explanation] = []
    hint = ""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if candidate.own is not None:
            tried += _on_own_mesh(mine, theirs)
            hint = _OWN_MESH
        else:
            if theirs is not None:
                other = None
                if other_strain is not None:
                    other = (OTHER_STRAIN[candidate.strain], other_strain.displacements)
                tried += result_hypotheses(mine, theirs, problem.mesh.points, other=other)
            if problem.time is None:
                apart = None if theirs is None else distance(mine, theirs)
                result = StaticResult(body, mine[-1], apart)
                if theirs is None:
                    # Mistakes of the result, where no reference sees them: undone, it balances.
                    for name, fixed in plain_hypotheses(result.displacement, problem.mesh.points):
                        left = StaticResult(body, fixed).stated
                        by_balance = Explanation(name, Cause.RESULT, left, result.stated, OF_FORCE)
                        tried.append(by_balance)
                tried += _statics(result, ask, bool(choose(tried)))
                if reference is not None:
                    tried += tool_force_hypotheses(candidate, reference)
            else:
                stepper, hint = stepper_of(body, candidate)
                if stepper is not None:
                    tried += motion_hypotheses(stepper, mine, own_steps_of(problem, candidate))
        found = choose(tried)
        stated, of = _stated(body, mine, theirs)
        if not found and problem.springs:
            hint = "With springs mechanical mistakes were not tried"
        if not found and not hint and problem.time is None:
            hint = _where(body, mine[-1], length_unit)
    return Diagnosis(
        candidate.strain, found, len({e.name for e in tried}), stated, of, hint, candidate.element
    )


def equations_left(problem: Problem, candidate: State) -> float:
    """Residual of the stated equations at a static result, over the largest nodal force."""
    body = Body(problem, candidate.strain, candidate.element)
    return StaticResult(body, candidate.displacement).stated


def _stated(body: Body, mine: Fields, theirs: Fields | None) -> tuple[float, str]:
    if theirs is not None:
        return distance(mine, theirs), OF_DISPLACEMENT
    if body.problem.time is not None:
        return float("nan"), OF_DISPLACEMENT
    return StaticResult(body, mine[-1]).stated, OF_FORCE


# Families of hypotheses of a static result; the next only where nothing simpler fits.
_FAMILIES = (
    (law_hypotheses, load_hypotheses, support_hypotheses, tool_hypotheses),
    (material_hypotheses, each_load_apart, turned_loads),
    (anisotropy_hypotheses,),
)


def _statics(result: StaticResult, ask: Ask | None, is_found: bool) -> Iterator[Explanation]:
    problem = result.body.problem
    if result.stated <= CONVERGED and not is_found:
        yield result.tried(_agreement(result), Cause.AGREES, 0)
    if problem.springs:
        return
    tried: list[Explanation] = []
    for number, families in enumerate(_FAMILIES):
        if number == 0 or not (is_found or choose(tried)):
            for family in families:
                tried += family(result)
    if ask is not None and not (is_found or choose(tried) or problem.inclusions):
        # Where the candidate cannot solve these problems, nothing is said of isotropy.
        with contextlib.suppress(CandidateFailedError, InputError):
            tried += isotropy_hypotheses(problem, result.displacement, ask)
    yield from tried


def _agreement(result: StaticResult) -> str:
    if result.body.problem.tools:
        return "the stated equations are kept wherever no tool can touch"
    if result.apart is not None and result.apart > SINGLE:
        return (
            "the stated equations are kept, yet the result is not the reference's: another "
            "equilibrium of the same body"
        )
    return "the stated equations are kept on this mesh"


def _on_own_mesh(mine: Fields, theirs: Fields | None) -> Iterator[Explanation]:
    """Mistakes of units alone, to the error that another mesh makes."""
    if theirs is None:
        return
    stated = distance(mine, theirs)
    for factor in LENGTH_UNITS:
        left = distance(mine / factor, theirs)
        name = displacement_words(factor)
        yield Explanation(
            name, Cause.UNITS, left, stated, OF_DISPLACEMENT, limit=_MESH_ERROR
        )  # fmt: skip


def _where(body: Body, displacement: Points, length_unit: str) -> str:
    """Positions where the stated equations fail, if those are few."""
    internal = body.internal(displacement)
    external = body.total(body.loads(displacement))
    scale = max(float(np.abs(internal).max()), float(np.abs(external).max()))
    off = np.where(body.free, np.abs(internal - external), 0.0).max(axis=1)
    bad = np.flatnonzero(~(off <= DOUBLE * scale))
    if not 0 < len(bad) <= _FEW * body.mesh.num_points:
        return ""
    x, y, z = body.mesh.points[bad].mean(axis=0) / LENGTH[length_unit]
    return (
        f"The stated equations hold but at {len(bad)} of {body.mesh.num_points} points, about "
        f"({x:.4g}, {y:.4g}, {z:.4g}) {length_unit}"
    )
