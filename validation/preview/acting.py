"""What acts on a body, as numbers: areas, forces, and where they act."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Problem
from palpate.validation.exchange.facets import area_vectors


@dataclass(frozen=True, eq=False)
class Acting:
    """One load on the rest body.

    Attributes:
        kind: In a word or two.
        facets: Loaded facets, shape (n, 3); none for weight and for point forces.
        area: Of them [m2].
        force: In all [N], shape (3,).
        center: Where the force acts [m], shape (3,).
    """

    kind: str
    facets: Indices
    area: float
    force: Points
    center: Points


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
            force = np.array(load.traction) * areas.sum()
            return Acting("force on a surface", load.facets, float(areas.sum()), force, center)
        case PointForce():
            center = mesh.points[load.points].mean(axis=0)
            return Acting("point force", _NONE, 0.0, np.sum(load.forces, axis=0), center)
        case BodyForce():
            low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
            force = np.array(load.force_density) * mesh.volume
            return Acting("weight", _NONE, 0.0, force, 0.5 * (low + high))


_NONE = np.zeros((0, 3), dtype=np.int32)
