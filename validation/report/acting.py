"""What acts on a body, as numbers: areas, forces, and where they act."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Problem
from palpate.validation.exchange.nodal_arrays import area_vectors, nodal_force


@dataclass(frozen=True, eq=False)
class Acting:
    """One load on the rest body.

    Attributes:
        kind: In a word or two.
        facets: Loaded facets, shape (n, 3); none for weight and for point forces.
        area: Of them [m2].
        force: In all [N], shape (3,).
        center: Where the force acts [m], shape (3,); of a traction that varies, the middle of
            what it acts on.
        moment: About the center [N m], shape (3,); 0 but of a traction that varies.
        spread: Of a traction that varies, its value at the middle of each facet [Pa], (n, 3).
    """

    kind: str
    facets: Indices
    area: float
    force: Points
    center: Points
    moment: Points = field(default_factory=lambda: np.zeros(3))
    spread: Points | None = None


def acting(problem: Problem, load: Load) -> Acting:
    """What a load comes to on the rest body, with a factor of 1."""
    mesh = problem.mesh
    match load:
        case Traction() | Pressure():
            vectors = area_vectors(mesh.points, load.facets)
            areas = np.linalg.norm(vectors, axis=1)
            center = np.average(mesh.points[load.facets].mean(axis=1), axis=0, weights=areas)
            if isinstance(load, Pressure):
                force = -load.pressure * vectors.sum(axis=0)
                return Acting("pressure", load.facets, float(areas.sum()), force, center)
            if not load.is_uniform:
                return _varying(problem, load, float(areas.sum()), center)
            force = np.array(load.traction) * areas.sum()
            return Acting("force on a surface", load.facets, float(areas.sum()), force, center)
        case PointForce():
            center = mesh.points[load.points].mean(axis=0)
            return Acting("point force", _NONE, 0.0, np.sum(load.forces, axis=0), center)
        case BodyForce():
            low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
            force = np.array(load.force_density) * mesh.volume
            return Acting("weight", _NONE, 0.0, force, 0.5 * (low + high))


def _varying(problem: Problem, load: Traction, area: float, center: Points) -> Acting:
    points = problem.mesh.points
    nodal = nodal_force(problem.mesh, load)
    force, moment = nodal.sum(axis=0), np.cross(points - center, nodal).sum(axis=0)
    # What is left by rounding is not told.
    size = float(np.ptp(points[np.unique(load.facets)], axis=0).max())
    largest = float(np.abs(nodal).sum())
    force[np.abs(force) < 1e-12 * largest] = 0.0
    moment[np.abs(moment) < 1e-12 * largest * size] = 0.0
    spread = load.at(points[load.facets].mean(axis=1))
    kind = "force on a surface, varying," if force.any() else "moment, its force"
    return Acting(kind, load.facets, area, force, center, moment, spread)


_NONE = np.zeros((0, 3), dtype=np.int32)
