"""References of a motion by the steps that a simulator states, and by other laws; kept like truths.

What the scheme and its step do is told apart from what the solver leaves, and from another law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem, Strain, with_law
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.judging.case_references import are_the_cases
from palpate.validation.peers.board_kept import Kept, key_of
from palpate.validation.peers.board_truths import made_by
from palpate.validation.references.reference_set import OF_ELEMENT, ReferenceSet
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.references.stored import (
    MissingReferenceError,
    UntrustedReferenceError,
    problem_key,
    read_reference,
    write_reference,
)
from palpate.validation.states import Progress, State

# Cells times steps of one run, which takes some minutes then; and of each of several laws.
_WORK, _WORK_OF_A_LAW = 2e7, 2e6
# Another law must leave at most this part of the distance from the stated one.
_EXPLAINS = 0.1
# Distances below this part of the largest displacement are nobody's law.
_NOT_A_LAW = 1e-3


@dataclass(frozen=True)
class OwnSteps:
    """Where such references come from.

    Attributes:
        kept: Where they are kept.
        progress: Called with one line for each run.
    """

    kept: Kept
    progress: Progress

    def of(self, problem: Problem, answer: State) -> State | None:
        """The same mesh as the answer's simulator says that it steps; None where it does not say.

        None too where that would take too long, or there is no such reference.
        """
        if answer.steps is None or are_the_cases(problem, answer.steps):
            return None
        return self._solve(problem, answer.strain, answer.element, answer.steps, _WORK)

    def followed(self, problem: Problem, answer: State, stated: State) -> tuple[str, State] | None:
        """Another law that the answer follows, by its own steps or the case's, and its motion.

        Args:
            problem: Under the law that is stated.
            answer: Of the simulator.
            stated: The reference of that law by the same steps.

        Returns:
            Its name and motion; "" and `stated` where no other law explains it better; None where
            none could be tried.
        """
        span = problem.time
        apart = distance(answer.displacements, stated.displacements)
        steps = answer.steps
        if apart <= _NOT_A_LAW:
            return "", stated
        if span is None or problem.tools:
            return None
        if steps is None:
            if span.time_step is None:
                return None
            steps = Steps(Integrator.CENTRAL_DIFFERENCES, span.time_step)
        nearest: tuple[float, str, State] | None = None
        is_tried = False
        for law in Law:
            try:
                other = with_law(problem, law)
            except InputError:
                continue
            if law is problem.material.law:
                continue
            found = self._solve(other, answer.strain, answer.element, steps, _WORK_OF_A_LAW)
            if found is None:
                continue
            is_tried = True
            left = distance(answer.displacements, found.displacements)
            if left <= _EXPLAINS * apart and (nearest is None or left < nearest[0]):
                nearest = left, law.value, found
        if nearest is None:
            return ("", stated) if is_tried else None
        return nearest[1:]

    def _solve(
        self, problem: Problem, strain: Strain, element: Element, steps: Steps, most: float
    ) -> State | None:
        assert problem.time is not None
        if not problem.mesh.num_cells * problem.time.end_time / steps.time_step <= most:
            return None
        name = f"steps-{problem.material.law}"
        key = key_of(problem_key(problem), strain, element, str(steps), *made_by())
        path = self.kept.path(name, key, ".npz")
        place = OF_ELEMENT[element], strain
        try:
            found, made_for = read_reference(path)
            if made_for == key:
                return found.states[place]
        except (MissingReferenceError, UntrustedReferenceError, KeyError):
            pass
        try:
            state = solve_by_steps(problem, strain, steps, self.progress, element=element)
        except (ReferenceFailedError, InputError):
            return None
        if not np.isfinite(state.displacements).all():
            return None
        write_reference(path, name, key, ReferenceSet({place: state}, {}, str(steps)), {})
        return state
