"""The judge's own springs over patches: see `palpate.meshes.spring`.

By quadrature at four places of each facet, where kappa and u are read between the corners: the
product of kappa, u and a shape function is of degree 3, and so it is exact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.nodal_arrays import FACET_PLACES, FACET_WEIGHTS, facet_areas


def spring_force(
    mesh: TetMesh, spring: Spring, displacement: Points, time: float | None = None
) -> Points:
    """Force of a spring on each point [N], (num_points, 3).

    Args:
        mesh: At rest.
        spring: With its facets in that mesh.
        displacement: Of the points [m].
        time: Of its path [s]; where it ends, at full stiffness, if None.
    """
    anchor = spring.path.end if time is None else spring.path.at(time)
    kappa = spring.densities(mesh.points)
    if time is not None and spring.amplitude is not None:
        kappa = spring.amplitude(time) * kappa
    apart = anchor - displacement[spring.facets]
    return _integrated(mesh, spring, kappa, apart)


def stiffness_times(mesh: TetMesh, springs: Sequence[Spring], change: Points) -> Points:
    """What springs at full stiffness push back with if a body moves on [N], (num_points, 3)."""
    force = np.zeros_like(change)
    for spring in springs:
        kappa = spring.densities(mesh.points)
        force += _integrated(mesh, spring, kappa, change[spring.facets])
    return force


def _integrated(mesh: TetMesh, spring: Spring, kappa: Floats, field: Points) -> Points:
    """Integral of kappa f N_a over the patch; both by the corners of the facets."""
    force = np.zeros_like(mesh.points)
    areas = facet_areas(mesh.points, spring.facets)
    for place, weight in zip(FACET_PLACES, FACET_WEIGHTS, strict=True):
        pushed = (weight * areas * (kappa @ place))[:, None] * np.einsum("k,mkj->mj", place, field)
        for corner, share in enumerate(place):
            np.add.at(force, spring.facets[:, corner], share * pushed)
    return force
