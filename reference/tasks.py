"""Tasks of the reference as plain data; importable without FEniCSx.

A task is called with a problem and a function that reports progress; it is passed to a child
process as a file and to the ranks of mpirun by pickling.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar

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
Answer = TypeVar("Answer")


def say_nothing(_line: str) -> None:
    """A function to report progress that drops it."""


class Task(Generic[Answer]):
    """A function to be called with a problem; its options are the fields of the task.

    Attributes:
        answer: The class of its result.
        function: "module:name" below palpate.reference; its docstring defines the fields.
    """

    answer: ClassVar[type[Any]]
    function: ClassVar[str]

    @property
    def needs_one_rank(self) -> bool:
        """Whether it cannot be distributed over the ranks of mpirun.

        Averages of smoothed tetrahedra need all cells at an edge, also those of other ranks.
        """
        return getattr(self, "element", None) is Element.SMOOTHED

    def options(self) -> dict[str, Any]:
        """Keyword arguments of the function, besides the one that reports progress."""
        return dict(vars(self))

    def __call__(self, problem: Problem, progress: Progress) -> Answer:
        """Call the function."""
        module, name = self.function.split(":")
        function = getattr(importlib.import_module(f"palpate.reference.{module}"), name)
        answer: Answer = function(problem, **self.options(), progress=progress)
        return answer


@dataclass(frozen=True)
class StaticTask(Task[ReferenceResult]):
    """`palpate.reference.statics.solve_static`."""

    strain: Strain = Strain.GREEN
    degree: int = 1
    relative_tolerance: float = 1e-10
    formulation: Formulation = Formulation.DISPLACEMENT
    element: Element = Element.LINEAR
    start: Points | None = None

    answer, function = ReferenceResult, "statics:solve_static"


@dataclass(frozen=True, eq=False)
class AdaptiveTask(Task[AdaptiveResult]):
    """`palpate.reference.adaptivity.adaptive.solve_adaptively`.

    Attributes:
        goals: Name and tolerance of each goal. A name is that of a quantity; for a quantity of a
            part of the body it is followed by "@" and a label chosen by the caller.
        seconds: Time of the budget [s].
        memory: Memory of the budget [GB].
        unknowns: Unknowns of the budget.
        part_cells: For each goal with a part, 1 in the cells whose stress counts and 0 in the
            others, shape (num_parts, num_cells).
        part_weights: `Part.weights` of the same goals, shape (num_parts, num_points, 3).
        part_supports: The support of the same goals, -1 for none, shape (num_parts,).
        strain: See `solve_adaptively`, also for the other fields.
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

    answer, function = AdaptiveResult, "adaptivity.adaptive:solve_adaptively"

    def options(self) -> dict[str, Any]:
        """Goals and budget from the plain fields."""
        from palpate.reference.adaptivity.goals import Budget, Goal, Part, Quantity

        rows = zip(self.part_cells, self.part_weights, self.part_supports, strict=True)
        parts = iter(
            [
                Part(np.flatnonzero(inside), weights, int(support) if support >= 0 else None)
                for inside, weights, support in rows
            ]
        )
        goals = [
            Goal(Quantity(name.split("@")[0]), bar, next(parts) if "@" in name else None, name)
            for name, bar in self.goals
        ]
        same = ("strain", "degree", "formulation", "start")
        return {
            "goals": goals,
            "budget": Budget(self.seconds, self.memory, self.unknowns),
            **{name: getattr(self, name) for name in same},
        }


@dataclass(frozen=True, eq=False)
class AuditTask(Task[Audit]):
    """`palpate.reference.audit.audit_displacement`."""

    displacement: Points
    strain: Strain = Strain.GREEN
    degree: int = 2

    answer, function = Audit, "audit:audit_displacement"


@dataclass(frozen=True)
class ImplicitTask(Task[ImplicitResult]):
    """`palpate.reference.dynamics.simulate_implicit`, from rest."""

    strain: Strain = Strain.GREEN
    degree: int = 2
    spectral_radius: float = 0.8
    is_mass_lumped: bool = False
    relative_tolerance: float = 1e-9

    answer, function = ImplicitResult, "dynamics:simulate_implicit"


@dataclass(frozen=True)
class SteppedTask(Task[SteppedResult]):
    """`palpate.reference.stepping.simulate_by`, from rest."""

    integrator: Integrator
    strain: Strain = Strain.GREEN
    element: Element = Element.LINEAR
    relative_tolerance: float = 1e-10

    answer, function = SteppedResult, "stepping:simulate_by"


def load_task(path: str | Path) -> Task[Any]:
    """Read a task written by `save_result`.

    Raises:
        FileFormatError: Missing, damaged, or not a task.
    """
    task: Task[Any] = load_result(path, *Task.__subclasses__())
    return task
