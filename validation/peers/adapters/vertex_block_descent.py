"""Vertex block descent, or XPBD, in plain NumPy: motions by backward Euler.

    palpate gate CASE --simulator "python vertex_block_descent.py {case} {result} {iterations}"
        --iterations 20 --integrator backward-euler --time-step 2.5e-3

A step from u with velocity v minimises, over the displacement u+ at its end,

    w/2 |u+ - y|^2 + W(u+),   w = (1 + lambda dt) m / dt^2,   y = u + (m v / dt + F) / w

with lumped masses m, mass damping lambda and dead loads F; then v+ = (u+ - u) / dt.

In block descent each point takes its own Newton step with the others fixed, colour by colour: A.
H. Chen, Z. Liu, Y. Yang, C. Yuksel, Vertex Block Descent, ACM Trans. Graphics 43 (2024), eq. 6-10,
without acceleration. It converges to the minimum, which is the solution of backward Euler.

With `method=xpbd` behind the iterations the six Green strains of a cell are its constraints (M.
Müller, N. Chentanez, T.-Y. Kim, M. Macklin, Strain Based Dynamics, 2014), with the inverse of V
times Saint-Venant-Kirchhoff's moduli as their compliance (M. Macklin, M. Müller, N. Chentanez,
XPBD, 2016: algorithm 1, eq. 18 for six at once). So its energy is the law's. Multipliers are summed
along directions that change during the iteration, which XPBD neglects: with more iterations it
converges to backward Euler only where steps are short.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import all_gradients, solve_case

# Rows and columns of xx, yy, zz, xy, xz, yz.
_I, _J = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])


class Body(ABC):
    """The arrays of a case in motion, and its steps."""

    version, takes = np.__version__, ("inclusions", "masses in motion")
    starts_at_y = False  # from y, block descent would need a line search or many more iterations

    def __init__(self, job: dict[str, Any]) -> None:
        if job["strain"] != "green":
            raise ValueError("only Green strain is known here")
        if job["time_step"] is None:
            raise ValueError("the case states no time_step")
        self._job, self.law_name = job, str(job["law"])
        self._iterations = int(job.get("iterations", 20))
        self.points, self.cells = job["points"], job["cells"]
        self.gradients, self.volumes = all_gradients(job)
        E, nu = job["youngs_modulus"], job["poissons_ratio"]
        self.lmbda, self.mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        self.is_free = job["fixed"] == 0

    @abstractmethod
    def improve(self, u: Any, y: Any, w: Any) -> None:
        """Improve u+ once, in place."""

    def deformation_gradients(self, u: Any, cells: Any) -> Any:
        """F of some cells, (n, 3, 3)."""
        return np.eye(3) + np.einsum("cai,caj->cij", u[self.cells[cells]], self.gradients[cells])

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From rest, or the initial velocity, to the end."""
        job, dt, times = self._job, float(self._job["time_step"]), self._job["output_times"]
        mass, force = job["lumped_mass"][:, None], job["external_force"]
        u = np.zeros_like(self.points)
        v = np.where(self.is_free, job.get("initial_velocity", u), 0.0)
        w = (1.0 + job["mass_damping"] * dt) * mass / dt**2
        states, per_output = [u], round(times[1] / dt)
        count = per_output * (len(times) - 1)
        if abs(per_output * dt - times[1]) > 1e-9 * dt:
            # Outputs lie between steps: every step is sent, to the first behind the end.
            per_output, count = 1, int(np.ceil(times[-1] / dt * (1.0 - 1e-9)))
            times = dt * np.arange(count + 1)
        for step in range(count):
            y = u + np.where(self.is_free, (mass * v / dt + force) / w, 0.0)
            new = y.copy() if self.starts_at_y else u.copy()
            for _ in range(self._iterations):
                self.improve(new, y, w)
            u, v = new, (new - u) / dt
            if not np.isfinite(u).all():
                raise SystemExit(f"no finite number after step {step + 1}")
            if (step + 1) % per_output == 0:
                states.append(u)
        self.result = {"displacement": np.array(states), "times": times}
        return {"integrator": "backward-euler", "time_step": dt, "iterations": self._iterations}


def colours(neighbours: list[Any]) -> list[Any]:
    """Greedy colouring: groups of items in which no two are neighbours."""
    of: list[int] = []
    for item, near in enumerate(neighbours):
        taken = {of[other] for other in near if other < item}
        of.append(next(k for k in range(item + 1) if k not in taken))
    return [np.flatnonzero(np.array(of) == k) for k in range(max(of) + 1)]


class BlockDescent(Body):
    """Block descent: sweeps over all points, colour by colour."""

    tool, laws = "vertex block descent", ("saint-venant-kirchhoff", "neo-hookean-stable")

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job)
        is_stvk = self.law_name == self.laws[0]
        self._blocks: Callable[..., Any] = self._stvk if is_stvk else self._neo_hookean_stable
        around: list[set[int]] = [set() for _ in self.points]
        for cell in self.cells.tolist():
            for point in cell:
                around[point] |= set(cell) - {point}
        self._groups = []
        for group in colours(around):
            of = np.full(len(self.points), -1)
            of[group] = np.arange(len(group))
            cells, corners = np.nonzero(of[self.cells] >= 0)
            self._groups.append((group, cells, corners, of[self.cells[cells, corners]]))

    def _stvk(self, u: Any, cells: Any, corners: Any) -> tuple[Any, Any]:
        """Forces and stiffnesses at corners, divided by volume."""
        F, g = self.deformation_gradients(u, cells), self.gradients[cells, corners]
        lmbda, mu, one = self.lmbda[cells, None, None], self.mu[cells, None, None], np.eye(3)
        E = 0.5 * (F.transpose(0, 2, 1) @ F - one)
        S = lmbda * np.trace(E, axis1=1, axis2=2)[:, None, None] * one + 2.0 * mu * E
        Sg, Fg = np.einsum("cij,cj->ci", S, g), np.einsum("cij,cj->ci", F, g)
        stiffness = np.einsum("ci,ci->c", g, Sg)[:, None, None] * one
        stiffness = stiffness + (lmbda + mu) * Fg[:, :, None] * Fg[:, None, :]
        stiffness += mu * np.einsum("ci,ci->c", g, g)[:, None, None] * (F @ F.transpose(0, 2, 1))
        return np.einsum("cij,cj->ci", F, Sg), stiffness

    def _neo_hookean_stable(self, u: Any, cells: Any, corners: Any) -> tuple[Any, Any]:
        F, g = self.deformation_gradients(u, cells), self.gradients[cells, corners]
        mu, L = self.mu[cells, None], (self.lmbda + self.mu)[cells, None]
        cofactor = np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])
        a, J = np.einsum("cij,cj->ci", cofactor, g), np.linalg.det(F)[:, None]
        force = mu * np.einsum("cij,cj->ci", F, g) + L * (J - 1.0 - mu / L) * a
        # det F is linear in the position of each point: it has no second derivative.
        stiffness = (mu[:, 0] * np.einsum("ci,ci->c", g, g))[:, None, None] * np.eye(3)
        return force, stiffness + L[:, :, None] * a[:, :, None] * a[:, None, :]

    def improve(self, u: Any, y: Any, w: Any) -> None:
        """One sweep over all points."""
        for group, cells, corners, rows in self._groups:
            f, K = self._blocks(u, cells, corners)
            volumes = self.volumes[cells]
            force = -w[group] * (u[group] - y[group])
            np.subtract.at(force, rows, volumes[:, None] * f)
            stiffness = w[group][:, :, None] * np.eye(3)
            np.add.at(stiffness, rows, volumes[:, None, None] * K)
            # A fixed component does not move.
            free = self.is_free[group]
            stiffness = np.where(free[:, :, None] & free[:, None, :], stiffness, np.eye(3))
            u[group] += np.linalg.solve(stiffness, np.where(free, force, 0.0)[..., None])[..., 0]


class PositionBased(Body):
    """XPBD: sweeps over all cells; multipliers start at zero in each step, with its new y."""

    tool, starts_at_y = "XPBD", True

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job)
        count = len(self.cells)
        of_point: list[list[int]] = [[] for _ in self.points]
        for number, cell in enumerate(self.cells.tolist()):
            for point in cell:
                of_point[point].append(number)
        near = [{k for p in cell for k in of_point[p]} - {n} for n, cell in enumerate(self.cells)]
        self._groups = colours(near)
        # W = V (lmbda/2 (tr E)^2 + mu E : E), where the shears count twice in E : E.
        moduli = np.zeros((count, 6, 6))
        moduli[:, :3, :3] = self.lmbda[:, None, None]
        moduli[:, np.arange(6), np.arange(6)] += self.mu[:, None] * np.array([2, 2, 2, 4, 4, 4])
        self._compliances = np.linalg.inv(self.volumes[:, None, None] * moduli)
        self._multipliers, self._last = np.zeros((count, 6)), np.zeros(0)

    def improve(self, u: Any, y: Any, w: Any) -> None:
        """One sweep over all cells."""
        if y is not self._last:
            self._multipliers[:], self._last = 0.0, y
        mobility = np.where(self.is_free, 1.0 / w, 0.0)
        for cells in self._groups:
            F, g = self.deformation_gradients(u, cells), self.gradients[cells]
            E = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
            # dE_ij / du_a = (F_.i g_aj + F_.j g_ai) / 2.
            D = 0.5 * (
                np.einsum("cmk,cak->ckam", F[:, :, _I], g[:, :, _J])
                + np.einsum("cmk,cak->ckam", F[:, :, _J], g[:, :, _I])
            )
            inverse_mass = mobility[self.cells[cells]]
            alpha, total = self._compliances[cells], self._multipliers[cells]
            matrix = np.einsum("ckam,cam,clam->ckl", D, inverse_mass, D) + alpha
            left = -E[:, _I, _J] - np.einsum("ckl,cl->ck", alpha, total)
            change = np.linalg.solve(matrix, left[..., None])[..., 0]
            self._multipliers[cells] = total + change
            u[self.cells[cells]] += inverse_mass * np.einsum("ckam,ck->cam", D, change)


if __name__ == "__main__":
    solve_case(None, PositionBased if "method=xpbd" in sys.argv else BlockDescent)
