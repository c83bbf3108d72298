"""Poses of the live page as they are judged: what was written beside a case, brought to rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.errors import FastsimError, RelaxationFailedError
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.result_files import ResultFile
from palpate.validation.live.pointer import RESTS
from palpate.validation.states import Progress, State

# Relaxation ends at this relative residual, or after so many steps; then Newton's method goes on.
_NEARLY, _MOST_STEPS = 1e-5, 30_000


class PoseOfPane(NamedTuple):
    """The pose of the body in a pane: strain measure and element are those it is stepped with.

    `displacement` [m] has shape (num_points, 3), `force` of the body on the tool [N] (3,). `to_go`
    is what is left of its motion over its largest displacement [-], and `why` says for what reason
    it cannot be judged, if there is one.
    """

    name: str
    strain: Strain
    element: Element
    displacement: Points
    force: Floats
    to_go: float = 0.0
    why: str = ""

    def state(self, problem: Problem, strain: Strain) -> State:
        """The pose as a candidate's solution for a strain measure.

        Raises:
            CandidateFailedError: It is no usable solution.
        """
        about: dict[str, Any] = {}
        if problem.tools:
            about["tool_forces"] = [self.force.tolist()]
        values = self.displacement[None]
        result = ResultFile(Path(self.name), values, are_positions=False, times=None, about=about)
        return state_of_result(result, problem, self.name, strain, element=self.element)


def read_pose(path: Path) -> list[PoseOfPane]:
    """Read what `recording.write_pose` wrote beside the case."""
    with np.load(path, allow_pickle=False) as given:
        keys = ("names", "strain", "element", "displacement", "force", "to_go")
        rows = zip(*(given[key] for key in keys), strict=True)
        return [
            PoseOfPane(str(n), Strain(s), Element(e), u, f, float(g)) for n, s, e, u, f, g in rows
        ]


def at_rest(problem: Problem, pane: PoseOfPane, progress: Progress) -> tuple[PoseOfPane, str]:
    """The equilibrium near the pose of a pane that still moves.

    Dynamic relaxation goes on from the pose with the damping that suits it, and Newton's method
    with contact ends in the equilibrium.

    Args:
        problem: Of the pose's case, which is static.
        pane: The pose; one that is at rest is returned as it is.
        progress: Called with a line of text now and then.

    Returns:
        The pose at rest, or the given one with the reason why there is none; and what was done, in
        a sentence, which is empty where nothing was.
    """
    if pane.to_go <= RESTS:
        return pane, ""
    progress(f"{pane.name}: bringing it to rest")
    common: dict[str, Any] = {"strain": pane.strain, "element": pane.element}
    near = pane.displacement
    try:
        try:
            near = relax(
                problem, **common, start=near, relative_tolerance=_NEARLY, max_steps=_MOST_STEPS
            ).displacement
        except RelaxationFailedError as error:
            near = error.displacement
        progress(f"{pane.name}: looking for its equilibrium")
        if problem.tools:
            pressed = solve_contact(problem, **common, start=near)
            rested, force = pressed.displacements[-1], pressed.forces[-1, 0]
        else:
            rested, force = solve_static(problem, **common, start=near).displacement, pane.force
    except FastsimError as error:
        why = f"the body does not rest in this pose, and no equilibrium near it was found: {error}"
        return pane._replace(why=why), f"{pane.name}: {why}"
    moved = 1e3 * float(np.linalg.norm(rested - pane.displacement, axis=1).max())
    done = f"{pane.name}: brought to rest by the static solver, which moves no point by more than "
    return pane._replace(displacement=rested, force=force, to_go=0.0), f"{done}{moved:.2g} mm"
