"""Convergence in h and p on smooth problems: a manufactured solution, and a confined column."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate.fastsim.statics import StaticResult, solve_static
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.metrics.elasticity import strain_energy
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.studies.column import ColumnAnswer, column, exact_column
from palpate.validation.studies.error_family import ErrorFamily
from palpate.validation.studies.manufactured import errors, manufactured_problem

Solve = Callable[..., StaticResult]
# Refinements of the column for each degree: more would take minutes, and drown in rounding.
LEVELS = {1: 3, 2: 3, 3: 2}
# Of the order of a field: 0.1 where three meshes are near the limit, 0.2 where two must do.
_TOLERANCES = {1: 0.1, 2: 0.1, 3: 0.2}


def follow_manufactured(
    bricks: tuple[int, ...] = (6, 12, 24), *, solve: Solve = solve_static
) -> list[ErrorFamily]:
    """Fastsim's P1 on uniform meshes of the cube: L2 order 2, H1 order 1.

    Args:
        bricks: Along an edge, rising.
        solve: fastsim's statics, or what is put to the test in its place.
    """
    found, notes = [], []
    for count in bricks:
        problem = manufactured_problem(count)
        found.append(errors(problem.mesh, solve(problem).displacement))
        notes.append(f"{problem.mesh.num_cells} cells")
    sizes = tuple(1.0 / n for n in bricks)
    return [
        ErrorFamily(
            name=f"manufactured solution, {norm} of P1 (fastsim)",
            label=f"P1, {norm} norm",
            what="h",
            sizes=sizes,
            errors=tuple(pair[k] for pair in found),
            expected_order=order,
            tolerance=tolerance,
            notes=tuple(notes),
        )
        for k, (norm, order, tolerance) in enumerate((("L2", 2.0, 0.2), ("H1", 1.0, 0.1)))
    ]


def follow_degrees(progress: Callable[[str], None]) -> list[ErrorFamily]:
    """The reference's P1, P2 and P3 on the column: energy, whose order is twice the field's.

    The difference of strain energy at equilibrium is the square of the energy norm of the error,
    to leading order, so half its order is that of the displacement in the energy norm: p.
    """
    from palpate.reference.child import solve_static_in_child

    exact = exact_column()
    families = []
    for degree, count in LEVELS.items():
        found, notes = [], []
        for level in range(count):
            problem = column(level)
            progress(f"column, P{degree}, {problem.mesh.num_cells} cells")
            result = solve_static_in_child(problem, degree=degree, relative_tolerance=1e-12)
            found.append(abs(result.strain_energy / exact.strain_energy - 1.0) ** 0.5)
            notes.append(f"{problem.mesh.num_cells} cells")
        families.append(
            ErrorFamily(
                name=f"confined column, energy norm of P{degree} (reference)",
                label=f"P{degree}, energy norm",
                what="p",
                sizes=tuple(0.5**level for level in range(count)),
                errors=tuple(found),
                expected_order=float(degree),
                tolerance=_TOLERANCES[degree],
                notes=tuple(notes),
            )
        )
    return families


@dataclass(frozen=True)
class ColumnGrids:
    """fastsim on the column's three meshes, and what its grid convergence index says.

    Attributes:
        quantity: Which number.
        exact: In closed form.
        assessed: From the three meshes.
        expected_order: By theory [-].
    """

    quantity: str
    exact: float
    assessed: GridConvergence
    expected_order: float = 2.0

    @property
    def is_contained(self) -> bool:
        """Does the error bar around the finest value hold the exact one?"""
        bar = self.assessed.error_bar
        return bar is not None and abs(self.assessed.value - self.exact) <= bar


def follow_column(*, first: int = 1, solve: Solve = solve_static) -> list[ColumnGrids]:
    """Energy and change of volume of the column by fastsim on three meshes, with their GCI.

    Args:
        first: Refinements of the coarsest mesh.
        solve: fastsim's statics, or what is put to the test in its place.
    """
    answers = []
    for level in range(first, first + 3):
        problem = column(level)
        u, mesh = solve(problem).displacement, problem.mesh
        change = float(signed_volumes(mesh.points + u, mesh.cells).sum()) - mesh.volume
        answers.append(ColumnAnswer(strain_energy(problem, u, Strain.GREEN), change))
    exact = exact_column()
    return [
        ColumnGrids(
            quantity,
            getattr(exact, name),
            assess_grid_convergence(
                [getattr(a, name) for a in reversed(answers)], [1.0, 2.0, 4.0], expected_order=2.0
            ),
        )
        for quantity, name in (
            ("strain energy [J]", "strain_energy"),
            ("change of volume [m3]", "volume_change"),
        )
    ]
