"""A grip: a spring over a patch of the surface, its anchor in the hand."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.spring import AnchorPath, Spring
from palpate.validation.case.units import FORCE, LENGTH
from palpate.validation.live.hand import Hand
from palpate.validation.live.live_case import LiveCase
from palpate.validation.live.pane import Pane

# Of the stiffest spring that the time step bears: two grips may lie over each other in a recording.
_PART_OF_ROOM = 0.4
# Grips of one recording, for that reason.
MOST_GRIPS = 2


@dataclass
class Grip:
    """One hold of the surface.

    Attributes:
        table: Of the spring in a case file, without path.
        spring: The same in SI units, its anchor where the patch is.
        hand: Moves the anchor, in the case's unit, from where the body is at rest.
        first: Where the anchor was when the hand took hold, in the case's unit.
        begin: Step at which it did.
        end: At which it let go; None while it holds.
        places: Of the anchor at the end of each tick.
    """

    table: dict[str, Any]
    spring: Spring
    hand: Hand
    first: Floats
    begin: int
    end: int | None = None
    places: list[Floats] = field(default_factory=list)

    def recorded(self, clock_step: float, steps: int) -> dict[str, Any]:
        """Its table with path and factors over time.

        On and off within the step before: forces are found at whole steps.

        Args:
            clock_step: [s].
            steps: In a tick.
        """
        path = [self.first, *self.places]
        table = dict(self.table)
        table["path"] = [
            {"time": (self.begin + number * steps) * clock_step, "displacement": place.tolist()}
            for number, place in enumerate(path)
        ]
        factors: dict[int, float] = {}
        if self.begin > 0:
            factors |= {self.begin - 1: 0.0, self.begin: 1.0}
        if self.end is not None:
            factors |= {self.end - 1: 1.0, self.end: 0.0}
        if factors:
            table["amplitude"] = {
                "times": [step * clock_step for step in sorted(factors)],
                "factors": [factors[step] for step in sorted(factors)],
            }
        return table

    def held(self) -> dict[str, Any]:
        """Its table with the anchor as it is now, for statics."""
        return {**self.table, "displacement": self.hand.place.tolist()}


def take_hold(
    live: LiveCase, pane: Pane, point: int, radius: float, *, largest_way: float, digits: int
) -> Grip:
    """Take hold of the surface about one of its points.

    The patch is as stiff as a rigid disc of that radius on a half space, 2 E r, or less where the
    time step bears no more.

    Args:
        live: What is touched.
        pane: Whose patch says where the anchor begins; it pulls there with no force.
        point: Of the mesh.
        radius: [m], > 0.
        largest_way: Of the anchor in a tick, in the case's unit.
        digits: Of places behind the point, in the case's unit.

    Raises:
        InputError: No patch there.
    """
    units, mesh, body = live.case.spec.units, live.problem.mesh, pane.body
    place = np.round(mesh.points[point] / live.unit, digits)
    size = float(f"{radius / live.unit:.6g}")
    center = units.place((place[0], place[1], place[2]))
    none = AnchorPath(np.zeros(1), np.zeros((1, 3)))
    soft = Spring.on(mesh, center, units.metres(size), 1.0, none)
    patch = PatchSprings(mesh.points, (soft,))
    if pane.trouble:
        raise InputError("the body stands still; reset it first")
    room = (4.0 / body.time_step**2 - 4.0 / body.critical_time_step**2) * body.mass
    rows = patch.row_sums()
    most = _PART_OF_ROOM * float((room[rows > 0.0] / rows[rows > 0.0]).min())
    wanted = 2.0 * live.problem.material.youngs_modulus * radius
    per_unit = FORCE[units.force] / LENGTH[units.length]
    stiffness = float(f"{min(wanted, most) / per_unit:.3g}")
    first = np.round(patch.mean_displacements(body.displacement)[0] / live.unit, digits)
    anchor = np.array([units.place((first[0], first[1], first[2]))])
    spring = Spring.on(
        mesh,
        center,
        units.metres(size),
        units.newtons_per_metre(stiffness),
        AnchorPath(np.zeros(1), anchor),
    )
    table = {"center": place.tolist(), "radius": size, "stiffness": stiffness}
    hand = Hand(first, np.zeros(3), largest_way, digits)
    return Grip(table, spring, hand, first, body.steps)
