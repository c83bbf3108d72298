"""Errors of whole displacement fields against quadratic elements, and what fastsim takes to solve.

Studies of error against run time use it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Element, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.point_location import locate

STVK = "Saint-Venant-Kirchhoff"


@dataclass(frozen=True, eq=False)
class FieldTruth:
    """The displacement by quadratic elements, at the points of a problem's mesh [m].

    Of a motion at each of its outputs, (num_times, num_points, 3).
    """

    problem: Problem
    displacement: Points

    def error_of(self, other: TetMesh, displacement: Points) -> float:
        """Relative L2 distance of a solution on another mesh [-].

        Of a motion the largest of all times, over the largest displacement of all.
        """
        mesh, cells = self.problem.mesh, other.cells
        where = locate(other.points, cells, mesh.points)
        shape = (-1, other.num_points, 3)
        there = np.array([where.read(cells, state) for state in displacement.reshape(shape)])
        truth = self.displacement.reshape(-1, mesh.num_points, 3)
        if len(there) != len(truth):
            return float("inf")
        off = [l2_norm(mesh, state) for state in there - truth]
        return max(off) / max(l2_norm(mesh, state) for state in truth)

    def change_of(self, coarser: FieldTruth) -> float:
        """Relative L2 distance from a truth on a coarser mesh, at its points [-]."""
        mesh = coarser.problem.mesh
        here = read_at(self.problem.mesh, self.displacement, mesh.points)
        return l2_norm(mesh, coarser.displacement - here) / l2_norm(mesh, here)


def read_at(mesh: TetMesh, displacement: Points, positions: Points) -> Points:
    """A linear field at positions in its body [m]."""
    return locate(mesh.points, mesh.cells, positions).read(mesh.cells, displacement)


def time_fastsim(problem: Problem, element: Element = Element.LINEAR) -> tuple[float, Points]:
    """Processor time of the fastest of three solves [s], one where slow; the displacement [m]."""
    best, displacement = float("inf"), np.zeros_like(problem.mesh.points)
    for _ in range(3):
        start = time.process_time()
        displacement = solve_static(problem, element=element).displacement
        best = min(best, time.process_time() - start)
        if best > 1.0:
            break
    return best, displacement
