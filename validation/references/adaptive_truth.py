"""The truth of a static case on meshes refined where its error comes from, and its record.

It tells no stresses: they are no goal of the refinement yet, and where no goal asks for finer cells
their difference from mesh to mesh says nothing of their error.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate.meshes.problem import Problem, Strain
from palpate.reference.result import AdaptiveResult, formulation_for
from palpate.validation.metrics import COMPARISONS
from palpate.validation.references.sequences import NOISE
from palpate.validation.references.static_states import state_of
from palpate.validation.states import Progress, State

DEGREE = 2
# Where a file's provenance keeps the record of such a truth.
ADAPTIVE = "adaptive"


@dataclass(frozen=True)
class TruthRequest:
    """What is asked of a stored truth.

    Attributes:
        bar: Largest error bar that is small enough, relative [-].
        seconds: Of the reference's budget, for each strain measure.
        memory: Likewise [GB].
        metrics: Whose bars are to be that small, by strain measure; the others' are what they are.
        unknowns: Of the largest mesh.
    """

    bar: float = 0.005
    seconds: float = 900.0
    memory: float = 8.0
    metrics: Mapping[Strain, Collection[str]] = field(default_factory=dict)
    unknowns: float = math.inf

    def tolerance(self, metric: str, strain: Strain) -> float:
        """The bar that is asked of a metric; where nothing is checked, twice it of displacement."""
        wanted = self.metrics.get(strain, ())
        if not wanted:
            return 2.0 * self.bar if metric == "displacement_l2" else math.inf
        return self.bar if metric in wanted else math.inf


def solve_truth(
    problem: Problem,
    strain: Strain,
    request: TruthRequest,
    progress: Progress,
    *,
    label: str,
) -> tuple[State, dict[str, float], dict[str, Any]]:
    """Solve adaptively in a child process.

    Returns:
        The state at the problem's points, bars by metric, and the record of meshes for the file.

    Raises:
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    found = refine_truth(problem, strain, request, progress, label=label)
    seconds = float(found.seconds.sum())
    state = state_of(found, strain, label=label, degree=found.degree, seconds=seconds)
    bars = {metric: found.bar(metric) for metric in COMPARISONS}
    return state, bars, record_of(found)


def refine_truth(
    problem: Problem, strain: Strain, request: TruthRequest, progress: Progress, *, label: str
) -> AdaptiveResult:
    """`solve_adaptively` in a child process, as it was asked for.

    Raises:
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import AdaptiveTask

    progress(f"{label}, {strain} strain, adaptive, from {problem.mesh.num_cells} cells")
    task = AdaptiveTask(
        tuple((metric, request.tolerance(metric, strain)) for metric in COMPARISONS),
        request.seconds,
        request.memory,
        strain,
        DEGREE,
        formulation_for(problem, DEGREE),
        request.unknowns,
    )
    # The budget is kept by not beginning; what was begun is not cut off.
    found = run_task(task, problem, time_limit=4.0 * request.seconds, progress=progress)
    assert isinstance(found, AdaptiveResult)
    progress(f"{label}, {strain} strain: {found.ended}")
    return found


def record_of(found: AdaptiveResult) -> dict[str, Any]:
    """The sequence of meshes as plain values; JSON knows no infinity: None."""

    def column(values: Any, k: int) -> list[float | None]:
        return [float(v) if math.isfinite(v) else None for v in values[:, k]]

    return {
        "degree": found.degree,
        "formulation": found.formulation.value,
        "ended": found.ended,
        "cells": [int(n) for n in found.num_cells],
        "unknowns": [int(n) for n in found.num_unknowns],
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


def recorded_bars(tables: Mapping[str, Any]) -> dict[str, float]:
    """The bars that kept sequences make, by metric, as they were made; see `error_bars`.

    Infinite where a table, which anybody may have written, is none.
    """
    from palpate.reference.adaptivity.goals import error_bars

    kept: dict[str, tuple[list[float], list[float]]] = {}
    for metric, table in tables.items():
        try:
            differences, estimates = (
                [math.inf if v is None else float(v) for v in table[key]]
                for key in ("differences", "estimates")
            )
        except (KeyError, TypeError, ValueError):
            continue
        if len(estimates) == len(differences) + 1:
            kept[metric] = differences, estimates
    return dict.fromkeys(tables, math.inf) | error_bars(kept)


def most_apart(table: Mapping[str, Any]) -> float:
    """How far the first mesh of a kept sequence can be from the last, by the triangle inequality.

    Each difference is in units of its finer mesh's size, which is at most the last one's times
    1 + d for each step after it.
    """
    whole, larger = 0.0, 1.0
    for value in reversed(list(_differences(table))):
        whole += value * larger
        larger *= 1.0 + value
    return whole + NOISE


def _differences(table: Mapping[str, Any]) -> Iterator[float]:
    found = table.get("differences")
    for value in found if isinstance(found, list) else [None]:
        yield float(value) if isinstance(value, int | float) else math.inf
