"""Explicit steps as a plain loop over cells, compiled by numba: what a good afternoon gives."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from harness import central_differences, lame, rest_shape


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


class Steps:
    """The same law and the same update as ours."""

    version = numba.__version__

    def __init__(self, job: dict[str, Any]) -> None:
        self.precision = str(job["precision"])
        real = np.dtype(self.precision).type
        gradients, volumes = rest_shape(job)
        keep, mobility = central_differences(job)
        u = job["test_displacement"].astype(real)
        force = np.zeros_like(u)
        body = (
            job["cells"], np.ascontiguousarray(gradients, real), volumes.astype(real),
            *(real(modulus) for modulus in lame(job)), force,
        )  # fmt: skip
        add_forces(u, *body)
        self.answer = {"force": force.copy()}
        u[:] = 0
        self._arguments = (
            u, np.zeros_like(u), *body, job["external_force"].astype(real),
            mobility.astype(real), real(keep),
        )  # fmt: skip

    def advance(self, num_steps: int) -> None:
        """Steps in one compiled call."""
        run(num_steps, *self._arguments)
