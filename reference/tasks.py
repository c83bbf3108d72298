"""What the reference can be asked to do, as plain data; importable without FEniCSx.

A task is called with a problem and a place to tell progress; it travels to a child process as a
file and to the ranks of mpirun as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.result import (
    AdaptiveResult,
    Audit,
    Formulation,
    ImplicitResult,
    ReferenceResult,
    SteppedResult,
    load_result,
)
from palpate.reference.schemes import Integrator

Progress: TypeAlias = Callable[[str], None]
Answer = TypeVar("Answer", covariant=True)


class Task(Protocol[Answer]):
    """What is done with a problem.

    Attributes:
        answer: The class of what comes out.
        needs_one_rank: Whether it cannot be spread over the ranks of mpirun.
    """

    @property
    def answer(self) -> type[Answer]: ...  # noqa: D102  (above)

    @property
    def needs_one_rank(self) -> bool: ...  # noqa: D102  (above)

    def __call__(self, problem: Problem, progress: Progress) -> Answer: ...  # noqa: D102


class _OfElement:
    """Averages of smoothed tetrahedra need all cells at an edge, those of other ranks too."""

    element: Element

    @property
    def needs_one_rank(self) -> bool:
        return self.element is Element.SMOOTHED


# The fields of a task are the options of what it calls, which says what they mean.
@dataclass(frozen=True)
class StaticTask(_OfElement):
    """`palpate.reference.statics.solve_static`."""

    strain: Strain = Strain.GREEN
    degree: int = 1
    relative_tolerance: float = 1e-10
    formulation: Formulation = Formulation.DISPLACEMENT
    element: Element = Element.LINEAR
    start: Points | None = None

    answer = ReferenceResult

    def __call__(self, problem: Problem, progress: Progress) -> ReferenceResult:
        """Solve."""
        from palpate.reference.statics import solve_static

        return solve_static(problem, **vars(self), progress=progress)


@dataclass(frozen=True, eq=False)
class AdaptiveTask:
    """`palpate.reference.adaptivity.adaptive.solve_adaptively`.

    Attributes:
        goals: What each is called and its tolerance. A name is that of a quantity; where it is of
            a part of the body, "@" and something of the caller's own follow.
        seconds: Of the budget.
        memory: Likewise [GB].
        unknowns: Likewise.
        part_cells: Of the goals with a part, in their order, 1 in the cells whose stress counts and
            0 in the others, shape (num_parts, num_cells).
        part_weights: Likewise `Part.weights`, shape (num_parts, num_points, 3).
        part_supports: Likewise the support, -1 for none, shape (num_parts,).
        strain: See `solve_adaptively`; so are the others.
    """

    goals: tuple[tuple[str, float], ...]
    seconds: float
    memory: float
    strain: Strain = Strain.GREEN
    degree: int = 2
    formulation: Formulation = Formulation.DISPLACEMENT
    unknowns: float = math.inf
    part_cells: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    part_weights: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))
    part_supports: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    start: Points | None = None

    answer = AdaptiveResult
    needs_one_rank = False

    def __call__(self, problem: Problem, progress: Progress) -> AdaptiveResult:
        """Solve, estimate, refine."""
        from palpate.reference.adaptivity.adaptive import solve_adaptively
        from palpate.reference.adaptivity.goals import Budget, Goal, Part, Quantity

        rows = zip(self.part_cells, self.part_weights, self.part_supports, strict=True)
        parts = iter(
            [
                Part(np.flatnonzero(inside), weights, int(support) if support >= 0 else None)
                for inside, weights, support in rows
            ]
        )
        return solve_adaptively(
            problem,
            [
                Goal(
                    Quantity(name.split("@")[0]),
                    tolerance,
                    next(parts) if "@" in name else None,
                    name,
                )
                for name, tolerance in self.goals
            ],
            budget=Budget(self.seconds, self.memory, self.unknowns),
            strain=self.strain,
            degree=self.degree,
            formulation=self.formulation,
            start=self.start,
            progress=progress,
        )


@dataclass(frozen=True, eq=False)
class AuditTask:
    """`palpate.reference.audit.audit_displacement`."""

    displacement: Points
    strain: Strain = Strain.GREEN
    degree: int = 2

    answer = Audit
    needs_one_rank = False

    def __call__(self, problem: Problem, progress: Progress) -> Audit:
        """Audit."""
        from palpate.reference.audit import audit_displacement

        return audit_displacement(problem, **vars(self), progress=progress)


@dataclass(frozen=True)
class ImplicitTask:
    """`palpate.reference.dynamics.simulate_implicit`, from rest."""

    strain: Strain = Strain.GREEN
    degree: int = 2
    spectral_radius: float = 0.8
    is_mass_lumped: bool = False
    relative_tolerance: float = 1e-9

    answer = ImplicitResult
    needs_one_rank = False

    def __call__(self, problem: Problem, progress: Progress) -> ImplicitResult:
        """Simulate."""
        from palpate.reference.dynamics import simulate_implicit

        return simulate_implicit(problem, **vars(self), progress=progress)


@dataclass(frozen=True)
class SteppedTask(_OfElement):
    """`palpate.reference.stepping.simulate_by`, from rest."""

    integrator: Integrator
    strain: Strain = Strain.GREEN
    element: Element = Element.LINEAR
    relative_tolerance: float = 1e-10

    answer = SteppedResult

    def __call__(self, problem: Problem, progress: Progress) -> SteppedResult:
        """Step."""
        from palpate.reference.stepping import simulate_by

        return simulate_by(problem, **vars(self), progress=progress)


def load_task(path: str | Path) -> Task[Any]:
    """Read a task written by `save_result`.

    Raises:
        FileFormatError: Missing, damaged, or not a task.
    """
    task: Task[Any] = load_result(
        path, StaticTask, AdaptiveTask, AuditTask, ImplicitTask, SteppedTask
    )
    return task
