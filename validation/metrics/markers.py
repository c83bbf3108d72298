"""Markers on a body: where they move when it does.

A marker is a ball on a pin, stuck to the surface. Its foot is a patch of surface points around the
nearest one; ball and pin follow the rigid motion that fits the patch best, so that they turn with
the face they stick to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.measured_tracks import rigid_motion

# A patch that turns needs three points; more take the mesh's roughness out.
_LEAST_POINTS = 6


@dataclass(frozen=True, eq=False)
class Pin:
    """A marker that follows a patch of the surface.

    Attributes:
        position: Of the marker at rest [m], shape (3,).
        points: Of the patch, shape (n,).
    """

    position: Points
    points: Indices

    def moved(self, rest: Points, displacement: Points) -> Points:
        """How far the marker moves [m], shape (3,).

        Args:
            rest: Points of the mesh [m], shape (num_points, 3).
            displacement: Theirs [m], shape (num_points, 3).
        """
        patch = rest[self.points]
        frame = rigid_motion(patch, patch + displacement[self.points])
        return np.asarray(frame.rotation @ self.position + frame.translation - self.position)


def pin_on(mesh: TetMesh, position: Points, *, radius: float) -> Pin:
    """A marker's pin, glued to the surface around the point nearest to it.

    Args:
        mesh: The body at rest.
        position: Of the marker [m], shape (3,).
        radius: Of the patch it is glued to [m]; widened until six points are in it.

    Returns:
        The pin.
    """
    surface = np.unique(mesh.boundary_facets)
    points = mesh.points[surface]
    foot = points[np.argmin(np.linalg.norm(points - position, axis=1))]
    distances = np.linalg.norm(points - foot, axis=1)
    reach = max(radius, float(np.sort(distances)[:_LEAST_POINTS][-1]) * (1.0 + 1e-9))
    return Pin(np.asarray(position, float), surface[distances <= reach].astype(np.int32))
