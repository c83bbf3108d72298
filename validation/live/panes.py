"""The simulators of the page: bodies that follow one pointer, and what is read from them."""

from __future__ import annotations

import dataclasses
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from palpate.fastsim.body import Body, cauchy_stress
from palpate.fastsim.condensed import (
    CondensedModel,
    CondensedSteps,
    UnsettledContactError,
    condense,
    condensed_size,
)
from palpate.fastsim.contact.contact_law import half_thickness
from palpate.fastsim.contact.tool_contact import POSE, ToolContact, gaps_at
from palpate.fastsim.errors import FastsimError
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Inclusion, Problem, Strain
from palpate.meshes.rigid_tool import ToolError
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.laws import strain_of
from palpate.validation.report.loads_and_tools import inclusions_of
from palpate.validation.states import CellStresses

STRAIN_NAMES = {Strain.LINEAR: "linear strain", Strain.GREEN: "Green strain"}
# A cell below this fraction of its volume is pressed no further: soon the law softens, and such a
# cell inverts within a few ticks. From the second number above it on the tool slows down.
_LEAST_DET_F, _SLOWER = 0.45, 0.4
# The gap between vertices is checked once in this number of ticks.
_CHECK_EVERY = 6
# Depth of the surface in the tool, as a fraction of half the tool's thickness: beyond the first a
# warning is given; beyond the second the tool is passing through the surface.
_DEEP, _THROUGH = 0.1, 0.5


_NO_POINTS = np.zeros(0, dtype=np.int32)


class Surface:
    """The surface of a body, and the cells behind it.

    Attributes:
        used: Points of the boundary, ascending, shape (n,).
        facets: Boundary facets in the numbering of these points, shape (m, 3).
        inner: Points of inclusions that are drawn inside, none of the boundary, shape (k,).
    """

    def __init__(self, problem: Problem, inner: Indices = _NO_POINTS) -> None:
        mesh = problem.mesh
        self.inner = inner
        self.used, inverse = np.unique(mesh.boundary_facets, return_inverse=True)
        self.facets: Indices = inverse.reshape(-1, 3).astype(np.int32)
        cells = np.flatnonzero(np.isin(mesh.cells, self.used).sum(axis=1) >= 3)
        self._points, corners = np.unique(mesh.cells[cells], return_inverse=True)
        self._corners = corners.reshape(-1, 4)
        self._problem = Problem(
            TetMesh(mesh.points[self._points], self._corners.astype(np.int32)),
            problem.material,
            (),
            (),
            inclusions=tuple(
                Inclusion(rows.astype(np.int32), inclusion.material)
                for inclusion in problem.inclusions
                if len(rows := np.flatnonzero(np.isin(cells, inclusion.cells)))
            ),
        )
        self._shown = np.searchsorted(self._points, self.used)
        self._counts = np.bincount(corners.reshape(-1), minlength=len(self._points))

    def body(self, strain: Strain) -> Body:
        """A body of the cells behind the surface alone."""
        return Body.of(self._problem, strain)

    def equivalent(self, body: Body, displacement: Points, *, of_strain: bool) -> Floats:
        """Equivalent strain [-] or von Mises stress [Pa] at the surface's points.

        Each value is the mean over the cells behind the surface that meet at the point.
        """
        own = displacement[self._points]
        if of_strain:
            strains = strain_of(body.displacement_gradients(own), body.strain)
            of_cells = CellStresses(strains, strains).von_mises * (2.0 / 3.0)
        else:
            stresses = cauchy_stress(body, own)
            of_cells = CellStresses(stresses, stresses).von_mises
        total = np.bincount(self._corners.ravel(), np.repeat(of_cells, 4), len(self._counts))
        at_points: Floats = (total / self._counts)[self._shown]
        return at_points

    def volume(self, points: Points) -> float:
        """Volume enclosed by the surface with its points at these positions, shape (n, 3)."""
        a, b, c = (points[self.facets[:, k]] for k in range(3))
        return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


class BetweenVertices:
    """Depth of a body's flat facets in the first tool of a problem, which only vertices touch.

    Args:
        problem: The problem with the tool, which is rotated as at the start.
    """

    def __init__(self, problem: Problem) -> None:
        self._mesh = problem.mesh
        self._shape = ToolContact(problem, problem.tools[0]).shape
        self._thickness = half_thickness(problem.tools[0].shape)
        self._pose = np.zeros(1, POSE)
        self._pose["rotation"] = problem.tools[0].path.pose_at(0.0)[1]

    def depth(self, position: Floats, displacement: Points) -> float:
        """The depth of the deepest midpoint of an edge or a facet [m], >= 0.

        Args:
            position: Position of the tool [m], shape (3,).
            displacement: Displacement of the body [m], shape (num_points, 3).
        """
        corners = (self._mesh.points + displacement)[self._mesh.boundary_facets]
        middles = 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)
        self._pose["position"] = position
        gaps = gaps_at(self._shape, np.vstack([middles, corners.mean(axis=1)]), self._pose)
        return max(0.0, -float(gaps.distances.min()))

    def is_through(self, depth: float) -> bool:
        """Whether the tool has pushed the vertices apart, and would pass through the surface."""
        return depth > _THROUGH * self._thickness

    def warning(self, position: Floats, displacements: Sequence[Points]) -> str:
        """A warning where facets of one of the bodies are deep in the tool; empty otherwise."""
        deepest = max(self.depth(position, displacement) for displacement in displacements)
        if deepest <= _DEEP * self._thickness:
            return ""
        return (
            f"between its vertices the surface is up to {1e3 * deepest:.2g} mm inside the tool, "
            "which only vertices touch: tissue would not let it in, so the truth will be far off, "
            "or none be found; take a finer mesh or a larger tool"
        )


class Pane(ABC):
    """A body that is touched: one tool, and at most one spring that pulls at the surface.

    Args:
        problem: The problem with one tool, whose path is its start, and a time span of one tick.
        surface: The surface of its mesh.
        strain: Linear or Green strain.
        element: Linear or smoothed tetrahedra.
        name: The name that people read.

    Attributes:
        spring: The spring that pulls; None where there is none.
        trouble: The reason why the body stands still; empty while it moves.
        smallest_det_f: The smallest det F of late; 1 under linear strain, which does not define it.
        largest_speed: Speed of the tool up to which vertices can follow [m/s].
        seconds: Wall time of the last tick [s].
        cpu_seconds: Processor time of this thread in the last tick [s].
    """

    largest_speed = float("inf")
    _elastic: Body

    def __init__(
        self, problem: Problem, surface: Surface, strain: Strain, element: Element, name: str
    ) -> None:
        self.name, self.strain, self.element = name, strain, element
        self._surface, self._skin = surface, surface.body(strain)
        self._points = problem.mesh.points
        self._rest = self._points[surface.used]
        self._volume = surface.volume(self._rest)

    @property
    def room(self) -> float:
        """Fraction of its speed that the tool may have [-]; at 0 or less, press no further."""
        return 1.0

    @property
    @abstractmethod
    def displacement(self) -> Points:
        """Displacement of all points [m], shape (num_points, 3)."""

    def reset(self) -> None:
        """Return the body to rest at time 0, and the tool to its start."""
        self.spring: Spring | None = None
        self._anchor = np.zeros(3)
        self.trouble, self.smallest_det_f = "", 1.0
        self.seconds = self.cpu_seconds = 0.0

    def attach(self, spring: Spring) -> None:
        """Add a spring to those of the problem."""
        self.spring, self._anchor = spring, np.array(spring.path.end)
        self._patch = PatchSprings(self._points, (spring,))

    def release(self) -> None:
        """Remove the spring of `attach`."""
        self.spring = None

    def pull(self) -> Floats:
        """Present force of the body on the anchor of the spring [N], shape (3,)."""
        if self.spring is None:
            return np.zeros(3)
        moved = np.zeros_like(self._points)
        moved[self._surface.used] = self._moved()
        back: Floats = -self._patch.resultants(moved, self._anchor[None], np.ones(1))[0]
        return back

    def strain_energy(self) -> float:
        """Strain energy of the body [J]."""
        return self._elastic.strain_energy(self.displacement)

    @abstractmethod
    def mean_force(self) -> Floats:
        """Mean force of the body on the tool since the last call [N], shape (3,)."""

    @abstractmethod
    def _step(self, position: Floats, num_steps: int) -> None:
        """Take the steps of a tick, the anchor going to `_anchor`."""

    def advance(self, position: Floats, anchor: Floats | None, num_steps: int) -> None:
        """Advance by a tick, in which tool and anchor move to these positions [m], shape (3,)."""
        if self.trouble:
            return
        if self.spring is not None and anchor is not None:
            self._anchor = anchor
        begin, cpu = time.perf_counter(), time.thread_time()
        try:
            self._step(position, num_steps)
        except (FastsimError, ToolError) as error:
            # Whatever ends a body here, it was the hand that did it.
            advice = getattr(error, "suggestion", "")
            words = "press less deep, or more slowly; reset to go on"
            self.trouble = str(error).replace(advice, words) if advice else str(error)
        self.seconds = time.perf_counter() - begin
        self.cpu_seconds = time.thread_time() - cpu

    def _moved(self) -> Points:
        """Displacement of the surface's points [m]."""
        return self.displacement[self._surface.used]

    def positions(self) -> Points:
        """Positions of the surface points [m], shape (n, 3)."""
        positions: Points = self._rest + self._moved()
        return positions

    def inner_positions(self) -> Points:
        """Positions of the points of inclusions inside [m], shape (k, 3)."""
        inner = self._surface.inner
        positions: Points = self._points[inner] + self._inner_moved()
        return positions

    def _inner_moved(self) -> Points:
        return self.displacement[self._surface.inner]

    def shades(self, by: str) -> Floats:
        """The quantity that colours the surface, at its points [m], [-] or [Pa], shape (n,)."""
        if by == "displacement":
            length: Floats = np.linalg.norm(self._moved(), axis=1)
            return length
        return self._surface.equivalent(self._skin, self.displacement, of_strain=by == "strain")

    def volume_change(self, positions: Points) -> float:
        """Change of volume as a fraction of the volume at rest [-]."""
        return self._surface.volume(positions) / self._volume - 1.0


class ExplicitPane(Pane):
    """A body that is stepped in time."""

    def __init__(
        self, problem: Problem, surface: Surface, strain: Strain, element: Element
    ) -> None:
        smoothed = " (smoothed)" if element is Element.SMOOTHED else ""
        super().__init__(problem, surface, strain, element, STRAIN_NAMES[strain] + smoothed)
        self.body = ExplicitBody(problem, strain=strain, element=element)
        self._elastic, self._first = self.body.elastic, self.body.springs
        self._between = BetweenVertices(problem)
        if self.body.tools is not None:
            self.largest_speed = min(self.body.tools.largest_speeds)
        self.reset()

    @property
    def displacement(self) -> Points:
        """See `Pane`."""
        return self.body.displacement

    @property
    def room(self) -> float:
        """See `Pane`: less as a cell is nearly crushed, none while the tool passes the surface."""
        return 0.0 if self._is_through else (self.smallest_det_f - _LEAST_DET_F) / _SLOWER

    def reset(self) -> None:
        """See `Pane`."""
        super().reset()
        self.body.change_springs(self._first.anew())
        start = self.body.problem.initial_velocity
        velocity = None if start is None else start.at(self._points)
        self.body.set_state(np.zeros_like(self._points), velocity)
        self._is_through = self._touches = False
        self._ticks = 0
        self._impulse, self._since, self._force = np.zeros(3), 0.0, np.zeros(3)

    def attach(self, spring: Spring) -> None:
        """See `Pane`."""
        super().attach(spring)
        self.body.change_springs(self.body.springs.with_spring(spring))

    def release(self) -> None:
        """See `Pane`."""
        if self.spring is not None:
            self.body.change_springs(self.body.springs.without_spring(len(self.body.springs) - 1))
        super().release()

    def _step(self, position: Floats, num_steps: int) -> None:
        body = self.body
        body.move_tool(0, position)
        if self.spring is not None:
            end = (body.steps + num_steps) * body.time_step
            body.springs.send(len(body.springs) - 1, self._anchor, body.time, end)
        body.step(num_steps)
        record = body.take_tool_records()[0]
        self._touches = bool(np.any(record["impulse"]))
        self._impulse += record["impulse"]
        self._since += num_steps * body.time_step
        if self.strain is Strain.GREEN:
            self.smallest_det_f = body.elastic.smallest_det_f(body.displacement)[0]
        self._ticks += 1
        if self._ticks % _CHECK_EVERY == 0:
            depth = self._between.depth(position, body.displacement) if self._touches else 0.0
            self._is_through = self._between.is_through(depth)

    def mean_force(self) -> Floats:
        """See `Pane`."""
        if self._since:
            self._force = self._impulse / self._since
            self._impulse, self._since = np.zeros(3), 0.0
        return self._force


class CondensedSpring:
    """A spring over a patch of a condensed body: K (d - u) with the patch's own compliance C.

    With u = u' + C f, where u' is due to everything else, (1 + K C) f = K (d - u').

    Args:
        model: The condensed model of the body.
        patch: The spring.

    Attributes:
        rows: Rows of the model's touched points on which it pulls.
        force: Its force on these points [N], shape (len(rows), 3).
    """

    def __init__(self, model: CondensedModel, patch: PatchSprings) -> None:
        mesh = model.problem.mesh
        row = np.full(mesh.num_points, -1, dtype=np.int32)
        row[model.touched] = np.arange(len(model.touched))
        corners = np.unique(patch.facets)
        # Points that are fixed in all components take no force.
        points = corners[row[corners] >= 0]
        self.rows: Indices = row[points]
        self._sums = patch.row_sums()[points]
        self._seen = self.rows + len(model.seen) - len(model.touched)
        stiffness, compliance = [], []
        for point in points:
            for axis in range(3):
                unit = np.zeros_like(mesh.points)
                unit[point, axis] = 1.0
                stiffness.append(patch.multiply(unit)[points].ravel())
                response = model.compliance.response(unit[model.touched])
                compliance.append(response[self._seen].ravel())
        self._stiffness, self._compliance = np.array(stiffness).T, np.array(compliance).T
        self._solve = np.linalg.inv(np.eye(len(compliance)) + self._stiffness @ self._compliance)
        self.force = np.zeros((len(points), 3))

    def pull(self, anchor: Floats, displacement: Points) -> None:
        """Find the force of the spring.

        Args:
            anchor: Displacement of the anchor [m], shape (3,).
            displacement: Displacement of the observed points under its force and all else [m].
        """
        others = displacement[self._seen].ravel() - self._compliance @ self.force.ravel()
        right = np.outer(self._sums, anchor).ravel() - self._stiffness @ others
        self.force = (self._solve @ right).reshape(-1, 3)


class CondensedPane(Pane):
    """The condensed linear model: an equilibrium in each tick, without inertia.

    Where contact does not converge, the body stays as it was. Where tool and spring both act, each
    follows the other a tick later.

    Raises:
        InputError: The problem has loads, springs or moved supports; or one of the reasons of
            `condense` and `CondensedSteps`.
    """

    def __init__(self, problem: Problem, surface: Surface, element: Element) -> None:
        if problem.loads or problem.springs:
            raise InputError(
                "the condensed body bears tool and spring alone: leave the case's loads out"
            )
        smoothed = ", smoothed" if element is Element.SMOOTHED else ""
        name = f"{STRAIN_NAMES[Strain.LINEAR]} (condensed{smoothed})"
        super().__init__(problem, surface, Strain.LINEAR, element, name)
        drawn = np.union1d(surface.used, surface.inner)
        self._model = condense(problem, element=element, seen=drawn, keep_inside=True)
        if self._model.terms:
            raise InputError("the condensed body's supports stand still: this case moves one")
        self._steps = CondensedSteps(self._model)
        self._elastic = Body.of(problem, self.strain, element=element)
        self._rotation = problem.tools[0].path.pose_at(0.0)[1]
        row = np.zeros(problem.mesh.num_points, dtype=np.int32)
        row[self._model.seen] = np.arange(len(self._model.seen))
        self._used, self._inner = row[surface.used], row[surface.inner]
        self.reset()

    @property
    def displacement(self) -> Points:
        """See `Pane`; interior points follow those of the surface."""
        return self._model.whole_displacement(self._steps.contact_forces + self._spring_forces())

    def reset(self) -> None:
        """See `Pane`."""
        super().reset()
        self._pulling: CondensedSpring | None = None
        self._steps.clear()
        self._steps.set_base()
        self._seen = np.zeros((len(self._model.seen), 3))
        self._force = np.zeros(3)

    def attach(self, spring: Spring) -> None:
        """See `Pane`."""
        super().attach(spring)
        self._pulling = CondensedSpring(self._model, self._patch)

    def release(self) -> None:
        """See `Pane`."""
        super().release()
        self._pulling = None
        self._steps.set_base()

    def _step(self, position: Floats, num_steps: int) -> None:
        del num_steps  # there is one equilibrium
        if self._pulling is not None:
            self._pulling.pull(self._anchor, self._seen)
            self._steps.set_base(self._spring_forces())
        try:
            state = self._steps.step([(position, self._rotation)])
        except UnsettledContactError:
            return
        self._seen, self._force = state.displacement, state.forces[0]

    def _moved(self) -> Points:
        moved: Points = self._seen[self._used]
        return moved

    def _inner_moved(self) -> Points:
        moved: Points = self._seen[self._inner]
        return moved

    def mean_force(self) -> Floats:
        """See `Pane`."""
        return self._force

    def _spring_forces(self) -> Points:
        forces = np.zeros((len(self._model.touched), 3))
        if self._pulling is not None:
            forces[self._pulling.rows] = self._pulling.force
        return forces


def condensed_words(problem: Problem, element: Element) -> str:
    """The memory and time that the condensed pane of a case's body will take, in a sentence."""
    bare = dataclasses.replace(problem, loads=(), springs=(), tools=(), time=None)
    inside = [one.facets for one in inclusions_of(problem)]
    seen = np.unique(np.concatenate([problem.mesh.boundary_facets, *inside]))
    return f"condensing: {condensed_size(bare, element=element, seen=seen, keep_inside=True)}"


def make_panes(
    problem: Problem,
    surface: Surface,
    elements: tuple[Element, ...],
    *,
    is_condensed: bool = False,
) -> list[Pane]:
    """Make the panes: linear beside Green strain, then those that are asked for besides.

    These are Green strain by the further elements, and the condensed model by the first element.
    """
    kinds = [(strain, elements[0]) for strain in (Strain.LINEAR, Strain.GREEN)]
    kinds += [(Strain.GREEN, element) for element in elements[1:]]
    panes: list[Pane] = [
        ExplicitPane(problem, surface, strain, element) for strain, element in kinds
    ]
    if is_condensed:
        panes.append(CondensedPane(problem, surface, elements[0]))
    return panes
