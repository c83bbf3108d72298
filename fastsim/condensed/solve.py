"""A static problem solved by its condensed model: loads, supports, tools along their paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate.fastsim.condensed.condense import MOST_BYTES, condense, condense_once
from palpate.fastsim.condensed.model import CondensedModel
from palpate.fastsim.condensed.setup import (
    NotCondensableError,
    UnsettledContactError,
    surface_points,
)
from palpate.fastsim.condensed.steps import CondensedSteps, StepState, require_known_tool
from palpate.fastsim.contact.contact_law import (
    ContactLaw,
    half_thickness,
    require_larger_than_gaps,
    require_outside,
)
from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.tool_contact import ToolContact
from palpate.fastsim.forces import external_force
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import PointForce, Pressure, Traction
from palpate.meshes.problem import Element, Problem, Strain

# Largest way of a tool in a step, over its half thickness.
_PART_OF_THICKNESS = 0.25
_SMALLEST_STEP = 1.0 / 4096.0


@dataclass(frozen=True, eq=False)
class CondensedResult:
    """A static solution by the condensed model.

    Attributes:
        displacement: Displacement of all points [m], shape (num_points, 3).
        tool_forces: On each tool at the end of its path [N], shape (num_tools, 3).
        num_touched: Points of the compliance.
        model_bytes: Size of the compliance.
        steps: Number of steps of the tools.
        iterations: Newton iterations of contact.
        model_made: When the model was made, where it was read from a folder; else "".
    """

    displacement: Points
    tool_forces: Floats
    num_touched: int
    model_bytes: int
    steps: int
    iterations: int
    model_made: str = ""


def solve_condensed(
    problem: Problem,
    *,
    strain: Strain = Strain.LINEAR,
    element: Element = Element.LINEAR,
    contact: ContactLaw | None = None,
    most_bytes: int = MOST_BYTES,
    folder: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> CondensedResult:
    """Solve a static problem by its condensed model: what `solve_static` finds by linear strain.

    Loads on the boundary act through the compliance of the points that they push, tools through
    that of the points that they may touch.

    Args:
        problem: Statics; tools on paths, without friction, none a box.
        strain: Linear, or refused.
        element: Linear tetrahedra, plain or smoothed.
        contact: How contact is enforced: None is the constraint.
        most_bytes: Memory allowed.
        folder: Where models are stored and read from: see `condense_once`; None stores none.
        progress: Called with one line now and then.

    Returns:
        Displacement of all points, and the forces on the tools at the end of their paths.

    Raises:
        NotCondensableError: Green strain, a motion, or a tool that it does not know.
        UnsupportedBodyError: The body can float.
        CondensedTooLargeError: It needs more memory.
        ToolInsideError, ToolTooSmallError: For the same reasons as in `solve_contact`.
        ContactLostError: A tool's contact does not settle.
    """
    require_posable(problem, strain)
    surface = surface_points(problem)
    pushed = _surface_force(problem, surface)
    touched = np.flatnonzero(np.any(pushed != 0.0, axis=1)).astype(np.int32)
    for tool in problem.tools:
        touched = np.union1d(touched, ToolContact(problem, tool).vertices).astype(np.int32)
    if not len(touched):
        touched = surface[:1]
    # Nodal forces that are not pushed are loads of the model.
    rest = external_force(problem) - pushed
    points = np.flatnonzero(np.any(rest != 0.0, axis=1)).astype(np.int32)
    loads = (PointForce(points, rest[points]),) if len(points) else ()
    make = condense if folder is None else partial(condense_once, folder)
    model = make(
        dataclasses.replace(problem, loads=loads),
        element=element,
        touched=touched,
        seen=touched,
        keep_inside=True,
        most_bytes=most_bytes,
        progress=progress,
    )
    forces = pushed[touched]
    if not problem.tools:
        return _result(model, model.whole_displacement(forces), np.zeros((0, 3)), 0, 0)
    for number, tool in enumerate(problem.tools):
        one = ToolContact(problem, tool)
        require_larger_than_gaps(problem, one, number)
        require_outside(problem, one, number, np.zeros_like(problem.mesh.points))
    way = _Way(CondensedSteps(model, problem.tools, law=contact), forces, progress)
    state = way.go()
    total = forces + way.steps.contact_forces
    return _result(model, model.whole_displacement(total), state.forces, way.count, way.iterations)


def require_posable(problem: Problem, strain: Strain) -> None:
    """Refuse a problem that the condensed model cannot solve, with the reason.

    Raises:
        NotCondensableError: Green strain, a motion, or a tool that it does not know.
    """
    if strain is not Strain.LINEAR:
        raise NotCondensableError(
            "the condensed model adds displacements up, which Green strain does not allow; ask "
            'for linear strain (strain = "linear", --strain linear)'
        )
    if problem.time is not None:
        raise NotCondensableError(
            "the condensed model has no inertia, and this problem is a motion; take statics"
        )
    for number, tool in enumerate(problem.tools, start=1):
        require_known_tool(tool, number)


class _Way:
    """The tools' way along their paths, in steps short enough for contact to settle."""

    def __init__(
        self, steps: CondensedSteps, forces: Points, progress: Callable[[str], None] | None
    ) -> None:
        self.steps = steps
        self.count = self.iterations = 0
        self._paths = [tool.path for tool in steps.tools]
        self._progress = progress
        steps.set_base(forces)

    def go(self) -> StepState:
        """To the end of the paths."""
        knots = np.unique(np.concatenate([path.times for path in self._paths]))
        first = float(knots[0])
        try:
            state = self._step(first)
        except UnsettledContactError as error:
            raise ContactLostError(first, str(error), None) from error
        for begin, end in pairwise(knots.tolist()):
            state = self._between(begin, end, state)
            if self._progress:
                self._progress(f"t = {end:.4g}: {state.touching} vertices touch")
        return state

    def _between(self, begin: float, end: float, state: StepState) -> StepState:
        longest = _PART_OF_THICKNESS * min(half_thickness(t.shape) for t in self.steps.tools)
        lengths = [
            float(np.linalg.norm(path.pose_at(end)[0] - path.pose_at(begin)[0]))
            for path in self._paths
        ]
        count = max(1, int(np.ceil(max(lengths) / longest))) if np.isfinite(longest) else 1
        step, time = (end - begin) / count, begin
        while time < end:
            target = end if time + 1.001 * step >= end else time + step
            try:
                state, time = self._step(target), target
            except UnsettledContactError as error:
                step *= 0.5
                if step < _SMALLEST_STEP * (end - begin) / count:
                    raise ContactLostError(time, str(error), None) from error
        return state

    def _step(self, time: float) -> StepState:
        state = self.steps.step([path.pose_at(time) for path in self._paths])
        self.count += 1
        self.iterations += state.iterations
        return state


def _result(
    model: CondensedModel, displacement: Points, forces: Floats, steps: int, iterations: int
) -> CondensedResult:
    return CondensedResult(
        displacement, forces, len(model.touched), model.num_bytes, steps, iterations, model.made
    )


def _surface_force(problem: Problem, surface: Indices) -> Points:
    """Tractions, pressures and point forces at these points [N], shape (num_points, 3)."""
    loads = tuple(x for x in problem.loads if isinstance(x, Traction | Pressure | PointForce))
    given = external_force(dataclasses.replace(problem, loads=loads))
    force = np.zeros_like(given)
    force[surface] = given[surface]
    return force
