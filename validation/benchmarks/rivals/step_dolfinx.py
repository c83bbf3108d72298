"""Explicit steps whose force dolfinx assembles from UFL."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401  (the wheel: finds its libraries for the imports below)
import dolfinx
import ufl
from dolfinx import fem
from mpi4py import MPI

_OPTIONS = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}


class Rival:
    """StVK; residual assembled as a vector at each step."""

    tool, version, precision = "dolfinx", dolfinx.__version__, "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        is_old = tuple(map(int, dolfinx.__version__.split(".")[:2])) < (0, 6)
        points, cells = body["points"], body["cells"].astype(np.int64)
        if is_old:
            shape = ufl.Cell("tetrahedron", geometric_dimension=3)
            element = ufl.Mesh(ufl.VectorElement("Lagrange", shape, 1))
            mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, points, element)
            V = fem.VectorFunctionSpace(mesh, ("Lagrange", 1))
        else:
            import basix.ufl

            element = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
            mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, element, points)
            V = fem.functionspace(mesh, ("Lagrange", 1, (3,)))
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
        u, v = fem.Function(V), ufl.TestFunction(V)
        identity = ufl.Identity(3)
        F = identity + ufl.grad(u)
        strain = 0.5 * (F.T * F - identity)
        S = lmbda * ufl.tr(strain) * identity + 2.0 * mu * strain
        residual = ufl.inner(F * S, ufl.grad(v)) * ufl.dx
        if is_old:
            self._form = fem.form(residual, jit_params=_OPTIONS)
        else:
            self._form = fem.form(residual, jit_options=_OPTIONS)
        # P1: one dof block for each vertex, numbered as the geometry's nodes are after create_mesh.
        place = self._place_of_points(V, points)
        dt, half = float(body["time_step"]), 0.5 * float(body["mass_damping"] * body["time_step"])
        self._keep = (1.0 - half) / (1.0 + half)
        mobility = np.outer(dt**2 / (body["lumped_mass"] * (1.0 + half)), np.ones(3))
        mobility[body["held"]] = 0.0
        self._mobility, self._load = np.empty_like(points), np.empty_like(points)
        self._mobility[place], self._load[place] = mobility, body["external_force"]
        self._u, self._array = u, u.x.array.reshape(-1, 3)
        self._vector = fem.assemble_vector(self._form)
        self._increment = np.zeros_like(points)
        self._array[place] = body["test_displacement"]
        self.force = self._internal()[place].copy()
        self._array[:] = 0.0

    @staticmethod
    def _place_of_points(V: Any, points: Any) -> Any:
        found = V.tabulate_dof_coordinates()
        order, given = np.lexsort(np.round(found, 9).T), np.lexsort(np.round(points, 9).T)
        place = np.empty(len(points), np.int64)
        place[given] = order
        assert np.abs(found[place] - points).max() < 1e-8
        return place

    def _internal(self) -> Any:
        self._vector.array[:] = 0.0
        fem.assemble_vector(self._vector.array, self._form)
        return self._vector.array.reshape(-1, 3)

    def advance(self, num_steps: int) -> None:
        """Central differences in increments."""
        for _ in range(num_steps):
            force = self._load - self._internal()
            self._increment *= self._keep
            self._increment += self._mobility * force
            self._array += self._increment


def prepare(body: dict[str, Any]) -> Rival:
    """Compile the form."""
    return Rival(body)
