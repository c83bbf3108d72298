"""A tool moved along its path through equilibria, or pushed against a body by a force.

Along a path the tool moves from knot to knot. A tool driven by a force is moved along its line in
steps, with the body in equilibrium at each, until the body pushes back with that force; the
distance is then found between the last two by the regula falsi with halved ends (M. Dowell,
P. Jarratt, BIT 11, 1971: "Illinois").
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, SphereShape, SurfaceShape
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import ToolContact, ToolState
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.load_stepping import SMALLEST_STEP, follow
from palpate.reference.newton import Newton, Outcome
from palpate.reference.result import ToolHistory, Vector

# Uzawa steps end when the multipliers contain the contact forces up to this many times the relative
# tolerance of Newton's iteration, which would not respond to smaller changes of the multipliers.
OVER_NEWTON = 10.0
_CARRIED_ON_THE_WAY = 0.1
_MOST_UZAWA_STEPS = 30
_FEW_ITERATIONS = 12
# Over facets the first solve ends at this relative residual, each further one at a part of the last
# change of the multipliers: the next change corrects what is left, and costs one iteration.
_FIRST_RESIDUAL, _PART_OF_CHANGE = 0.1, 0.01
# Penalties over those of statics, to approach a state that is known from another mesh, and the
# tolerance of each solve. Once the nodes in contact are known, the stiff penalty needs hardly more
# than one step; where they are not, the usual one finds them.
_SOFTER, _STIFFER = (0.1, 1.0, 1.0, 1.0), (100.0, 1.0)
_ROUGHLY = 1e-3
# Where equilibria are asked for less exactly than this, the end of the path that can be borne is
# found to the second: to the first it takes hundreds of iterations.
EXACT, _ROUGH_STEP = 1e-8, 1.0 / 64.0
# A node is assumed to enter a box on a straight line: steps are short, in units of facet size.
_REACH_OF_BOXES = 0.05
# In long steps a node would pass through a round tool, or far round it: in units of its radius.
_REACH_OF_ROUND = 0.25

Report = Callable[[int, float, float], None]


class _Stretch:
    """The tools on their paths from one time to another, under the full load."""

    def __init__(
        self,
        newton: Newton,
        contacts: Sequence[ToolContact],
        begin: float,
        end: float,
    ) -> None:
        self._newton = newton
        self._contacts = contacts
        self._begin, self._end = begin, end

    def _time(self, parameter: float) -> float:
        return self._begin + parameter * (self._end - self._begin)

    def solve(self, start: Floats, parameter: float, *, report: Report | None = None) -> Outcome:
        for contact in self._contacts:
            contact.set_time(self._time(parameter))
            contact.go_back()
        all_of_it = OVER_NEWTON * self._newton.relative_tolerance
        if parameter == 1.0:
            return settle(self._newton, self._contacts, start, all_of_it, report=report)
        # Before the end of the path the penalty alone is nearly accurate enough, and the residual
        # of a state from which nothing but the next one begins.
        forgets = all(contact.forgets_its_way for contact in self._contacts)
        return settle(
            self._newton,
            self._contacts,
            start,
            _CARRIED_ON_THE_WAY,
            enough=_ROUGHLY if forgets else 0.0,
            report=report,
        )

    def is_stable(self, displacement: Floats, parameter: float) -> bool:
        for contact in self._contacts:
            contact.set_time(self._time(parameter))
        return self._newton.is_stable(displacement, 1.0)

    def keep(self, displacement: Floats, parameter: float) -> None:
        for contact in self._contacts:
            contact.set_time(self._time(parameter))
            contact.keep(displacement)


def settle(
    newton: Newton,
    contacts: Sequence[ToolContact],
    start: Floats,
    carried: float,
    *,
    enough: float = 0.0,
    report: Report | None = None,
) -> Outcome:
    """Find the equilibrium with the tools at their present poses: Newton inside, Uzawa outside.

    The last relative residual is at most that of `newton` or, where larger, `enough`.
    """
    u, iterations = start, 0
    is_loose = all(contact.is_averaged for contact in contacts) and bool(contacts)
    tolerance = max(_FIRST_RESIDUAL if is_loose else 0.0, enough)
    enough = max(newton.relative_tolerance, _PART_OF_CHANGE * carried, enough)
    outcome = newton.solve(u, 1.0, report=report, least_tolerance=tolerance)
    for _ in range(_MOST_UZAWA_STEPS):
        iterations += outcome.iterations
        u = outcome.displacement
        if not outcome.converged:
            break
        slid = [contact.let_go(u) for contact in contacts]
        if any(again for _, again in slid):
            reason = "a node slides to and fro over an edge of a box"
            return Outcome(u, outcome.relative_residual, iterations, reason)
        if any(count for count, _ in slid):
            outcome = newton.solve(u, 1.0, report=report, least_tolerance=tolerance)
            continue
        roundings = [contact.rounding_error(u) for contact in contacts]
        changes = [contact.augment(u) for contact in contacts]
        if tolerance <= enough and all(
            change <= max(carried * whole, rounding)
            for (change, whole), rounding in zip(changes, roundings, strict=True)
        ):
            break
        if is_loose:
            parts = [change / whole for change, whole in changes if whole > 0.0]
            tolerance = min(tolerance, _PART_OF_CHANGE * max(parts, default=0.0))
        outcome = newton.solve(u, 1.0, report=report, least_tolerance=tolerance)
    else:
        reason = f"the contact forces do not settle in {_MOST_UZAWA_STEPS} steps"
        return Outcome(u, outcome.relative_residual, iterations, reason)
    return dataclasses.replace(outcome, displacement=u, iterations=iterations)


def follow_tools(
    newton: Newton,
    sampler: DetFSampler,
    contacts: Sequence[ToolContact],
    start: Floats,
    *,
    progress: Callable[[str], None],
) -> Outcome:
    """Move the tools along their paths under the full load, and store the forces at the knots.

    Args:
        newton: Newton's method for the equilibrium with these contacts.
        sampler: Measures det F.
        contacts: The tools at the beginning of their paths.
        start: Displacement to start from, flat [m].
        progress: Called with one line of text for every iteration.
    """
    knots = sorted({float(t) for contact in contacts for t in contact.tool.path.times})
    u = start
    times: list[float] = []
    states: list[tuple[ToolState, ...]] = []
    # The first stretch has no length: the tools are at the beginning of their paths.
    before, iterations, residual, reason = knots[0], 0, 0.0, ""
    span = (knots[-1] - knots[0]) or 1.0
    factors: list[float] = []
    for knot in knots:
        first = _first_step(contacts, before, knot)
        path = follow(
            _Stretch(newton, contacts, before, knot),
            sampler,
            u,
            first,
            name=f"tools from {before:g} to {knot:g},",
            few_iterations=_FEW_ITERATIONS,
            largest_step=_largest_step(contacts, before, knot),
            smallest_step=SMALLEST_STEP if newton.relative_tolerance <= EXACT else _ROUGH_STEP,
            progress=progress,
        )
        u, reason, residual = path.displacement, path.reason, path.relative_residual
        iterations += path.iterations
        factors += [(before + s * (knot - before) - knots[0]) / span for s in path.load_factors]
        if reason:
            break
        times.append(knot)
        states.append(tuple(contact.state(u) for contact in contacts))
        before = knot
    return Outcome(u, residual, iterations, reason, tuple(factors), histories(times, states))


def go_on_at_end(
    newton: Newton,
    contacts: Sequence[ToolContact],
    near: Floats,
    *,
    needed: Floats | None = None,
    report: Report,
) -> Outcome:
    """The equilibrium at the end of the paths, from a displacement near it, without the paths.

    Args:
        newton: Newton's method for the equilibrium with these contacts.
        contacts: Tools whose equilibrium does not depend on their paths.
        near: Displacement to start from, flat [m].
        needed: Nodal forces that balance the body there [N], flat, where they are known.
        report: Called with iteration, relative residual and smallest det F.

    Returns:
        The outcome, with histories at the end only.
    """
    end = max((float(contact.tool.path.times[-1]) for contact in contacts), default=0.0)
    for contact in contacts:
        contact.set_time(end)
        if needed is not None:
            contact.bear(near, needed)
    u = near
    # Between the nodes of a coarser mesh the surfaces of body and tool differ a little: begin with
    # soft penalties, since stiff ones would give far too large forces.
    for factor in _SOFTER if contacts else ():
        for contact in contacts:
            contact.weigh(factor)
        found = newton.solve(u, 1.0, report=report, least_tolerance=_ROUGHLY)
        if not found.converged:
            break
        u = found.displacement
        for contact in contacts:
            contact.augment(u)
    carried = OVER_NEWTON * newton.relative_tolerance
    for contact in contacts:
        contact.keep(u)
    for factor in _STIFFER:
        for contact in contacts:
            contact.go_back()
            contact.weigh(factor)
        found = settle(newton, contacts, u, carried, report=report)
        if found.converged or not contacts:
            break
    u, reason = found.displacement, found.reason
    if found.converged and not newton.is_stable(u, 1.0):
        reason = "the equilibrium found is not stable"
    return dataclasses.replace(
        found,
        reason=reason,
        load_factors=() if reason else (1.0,),
        tools=histories((end,), [[contact.state(u) for contact in contacts]]),
    )


def histories(
    times: Sequence[float], states: Sequence[Sequence[ToolState]]
) -> tuple[ToolHistory, ...]:
    """The history of each tool, from the states of all tools at some times."""
    return tuple(
        ToolHistory(
            times=tuple(times),
            forces=tuple(_vector(s.force) for s in one),
            moments=tuple(_vector(s.moment) for s in one),
            active_areas=tuple(s.active_area for s in one),
            penetrations=tuple(s.penetration for s in one),
        )
        for one in zip(*states, strict=True)
    )


def _vector(row: Points) -> Vector:
    x, y, z = row.tolist()
    return (x, y, z)


def _first_step(contacts: Sequence[ToolContact], begin: float, end: float) -> float:
    """The first step: no tool's origin moves further than about a facet, or its longest step."""
    step = 1.0
    for contact in contacts:
        moved = _way(contact, begin, end)
        if moved > contact.points.facet_size:
            step = min(step, contact.points.facet_size / moved)
    return min(step, _largest_step(contacts, begin, end))


def _largest_step(contacts: Sequence[ToolContact], begin: float, end: float) -> float:
    """The largest step: only short steps show from which side a node came into contact."""
    step = 1.0
    for contact in contacts:
        moved, reach = _way(contact, begin, end), first_reach(contact)
        if moved > reach:
            step = min(step, reach / moved)
    return step


def first_reach(contact: ToolContact) -> float:
    """Largest distance that a tool of its shape may move in one step [m]."""
    match contact.tool.shape:
        case BoxShape():
            return _REACH_OF_BOXES * contact.points.facet_size
        case SphereShape(radius) | CapsuleShape(radius):
            return _REACH_OF_ROUND * radius
        case SurfaceShape(surface):
            return 0.5 * _REACH_OF_ROUND * float(np.ptp(surface.points, axis=0).min())
    return math.inf


def _way(contact: ToolContact, begin: float, end: float) -> float:
    path = contact.tool.path
    return float(np.linalg.norm(path.pose_at(end)[0] - path.pose_at(begin)[0]))


# Relative tolerance of the driving force.
_REACHED = 1e-9
_SMALLEST_STEP = 1e-3
_MOST_TRIES = 60
# A tool that has moved so many times the body's size plus its distance from it has missed it.
_FARTHEST = 2.0


class _Drive:
    """A tool that is driven along its line, and the force of the body on it."""

    def __init__(
        self, newton: Newton, contact: ToolContact, start: Floats, progress: Callable[[str], None]
    ) -> None:
        drive = contact.tool.drive
        assert drive is not None
        self.direction, self.wanted = np.array(drive.direction), drive.force
        self.newton, self.contact, self.tell = newton, contact, progress
        self.displacement, self.iterations = start, 0
        self._carried = OVER_NEWTON * newton.relative_tolerance

    def at(self, way: float) -> tuple[Outcome, float]:
        """Equilibrium with the tool at a distance along its line [m], and the missing force [N]."""
        self.contact.move(way)
        self.contact.go_back()
        found = settle(self.newton, (self.contact,), self.displacement, self._carried)
        self.iterations += found.iterations
        if not found.converged:
            return found, 0.0
        pushed = -float(self.contact.state(found.displacement).force @ self.direction)
        self.tell(f"tool {way:.6g} m along: {pushed:.6g} N of {self.wanted:.6g} N")
        return found, self.wanted - pushed

    def keep(self, found: Outcome) -> None:
        self.displacement = found.displacement
        self.contact.keep(self.displacement)


def press(
    newton: Newton, contact: ToolContact, start: Floats, *, progress: Callable[[str], None]
) -> Outcome:
    """Push a tool along its line until the body takes all of the force.

    Args:
        newton: Newton's method for the equilibrium with this contact.
        contact: The tool at its start.
        start: Displacement to start from, flat [m].
        progress: Called with one line of text for every position.

    Raises:
        InputError: The force of the body at the start is larger than the driving force.

    Returns:
        The outcome as for a path of two knots, the start and the position of rest.
    """
    drive = _Drive(newton, contact, start, progress)
    found, lacking = drive.at(0.0)
    if not found.converged:
        return _ended(drive, found, 0.0, found.reason)
    if lacking < 0.0:
        raise InputError(
            f"where the tool starts the body pushes it back with {drive.wanted - lacking:.4g} N, "
            f"more than the {drive.wanted:.4g} N it is driven by; start it farther away"
        )
    drive.keep(found)
    before = contact.state(found.displacement)
    rest = contact.points.rest
    middle = fenicsx.total(rest.sum(axis=0)) / fenicsx.total(len(rest))
    size = float(np.linalg.norm(np.ptp(contact.source_points, axis=0)))
    farthest = _FARTHEST * (size + float(np.linalg.norm(middle - contact.position)))
    longest = min(0.25 * contact.points.facet_size, first_reach(contact))
    low, step = (0.0, lacking), longest
    while True:
        way = low[0] + max(step, contact.clearance(drive.displacement))
        if way > farthest:
            return _ended(drive, found, low[0], "the tool passes the body; aim it at the body")
        next_found, lacking = drive.at(way)
        if not next_found.converged:
            step *= 0.5
            if step < _SMALLEST_STEP * longest:
                return _ended(drive, found, low[0], next_found.reason)
            continue
        found = next_found
        if lacking <= 0.0:
            break
        drive.keep(found)
        low = way, lacking
    high, side = (way, lacking), 0
    for _ in range(_MOST_TRIES):
        if abs(lacking) <= _REACHED * drive.wanted:
            drive.keep(found)
            states = [(before,), (contact.state(found.displacement),)]
            return dataclasses.replace(
                _ended(drive, found, way, ""), tools=histories((0.0, 1.0), states)
            )
        way = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
        found, lacking = drive.at(way)
        if not found.converged:
            return _ended(drive, found, low[0], found.reason)
        # The residual of an end that remains twice is halved, or the end would remain for ever.
        if lacking > 0.0:
            low, high = (way, lacking), (high[0], high[1] * (0.5 if side > 0 else 1.0))
        else:
            low, high = (low[0], low[1] * (0.5 if side < 0 else 1.0)), (way, lacking)
        side = 1 if lacking > 0.0 else -1
    return _ended(drive, found, low[0], f"the force is not met in {_MOST_TRIES} tries")


def _ended(drive: _Drive, found: Outcome, way: float, reason: str) -> Outcome:
    where = f", {way:.4g} m along its line" if reason else ""
    return Outcome(
        drive.displacement,
        found.relative_residual,
        drive.iterations,
        f"{reason}{where}",
        (0.0,) if reason else (1.0,),
    )
