"""Points of the surface at which the gap from a tool is measured, and their part in constraints.

The distance g from a tool is taken at points q of the surface, each a combination of nodes j with
shares b, and a constraint i averages them over its rest area a_i with parts c:

    x_q = sum_j b_qj (X_j + u_j),   g_i = sum_q c_qi g(x_q).

Pressures p_i do the virtual work sum_i a_i p_i dg_i: a force of sum_i a_i p_i c_qi along the normal
at each point, and b_qj of that at its nodes.

Nodes: every node is a point and a constraint. Its area is the integral of its shape function over
the contact facets: a quadrature of the facets that is exact to the degree of the displacement and
has no more constraints than the surface has nodes (Gauss points on a curved tool have more, and
lock). Degree 1: the vertices, a third of each facet, the discrete problem of linear simulators.
Degree 2: the midpoints of the edges, a third of each facet; the vertices have no area.

Facets (degree 1, see `ContactRule`): c_qi = A_f w_q (4 b_qi - 1) / a_i at the points of the facets
of a vertex, so that a gap that is linear in a facet is averaged to its value at the vertex. A
constraint reaches all vertices of the facets at its own. Averages of vectors, and forces on them,
which friction asks for, have the same parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.rigid_tool import ContactRule
from palpate.reference import fenicsx
from palpate.reference.fenicsx import ufl
from palpate.reference.loads import traction_work
from palpate.reference.mesh_transfer import TransferredSpace


def _points_of_facet() -> Points:
    """Barycentric coordinates of the points of a facet, shape (12, 3); each weighs a twelfth."""
    corners, middles = np.eye(3), 0.5 * (1.0 - np.eye(3))
    quarters = [middles, *([corners[k], middles[k - 1], middles[k - 2]] for k in range(3))]
    inner = (1.0 + 3.0 * np.eye(3)) / 6.0  # (2/3, 1/6, 1/6) and its rotations
    return np.concatenate([inner @ np.array(quarter) for quarter in quarters])


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Points of the surface that may touch a tool, in m patches of q points and w nodes each.

    A patch is a node, or a facet with its corners.

    Attributes:
        nodes: Blocked dofs that this rank owns, one for each constraint, shape (n,).
        rest: Rest positions of these nodes [m], shape (n, 3).
        areas: Rest areas of the constraints [m2], shape (n,), >= 0; 0 only for nodes without one.
        facet_size: Root of twice the mean facet area [m].
        own_dofs: Displacements of these nodes in a flat vector of all unknowns, shape (n, 3).
        dofs: The same of the patches' nodes, shape (m, w, 3).
        corners: Rest positions of the patches' nodes [m], shape (m, w, 3).
        shares: Combination of nodes that is a point [-], the same in each patch, shape (q, w).
        constraints: Numbers of the constraints of the patches' nodes, shape (m, w).
        parts: Part of a point in these constraints [-], shape (m, q, w); 0 for a node that is fixed
            along all three axes.
        point_areas: Rest area of each point [m2], shape (m q,).
    """

    nodes: Indices
    rest: Points
    areas: Floats
    facet_size: float
    own_dofs: Indices
    dofs: Indices
    corners: Points
    shares: Floats
    constraints: Indices
    parts: Floats
    point_areas: Floats

    def positions(self, displacement: Floats) -> Points:
        """Deformed positions of the points for a flat vector of all unknowns [m], (m q, 3)."""
        corners = self.corners + displacement[self.dofs]
        placed: Points = np.einsum("qw,mwi->mqi", self.shares, corners).reshape(-1, 3)
        return placed

    def values(self, field: Floats) -> Points:
        """A flat vector of all unknowns at the points, shape (m q, 3)."""
        values: Points = np.einsum("qw,mwi->mqi", self.shares, field[self.dofs]).reshape(-1, 3)
        return values

    def gaps(self, distances: Floats) -> Floats:
        """Averages of values at the points, shape (m q,), in the constraints, shape (n,)."""
        by_patch = np.einsum("mqw,mq->mw", self.parts, distances.reshape(self.parts.shape[:2]))
        return _sums(self.constraints, by_patch, len(self.areas))

    def averages(self, vectors: Points) -> Points:
        """The same of vectors at the points, shape (m q, 3): shape (n, 3)."""
        return np.stack([self.gaps(component) for component in vectors.T], axis=1)

    def normals(self, normals: Points) -> Points:
        """The directions of averages of normals at the points, shape (n, 3)."""
        averages = self.averages(normals)
        if self.shares.shape[1] == 1:  # nodes have their own
            return averages
        lengths = np.linalg.norm(averages, axis=1)[:, None]
        directions: Points = averages / np.where(lengths > 0.0, lengths, 1.0)
        return directions

    def loads(self, pressures: Floats) -> Floats:
        """Forces along the normals at the points [N], (m q,), of pressures [Pa], (n,)."""
        forces = (self.areas * pressures)[self.constraints]
        loads: Floats = np.einsum("mqw,mw->mq", self.parts, forces).ravel()
        return loads

    def spread(self, tractions: Points) -> Points:
        """Forces at the points [N], (m q, 3), of tractions on the averages [Pa], (n, 3)."""
        return np.stack([self.loads(component) for component in tractions.T], axis=1)

    def at_nodes(self, forces: Points, num_dofs: int) -> Floats:
        """Flat nodal forces of forces at the points, shape (m q, 3)."""
        vectors = forces.reshape(*self.parts.shape[:2], 3)
        nodal = np.einsum("qw,mqi->mwi", self.shares, vectors)
        return _sums(self.dofs, nodal, num_dofs)

    @cached_property
    def _reach(self) -> tuple[Indices, Indices, Indices]:
        """The nodes that the constraints depend on, those of one constraint after the other.

        Returns:
            Their displacements, shape (r, 3); where those of each constraint begin, shape (n + 1,);
            and the row of every (patch, constraint, node), shape (m, w, w).
        """
        shape = (*self.constraints.shape, self.constraints.shape[1])
        of = np.broadcast_to(self.constraints[:, :, None], shape).ravel()
        node = np.broadcast_to(self.dofs[:, None, :, 0], shape).ravel()
        pairs, row = np.unique(np.stack([of, node]), axis=1, return_inverse=True)
        dofs = np.empty((pairs.shape[1], 3), dtype=np.int32)
        dofs[row.ravel()] = np.broadcast_to(self.dofs[:, None], (*shape, 3)).reshape(-1, 3)
        starts = np.searchsorted(pairs[0], np.arange(len(self.areas) + 1))
        return dofs, starts, row.reshape(shape)

    def gradients(self, normals: Points) -> tuple[list[Indices], list[Floats]]:
        """Displacements that each constraint depends on, and its derivatives by them, flat."""
        dofs, starts, rows = self._reach
        vectors = normals.reshape(*self.parts.shape[:2], 3)
        each = np.einsum("mqv,mqi,qw->imvw", self.parts, vectors, self.shares)
        sums = [_sums(rows, one, len(dofs)) for one in each]
        inner = starts[1:-1]
        values = np.split(np.stack(sums, axis=1), inner)
        return [of.ravel() for of in np.split(dofs, inner)], [of.ravel() for of in values]

    def reached(self) -> list[Indices]:
        """Displacements that each constraint depends on."""
        dofs, starts, _ = self._reach
        return [of.ravel() for of in np.split(dofs, starts[1:-1])]

    def blocks(self, stiffness: Floats) -> Floats:
        """Stiffness of the patches, shape (m, 3 w, 3 w), of that at the points, (m q, 3, 3)."""
        (m, q, w), b = self.parts.shape, self.shares
        at_points = stiffness.reshape(m, q, 3, 3)
        blocks: Floats = np.einsum("qv,mqij,qw->mviwj", b, at_points, b)
        return blocks.reshape(m, 3 * w, 3 * w)


def _sums(rows: Indices, values: Floats, count: int) -> Floats:
    sums: Floats = np.bincount(rows.ravel(), values.ravel(), count).astype(np.float64, copy=False)
    return sums


def find_contact_points(
    space: TransferredSpace,
    facets: Indices,
    fixed: Indices,
    numbers: Indices | None = None,
    rule: ContactRule = ContactRule.VERTICES,
) -> ContactPoints:
    """Collect the points of the facets that may touch a tool.

    Nodes that are fixed along all three axes have no constraint.

    Args:
        space: Displacement space; for contact over facets of degree 1, on one rank.
        facets: Facets by the mesh's points, shape (m, 3); empty is the whole boundary.
        fixed: Degrees of freedom of the displacement that are fixed, shape (n,).
        numbers: Indices of displacements among all unknowns, shape (at least 3 num_blocks,); None
            where there are no other unknowns.
        rule: VERTICES stands for the nodes of any degree.
    """
    source = space.transferred.source
    chosen = facets if len(facets) else source.boundary_facets
    v = ufl.TestFunction(space.space)
    # The same form as for any traction, so that nothing more is compiled.
    work = traction_work(space, Traction(chosen, (1.0, 1.0, 1.0)), v, "a tool")
    nodal = fenicsx.assemble_vector(fenicsx.form(work))[::3]
    ends = source.points[chosen]
    doubled = np.linalg.norm(np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]), axis=1)
    entities = space.transferred.facet_entities(chosen, "a tool")
    nodes = np.asarray(fenicsx.fem.locate_dofs_topological(space.space, 2, entities), np.int32)
    nodes = nodes[nodes < space.num_blocks]
    nodes = nodes[np.bincount(fixed // 3, minlength=space.num_blocks)[nodes] < 3]
    # For degree 2 the shape functions of vertices integrate to rounding errors.
    least = 1e-12 * fenicsx.largest(float(nodal.max(initial=0.0)))
    areas = np.where(nodal[nodes] > least, nodal[nodes], 0.0)
    number = np.full(space.num_blocks, -1, dtype=np.int32)
    number[nodes] = np.arange(len(nodes))
    if rule is ContactRule.FACETS:
        patches = space.dof_of_point[chosen]
        is_near = (number[patches] >= 0).any(axis=1)
        patches, shares = patches[is_near], _points_of_facet()
        point_areas = 0.5 * doubled[is_near, None] / len(shares)  # the same at each point
        constraints = number[patches]
        over = np.where(constraints >= 0, areas[constraints], np.inf)
        parts = (4.0 * shares - 1.0) * (point_areas / over)[:, None, :]
        constraints = np.where(constraints >= 0, constraints, constraints.max(axis=1)[:, None])
        of_points = np.repeat(point_areas, len(shares))
    else:
        patches, shares, constraints = nodes[:, None], np.ones((1, 1)), number[nodes][:, None]
        parts, of_points = np.ones((len(nodes), 1, 1)), areas
    axes = np.arange(3, dtype=np.int32)
    own, dofs = 3 * nodes[:, None] + axes, 3 * patches[:, :, None] + axes
    if numbers is not None:
        own, dofs = numbers[own], numbers[dofs]
    corners, size = space.coordinates[patches], float(np.sqrt(doubled.mean()))
    return ContactPoints(
        nodes, space.coordinates[nodes], areas, size, own, dofs, corners, shares, constraints,
        parts, of_points,
    )  # fmt: skip
