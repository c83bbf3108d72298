"""Where a check looks: cells of a region, a support, or the cut that bounds a region."""

from __future__ import annotations

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.case.regions import select_cells, select_points
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.metrics import Part


def part_of_check(spec: CheckSpec, problem: Problem, units: Units, what: str) -> Part | None:
    """What of the body a check is about; None where it is about all of it.

    Args:
        spec: The check.
        problem: The case's.
        units: The case's.
        what: "check 1": for messages.

    Raises:
        EmptyRegionError: The region selects nothing.
        InputError: No such support or tool, a support that moves in time, or a region without a
            cut: all of the body lies in it.
    """
    mesh = problem.mesh
    weights = np.zeros_like(mesh.points)
    none = np.zeros(0, dtype=np.int32)
    if spec.support is not None:
        if spec.support > len(problem.supports):
            raise InputError(
                f"{what}: support = {spec.support}, but the case has {len(problem.supports)} "
                "[[support]] tables, counted from 1"
            )
        support = problem.supports[spec.support - 1]
        if support.is_moved and support.amplitude is not None and problem.time is not None:
            raise InputError(
                f"{what}: support {spec.support} moves in time, and the inertia of what it holds "
                "is no part of what is read of its force; check one at rest"
            )
        weights[support.points] = support.components
        number = spec.support - 1
        return Part(none, weights, support=number, says=f"support {spec.support}")
    if spec.tool is not None:
        if spec.tool > len(problem.tools):
            raise InputError(
                f"{what}: tool = {spec.tool}, but the case has {len(problem.tools)} [[tool]] "
                "tables, counted from 1"
            )
        return Part(none, weights, tool=spec.tool - 1, says=f"tool {spec.tool}")
    if spec.region is None:
        return None
    if not spec.about.is_of_surface:
        cells = select_cells(mesh, spec.region, units, what)
        return Part(cells, weights, says=f"in {len(cells)} of {mesh.num_cells} cells")
    points = select_points(mesh, spec.region, units, what)
    if len(points) == mesh.num_points:
        raise InputError(
            f"{what}: all points of the body lie in the region, so that nothing is cut; make it "
            "smaller"
        )
    weights[points] = 1.0
    says = f"through the cut around {len(points)} of {mesh.num_points} points"
    return Part(none, weights, says=says)
