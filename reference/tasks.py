"""Tasks of the reference as plain data; importable without FEniCSx.

A task is called with a problem and a function that reports progress; it is passed to a child
process and to the ranks of mpirun by pickling.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeAlias, TypeVar

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.adaptivity.goals import Budget, Goal, JudgedSolution
from palpate.reference.result import (
    AdaptiveResult,
    Audit,
    Formulation,
    ImplicitResult,
    ReferenceResult,
    SteppedResult,
)
from palpate.reference.schemes import Integrator

Progress: TypeAlias = Callable[[str], None]
Answer = TypeVar("Answer")


def say_nothing(_line: str) -> None:
    """A function to report progress that drops it."""


class Task(Generic[Answer]):
    """A function to be called with a problem; its options are the fields of the task.

    `function` is "module:name" below palpate.reference; its docstring defines the fields.
    """

    function: ClassVar[str]

    @property
    def needs_one_rank(self) -> bool:
        """Whether it cannot be distributed over the ranks of mpirun.

        Averages of smoothed tetrahedra need all cells at an edge, also those of other ranks.
        """
        return getattr(self, "element", None) is Element.SMOOTHED

    def __call__(self, problem: Problem, progress: Progress) -> Answer:
        """Call the function."""
        module, name = self.function.split(":")
        function = getattr(importlib.import_module(f"palpate.reference.{module}"), name)
        answer: Answer = function(problem, **vars(self), progress=progress)
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

    function = "statics:solve_static"


@dataclass(frozen=True, eq=False)
class AdaptiveTask(Task[AdaptiveResult]):
    """`palpate.reference.adaptivity.adaptive.solve_adaptively`."""

    goals: tuple[Goal, ...]
    budget: Budget
    strain: Strain = Strain.GREEN
    degree: int = 2
    formulation: Formulation = Formulation.DISPLACEMENT
    relative_tolerance: float = 1e-10
    start: Points | None = None
    judged: tuple[JudgedSolution, ...] = ()

    function = "adaptivity.adaptive:solve_adaptively"


@dataclass(frozen=True, eq=False)
class AuditTask(Task[Audit]):
    """`palpate.reference.audit.audit_displacement`."""

    displacement: Points
    strain: Strain = Strain.GREEN
    degree: int = 2

    function = "audit:audit_displacement"


@dataclass(frozen=True)
class ImplicitTask(Task[ImplicitResult]):
    """`palpate.reference.dynamics.simulate_implicit`, from rest."""

    strain: Strain = Strain.GREEN
    degree: int = 2
    spectral_radius: float = 0.8
    is_mass_lumped: bool = False
    relative_tolerance: float = 1e-9

    function = "dynamics:simulate_implicit"


@dataclass(frozen=True)
class SteppedTask(Task[SteppedResult]):
    """`palpate.reference.stepping.simulate_by`, from rest."""

    integrator: Integrator
    strain: Strain = Strain.GREEN
    element: Element = Element.LINEAR
    relative_tolerance: float = 1e-10

    function = "stepping:simulate_by"
