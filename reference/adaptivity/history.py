"""What an adaptive solve found on each of its meshes, and the error bars that follow."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Problem
from palpate.reference import fenicsx
from palpate.reference.adaptivity.error_bars import error_bars
from palpate.reference.adaptivity.goals import (
    Goal,
    difference,
    has_limit,
    has_point_forces,
)
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.result import AdaptiveResult, ReferenceResult


class History:
    """What each mesh was and said."""

    def __init__(self, goals: Sequence[Goal]) -> None:
        self._goals = tuple(goals)
        self._last: ReferenceResult | None = None
        self.cells: list[int] = []
        self.unknowns: list[int] = []
        self.seconds: list[float] = []
        self.estimates: list[list[float]] = []
        self.differences: list[list[float]] = []
        self.bars: list[list[float]] = []

    def add(
        self,
        problem: Problem,
        current: Problem,
        discrete: DiscreteProblem,
        state: ReferenceResult,
        errors: dict[Goal, Floats],
    ) -> None:
        """Keep what a mesh gave: its estimates, its difference from the one before, its bars."""
        self.cells.append(current.mesh.num_cells)
        self.unknowns.append(int(fenicsx.total(discrete.num_dofs)))
        self.estimates.append([float(errors[goal].sum()) for goal in self._goals])
        self.differences.append(
            [
                math.inf
                if self._last is None
                else difference(goal, problem.mesh, state, self._last)
                for goal in self._goals
            ]
        )
        series = zip(*self.differences[1:], strict=True) if len(self.cells) > 1 else ()
        rows = list(series) or [()] * len(self._goals)
        is_singular = has_point_forces(problem, state)
        names = [goal.called for goal in self._goals]
        told = zip(names, rows, zip(*self.estimates, strict=True), strict=True)
        bars = error_bars({name: (row, estimates) for name, row, estimates in told})
        self.bars.append(
            [
                bars[goal.called]
                if has_limit(goal.quantity, state.strain, has_point_forces=is_singular)
                else math.inf
                for goal in self._goals
            ]
        )
        self._last = state

    def lose_limit(self) -> None:
        """There is a finer mesh without an equilibrium: nothing has a limit."""
        self.bars[-1] = [math.inf] * len(self._goals)

    def needs(self) -> list[float]:
        """How many times too large each goal's bar is.

        Where it has none yet, its estimate, or its difference from the mesh before if that is more.
        """
        rows = zip(
            self._goals, self.bars[-1], self.estimates[-1], self.differences[-1], strict=True
        )
        needs = [
            (bar if math.isfinite(bar) else max(e, d) if math.isfinite(d) else e) / goal.tolerance
            for goal, bar, e, d in rows
        ]
        return needs if any(need > 0.0 for need in needs) else [1.0] * len(needs)

    def met(self) -> str:
        """That every bar is small enough, in words; empty where one is not."""
        pairs = zip(self.bars[-1], self._goals, strict=True)
        return "every bar is met" if all(bar <= goal.tolerance for bar, goal in pairs) else ""

    def line(self) -> str:
        """The last mesh in a line of progress."""
        said = ", ".join(
            f"{goal.called} {bar:.2g}" for goal, bar in zip(self._goals, self.bars[-1], strict=True)
        )
        return (
            f"mesh {len(self.cells)}: {self.cells[-1]} cells, {self.unknowns[-1]} unknowns, "
            f"{self.seconds[-1]:.1f} s; bars: {said}"
        )

    def result(
        self, state: ReferenceResult, end: str, first: ReferenceResult | None
    ) -> AdaptiveResult:
        """The last state with everything kept.

        Args:
            state: The last.
            end: Why no finer mesh followed.
            first: See `AdaptiveResult`.
        """
        fields = {f.name: getattr(state, f.name) for f in dataclasses.fields(ReferenceResult)}
        return AdaptiveResult(
            **fields,
            quantities=tuple(goal.called for goal in self._goals),
            tolerances=tuple(goal.tolerance for goal in self._goals),
            num_cells=np.array(self.cells),
            num_unknowns=np.array(self.unknowns),
            seconds=np.array(self.seconds),
            estimates=np.array(self.estimates),
            differences=np.array(self.differences),
            bars=np.array(self.bars),
            ended=end,
            first=first,
        )
