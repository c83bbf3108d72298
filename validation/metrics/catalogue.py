"""Every metric by name: unit, scale, meaning, and how it is measured."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.metrics import fields, motion, pairs, surfaces
from palpate.validation.metrics.finite import are_measurable
from palpate.validation.metrics.own_mesh import measure_on_own_mesh
from palpate.validation.metrics.pairs import Difference
from palpate.validation.metrics.stillness import is_still
from palpate.validation.states import State

Compare = Callable[[Problem, State, State], Difference]


@dataclass(frozen=True)
class Metric:
    """One metric.

    Attributes:
        name: As in a case file.
        meaning: What it says, in one line.
        scale: What the error is divided by.
        compare: Candidate and reference to a relative error; None where it is the candidate's own.
        unit: Of the value.
        needs_same_mesh: Judged against the reference on the same mesh only: a quadratic solution
            read at the points does not carry it.
        needs_time: For cases with [time] only.
        needs_tools: Of cases with tools only.
        looks_at: Which states of a motion.
        reads_own_samples: Of the states as they were sent, not as they are read between them.
    """

    name: str
    meaning: str
    scale: str
    compare: Compare | None
    unit: str = "-"
    needs_same_mesh: bool = False
    needs_tools: bool = False
    needs_time: bool = False
    looks_at: str = "the last output"
    reads_own_samples: bool = False


def _of_mesh(name: str) -> Compare:
    compare = pairs.COMPARISONS[name]
    return lambda problem, candidate, reference: compare(problem.mesh, candidate, reference)


def _of_oscillation(name: str) -> Compare:
    return lambda problem, candidate, reference: motion.oscillation(
        name, problem, candidate, reference
    )


_LARGEST = "largest displacement of the reference"

CATALOGUE = {
    metric.name: metric
    for metric in (
        Metric(
            "displacement_l2",
            "error of displacement over the whole body, by rest volume",
            "L2 norm of the reference's displacement",
            _of_mesh("displacement_l2"),
        ),
        Metric(
            "displacement_h1",
            "error of the displacement's gradient: local strain and rotation",
            "H1 seminorm of the reference's displacement",
            fields.displacement_h1,
            needs_same_mesh=True,
        ),
        Metric(
            "energy_norm",
            "error of strain weighted by stiffness",
            "energy norm of the reference's displacement",
            fields.energy_norm,
            needs_same_mesh=True,
        ),
        Metric(
            "displacement_max",
            "largest error of displacement at a point",
            _LARGEST,
            _of_mesh("displacement_max"),
        ),
        Metric(
            "max_displacement",
            "error of the largest displacement",
            _LARGEST,
            _of_mesh("max_displacement"),
        ),
        Metric(
            "volume",
            "error of the deformed volume",
            "change of volume of the reference",
            _of_mesh("volume"),
        ),
        Metric(
            "local_volume",
            "root mean square error of det F over the cells",
            "root mean square of the reference's det F - 1",
            fields.local_volume,
            needs_same_mesh=True,
        ),
        Metric(
            "surface_area",
            "error of the deformed area",
            "change of area of the reference",
            _of_mesh("surface_area"),
        ),
        Metric(
            "surface_hausdorff",
            "largest distance between the deformed surfaces",
            _LARGEST,
            surfaces.surface_hausdorff,
        ),
        Metric(
            "surface_mean_distance",
            "mean distance between the deformed surfaces",
            _LARGEST,
            surfaces.surface_mean_distance,
        ),
        Metric(
            "reaction_force",
            "largest error of a support's total force",
            "largest support force of the reference",
            fields.reaction_force,
            needs_same_mesh=True,
        ),
        Metric(
            "tool_force",
            "largest error of the force on a tool",
            "largest force of the reference on a tool",
            fields.tool_force,
            needs_same_mesh=True,
            needs_tools=True,
            looks_at="all outputs: means from one to the next",
        ),
        Metric(
            "strain_energy",
            "error of the strain energy",
            "strain energy of the reference",
            fields.energy,
            needs_same_mesh=True,
        ),
        Metric(
            "trajectory_l2",
            "largest error of displacement over time",
            "largest L2 norm of the reference's displacement over time",
            motion.trajectory_l2,
            needs_time=True,
            looks_at="all outputs",
        ),
        *(
            Metric(
                name,
                f"error of the {name.removeprefix('oscillation_')} of the point that swings most",
                "the reference's (phase: one period; damping: its frequency; mean: its amplitude)",
                _of_oscillation(name),
                needs_time=True,
                looks_at="every state that was sent",
                reads_own_samples=True,
            )
            for name in motion.OSCILLATION
        ),
        Metric(
            "smallest_det_f",
            "smallest volume ratio of a cell",
            "none",
            None,
            looks_at="every state that was sent",
        ),
        Metric(
            "published_displacement",
            "error of a point's displacement against a closed form or a published number",
            "the number expected",
            None,
        ),
        Metric(
            "published_oscillation",
            "error of a point's amplitude, frequency, damping or mean, closed form or published",
            "the number expected",
            None,
            needs_time=True,
            looks_at="every state that was sent",
        ),
        Metric(
            "inverted_cells",
            "cells turned inside out",
            "none",
            None,
            unit="cells",
            looks_at="every state that was sent",
        ),
    )
}

# What the truth of a motion is held to: its points over time, not integrals of its last state.
MOVING_TRUTH_METRICS = (
    "displacement_l2",
    "displacement_max",
    "max_displacement",
    *(metric.name for metric in CATALOGUE.values() if metric.needs_time and metric.compare),
)


def measure(name: str, problem: Problem, candidate: State, reference: State) -> Difference:
    """A metric between two states of a problem; on its own mesh too where the candidate has one.

    Raises:
        InputError: No such metric, or one of the candidate alone.
    """
    metric = CATALOGUE.get(name)
    if metric is None or metric.compare is None:
        raise InputError(f"no metric {name!r} between two states")
    if not are_measurable(*_numbers_of(candidate)):
        return Difference(math.inf, math.nan, metric.scale)
    if not metric.needs_tools and all(is_still(problem.mesh, s) for s in (candidate, reference)):
        # Distances of surfaces and forces are then rounding, and nothing scales them.
        return Difference(0.0, 0.0, metric.scale)
    with np.errstate(over="ignore", invalid="ignore"):
        found = metric.compare(problem, candidate, reference)
        if candidate.own is not None:
            found = measure_on_own_mesh(name, found, problem, candidate, reference)
        other = candidate.other_reading
        if other is None or metric.reads_own_samples:
            return found
        apart = metric.compare(problem, candidate, other)
        off = apart.value * apart.scale / found.scale if apart.value else 0.0
    return dataclasses.replace(found, uncertainty=found.uncertainty + off)


def _numbers_of(state: State) -> list[NDArray[np.float64]]:
    """Everything that a metric may look at."""
    motions = [motion for motion in (state.trajectory, state.sent) if motion is not None]
    own = [] if state.own is None else [state.own.displacements]
    return [state.displacement, *(motion.displacements for motion in motions), *own]
