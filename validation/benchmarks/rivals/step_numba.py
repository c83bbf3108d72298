"""Explicit steps as a plain loop over cells, compiled by numba: what a good afternoon gives."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np


@numba.njit(fastmath=True, cache=False)  # type: ignore[untyped-decorator]
def add_forces(
    u: Any, cells: Any, gradients: Any, volumes: Any, lmbda: Any, mu: Any, force: Any
) -> None:
    """Add the internal force of every cell (StVK)."""
    H = np.zeros((3, 3), u.dtype)
    S = np.zeros((3, 3), u.dtype)
    P = np.zeros((3, 3), u.dtype)
    half = u.dtype.type(0.5)
    for c in range(cells.shape[0]):
        n0 = cells[c, 0]
        g = gradients[c]
        for i in range(3):
            du1 = u[cells[c, 1], i] - u[n0, i]
            du2 = u[cells[c, 2], i] - u[n0, i]
            du3 = u[cells[c, 3], i] - u[n0, i]
            for j in range(3):
                H[i, j] = du1 * g[0, j] + du2 * g[1, j] + du3 * g[2, j]
        for i in range(3):
            for j in range(i + 1):
                S[i, j] = half * (
                    H[i, j] + H[j, i] + H[0, i] * H[0, j] + H[1, i] * H[1, j] + H[2, i] * H[2, j]
                )
        pressure = lmbda * (S[0, 0] + S[1, 1] + S[2, 2])
        for i in range(3):
            for j in range(i + 1):
                S[i, j] = (mu + mu) * S[i, j] * volumes[c]
                S[j, i] = S[i, j]
            S[i, i] += pressure * volumes[c]
        for i in range(3):
            for j in range(3):
                P[i, j] = S[i, j] + H[i, 0] * S[0, j] + H[i, 1] * S[1, j] + H[i, 2] * S[2, j]
        for a in range(3):
            n = cells[c, a + 1]
            for i in range(3):
                f = P[i, 0] * g[a, 0] + P[i, 1] * g[a, 1] + P[i, 2] * g[a, 2]
                force[n, i] += f
                force[n0, i] -= f


@numba.njit(fastmath=True, cache=False)  # type: ignore[untyped-decorator]
def run(
    num_steps: int, u: Any, increment: Any, cells: Any, gradients: Any, volumes: Any, lmbda: Any,
    mu: Any, force: Any, external: Any, mobility: Any, keep: Any,
) -> None:  # fmt: skip
    """Do steps of central differences in increments."""
    for _ in range(num_steps):
        force[:] = 0
        add_forces(u, cells, gradients, volumes, lmbda, mu, force)
        for i in range(u.shape[0]):
            for j in range(3):
                d = keep * increment[i, j] + mobility[i, j] * (external[i, j] - force[i, j])
                increment[i, j] = d
                u[i, j] += d


class Rival:
    """The same law and the same update as ours."""

    tool, version = "numba", numba.__version__

    def __init__(self, body: dict[str, Any], precision: str) -> None:
        self.precision = precision
        real = np.dtype(precision).type
        points, self._cells = body["points"], body["cells"]
        edges = points[self._cells[:, 1:]] - points[self._cells[:, :1]]
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        dt, half = float(body["time_step"]), 0.5 * float(body["mass_damping"] * body["time_step"])
        mobility = np.outer(dt**2 / (body["lumped_mass"] * (1.0 + half)), np.ones(3))
        mobility[body["held"]] = 0.0
        self._gradients = np.ascontiguousarray(np.linalg.inv(edges).transpose(0, 2, 1), real)
        self._volumes = np.ascontiguousarray(np.linalg.det(edges) / 6.0, real)
        self._lame = real(E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))), real(E / (2.0 * (1.0 + nu)))
        self._mobility, self._external = mobility.astype(real), body["external_force"].astype(real)
        self._keep = real((1.0 - half) / (1.0 + half))
        self._u = body["test_displacement"].astype(real)
        self._increment, self._nodal = np.zeros_like(self._u), np.zeros_like(self._u)
        add_forces(
            self._u, self._cells, self._gradients, self._volumes, *self._lame, self._nodal
        )  # fmt: skip
        self.force = self._nodal.copy()
        self._u[:] = 0
        self.advance(1)

    def advance(self, num_steps: int) -> None:
        """Steps in one compiled call."""
        run(
            num_steps, self._u, self._increment, self._cells, self._gradients, self._volumes,
            *self._lame, self._nodal, self._external, self._mobility, self._keep,
        )  # fmt: skip


def prepare(body: dict[str, Any]) -> Rival:
    """Set up the body in double precision."""
    return Rival(body, str(body["precision"]))
