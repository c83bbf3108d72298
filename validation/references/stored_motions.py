"""The truth of a motion: implicit, quadratic, on meshes refined where the body bends.

Where it is clamped, or where tools touch it, the strain changes from cell to cell. Three meshes,
each refined from the last where its motion says, tell how far the last of them is from the limit;
three time steps on the second (on the first, nodes that come to a tool and leave it would drown it)
how far the shortest is. The truth is the finest mesh's with the shortest step.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats
from palpate.meshes.local_refinement import refine_cells
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics.pairs import make_state
from palpate.validation.references.bar_parts import BarParts
from palpate.validation.references.motion_runs import solve_implicit
from palpate.validation.references.motion_sequences import (
    assess_sequence,
    truth_metrics,
)
from palpate.validation.references.sequences import as_data, bar_of
from palpate.validation.references.sets import TRUTH
from palpate.validation.states import Progress, State, Trajectory

# Steps from output to output: all of them on the second mesh.
STEPS = (2, 4, 8)
_MESHES = 3
# Of the roughness of the strain over a motion, in the cells that are cut for the next mesh: the
# first that makes it at most so many times as large.
BULKS = (0.7, 0.5, 0.3)
GROWTH = 4


def solve_motion_truth(
    problem: Problem, strain: Strain, progress: Progress
) -> tuple[State, dict[str, BarParts], dict[str, Any]]:
    """The truth at the case's points, its error bars by part, and the sequences they come from.

    Args:
        problem: A motion.
        strain: Strain measure.
        progress: Called with one line for each run.

    Raises:
        ReferenceFailedError: A run failed.
    """
    long, middling, short = STEPS
    runs: list[State] = []
    meshes = [problem]
    for number in range(_MESHES):
        runs.append(solve_implicit(meshes[-1], strain, long, progress))
        if number + 1 < _MESHES:
            meshes.append(refine_where_rough(meshes[-1], runs[-1])[0])
    first, second, finest = (_read_at(problem.mesh, run) for run in runs)
    half, quarter = (
        _read_at(problem.mesh, solve_implicit(meshes[1], strain, steps, progress))
        for steps in (middling, short)
    )
    in_time = assess_sequence(problem, (quarter, half, second))
    in_space = assess_sequence(problem, (finest, second, first))
    truth = _read_at(problem.mesh, solve_implicit(meshes[-1], strain, short, progress))
    bars = {
        metric: BarParts(discretisation=bar_of(in_space[metric]), time=bar_of(in_time[metric]))
        for metric in truth_metrics(problem)
    }
    details = {
        "time": as_data(in_time),
        "mesh": as_data(in_space),
        "cells": [p.mesh.num_cells for p in meshes],
        "steps_per_output": list(STEPS),
    }
    return dataclasses.replace(truth, label=TRUTH), bars, details


def refine_where_rough(problem: Problem, run: State) -> tuple[Problem, float]:
    """The next mesh, and the part of the roughness that is in the cells cut for it [-].

    Args:
        problem: Whose mesh is refined.
        run: Its motion.
    """
    for bulk in BULKS:
        finer = refine_cells(problem, rough_cells(problem.mesh, run, bulk)).problem
        if finer.mesh.num_cells <= GROWTH * problem.mesh.num_cells:
            break
    return finer, bulk


def rough_cells(mesh: TetMesh, run: State, part: float) -> NDArray[np.bool_]:
    """The fewest cells that hold a part of how rough the displacement's gradient is over a motion.

    By the squared difference of each cell's gradient from the mean about its corners, by volume
    (after O. C. Zienkiewicz, J. Z. Zhu, Int. J. Numer. Meth. Engng 24, 1987).

    Args:
        mesh: Of the run.
        run: With its trajectory at the mesh's points.
        part: Of the whole, summed over the outputs [-], 0 to 1.

    Returns:
        Which cells, shape (num_cells,).
    """
    assert run.trajectory is not None
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    volumes = signed_volumes(mesh.points, mesh.cells)
    weights = np.bincount(mesh.cells.ravel(), np.repeat(volumes, 4), mesh.num_points)
    rough = np.zeros(mesh.num_cells)
    for placed in run.trajectory.displacements:
        moved = placed[mesh.cells]
        gradients = (inverse @ (moved[:, 1:] - moved[:, :1])).reshape(-1, 9)
        means = np.zeros((mesh.num_points, 9))
        np.add.at(means, mesh.cells, (volumes[:, None] * gradients)[:, None, :])
        means /= weights[:, None]
        apart = gradients[:, None, :] - means[mesh.cells]
        rough += volumes * np.sum(apart**2, axis=(1, 2))
    order = np.argsort(-rough, kind="stable")
    kept = np.searchsorted(np.cumsum(rough[order]), part * rough.sum()) + 1
    marked = np.zeros(mesh.num_cells, dtype=np.bool_)
    marked[order[:kept]] = True
    return marked


def _read_at(mesh: TetMesh, run: State) -> State:
    """A run on a refined mesh at the points of the mesh it came from, which come first."""
    assert run.trajectory is not None
    return _with(mesh, run, run.trajectory.displacements[:, : mesh.num_points], run.tool_forces)


def _with(mesh: TetMesh, run: State, moved: Floats, forces: Floats | None) -> State:
    assert run.trajectory is not None
    return make_state(
        mesh,
        moved[-1],
        label=run.label,
        simulator=run.simulator,
        strain=run.strain,
        degree=run.degree,
        seconds=run.seconds,
        details=run.details,
        tool_forces=forces,
        versions=dict(run.versions),
        trajectory=Trajectory(run.trajectory.times, moved),
    )
