"""One simulator of the page: a body that is stepped, and what is read from it."""

from __future__ import annotations

import time

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.cell_stress import cauchy_stress
from palpate.fastsim.errors import FastsimError
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Element, Inclusion, Problem, Strain
from palpate.meshes.rigid_tool import ToolError
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.live.between_vertices import BetweenVertices

STRAIN_NAMES = {Strain.LINEAR: "linear strain", Strain.GREEN: "Green strain"}
# A cell of less than this part of its volume takes no more: soon the law softens, and such a cell
# inverts within a few ticks. From so much above it on the tool goes slower and slower.
_LEAST_DET_F, _SLOWER = 0.45, 0.4
# Between vertices is looked every so many ticks.
_LOOK = 6


class Surface:
    """What is seen of a body, and the cells behind it.

    Attributes:
        used: Points of the boundary, ascending, shape (n,).
        facets: Boundary facets in their numbering, shape (m, 3).
    """

    def __init__(self, problem: Problem) -> None:
        mesh = problem.mesh
        self.used, inverse = np.unique(mesh.boundary_facets, return_inverse=True)
        self.facets: Indices = inverse.reshape(-1, 3).astype(np.int32)
        is_behind = np.isin(mesh.cells, self.used).sum(axis=1) >= 3
        self._cells = np.flatnonzero(is_behind)
        kept, corners = np.unique(mesh.cells[self._cells], return_inverse=True)
        self._kept = kept
        self._problem = Problem(
            TetMesh(mesh.points[kept], corners.reshape(-1, 4).astype(np.int32)),
            problem.material,
            (),
            (),
            inclusions=tuple(
                Inclusion(rows.astype(np.int32), inclusion.material)
                for inclusion in problem.inclusions
                if len(rows := np.flatnonzero(np.isin(self._cells, inclusion.cells)))
            ),
        )
        corner = np.searchsorted(kept, self.used)
        counts = np.bincount(corners.reshape(-1), minlength=len(kept))
        self._corners = corners.reshape(-1, 4)
        self._counts, self._shown = counts, corner

    def body(self, strain: Strain) -> Body:
        """Of the cells behind the surface alone."""
        return Body.of(self._problem, strain)

    def equivalent(self, body: Body, displacement: Points, *, of_strain: bool) -> Floats:
        """Equivalent strain [-] or von Mises stress [Pa] at the surface's points.

        Means over the cells that meet at a point, of those behind the surface.
        """
        own = displacement[self._kept]
        if of_strain:
            gradient = body.displacement_gradients(own)
            tensor = 0.5 * (gradient + gradient.transpose(0, 2, 1))
            if body.strain is Strain.GREEN:
                tensor = tensor + 0.5 * np.einsum("cki,ckj->cij", gradient, gradient)
            factor = 2.0 / 3.0
        else:
            tensor, factor = cauchy_stress(body, own), 1.5
        mean = np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        of_cells = np.sqrt(factor * np.sum((tensor - mean) ** 2, axis=(1, 2)))
        total = np.bincount(
            self._corners.reshape(-1), np.repeat(of_cells, 4), minlength=len(self._counts)
        )
        at_points: Floats = (total / self._counts)[self._shown]
        return at_points

    def volume(self, points: Points) -> float:
        """Enclosed by the surface's points at their places, shape (n, 3)."""
        a, b, c = (points[self.facets[:, k]] for k in range(3))
        return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


class Pane:
    """A body under the hand.

    Args:
        problem: With one tool, whose path is its start, and a time span of one tick.
        surface: Of its mesh.
        strain: Linear or Green.
        element: Linear or smoothed tetrahedra.

    Attributes:
        name: For people.
        body: What is stepped.
        trouble: Why it stands still; nothing while it goes.
        smallest_det_f: Lately; 1 under linear strain, which does not know it.
    """

    def __init__(
        self, problem: Problem, surface: Surface, strain: Strain, element: Element
    ) -> None:
        smoothed = " (smoothed)" if element is Element.SMOOTHED else ""
        self.name = f"{STRAIN_NAMES[strain]}{smoothed}"
        self.strain, self.element = strain, element
        self.body = ExplicitBody(problem, strain=strain, element=element)
        self._surface, self._skin = surface, surface.body(strain)
        self._rest = problem.mesh.points
        self._first = self.body.springs
        self._between = BetweenVertices(problem)
        self._volume = surface.volume(self._rest[surface.used])
        self.reset()

    @property
    def largest_speed(self) -> float:
        """Of the tool, up to which vertices can follow [m/s]."""
        tools = self.body.tools
        return float("inf") if tools is None else min(tools.largest_speeds)

    @property
    def room(self) -> float:
        """Part of its speed that the tool may have [-]; 0 or less: the body takes no more.

        A cell is near its end then, or the tool on its way through the surface.
        """
        return 0.0 if self._is_through else (self.smallest_det_f - _LEAST_DET_F) / _SLOWER

    def reset(self) -> None:
        """To rest, at time 0, the tool at its start."""
        self._is_held = False
        self.body.change_springs(self._first.anew())
        start = self.body.problem.initial_velocity
        velocity = None if start is None else start.at(self._rest)
        self.body.set_state(np.zeros_like(self._rest), velocity)
        self.trouble = ""
        self.smallest_det_f = 1.0
        self._is_through = self._touches = False
        self._ticks = 0
        self._impulse, self._since = np.zeros(3), 0.0
        self._force = np.zeros(3)
        self.seconds = self.cpu_seconds = 0.0

    def hold(self, spring: Spring) -> None:
        """Let a spring pull besides the problem's own."""
        self.body.change_springs(self.body.springs.with_spring(spring))
        self._is_held = True

    def let_go(self) -> None:
        """Let it pull no more."""
        if self._is_held:
            self.body.change_springs(self.body.springs.without_spring(len(self.body.springs) - 1))
            self._is_held = False

    def advance(self, place: Floats, anchor: Floats | None, num_steps: int) -> None:
        """One tick: the tool goes to a place [m], the anchor of what is held to its own."""
        if self.trouble:
            return
        begin, cpu = time.perf_counter(), time.thread_time()
        try:
            self.body.move_tool(0, place)
            if self._is_held and anchor is not None:
                now = self.body.time
                end = (self.body.steps + num_steps) * self.body.time_step
                self.body.springs.send(len(self.body.springs) - 1, anchor, now, end)
            self.body.step(num_steps)
            self._note(place, num_steps)
        except (FastsimError, ToolError) as error:
            self.trouble = str(error)
        self.seconds = time.perf_counter() - begin
        self.cpu_seconds = time.thread_time() - cpu

    def _note(self, place: Floats, num_steps: int) -> None:
        record = self.body.take_tool_records()[0]
        self._touches = bool(np.any(record["impulse"]))
        self._impulse += record["impulse"]
        self._since += num_steps * self.body.time_step
        if self.strain is Strain.GREEN:
            self.smallest_det_f = self.body.elastic.smallest_det_f(self.body.displacement)[0]
        self._ticks += 1
        if self._ticks % _LOOK == 0:
            depth = self._between.depth(place, self.body.displacement) if self._touches else 0.0
            self._is_through = self._between.is_through(depth)

    def pull(self) -> Floats:
        """Of the body on the hand that holds it by a spring, now [N], shape (3,)."""
        if not self._is_held:
            return np.zeros(3)
        pulled = self.body.springs.resultants(self.body.displacement, self.body.time)
        back: Floats = -pulled[-1]
        return back

    def mean_force(self) -> Floats:
        """Of the body on the tool since it was asked last [N], shape (3,)."""
        if self._since:
            self._force = self._impulse / self._since
            self._impulse, self._since = np.zeros(3), 0.0
        return self._force

    def places(self) -> Points:
        """Of the surface's points [m], shape (n, 3)."""
        used = self._surface.used
        places: Points = self._rest[used] + self.body.displacement[used]
        return places

    def shades(self, by: str) -> Floats:
        """What the surface is coloured by, at its points [m], [-] or [Pa], shape (n,)."""
        displacement = self.body.displacement
        if by == "displacement":
            length: Floats = np.linalg.norm(displacement[self._surface.used], axis=1)
            return length
        return self._surface.equivalent(self._skin, displacement, of_strain=by == "strain")

    def volume_change(self, places: Points) -> float:
        """Of its volume at rest [-]."""
        return self._surface.volume(places) / self._volume - 1.0

    def strain_energy(self) -> float:
        """[J]."""
        return self.body.elastic.strain_energy(self.body.displacement)


def make_panes(problem: Problem, surface: Surface, elements: tuple[Element, ...]) -> list[Pane]:
    """Linear beside Green strain, and Green strain by smoothed tetrahedra where those are asked."""
    kinds = [(strain, elements[0]) for strain in Strain]
    kinds += [(Strain.GREEN, element) for element in elements[1:]]
    order = sorted(kinds, key=lambda kind: kind[0] is Strain.GREEN)
    return [Pane(problem, surface, strain, element) for strain, element in order]
