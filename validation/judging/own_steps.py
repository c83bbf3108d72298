"""The reference by the scheme and step that a candidate states, in the place of the case's."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.metrics.numerical_damping import measure_numerical_damping
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Progress, State


def are_the_cases(problem: Problem, steps: Steps | None) -> bool:
    """Whether a candidate's steps are those of the case: its time step by central differences."""
    if steps is None or problem.time is None:
        return True
    return steps == Steps(Integrator.CENTRAL_DIFFERENCES, problem.time.time_step or steps.time_step)


def with_own_steps(
    problem: Problem,
    answers: Mapping[Strain, State],
    references: ReferenceSet,
    progress: Progress,
) -> ReferenceSet:
    """The set with the same mesh stepped as each answer states: what is left is the solver's.

    Args:
        problem: The case's.
        answers: Of the candidate, of one element.
        references: Of that element.
        progress: Called with one line for each run.

    Returns:
        As it was, where the answers state no steps of their own.
    """
    from palpate.validation.references.runs import solve_by_steps

    for strain, answer in answers.items():
        if are_the_cases(problem, answer.steps):
            continue
        assert answer.steps is not None
        note = (
            f"Same mesh, {strain} strain: the reference solved here by {answer.steps}, as "
            f"{answer.label} states it."
        )
        state, failure = None, ""
        try:
            state = solve_by_steps(problem, strain, answer.steps, progress, element=answer.element)
        except (ReferenceFailedError, InputError) as error:
            failure = f"the same mesh by {answer.steps}: {error}"
        references = references.with_same_mesh(strain, state, note, failure)
    return references


def notes_on_damping(problem: Problem, answers: Mapping[Strain, State]) -> list[str]:
    """A sentence on the numerical damping of each answer that states its steps and swings."""
    notes = []
    for strain, answer in answers.items():
        if answer.steps is None:
            continue
        try:
            found = measure_numerical_damping(problem, answer)
        except InputError:  # nothing swings long enough: nothing is measured
            continue
        notes.append(f"{answer.label}, {strain} strain: {found}.")
    return notes
