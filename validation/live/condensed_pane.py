"""The condensed linear model as a pane: an equilibrium under the hand each tick, no inertia."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.condensed import (
    CondensedModel,
    CondensedSteps,
    UnsettledContactError,
    condense,
    condensed_size,
)
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.spring import Spring
from palpate.validation.live.pane import STRAIN_NAMES, Pane, Surface, make_panes


@dataclass(frozen=True)
class AtRest:
    """The whole body of a condensed pane.

    Attributes:
        pane: Whose it is.
    """

    pane: CondensedPane

    @property
    def displacement(self) -> Points:
        """Of all points [m], shape (num_points, 3); those inside follow those of the surface."""
        return self.pane.whole_displacement()


class Grip:
    """A spring over a patch of a condensed body: K (d - u) with the patch's own compliance C.

    With u = u' + C f and u' what all else does, (1 + K C) f = K (d - u').

    Args:
        model: The body.
        spring: Over the patch; its path is not read.
    """

    def __init__(self, model: CondensedModel, spring: Spring) -> None:
        mesh = model.problem.mesh
        self.patch = PatchSprings(mesh.points, (spring,))
        place = np.full(mesh.num_points, -1, dtype=np.int32)
        place[model.touched] = np.arange(len(model.touched))
        corners = np.unique(self.patch.facets)
        # Points that are held in all components take no force.
        points = corners[place[corners] >= 0]
        self.rows: Indices = place[points]
        count = len(points)
        own = np.full(mesh.num_points, -1)
        own[points] = np.arange(count)
        stiffness = np.zeros((count, count))
        for facet, numbers in zip(own[self.patch.facets], self.patch.stiffnesses, strict=True):
            kept = np.flatnonzero(facet >= 0)
            stiffness[np.ix_(facet[kept], facet[kept])] += numbers.reshape(3, 3)[np.ix_(kept, kept)]
        self._stiffness = np.kron(stiffness, np.eye(3))
        self._sums = self.patch.row_sums()[points]
        seen = self.rows + len(model.seen) - len(model.touched)
        columns = []
        for k in range(3 * count):
            unit = np.zeros((len(model.touched), 3))
            unit[self.rows[k // 3], k % 3] = 1.0
            columns.append(model.compliance.response(unit)[seen].ravel())
        self._compliance = np.array(columns).T
        self._solve = np.linalg.inv(np.eye(3 * count) + self._stiffness @ self._compliance)
        self.seen: Indices = seen
        self.force = np.zeros((count, 3))

    def pull(self, anchor: Floats, displacement: Points) -> None:
        """Find its force [N].

        Args:
            anchor: How far it is moved [m], shape (3,).
            displacement: Of the seen points under the present force and all else [m].
        """
        others = displacement[self.seen].ravel() - self._compliance @ self.force.ravel()
        right = np.outer(self._sums, anchor).ravel() - self._stiffness @ others
        self.force = (self._solve @ right).reshape(-1, 3)


class CondensedPane:
    """A condensed body under the hand, with the words of `Pane`.

    Args:
        problem: As of `Pane`, without loads and springs.
        surface: Of its mesh.
        element: Linear or smoothed tetrahedra.

    Attributes:
        name: For people.
        strain: Linear.
        element: As given.
        body: The whole body, whose points inside are found when asked for.
        trouble: Nothing: where contact does not settle, the body stays as it was.
        smallest_det_f: 1: linear strain does not know it.
        largest_speed: Of the tool: infinite.
        room: Always.

    Raises:
        InputError: The problem has loads, springs or moved supports; or as of `condense` and
            `CondensedSteps`.
    """

    strain = Strain.LINEAR
    trouble = ""
    smallest_det_f = 1.0
    largest_speed = float("inf")
    room = 1.0

    def __init__(self, problem: Problem, surface: Surface, element: Element) -> None:
        if problem.loads or problem.springs:
            raise InputError("the condensed body bears the hand alone: leave the case's loads out")
        smoothed = ", smoothed" if element is Element.SMOOTHED else ""
        self.name = f"{STRAIN_NAMES[self.strain]} (condensed{smoothed})"
        self.element = element
        self._model = condense(problem, element=element, seen=surface.used, keep_inside=True)
        if self._model.terms:
            raise InputError("the condensed body's supports stand still: this case moves one")
        self._steps = CondensedSteps(self._model)
        self._elastic = Body.of(problem, self.strain, element=element)
        self._surface, self._skin = surface, surface.body(self.strain)
        self._rotation = problem.tools[0].path.pose_at(0.0)[1]
        place = np.zeros(problem.mesh.num_points, dtype=np.int32)
        place[self._model.seen] = np.arange(len(self._model.seen))
        self._used = place[surface.used]
        self._rest = problem.mesh.points[surface.used]
        self._volume = surface.volume(self._rest)
        self.body = AtRest(self)
        self.reset()

    def reset(self) -> None:
        """To rest, the tool away."""
        self._grip: Grip | None = None
        self._anchor = np.zeros(3)
        self._steps.clear()
        self._steps.set_base()
        self._displacement = np.zeros((len(self._model.seen), 3))
        self._force = np.zeros(3)
        self.seconds = self.cpu_seconds = 0.0

    def hold(self, spring: Spring) -> None:
        """Let a spring pull."""
        self._grip = Grip(self._model, spring)
        self._anchor = np.array(spring.path.end)

    def let_go(self) -> None:
        """Let it pull no more."""
        self._grip = None
        self._steps.set_base()

    def advance(self, place: Floats, anchor: Floats | None, num_steps: int) -> None:
        """Be in equilibrium, the tool in a place [m], the anchor of what is held in its own.

        Where both act, each follows the other a tick later.

        Args:
            place: Shape (3,).
            anchor: Shape (3,).
            num_steps: Of the other panes; without inertia there is one equilibrium.
        """
        del num_steps
        begin, cpu = time.perf_counter(), time.thread_time()
        if self._grip is not None:
            self._anchor = self._anchor if anchor is None else anchor
            self._grip.pull(self._anchor, self._displacement)
            self._steps.set_base(self._grip_forces())
        try:
            state = self._steps.step([(place, self._rotation)])
        except UnsettledContactError:
            pass
        else:
            self._displacement, self._force = state.displacement, state.forces[0]
        self.seconds = time.perf_counter() - begin
        self.cpu_seconds = time.thread_time() - cpu

    def pull(self) -> Floats:
        """Of the body on the hand that holds it by a spring [N], shape (3,)."""
        if self._grip is None:
            return np.zeros(3)
        moved = np.zeros_like(self._model.problem.mesh.points)
        moved[self._model.seen] = self._displacement
        pulled = self._grip.patch.resultants(moved, self._anchor[None], np.ones(1))
        back: Floats = -pulled[0]
        return back

    def mean_force(self) -> Floats:
        """Of the body on the tool [N], shape (3,)."""
        return self._force

    def places(self) -> Points:
        """Of the surface's points [m], shape (n, 3)."""
        places: Points = self._rest + self._displacement[self._used]
        return places

    def whole_displacement(self) -> Points:
        """Of all points [m], shape (num_points, 3)."""
        return self._model.whole_displacement(self._steps.contact_forces + self._grip_forces())

    def shades(self, by: str) -> Floats:
        """As of `Pane`."""
        if by == "displacement":
            length: Floats = np.linalg.norm(self._displacement[self._used], axis=1)
            return length
        whole = self.whole_displacement()
        return self._surface.equivalent(self._skin, whole, of_strain=by == "strain")

    def volume_change(self, places: Points) -> float:
        """Of its volume at rest [-]."""
        return self._surface.volume(places) / self._volume - 1.0

    def strain_energy(self) -> float:
        """[J]."""
        return self._elastic.strain_energy(self.whole_displacement())

    def _grip_forces(self) -> Points:
        forces = np.zeros((len(self._model.touched), 3))
        if self._grip is not None:
            forces[self._grip.rows] = self._grip.force
        return forces


def condensed_words(problem: Problem, element: Element) -> str:
    """What the condensed pane of a case's body will take, told without taking it."""
    bare = dataclasses.replace(problem, loads=(), springs=(), tools=(), time=None)
    seen = np.unique(problem.mesh.boundary_facets)
    return f"condensing: {condensed_size(bare, element=element, seen=seen, keep_inside=True)}"


AnyPane = Pane | CondensedPane


def all_panes(
    problem: Problem, surface: Surface, elements: tuple[Element, ...], is_condensed: bool
) -> list[AnyPane]:
    """Those of `make_panes`, and the condensed model with the first element if it is asked for."""
    panes: list[AnyPane] = [*make_panes(problem, surface, elements)]
    if is_condensed:
        panes.append(CondensedPane(problem, surface, elements[0]))
    return panes
