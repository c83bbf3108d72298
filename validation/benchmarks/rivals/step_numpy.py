"""Explicit steps in NumPy, vectorised over cells."""

from __future__ import annotations

from typing import Any

import numpy as np


class Rival:
    """The same law and the same update as ours."""

    tool, version, precision = "numpy", np.__version__, "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        points, self._cells = body["points"], body["cells"]
        edges = points[self._cells[:, 1:]] - points[self._cells[:, :1]]
        # Rows: rest gradients of shape functions 1, 2, 3.
        self._gradients = np.linalg.inv(edges).transpose(0, 2, 1)
        self._volumes = np.linalg.det(edges) / 6.0
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        self._lmbda = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        self._mu = E / (2.0 * (1.0 + nu))
        dt, half = float(body["time_step"]), 0.5 * float(body["mass_damping"] * body["time_step"])
        self._keep = (1.0 - half) / (1.0 + half)
        self._mobility = np.outer(dt**2 / (body["lumped_mass"] * (1.0 + half)), np.ones(3))
        self._mobility[body["held"]] = 0.0
        self._external = body["external_force"]
        self._u, self._increment = np.zeros_like(points), np.zeros_like(points)
        self.force = self._internal(body["test_displacement"])

    def _internal(self, u: Any) -> Any:
        at = u[self._cells]
        H = (at[:, 1:] - at[:, :1]).transpose(0, 2, 1) @ self._gradients
        strain = 0.5 * (H + H.transpose(0, 2, 1) + H.transpose(0, 2, 1) @ H)
        trace = np.trace(strain, axis1=1, axis2=2)
        S = 2.0 * self._mu * strain + self._lmbda * trace[:, None, None] * np.eye(3)
        P = (H + np.eye(3)) @ S * self._volumes[:, None, None]
        nodal = self._gradients @ P.transpose(0, 2, 1)
        nodal = np.concatenate([-nodal.sum(axis=1, keepdims=True), nodal], axis=1)
        flat, n = self._cells.ravel(), len(u)
        sums = [np.bincount(flat, nodal[:, :, j].ravel(), minlength=n) for j in range(3)]
        return np.stack(sums, axis=1)

    def advance(self, num_steps: int) -> None:
        """Central differences in increments."""
        for _ in range(num_steps):
            self._increment = self._keep * self._increment + self._mobility * (
                self._external - self._internal(self._u)
            )
            self._u = self._u + self._increment


def prepare(body: dict[str, Any]) -> Rival:
    """Set up the body."""
    return Rival(body)
