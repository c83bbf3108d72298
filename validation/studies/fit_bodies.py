"""Markers on a body as an experiment of a fit: where they move, and how that depends on numbers.

A marker is a ball on a pin, stuck to the surface. Its foot is a patch of surface points around the
nearest one; ball and pin follow the rigid motion that fits the patch best, so that they turn with
the face they stick to. Equilibria are of statics by fastsim; their derivatives are one solve of the
tangent for each parameter, that of a marker along them a difference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.fastsim.sensitivities import Change, find_sensitivities
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.measured_tracks import rigid_motion
from palpate.validation.studies.fit import Experiment, FitError

# A patch that turns needs three points; more take the mesh's roughness out.
_LEAST_POINTS = 6
# Relative step of a parameter in the forces, and of a marker along a displacement's derivative.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Pin:
    """A marker that follows a patch of the surface.

    Attributes:
        place: Of the marker at rest [m], shape (3,).
        points: Of the patch, shape (n,).
    """

    place: Points
    points: Indices

    def moved(self, rest: Points, displacement: Points) -> Points:
        """How far the marker moves [m], shape (3,).

        Args:
            rest: Points of the mesh [m], shape (num_points, 3).
            displacement: Theirs [m], shape (num_points, 3).
        """
        patch = rest[self.points]
        frame = rigid_motion(patch, patch + displacement[self.points])
        return np.asarray(frame.rotation @ self.place + frame.translation - self.place)


def pin_on(mesh: TetMesh, place: Points, *, radius: float) -> Pin:
    """A marker's pin, glued to the surface around the point nearest to it.

    Args:
        mesh: The body at rest.
        place: Of the marker [m], shape (3,).
        radius: Of the patch it is glued to [m]; widened until six points are in it.

    Returns:
        The pin.
    """
    surface = np.unique(mesh.boundary_facets)
    points = mesh.points[surface]
    foot = points[np.argmin(np.linalg.norm(points - place, axis=1))]
    distances = np.linalg.norm(points - foot, axis=1)
    reach = max(radius, float(np.sort(distances)[:_LEAST_POINTS][-1]) * (1.0 + 1e-9))
    return Pin(np.asarray(place, float), surface[distances <= reach].astype(np.int32))


@dataclass(eq=False)
class MarkedBody:
    """A body whose markers' motion from rest to equilibrium is predicted by parameters.

    Attributes:
        make: The static problem by the parameters, on one mesh.
        pins: Of each marker.
        steps: Scale of each parameter, of which differences take a ten-thousandth.
        strain: Strain measure.
        element: Its tetrahedra.
    """

    make: Callable[[Floats], Problem]
    pins: Mapping[str, Pin]
    steps: Floats
    strain: Strain = Strain.GREEN
    element: Element = Element.SMOOTHED
    _last: tuple[Floats, Problem, Points] | None = field(default=None, init=False, repr=False)

    def equilibrium(self, values: Floats) -> tuple[Problem, Points]:
        """The problem and its displacement [m], shape (num_points, 3); the last one is reused."""
        last = self._last
        if last is not None and np.array_equal(last[0], values):
            return last[1], last[2]
        problem = self.make(values)
        start = None if last is None else last[2]
        u = solve_static(problem, strain=self.strain, element=self.element, start=start)
        self._last = (np.array(values), problem, u.displacement)
        return problem, u.displacement

    def predict(self, values: Floats) -> Floats:
        """Motion of each marker [m], flat: x, y, z of the first, and so on."""
        problem, u = self.equilibrium(values)
        return self._moved(problem.mesh.points, u)

    def derivatives(self, values: Floats) -> Floats:
        """Of `predict` by the parameters, shape (3 num_markers, num_parameters)."""
        problem, u = self.equilibrium(values)
        changes = []
        for k, scale in enumerate(self.steps):
            step = np.zeros(len(self.steps))
            step[k] = _STEP * scale
            changes.append(Change(self.make(values - step), self.make(values + step), 2 * step[k]))
        found = find_sensitivities(problem, u, changes, strain=self.strain, element=self.element)
        columns, rest = [], problem.mesh.points
        for response, scale in zip(found, self.steps, strict=True):
            width = _STEP * scale
            pair = [self._moved(rest, u + sign * width * response) for sign in (1.0, -1.0)]
            columns.append((pair[0] - pair[1]) / (2.0 * width))
        return np.column_stack(columns)

    def experiment(self, name: str, moved: Mapping[str, Points], uncertainty: float,
                   finer: MarkedBody | None = None) -> Experiment:  # fmt: skip
        """The experiment in which these motions were measured.

        Args:
            name: For people.
            moved: Measured motion of each marker [m], shape (3,).
            uncertainty: Standard uncertainty of each component [m], > 0.
            finer: The same body by a finer model, for the last step.

        Returns:
            The experiment, for `fit`.

        Raises:
            FitError: A marker was not measured.
        """
        lost = [pin for pin in self.pins if pin not in moved]
        if lost:
            raise FitError(f"experiment {name}: {', '.join(lost)} was not measured; leave it out")
        return Experiment(
            name,
            [f"{pin} {axis}" for pin in self.pins for axis in "xyz"],
            np.concatenate([moved[pin] for pin in self.pins]),
            np.full(3 * len(self.pins), uncertainty),
            self.predict,
            self.derivatives,
            finer.predict if finer else None,
        )

    def _moved(self, rest: Points, u: Points) -> Floats:
        return np.concatenate([pin.moved(rest, u) for pin in self.pins.values()])
