"""Saint-Venant-Kirchhoff with the displacement gradient transposed: a slip that is easily made.

Small strains do not show it, nor does a stretch along the axes: shear and rotation do. The wrong
force is not that of an energy, so the fault is tried on a body in motion, which always has a next
step, by central differences in NumPy (eq. 12 of the paper, corrected, with D = mass_damping M).
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.exchange.nodal_loads import (
    cell_materials,
    held_components,
    lumped_mass,
    nodal_force,
)
from palpate.validation.metrics.elasticity import shape_gradients
from palpate.validation.simulators.answer import CandidateFailedError
from palpate.validation.states import Trajectory

# Displacements beyond so many body sizes are a blow-up.
_FAR = 10.0


class _Force:
    """Nodal force of a displacement, with H = grad u or with H^T in its place."""

    def __init__(self, problem: Problem, is_transposed: bool) -> None:
        mesh = problem.mesh
        E, nu = cell_materials(problem)[:, :2].T
        self._lmbda, self._mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
        self._gradients = shape_gradients(mesh)
        self._volumes = signed_volumes(mesh.points, mesh.cells)
        self._cells, self._num_points = mesh.cells, mesh.num_points
        self._is_transposed = is_transposed

    def __call__(self, displacement: Points) -> Points:
        corners = displacement[self._cells].transpose(0, 2, 1)
        H = corners @ self._gradients
        F = np.eye(3) + (H.transpose(0, 2, 1) if self._is_transposed else H)
        green = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
        S = 2.0 * self._mu[:, None, None] * green
        S += (self._lmbda * np.einsum("cii->c", green))[:, None, None] * np.eye(3)
        P = self._volumes[:, None, None] * (F @ S)
        by_corner = self._gradients @ P.transpose(0, 2, 1)
        force = np.empty((self._num_points, 3))
        for axis in range(3):
            force[:, axis] = np.bincount(
                self._cells.ravel(), by_corner[:, :, axis].ravel(), self._num_points
            )
        return force


def simulate_in_numpy(problem: Problem, *, is_transposed: bool) -> Trajectory:
    """The trajectory from rest; the problem states its time step, its loads are dead and constant.

    Raises:
        InputError: No time span, or no step in it.
        CandidateFailedError: Displacements grow beyond any body: the transposed force pushes the
            wrong way where the body turns, and feeds its swing.

    Note:
        Only for small meshes: some thousand cells x steps each millisecond.
    """
    span = problem.time
    if span is None or span.time_step is None:
        raise InputError("this fault steps a motion: it needs time_step in [time] of the case")
    per_output = round(span.end_time / span.num_outputs / span.time_step)
    dt = span.end_time / span.num_outputs / per_output
    force = _Force(problem, is_transposed)
    outer = np.zeros_like(problem.mesh.points)
    for load in problem.loads:
        outer += nodal_force(problem.mesh, load)
    fixed, moved = held_components(problem)
    mass = lumped_mass(problem)[:, None]
    damping = span.mass_damping
    now = np.where(fixed, moved, 0.0)
    states = [now]
    # Start-up value of eq. 13 from rest.
    before = now + 0.5 * dt * dt * (outer - force(now)) / mass
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    left, right = 1.0 / dt**2 + damping / (2.0 * dt), 1.0 / dt**2 - damping / (2.0 * dt)
    for step in range(1, per_output * span.num_outputs + 1):
        after = ((outer - force(now)) / mass + 2.0 / dt**2 * now - right * before) / left
        after = np.where(fixed, moved, after)
        if not np.abs(after).max() < _FAR * size:
            raise CandidateFailedError(f"the motion left its bounds at t = {step * dt:.3g} s")
        before, now = now, after
        if step % per_output == 0:
            states.append(now)
    return Trajectory(np.linspace(0.0, span.end_time, span.num_outputs + 1), np.array(states))
