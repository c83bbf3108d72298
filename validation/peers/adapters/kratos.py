"""Kratos: total Lagrangian linear tetrahedra, Saint-Venant-Kirchhoff; Newton's method.

palpate gate CASE --simulator "python kratos.py {case} {result}"
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import KratosMultiphysics as Kratos
import KratosMultiphysics.StructuralMechanicsApplication as Structural
import numpy as np
from harness import load_parts, solve_case
from KratosMultiphysics import python_linear_solver_factory as solvers

try:
    import KratosMultiphysics.LinearSolversApplication

    SOLVER = "LinearSolversApplication.sparse_lu"
except ImportError:
    SOLVER = "skyline_lu_factorization"

TOLERANCE = 1e-9
MOST_ITERATIONS = 40


class Static:
    """The load in four parts: from rest Newton's method does not reach large deflections."""

    tool, version, precision = "Kratos", version("KratosMultiphysics"), "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
        self._job = job
        self._model = Kratos.Model()
        part = self._part = self._model.CreateModelPart("body")
        part.ProcessInfo[Kratos.DOMAIN_SIZE] = 3
        for variable in (Kratos.DISPLACEMENT, Kratos.REACTION, Structural.POINT_LOAD):
            part.AddNodalSolutionStepVariable(variable)
        tissue = part.CreateNewProperties(1)
        tissue[Kratos.YOUNG_MODULUS] = float(job["youngs_modulus"][0])
        tissue[Kratos.POISSON_RATIO] = float(job["poissons_ratio"][0])
        tissue[Kratos.DENSITY] = float(job["density"][0])
        # Hooke's law between the strain and stress of the element: in a total Lagrangian element
        # these are Green's strain and the second Piola-Kirchhoff stress.
        tissue.SetValue(Kratos.CONSTITUTIVE_LAW, Structural.LinearElastic3DLaw())
        is_linear = str(job["strain"]) == "linear"
        kind = "SmallDisplacementElement3D4N" if is_linear else "TotalLagrangianElement3D4N"
        for index, position in enumerate(job["points"].tolist(), 1):
            part.CreateNewNode(index, *position)
        for index, cell in enumerate((job["cells"] + 1).tolist(), 1):
            part.CreateNewElement(kind, index, cell, tissue)
        self._pushed = np.flatnonzero(job["external_force"].any(axis=1)).tolist()
        for index, point in enumerate(self._pushed, 1):
            part.CreateNewCondition("PointLoadCondition3D1N", index, [point + 1], tissue)
        axes = "XYZ"
        self._axes = [getattr(Kratos, f"DISPLACEMENT_{axis}") for axis in axes]
        for axis, variable in zip(axes, self._axes, strict=True):
            reaction = getattr(Kratos, f"REACTION_{axis}")
            Kratos.VariableUtils().AddDof(variable, reaction, part)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job, part = self._job, self._part
        settings = Kratos.Parameters(f'{{"solver_type": "{SOLVER}"}}')
        # A tolerance of the correction: the residual's ratio may be met far from equilibrium where
        # points are moved, and rounding may prevent it from being met.
        criterion = Kratos.DisplacementCriteria(TOLERANCE, 1e-14)
        criterion.SetEchoLevel(0)
        strategy = Kratos.ResidualBasedNewtonRaphsonStrategy(
            part,
            Kratos.ResidualBasedIncrementalUpdateStaticScheme(),
            criterion,
            Kratos.ResidualBasedBlockBuilderAndSolver(solvers.ConstructSolver(settings)),
            MOST_ITERATIONS, False, False, True,
        )  # fmt: skip
        strategy.SetEchoLevel(0)
        fixed = np.argwhere(job["fixed"]).tolist()
        iterations = 0
        for fraction in load_parts(job):
            part.CloneTimeStep(fraction)
            for point, axis in fixed:
                node = part.GetNode(point + 1)
                node.Fix(self._axes[axis])
                moved = fraction * float(job["prescribed_displacement"][point, axis])
                node.SetSolutionStepValue(self._axes[axis], moved)
            for point in self._pushed:
                load = Kratos.Array3((fraction * job["external_force"][point]).tolist())
                part.GetNode(point + 1).SetSolutionStepValue(Structural.POINT_LOAD, load)
            strategy.Initialize()
            strategy.InitializeSolutionStep()
            strategy.Predict()
            has_converged = strategy.SolveSolutionStep()
            strategy.FinalizeSolutionStep()
            iterations += int(part.ProcessInfo[Kratos.NL_ITERATION_NUMBER])
            if not has_converged:
                raise SystemExit(f"no equilibrium at {fraction:g} of the load")
        rows = [list(node.GetSolutionStepValue(Kratos.DISPLACEMENT)) for node in part.Nodes]
        self.result = {"displacement": np.array(rows)}
        return {"method": f"Newton, {SOLVER}", "newton_iterations": iterations}


if __name__ == "__main__":
    solve_case(Static)
