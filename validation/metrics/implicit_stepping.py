"""The judge's own implicit motion: the schemes of `palpate.reference.schemes` in NumPy.

Each step is solved by Newton's method with a tangent by complex steps, on linear tetrahedra, apart
from fastsim and from the reference. Only the first part of a motion is stepped, to be compared with
a stored trajectory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference.schemes import Integrator, State, Stencil, stencil_of
from palpate.validation.exchange.nodal_arrays import cell_materials, fixed_components, lumped_mass
from palpate.validation.metrics.body import Body, shape_gradients
from palpate.validation.metrics.laws import along

# A step is solved where the last change of Newton's is so small beside the displacement [-].
_SOLVED = 1e-11
_MOST_ITERATIONS = 25
# Below this factor from one change to the next the tangent of before serves on.
_FAST = 0.1


def can_be_stepped(body: Body) -> bool:
    """Whether its forces are those of each cell alone, and fixed components those of the axes."""
    span = body.problem.time
    is_plain = body.slopes is None and not body.problem.springs and not body.problem.tools
    return is_plain and not body.is_smoothed and not (span and span.stiffness_damping)


def consistent_mass(body: Body) -> Any:
    """The mass matrix of linear shape functions [kg], sparse, (num_points, num_points).

    Masses on the surface are lumped at their points.
    """
    from scipy.sparse import coo_matrix, diags

    mesh, problem = body.mesh, body.problem
    of_cells = signed_volumes(mesh.points, mesh.cells) * cell_materials(problem)[:, 2]
    blocks = of_cells[:, None, None] * (np.eye(4) + 1.0) / 20.0
    rows = np.repeat(mesh.cells, 4, axis=1).ravel()
    columns = np.tile(mesh.cells, (1, 4)).ravel()
    shape = (mesh.num_points, mesh.num_points)
    full = coo_matrix((blocks.ravel(), (rows, columns)), shape=shape).tocsr()
    hung = lumped_mass(problem) - np.asarray(full.sum(axis=1)).ravel()
    return full + diags(hung)


@dataclass(frozen=True, eq=False)
class ImplicitStepper:
    """Steps a body's motion to its first outputs by an implicit scheme.

    Attributes:
        body: The body, for which `can_be_stepped`.
        scheme: The scheme.
        per_output: Steps to an output.
        num_outputs: Outputs after the first.
        has_consistent_mass: Whether the mass matrix is full, not lumped.
    """

    body: Body
    scheme: Integrator
    per_output: int
    num_outputs: int
    has_consistent_mass: bool = False

    def outputs(self) -> Iterator[Points]:
        """The state at each output [m], (num_points, 3); ends where a step has no solution."""
        from scipy.sparse.linalg import splu

        span = self.body.problem.time
        assert span is not None
        dt, free = span.end_time / span.num_outputs / self.per_output, self._free
        u, v = self._at_supports(np.zeros(self.body.mesh.points.size), 0.0), self._speed
        a = np.zeros_like(u)
        force = self._force(u, 0.0)
        a[free] = splu(self._mass[free][:, free].tocsc()).solve(force[free])
        a -= span.mass_damping * v
        state, solver = State(u, v, a), None
        for step in range(self.per_output * self.num_outputs):
            stencil = stencil_of(self.scheme, state, dt)
            solved, solver = self._solve(stencil, step * dt, span.mass_damping, solver)
            if solved is None:
                return
            state = stencil.after(solved)
            if (step + 1) % self.per_output == 0:
                yield state.u.reshape(-1, 3)

    def _solve(
        self, stencil: Stencil, time: float, damping: float, solver: Any
    ) -> tuple[Floats | None, Any]:
        """The displacement at the end of a step, None where there is none, and the last tangent."""
        from scipy.sparse.linalg import splu

        free, last = self._free, np.inf
        u = self._at_supports(stencil.state.u + stencil.time_step * stencil.state.v,
                              time + stencil.time_step)  # fmt: skip
        for _ in range(_MOST_ITERATIONS):
            inertia = stencil.acceleration(u) + damping * stencil.velocity(u)
            middle = stencil.middle(u)
            lacking = self._force(middle, time + stencil.theta * stencil.time_step)
            lacking -= self._mass @ inertia
            if not np.isfinite(lacking).all():
                return None, None
            if solver is None:
                matrix = (stencil.A + damping * stencil.B) * self._mass
                matrix = matrix + stencil.theta * self._tangent(middle)
                solver = splu(matrix[free][:, free].tocsc())
            change = solver.solve(lacking[free])
            u[free] += change
            size = float(np.abs(change).max())
            if size <= _SOLVED * float(np.abs(u).max()):
                return u, solver
            solver, last = (solver if size < _FAST * last else None), size
        return None, None

    def _force(self, u: Floats, time: float) -> Floats:
        """External less internal force [N], flat."""
        moved = u.reshape(-1, 3)
        found: Floats = (self.body.external(moved, time) - self.body.internal(moved)).ravel()
        return found

    def _tangent(self, u: Floats) -> Any:
        """Derivative of the internal forces [N/m], sparse; that of loads is left out."""
        from scipy.sparse import coo_matrix

        body = self.body
        H, mesh = body.gradient(u.reshape(-1, 3)), body.mesh
        C = np.empty((mesh.num_cells, 3, 3, 3, 3))
        for i, j in np.ndindex(3, 3):
            unit = np.zeros_like(H)
            unit[:, i, j] = 1.0
            C[..., i, j] = along(body.first_stress, H, unit)
        g = shape_gradients(mesh)
        blocks = np.einsum("c,cal,cklij,cbj->cakbi", body.volumes, g, C, g, optimize=True)
        dofs = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(-1, 12)
        rows, columns = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
        return coo_matrix((blocks.ravel(), (rows, columns)), shape=(u.size, u.size)).tocsr()

    @cached_property
    def _mass(self) -> Any:
        from scipy.sparse import diags, identity, kron

        lumped = diags(lumped_mass(self.body.problem))
        scalar = consistent_mass(self.body) if self.has_consistent_mass else lumped
        return kron(scalar, identity(3)).tocsr()

    @cached_property
    def _free(self) -> Any:
        return np.flatnonzero(~self.body.fixed.ravel())

    @cached_property
    def _speed(self) -> Floats:
        problem, speed = self.body.problem, np.zeros_like(self.body.mesh.points)
        if problem.initial_velocity is not None:
            speed = np.where(self.body.fixed, 0.0, problem.initial_velocity.at(problem.mesh.points))
        return speed.ravel()

    def _at_supports(self, u: Floats, time: float) -> Floats:
        """With fixed components where supports put them at a time [s]."""
        placed: Floats = np.where(
            self.body.fixed.ravel(), fixed_components(self.body.problem, time)[1].ravel(), u
        )
        return placed
