"""A tool pushed against a body by a force, in equilibrium: how far it goes along its line.

The tool is put further and further along its line, with the body in equilibrium each time, until
the body pushes back with the force; the way is then found between the last two by the regula falsi
with halved ends (M. Dowell, P. Jarratt, BIT 11, 1971: "Illinois").
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import ToolContact
from palpate.reference.contact.tool_path import (
    OVER_NEWTON,
    ToolRun,
    first_reach,
    histories,
    settle,
)
from palpate.reference.load_stepping import LoadPath
from palpate.reference.newton import Newton, NewtonOutcome

# Of the force, what may be missing.
_REACHED = 1e-9
_SMALLEST_STEP = 1e-3
_MOST_TRIES = 60
# Sizes of the body and the tool's distance from it: who has gone so far has missed it.
_FARTHEST = 2.0


class _Drive:
    """The tool along its line, and how hard the body pushes it back."""

    def __init__(
        self, newton: Newton, contact: ToolContact, start: Floats, progress: Callable[[str], None]
    ) -> None:
        drive = contact.tool.drive
        assert drive is not None
        self.direction, self.wanted = np.array(drive.direction), drive.force
        self.newton, self.contact, self.tell = newton, contact, progress
        self.displacement, self.iterations = start, 0
        self._carried = OVER_NEWTON * newton.relative_tolerance

    def at(self, way: float) -> tuple[NewtonOutcome, float]:
        """The equilibrium with the tool so far along [m], and the force it lacks [N]."""
        self.contact.move(way)
        self.contact.go_back()
        found = settle(self.newton, (self.contact,), self.displacement, self._carried)
        self.iterations += found.iterations
        if not found.converged:
            return found, 0.0
        pushed = -float(self.contact.state(found.displacement).force @ self.direction)
        self.tell(f"tool {way:.6g} m along: {pushed:.6g} N of {self.wanted:.6g} N")
        return found, self.wanted - pushed

    def keep(self, found: NewtonOutcome) -> None:
        self.displacement = found.displacement
        self.contact.keep(self.displacement)


def press(
    newton: Newton, contact: ToolContact, start: Floats, *, progress: Callable[[str], None]
) -> ToolRun:
    """Push a tool along its line until the body takes all of the force.

    Args:
        newton: The iteration, of an equilibrium with this contact.
        contact: The tool, where it starts.
        start: Displacement to begin with, flat [m].
        progress: Called with one line of text for every place.

    Raises:
        InputError: At the start the body pushes harder than the force.

    Returns:
        As of a path of two knots, where it starts and where it rests.
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
            run = _ended(drive, found, way, "")
            states = [(before,), (contact.state(found.displacement),)]
            return ToolRun(run.path, histories((0.0, 1.0), states))
        way = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
        found, lacking = drive.at(way)
        if not found.converged:
            return _ended(drive, found, low[0], found.reason)
        # An end that stays twice is taken for half as far off, or it would stay for good.
        if lacking > 0.0:
            low, high = (way, lacking), (high[0], high[1] * (0.5 if side > 0 else 1.0))
        else:
            low, high = (low[0], low[1] * (0.5 if side < 0 else 1.0)), (way, lacking)
        side = 1 if lacking > 0.0 else -1
    return _ended(drive, found, low[0], f"the force is not met in {_MOST_TRIES} tries")


def _ended(drive: _Drive, found: NewtonOutcome, way: float, reason: str) -> ToolRun:
    where = f", {way:.4g} m along its line" if reason else ""
    return ToolRun(
        LoadPath(
            drive.displacement,
            (1.0,) if not reason else (0.0,),
            found.relative_residual,
            drive.iterations,
            f"{reason}{where}",
        ),
        (),
    )
