"""Static solve by dolfinx: full Newton steps, conjugate gradients with GAMG and rigid modes."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401  (the wheel: finds its libraries for the imports below)
import dolfinx
import dolfinx.fem.petsc as fem_petsc
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

_IS_OLD = tuple(map(int, dolfinx.__version__.split(".")[:2])) < (0, 6)
_JIT = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}
_OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    "pc_gamg_type": "agg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.01,
    "pc_gamg_reuse_interpolation": True,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    "mg_levels_ksp_max_it": 3,
}


class Rival:
    """One whole solve a step; the mesh, the space and the compiled forms are there already."""

    tool, version, precision, force = "dolfinx", dolfinx.__version__, "float64", None

    def __init__(self, body: dict[str, Any]) -> None:
        points, cells = body["points"], body["cells"].astype(np.int64)
        if _IS_OLD:
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
        self._is_linear = str(body["strain"]) == "linear"
        self._u = u = fem.Function(V)
        v, du = ufl.TestFunction(V), ufl.TrialFunction(V)
        identity, H = ufl.Identity(3), ufl.grad(u)
        strain = 0.5 * (H + H.T) if self._is_linear else 0.5 * (H + H.T + H.T * H)
        S = lmbda * ufl.tr(strain) * identity + 2.0 * mu * strain
        P = S if self._is_linear else (identity + H) * S
        residual = ufl.inner(P, ufl.grad(v)) * ufl.dx
        tangent = ufl.derivative(residual, u, du)
        options: dict[str, Any] = {"jit_params" if _IS_OLD else "jit_options": _JIT}
        self._residual, self._tangent = fem.form(residual, **options), fem.form(tangent, **options)
        coordinates = V.tabulate_dof_coordinates()
        order = np.lexsort(np.round(coordinates, 9).T)
        given = np.lexsort(np.round(points, 9).T)
        self._place = np.empty(len(points), np.int64)
        self._place[given] = order
        assert np.abs(coordinates[self._place] - points).max() < 1e-8
        self._load = np.empty_like(points)
        self._load[self._place] = body["external_force"]
        held = self._place[body["held"]].astype(np.int32)
        self._held = (3 * held[:, None] + np.arange(3)).ravel()
        zero = np.zeros(3, dtype=PETSc.ScalarType)
        self._bc = fem.dirichletbc(zero, np.sort(held), V)
        self._centred = coordinates - coordinates.mean(axis=0)
        self._tip = int(self._place[int(body["tip"])])
        self._tolerance = float(body["relative_tolerance"])

    def _rigid_modes(self, matrix: Any) -> Any:
        modes = np.zeros((6, len(self._centred), 3))
        for axis in range(3):
            modes[axis, :, axis] = 1.0
            modes[3 + axis] = np.cross(np.eye(3)[axis], self._centred)
        vectors = []
        for mode in np.linalg.qr(modes.reshape(6, -1).T)[0].T:
            vectors.append(matrix.createVecRight())
            vectors[-1].array[:] = mode
        return PETSc.NullSpace().create(vectors=vectors, comm=PETSc.COMM_SELF)

    def _imbalance(self) -> Any:
        force = fem.assemble_vector(self._residual)
        imbalance = self._load.ravel() - np.asarray(force.array)
        imbalance[self._held] = 0.0
        return imbalance

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        self._u.x.array[:] = 0.0
        matrix = fem_petsc.create_matrix(self._tangent)
        right, step = matrix.createVecs()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOptionsPrefix("bench_static_")
        for key, value in _OPTIONS.items():
            PETSc.Options("bench_static_")[key] = value
        ksp.setFromOptions()
        imbalance = self._imbalance()
        first = np.linalg.norm(imbalance)
        iterations = linear_iterations = 0
        relative = 1.0
        while relative > self._tolerance and iterations < 30:
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, self._tangent, bcs=[self._bc])
            matrix.assemble()
            if iterations == 0:
                matrix.setBlockSizes(3, 3)
                matrix.setNearNullSpace(self._rigid_modes(matrix))
                matrix.setOption(PETSc.Mat.Option.SPD, True)
                ksp.setOperators(matrix)
            enough = 0.3 * self._tolerance / relative
            early = 0.0 if self._is_linear else min(1e-2, 0.1 * relative)
            ksp.setTolerances(rtol=max(early, enough), max_it=2000)
            right.array[:] = imbalance
            ksp.solve(right, step)
            self._u.x.array[:] += step.array
            imbalance = self._imbalance()
            relative = float(np.linalg.norm(imbalance) / first)
            iterations += 1
            linear_iterations += ksp.getIterationNumber()
        tip = float(self._u.x.array[3 * self._tip + 2])
        for thing in (ksp, matrix, right, step):
            thing.destroy()
        return {
            "tip_displacement": tip,
            "iterations": iterations,
            "linear_iterations": linear_iterations,
            "solver": "Newton, conjugate gradients, GAMG",
        }


def prepare(body: dict[str, Any]) -> Rival:
    """Make the mesh and compile the forms."""
    return Rival(body)
