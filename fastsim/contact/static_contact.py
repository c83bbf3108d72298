"""Equilibrium with rigid tools, knot by knot along their paths: force against depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.contact.contact_law import (
    ContactForm,
    ContactLaw,
    layer_stiffness,
    mean_edge,
    require_larger_than_gaps,
    require_outside,
)
from palpate.fastsim.contact.contact_term import ContactTerm
from palpate.fastsim.contact.errors import ContactLostError, FacetContactError
from palpate.fastsim.contact.tool_contact import ToolContact, on_tool, poses_at
from palpate.fastsim.newton import Newton
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.rigid_tool import (
    BoxShape,
    ContactRule,
    ForceDrive,
    RigidTool,
    require_drive_of_statics,
)

# Penalty in layers of cells: presses as much as a hundredth of a layer.
STIFFNESS_IN_LAYERS = 100.0
# Over facets, as in motion; multipliers of neighbours are coupled there, and with a softer penalty
# fewer of them become active and inactive in turn while they are found.
_LAYERS_OVER_FACETS = 10.0
# Multipliers are settled when they change by no more than this.
_SETTLED = 1e-9
_MOST_UPDATES = 40
# Relative residual of the prediction.
_ROUGH = 1e-3
# Relative residual before the first update of the multipliers, and then over their last change.
_ROUGH_START = 1e-1
_PART_OF_CHANGE = 1e-2
# Multipliers that change by more than this part of their last change are found with a penalty that
# is so much stiffer, up to so many times the first.
_SLOW = 0.14
_STEP_OF_STIFFNESS = 10.0
_STIFFEST = 100.0
# The end of the path that can be borne is found to this part of it.
_SMALLEST_STEP = 1.0 / 1024.0


@dataclass(frozen=True, eq=False)
class ContactResult:
    """Equilibria at the knots of the tools' paths.

    Attributes:
        times: Load parameter at the knots, shape (n,); of a tool that is driven by a force the way
            along its line [m], at its start (0) and where it rests.
        displacements: [m], shape (n, num_points, 3).
        forces: On each tool [N], shape (n, num_tools, 3).
        moments: On each tool about its origin [N m], shape (n, num_tools, 3).
        areas: Rest area of the vertices (points of facets, with a penalty over these) that each
            tool presses [m2], shape (n, num_tools).
        penetrations: Deepest of them in each tool [m], >= 0, shape (n, num_tools); with the
            constraint over facets by the gaps that are averaged for the vertices.
        smallest_det_f: At each knot [-], shape (n,).
        stiffnesses: Penalty of each tool [Pa/m].
        iterations: Newton iterations in all.
        linear_iterations: Conjugate-gradient iterations in all.
        residual_history: Residual history of the last Newton solve.
    """

    times: Floats
    displacements: Floats
    forces: Floats
    moments: Floats
    areas: Floats
    penetrations: Floats
    smallest_det_f: Floats
    stiffnesses: tuple[float, ...]
    iterations: int
    linear_iterations: int
    residual_history: tuple[float, ...]


def solve_contact(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    law: ContactLaw | None = None,
    times: Floats | None = None,
    start: Points | None = None,
    relative_tolerance: float = 1e-10,
    max_iterations: int = 40,
    progress: Callable[[str], None] | None = None,
) -> ContactResult:
    """Find the equilibria R(a) = F + contact at the knots of the tools' paths.

    The loads act in full at the first knot; from there on the tools move.

    Args:
        problem: With at least one tool, on paths; or one that is driven by a force, of which the
            amplitude does not matter. With friction the result depends on the steps.
        strain: Engineering or finite strain.
        element: Plain or smoothed.
        law: Penalty or constraint; None is the constraint.
        times: Times of the paths at which results are wanted, increasing; None is every knot.
        start: A displacement near the equilibrium at the end of the paths [m], shape
            (num_points, 3), from which that one alone is sought, without the way there; no tool
            is driven by a force then.
        relative_tolerance: Out-of-balance force over loads or contact forces.
        max_iterations: Newton iterations per step.
        progress: Called with one line per knot.

    Returns:
        The equilibria. With the constraint no vertex (no averaged gap, over facets) is deeper than
        1e-9 of what its penalty would leave.

    Raises:
        InputError: A tool driven by a force beside others, with friction, from too near or with a
            start; or friction with a penalty.
        UnsupportedBodyError: The body can float.
        FacetContactError: The constraint over facets with a box, across whose edges gaps are not
            averaged.
        ToolInsideError: A tool is in the body at the first knot.
        ContactLostError: No (stable) equilibrium beyond a time; carries the results before it.
    """
    law = law or ContactLaw()
    _require_known_to_statics(problem, law.form)
    require_supported(problem)
    is_penalty = law.form is ContactForm.PENALTY
    contacts = [ToolContact(problem, tool, is_penalty=is_penalty) for tool in problem.tools]
    stiffnesses = [
        law.stiffness or layers_of_penalty(contact.tool) * layer_stiffness(problem, contact.facets)
        for contact in contacts
    ]
    for number, contact in enumerate(contacts):
        require_larger_than_gaps(problem, contact, number)
        require_outside(problem, contact, number, np.zeros_like(problem.mesh.points))
    term = ContactTerm(contacts, stiffnesses)
    newton = Newton(problem, strain, relative_tolerance, max_iterations, element=element, term=term)
    path = _Path(problem, newton, term, law.form)
    wanted = _knots(problem) if times is None else np.asarray(times, dtype=np.float64)
    is_driven = problem.tools[0].drive is not None
    if start is not None:
        if is_driven:
            raise InputError("a tool that is driven by a force has no start; leave it out")
        wanted = wanted[-1:]
        reason = path.go_on_from(newton.body.checked(start), float(wanted[0]))
    else:
        reason = path.load(0.0 if is_driven else wanted[0])
    if not reason and problem.tools[0].drive is not None:
        reason = path.drive(problem.tools[0].drive)
    for time in () if reason or is_driven else wanted[1:]:
        reason = path.press(time, float(wanted[-1] - wanted[0]))
        if reason:
            break
        if progress:
            progress(f"t = {time:.4g}: {newton.iterations} iterations")
    if reason:
        partial = path.partial(stiffnesses)
        body = newton.body
        crushed = body.crushed_cell(path.displacement) if body.folds else None
        raise ContactLostError(path.time, reason, partial, crushed=crushed)
    return path.result(stiffnesses)


class _Path:
    """The state along the path, and the results at its knots."""

    def __init__(
        self, problem: Problem, newton: Newton, term: ContactTerm, form: ContactForm
    ) -> None:
        self.newton = newton
        self.term = term
        self.displacement = np.zeros_like(problem.mesh.points)
        self.time = 0.0
        self.rows: list[tuple[float, Points, list[Points], list[float], list[float], float]] = []
        self.history: list[float] = []
        self._problem = problem
        self._form = form
        # As the gaps of neighbours are coupled, multipliers that are far off are not worth solving
        # for to the last digit.
        is_coupled = any(tool.contact is ContactRule.FACETS for tool in problem.tools)
        is_rough = is_coupled and form is ContactForm.CONSTRAINT
        self._first_tolerance = _ROUGH_START if is_rough else 0.0
        self._shortest_step = np.inf

    def go_on_from(self, start: Points, time: float) -> str:
        """Find the equilibrium at a time near a displacement; return why there is none, or empty.

        First with the forces on the tools that balance there, which far from an equilibrium are
        far too large; then without.
        """
        term, reason = self.term, ""
        self.time = time
        for is_borne in (True, False):
            self.displacement = start
            term.poses = self._poses(time)
            if is_borne:
                term.bear(start, -self.newton.residual_at(start))
            else:
                term.multipliers = [0.0 * of for of in term.multipliers]
                term.settled = list(term.multipliers)
            term.keep(start, term.poses)
            term.poses = []
            reason = self._settle(time, 1.0)
            if not reason:
                self._keep()
                break
        return reason

    def load(self, time: float) -> str:
        """Raise the loads at the first pose; return the reason of a failure, else empty."""
        self.time = float(time)
        factor, step = 0.0, 1.0
        self.term.keep(self.displacement, self._poses(self.time))
        while factor < 1.0:
            target = min(1.0, factor + step)
            reason = self._settle(self.time, target)
            if not reason:
                factor = target
                continue
            step *= 0.5
            if step < _SMALLEST_STEP:
                return f"{reason}, at {factor:.4g} of the loads"
        self._keep()
        return ""

    def press(self, end: float, span: float) -> str:
        """Move the tools on to a time; return the reason of a failure, else empty."""
        step = end - self.time
        self._shortest_step = 2.0 * _SMALLEST_STEP * span
        while self.time < end:
            target = end if self.time + 1.001 * step >= end else self.time + step
            reason = self._settle(target, 1.0)
            if not reason:
                self.time = target
                continue
            step *= 0.5
            if step < _SMALLEST_STEP * span:
                return reason
        self._keep()
        return ""

    def drive(self, drive: ForceDrive) -> str:
        """Push the tool along its line to its force; return the reason of a failure, else empty."""
        contact, direction = self.term.contacts[0], np.array(drive.direction)
        lacking = drive.force - self._taken(direction)
        if lacking < 0.0:
            raise InputError(
                f"where the tool starts the body pushes it back with {drive.force - lacking:.4g} N,"
                f" more than the {drive.force:.4g} N it is driven by; start it farther away"
            )
        points = self._problem.mesh.points
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        start = self.term.poses[0]["position"]
        farthest = 2.0 * (size + float(np.linalg.norm(points.mean(axis=0) - start)))
        longest = step = 0.25 * mean_edge(self._problem, contact.facets)
        self._shortest_step = 2.0 * _SMALLEST_STEP * longest
        while lacking > 0.0:
            low = self.time, lacking
            gaps = self.term.pressed(self.displacement)[0].gaps
            clear = float(gaps.distances.min(initial=np.inf))
            way = self.time + max(step, clear)
            if way > farthest:
                return "the tool passes the body; aim it at the body"
            reason = self._settle(way, 1.0)
            if reason:
                step *= 0.5
                if step < _SMALLEST_STEP * longest:
                    return reason
                continue
            self.time, lacking = way, drive.force - self._taken(direction)
        # Regula falsi; the value of an end that stays twice is halved ("Illinois").
        high, stayed = (self.time, lacking), 0
        for _ in range(_MOST_UPDATES):
            if abs(lacking) <= _SETTLED * drive.force:
                self._keep()
                return ""
            way = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
            reason = self._settle(way, 1.0)
            if reason:
                return reason
            self.time, lacking = way, drive.force - self._taken(direction)
            if lacking > 0.0:
                low, high = (way, lacking), (high[0], high[1] * (0.5 if stayed > 0 else 1.0))
                stayed = 1
            else:
                low, high = (low[0], low[1] * (0.5 if stayed < 0 else 1.0)), (way, lacking)
                stayed = -1
        return "the force was not met"

    def _taken(self, direction: Floats) -> float:
        """Force of the first tool on the body along its line [N]."""
        return float(self.term.vectors(self.displacement)[0].sum(axis=0) @ direction)

    def partial(self, stiffnesses: list[float]) -> ContactResult | None:
        """Results so far, with the last equilibrium; None before the loads act in full."""
        if not self.rows:
            return None
        if self.time > self.rows[-1][0]:
            self._keep()
        return self.result(stiffnesses)

    def result(self, stiffnesses: list[float]) -> ContactResult:
        times, states, on_tools, areas, depths, dets = zip(*self.rows, strict=True)
        forces, moments = np.split(np.array(on_tools), 2, axis=2)
        return ContactResult(
            times=np.array(times),
            displacements=np.array(states),
            forces=forces,
            moments=moments,
            areas=np.array(areas),
            penetrations=np.array(depths),
            smallest_det_f=np.array(dets),
            stiffnesses=tuple(stiffnesses),
            iterations=self.newton.iterations,
            linear_iterations=self.newton.linear_iterations,
            residual_history=tuple(self.history),
        )

    def _settle(self, time: float, factor: float) -> str:
        """Equilibrium with the tools where they are at a time; multipliers too."""
        newton, term = self.newton, self.term
        # Updates make new arrays: the old ones stay as they are.
        before = list(term.multipliers), list(term.poses)
        poses = self._poses(time)
        displacement = self.displacement
        if term.poses:
            displacement = self._predict(poses, factor)
        term.poses = poses
        reason = "the multipliers did not settle"
        tolerance, rough = newton.tolerance, self._first_tolerance
        stiffer, last_change = 1.0, np.inf
        for _ in range(_MOST_UPDATES):
            newton.tolerance = max(tolerance, rough)
            try:
                outcome = newton.solve(displacement, factor)
            finally:
                is_rough, newton.tolerance = newton.tolerance > tolerance, tolerance
            if outcome.displacement is None:
                reason = outcome.reason
                break
            displacement, self.history = outcome.displacement, outcome.history
            term.settle(displacement)
            slid, is_again = term.move_round_edges(displacement)
            if is_again:
                reason = "a vertex slides to and fro over an edge of a box"
                break
            if slid:
                continue
            is_penalty = self._form is ContactForm.PENALTY
            change = 0.0 if is_penalty else self._update(displacement)
            rough = _PART_OF_CHANGE * change if is_rough else 0.0
            if self._first_tolerance and change > _SLOW * last_change and stiffer < _STIFFEST:
                stiffer *= _STEP_OF_STIFFNESS
                term.stiffen(stiffer)
            last_change = change
            if change <= _SETTLED and not is_rough:
                too_far = term.why_too_far(self._problem, displacement, before[1] or poses)
                if too_far and abs(time - self.time) > self._shortest_step:
                    reason = too_far
                    break
                self.displacement = displacement
                term.stiffen(1.0)
                term.keep(displacement, poses)
                return ""
        term.stiffen(1.0)
        term.multipliers, term.poses = before
        term.go_back()
        if term.poses:
            term.settle(self.displacement)
        return reason

    def _update(self, displacement: Points) -> float:
        """Update the multipliers; return how much they changed, over their size.

        The multipliers of a tool that only just touches are rounding errors and never settle.
        """
        change, size = self.term.update_multipliers(displacement)
        if change <= max(_SETTLED * size, self.term.rounding_error(self.newton.body)):
            return 0.0
        return change / size if size > 0.0 else 1.0

    def _predict(self, poses: list[NDArray[np.void]], factor: float) -> Points:
        """Rough displacement with the tools at other poses, to start from."""
        tolerance, self.newton.tolerance = self.newton.tolerance, _ROUGH
        try:
            with self.term.going_to(poses):
                outcome = self.newton.solve(self.displacement, factor)
        finally:
            self.newton.tolerance = tolerance
        return self.displacement if outcome.displacement is None else outcome.displacement

    def _poses(self, time: float) -> list[NDArray[np.void]]:
        poses = [poses_at(c.tool.path, np.array([time]))[0] for c in self.term.contacts]
        for contact, pose in zip(self.term.contacts, poses, strict=True):
            if contact.tool.drive is not None:
                # Of such a tool the time is the way along its line.
                pose["position"] += time * np.array(contact.tool.drive.direction)
        return poses

    def _keep(self) -> None:
        term, u = self.term, self.displacement
        on_tools, areas, depths = [], [], []
        for contact, pose, pressed, force in zip(
            term.contacts, term.poses, term.pressed(u), term.vectors(u), strict=True
        ):
            on_tools.append(on_tool(contact, u, force, pose))
            areas.append(float(contact.sampling.areas[pressed.push > 0.0].sum()))
            depths.append(float(max(0.0, -pressed.averages.min(initial=0.0))))
        smallest = self.newton.body.smallest_det_f(u)[0]
        self.rows.append((self.time, u.copy(), on_tools, areas, depths, smallest))


def layers_of_penalty(tool: RigidTool) -> float:
    """The default penalty over the stiffness of a layer of cells."""
    is_over_facets = tool.contact is ContactRule.FACETS
    return _LAYERS_OVER_FACETS if is_over_facets else STIFFNESS_IN_LAYERS


def _knots(problem: Problem) -> Floats:
    knots: Floats = np.unique(np.concatenate([tool.path.times for tool in problem.tools]))
    return knots


def _require_known_to_statics(problem: Problem, form: ContactForm) -> None:
    if not problem.tools:
        raise InputError("no tool: use palpate.fastsim.statics.solve_static")
    require_drive_of_statics(problem.tools)
    for number, tool in enumerate(problem.tools, start=1):
        is_box = isinstance(tool.shape, BoxShape) and tool.contact is ContactRule.FACETS
        if is_box and form is ContactForm.CONSTRAINT:
            # Beyond an edge the distance is one to the side, whose average over a facet that the
            # edge crosses is no gap.
            what = "with a box it is a penalty, since gaps are not averaged across its edges"
            raise FacetContactError(number - 1, what)
        if tool.friction_coefficient > 0.0 and form is ContactForm.PENALTY:
            raise InputError(
                f"tool {number} has friction: statics know it with the constraint, not a penalty"
            )
