"""One solve by the reference, whatever the case asks for: statics or motion, with tools or not."""

from __future__ import annotations

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.result import Formulation
from palpate.validation.references.motion_runs import (
    STEPS_PER_OUTPUT,
    solve_explicit,
    solve_implicit,
)
from palpate.validation.references.sets import solve_state
from palpate.validation.states import Progress, State


def solve_reference(
    problem: Problem,
    strain: Strain,
    degree: int,
    progress: Progress,
    *,
    formulation: Formulation = Formulation.DISPLACEMENT,
    element: Element = Element.LINEAR,
) -> State:
    """The reference's answer to a problem.

    A motion of degree 1 takes the problem's own steps, explicitly, where it states one; every
    other is implicit, with four steps from output to output.

    Args:
        problem: In statics with the tools at the end of their paths.
        strain: Strain measure.
        degree: Of the elements, 1 or 2.
        progress: Called with one line now and then.
        formulation: Of statics: with pressure among the unknowns where MIXED.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        InputError: A motion with tools or of smoothed tetrahedra that is not of degree 1 with a
            stated step, a mixed motion, or an element, load or tool that cannot be used.
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    if problem.time is None:
        return solve_state(
            problem, strain, degree, progress, formulation=formulation, element=element
        )
    if formulation is Formulation.MIXED:
        raise InputError(
            "the mixed formulation finds equilibrium, and this problem is a motion; leave it out"
        )
    if degree == 1 and problem.time.time_step is not None:
        return solve_explicit(problem, strain, progress, element=element)
    if element is Element.SMOOTHED:
        raise InputError(
            "the reference moves smoothed tetrahedra by explicit steps only: take degree 1, and "
            "give time_step in [time]"
        )
    if problem.tools:
        raise InputError(
            "the reference moves tools by explicit steps only: take degree 1, and give time_step "
            "in [time]"
        )
    return solve_implicit(problem, strain, STEPS_PER_OUTPUT, progress, degree=degree)
