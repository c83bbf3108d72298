"""Where contact is looked for: nodes of the body's boundary with their parts of its rest area.

The area of a node is the integral of its shape function over the contact facets: a quadrature of
the facets that is exact to the degree of the displacement and holds no more constraints than the
surface has nodes (Gauss points on a curved tool do, and lock). Degree 1: the vertices, a third of
each facet, the discrete problem of linear simulators. Degree 2: the middles of the edges, a third
of each facet; nothing at the vertices, which follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Traction
from palpate.reference import fenicsx
from palpate.reference.fenicsx import ufl
from palpate.reference.loads import traction_work
from palpate.reference.mesh_transfer import TransferredSpace


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Nodes of the surface that may touch a tool.

    Attributes:
        nodes: Blocked dofs, of this rank's own, shape (n,).
        dofs: Where their displacements stand in a flat vector of all unknowns, shape (n, 3).
        rest: Rest places [m], shape (n, 3).
        areas: Part of the rest area [m2], shape (n,), >= 0; 0 only where a node follows others.
        facet_size: Root of twice the mean facet area [m].
    """

    nodes: Indices
    dofs: Indices
    rest: Points
    areas: Floats
    facet_size: float

    def places(self, displacement: Floats) -> Points:
        """Where the nodes are under a flat vector of all unknowns [m], shape (n, 3)."""
        placed: Points = self.rest + displacement[self.dofs]
        return placed


def find_contact_points(
    space: TransferredSpace, facets: Indices, held: Indices, numbers: Indices | None = None
) -> ContactPoints:
    """Collect the nodes of the facets that may touch a tool.

    A node that is held along all three axes takes no part.

    Args:
        space: Displacement space.
        facets: By the mesh's points, shape (m, 3); empty is the whole boundary.
        held: Degrees of freedom of the displacement that are held, shape (n,).
        numbers: Where displacements stand among all unknowns, shape (at least 3 num_blocks,); None
            where there are no others.
    """
    source = space.transferred.source
    chosen = facets if len(facets) else source.boundary_facets
    v = ufl.TestFunction(space.space)
    # The form of any traction: nothing more to compile.
    work = traction_work(space, Traction(chosen, (1.0, 1.0, 1.0)), v, "a tool")
    nodal = fenicsx.assemble_vector(fenicsx.form(work))[::3]
    corners = source.points[chosen]
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    entities = space.transferred.facet_entities(chosen, "a tool")
    nodes = np.asarray(fenicsx.fem.locate_dofs_topological(space.space, 2, entities), np.int32)
    nodes = nodes[nodes < space.num_blocks]
    nodes = nodes[np.bincount(held // 3, minlength=space.num_blocks)[nodes] < 3]
    # Of degree 2 the shape functions of vertices integrate to rounding errors.
    least = 1e-12 * fenicsx.largest(float(nodal.max(initial=0.0)))
    areas = np.where(nodal[nodes] > least, nodal[nodes], 0.0)
    dofs = 3 * nodes[:, None] + np.arange(3, dtype=np.int32)
    if numbers is not None:
        dofs = numbers[dofs]
    size = float(np.sqrt(doubled.mean()))
    return ContactPoints(nodes, dofs, space.coordinates[nodes], areas, size)
