"""The truth of a static case on meshes refined where its error comes from, and its record.

Its stresses are stored where a part of the body is asked for: where no goal asks for finer cells
their difference from mesh to mesh says nothing of their error.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.reference.result import LOST, AdaptiveResult, formulation_for
from palpate.validation.metrics import WHOLE_BODY_METRICS, Part, stress_integrals
from palpate.validation.references.bars import NOISE, name_of_part
from palpate.validation.references.reference_set import TRUTH
from palpate.validation.references.runs import state_of, stresses_of
from palpate.validation.states import Progress, State

if TYPE_CHECKING:
    from palpate.reference.adaptivity.goals import JudgedSolution

DEGREE = 2
# Key of the record of such a truth in a file's provenance.
ADAPTIVE = "adaptive"
# Asked for only where a check does.
ENERGY = "strain_energy"


def whole_metrics(problem: Problem) -> tuple[str, ...]:
    """Metrics that have a bar for every body as a whole, and for the tools on it."""
    return (*WHOLE_BODY_METRICS, *(["tool_force"] if problem.tools else []))


@dataclass(frozen=True)
class TruthRequest:
    """What a stored truth has to reach, and the budget for it.

    Attributes:
        bar: Largest error bar that is small enough, relative [-].
        seconds: Time budget of the reference for each strain measure [s].
        memory: Its memory budget [GB].
        metrics: Metrics of the whole body, whose bars are to be that small, by strain measure; of
            others no bar is asked.
        unknowns: Most unknowns of the largest mesh.
        parts: Pairs of a metric and the part of the body it is asked in, by strain measure, with
            bars as small.
        start: See `solve_adaptively`.
        residual: Relative residual of the equilibria [-].
        judged: Solutions that it is solved for alone: where its bars decide on them, it ends.
        has_others: Whether metrics of which no bar is asked have one all the same, which takes
            their duals.
    """

    bar: float = 0.005
    seconds: float = 900.0
    memory: float = 8.0
    metrics: Mapping[Strain, Collection[str]] = field(default_factory=dict)
    unknowns: float = math.inf
    parts: Mapping[Strain, Sequence[tuple[str, Part]]] = field(default_factory=dict)
    start: Points | None = None
    residual: float = 1e-10
    judged: tuple[JudgedSolution, ...] = ()
    has_others: bool = True

    def tolerance(self, metric: str, strain: Strain) -> float:
        """The bar asked of a metric; where nothing is checked, twice that of displacement."""
        wanted = self.metrics.get(strain, ())
        if not wanted:
            return 2.0 * self.bar if metric == "displacement_l2" else math.inf
        return self.bar if metric in wanted else math.inf

    def asks_energy(self, strain: Strain) -> bool:
        """Whether the energy is checked, which is stored beside the stresses."""
        return ENERGY in self.metrics.get(strain, ())

    def named_parts(self, strain: Strain) -> dict[str, Part]:
        """The parts by what their metrics are called among error bars, each once."""
        return {name_of_part(metric, part): part for metric, part in self.parts.get(strain, ())}


def solve_truth(
    problem: Problem, strain: Strain, request: TruthRequest, progress: Progress
) -> tuple[State, dict[str, float], dict[str, Any]]:
    """Solve adaptively in a child process.

    Returns:
        The state at the problem's points, bars by metric, and the record of meshes for the file.

    Raises:
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    return truth_of(problem, strain, request, refine_truth(problem, strain, request, progress))


def truth_of(
    problem: Problem, strain: Strain, request: TruthRequest, found: AdaptiveResult
) -> tuple[State, dict[str, float], dict[str, Any]]:
    """The result of `refine_truth`, as `solve_truth` returns it."""
    seconds = float(found.seconds.sum())
    integrals = None
    if request.named_parts(strain) or request.asks_energy(strain):
        integrals = stress_integrals(problem.mesh, stresses_of(found), found.strain_energy)
    state = state_of(
        found, strain, label=TRUTH, degree=found.degree, seconds=seconds, integrals=integrals
    )
    return state, {name: found.bar(name) for name in found.quantities}, record_of(found)


def refine_truth(
    problem: Problem, strain: Strain, request: TruthRequest, progress: Progress
) -> AdaptiveResult:
    """`solve_adaptively` in a child process, as it was asked for.

    Raises:
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    from palpate.reference.adaptivity import goals as goals_of
    from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
    from palpate.reference.child import run_task
    from palpate.reference.tasks import AdaptiveTask

    progress(f"{TRUTH}, {strain} strain, adaptive, from {problem.mesh.num_cells} cells")
    whole = (*whole_metrics(problem), ENERGY)
    tolerances = {name: request.tolerance(name, strain) for name in whole}
    goals = [
        Goal(Quantity(name), tolerance)
        for name, tolerance in tolerances.items()
        if request.has_others or math.isfinite(tolerance)
    ]
    for name, part in request.named_parts(strain).items():
        # Of validation's part what the reference knows of.
        own = goals_of.Part(np.unique(part.cells), part.weights, part.support)
        goals.append(Goal(Quantity(name.partition("@")[0]), request.bar, own, name))
    task = AdaptiveTask(
        tuple(goals),
        Budget(request.seconds, request.memory, request.unknowns),
        strain,
        DEGREE,
        formulation_for(problem, DEGREE),
        relative_tolerance=request.residual,
        start=request.start,
        judged=request.judged,
    )
    # The budget is respected by not beginning; what was begun is not cut off.
    found = run_task(task, problem, time_limit=4.0 * request.seconds, progress=progress)
    assert isinstance(found, AdaptiveResult)
    progress(f"{TRUTH}, {strain} strain: {found.ended}")
    return found


def record_of(found: AdaptiveResult) -> dict[str, Any]:
    """The sequence of meshes as plain values; JSON knows no infinity: None."""

    def column(values: Any, k: int) -> list[float | None]:
        return [_finite(v) for v in values[:, k]]

    return {
        "degree": found.degree,
        "formulation": found.formulation.value,
        "ended": found.ended,
        "cells": [int(n) for n in found.num_cells],
        "unknowns": [int(n) for n in found.num_unknowns],
        "smallest_det_f": [float(f"{d:.6g}") for d in found.smallest_det_fs],
        "lowest_eigenvalue": _finite(found.lowest_eigenvalue),
        "load_over_critical": _finite(found.load_over_critical),
        "seconds": [round(float(s), 1) for s in found.seconds],
        "metrics": {
            name: {
                "estimates": column(found.estimates, k),
                "differences": column(found.differences, k)[1:],
                "bars": column(found.bars, k),
            }
            for k, name in enumerate(found.quantities)
        },
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def why_without_limit(record: Any, problem: Problem, strain: Strain, metric: str) -> str:
    """Why the meshes of a record leave a metric without a bar; empty where they leave one.

    A record, which anybody may have written, of an older version has no smallest det F.
    """
    from palpate.reference.adaptivity.error_bars import goes_towards_inversion
    from palpate.reference.adaptivity.goals import Quantity, softens

    if not isinstance(record, Mapping):
        return ""
    ended, values = record.get("ended"), record.get("smallest_det_f")
    if isinstance(ended, str) and ended.startswith(LOST):
        return f"the truth has no limit: {ended}"
    name = metric.partition("@")[0]
    is_of_points = name in {str(q) for q in Quantity} and Quantity(name).is_of_points
    if not (is_of_points and softens(problem, strain) and isinstance(values, list)):
        return ""
    if not all(isinstance(v, int | float) for v in values) or not goes_towards_inversion(values):
        return ""
    shown = ", ".join(f"{v:.3g}" for v in values)
    return (
        f"the truth's smallest det F falls with every mesh ({shown}): a cell inverts at a corner "
        f"as the mesh is refined, so that {name} has no limit; round the corner or "
        f"{'press less deep' if problem.tools else 'lower the load'}"
    )


def recorded_bars(tables: Mapping[str, Any]) -> dict[str, float]:
    """The bars that recorded sequences make, by metric; see `error_bars`.

    Infinite where a table, which anybody may have written, is none.
    """
    from palpate.reference.adaptivity.error_bars import error_bars
    from palpate.reference.adaptivity.goals import Quantity

    known = {str(quantity) for quantity in Quantity}
    sequences: dict[str, tuple[list[float], list[float]]] = {}
    for metric, table in tables.items():
        if metric.partition("@")[0] not in known:
            continue
        try:
            differences, estimates = (
                [math.inf if v is None else float(v) for v in table[key]]
                for key in ("differences", "estimates")
            )
        except (KeyError, TypeError, ValueError):
            continue
        if len(estimates) == len(differences) + 1:
            sequences[metric] = differences, estimates
    return dict.fromkeys(tables, math.inf) | error_bars(sequences)


def most_apart(table: Mapping[str, Any]) -> float:
    """How far the first mesh of a record can be from the last, by the triangle inequality.

    Each difference is in units of its finer mesh's size, which is at most the last one's times
    1 + d for each step after it.
    """
    whole, larger = 0.0, 1.0
    for value in reversed(list(_differences(table))):
        whole += value * larger
        larger *= 1.0 + value
    return whole + NOISE


def least_apart(table: Mapping[str, Any]) -> float:
    """How near the first mesh of a record can be to the last; see `most_apart`."""
    first, *later = list(_differences(table)) or [0.0]
    size = math.prod(max(0.0, 1.0 - value) for value in later)
    whole = first * size - most_apart({"differences": later})
    return max(0.0, whole) if math.isfinite(whole) else 0.0


def _differences(table: Mapping[str, Any]) -> Iterator[float]:
    found = table.get("differences")
    for value in found if isinstance(found, list) else [None]:
        yield float(value) if isinstance(value, int | float) else math.inf
