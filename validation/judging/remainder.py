"""What an error is called that neither strain, mesh nor time step accounts for.

It is the solver's only where the answer keeps the stated equations, or where the simulator says of
itself that it stopped this early: of a motion, that it takes so many iterations in each step of a
scheme that it states, which a sweep over both may refute. A wrong law, load or unit is called by
its name where the diagnosis found it; else the error is not explained.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.meshes.problem import Problem
from palpate.validation.diagnosis import Cause, Diagnosis
from palpate.validation.diagnosis.diagnose import equations_left
from palpate.validation.diagnosis.explanation import CONVERGED, SINGLE
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.states import State

SOLVER = "solver"
UNEXPLAINED = "not explained by mesh, time or solver"
# A simulator measures its residual in a norm of its own.
_NORMS_DIFFER = 10.0
# Nobody stops earlier on purpose.
_MOST_SAID = 0.1
_SOLVERS = (Cause.AGREES, Cause.PRECISION)


def name_of_rest(
    problem: Problem,
    candidate: State,
    same_mesh: State | None = None,
    diagnoses: Sequence[Diagnosis] = (),
) -> str:
    """The name of what is left of a candidate's error on the same mesh, strain and step.

    Args:
        problem: The case's problem.
        candidate: Its answer at the case's points.
        same_mesh: The reference's there, for motions, which have no residual.
        diagnoses: Of the case, if it was red.
    """
    which = (candidate.strain, candidate.element)
    mine = [d for d in diagnoses if (d.strain, d.element) == which]
    first = mine[0].first if mine else None
    if first is not None:
        return SOLVER if first.cause in _SOLVERS else f"explained: {first.name}"
    if problem.time is not None:
        motions = [s.trajectory for s in (candidate, same_mesh) if s is not None]
        if len(motions) == 2 and motions[0] is not None and motions[1] is not None:
            apart = distance(motions[0].displacements, motions[1].displacements)
            return SOLVER if apart <= SINGLE or _stops_early(candidate) else UNEXPLAINED
        return UNEXPLAINED
    left = equations_left(problem, candidate)
    said = candidate.details.get("relative_residual")
    allowed = CONVERGED
    if isinstance(said, float) and 0.0 < said <= _MOST_SAID:
        allowed = max(allowed, _NORMS_DIFFER * said)
    return SOLVER if left <= allowed else UNEXPLAINED


def _stops_early(candidate: State) -> bool:
    """Whether a motion's simulator states its scheme, and iterations that it stops after."""
    iterations = candidate.says.get("iterations")
    return candidate.steps is not None and isinstance(iterations, int) and iterations > 0
