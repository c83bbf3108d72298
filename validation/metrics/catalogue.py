"""Every metric by name: what it says, what it needs, and how it is measured.

Nobody else compares names: what sets a metric apart is a property of it here.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.metrics import fields, motion, numbers, own_mesh, pairs, stress, surfaces
from palpate.validation.metrics.finite import are_measurable, is_still
from palpate.validation.metrics.metric import Compare, Metric
from palpate.validation.metrics.pairs import Difference
from palpate.validation.metrics.stress import Part
from palpate.validation.states import State


def _of_mesh(name: str) -> Compare:
    compare = pairs.COMPARISONS[name]
    return lambda problem, candidate, reference: compare(problem.mesh, candidate, reference)


_AXES = ("x", "y", "z")
_LARGEST = "largest displacement of the reference"
_METRICS = (
    Metric(
        "displacement_l2",
        "error of displacement over the whole body, by rest volume",
        "L2 norm of the reference's displacement",
        _of_mesh("displacement_l2"),
        own_mesh.displacement_l2,
        has_moving_truth=True,
    ),
    Metric(
        "displacement_h1",
        "error of the displacement's gradient: local strain and rotation",
        "H1 seminorm of the reference's displacement",
        fields.displacement_h1,
        own_mesh.displacement_h1,
        needs_same_mesh=True,
    ),
    Metric(
        "energy_norm",
        "error of strain weighted by stiffness",
        "energy norm of the reference's displacement",
        fields.energy_norm,
        own_mesh.energy_norm,
        needs_same_mesh=True,
    ),
    Metric(
        "displacement_max",
        "largest error of displacement at a point",
        _LARGEST,
        _of_mesh("displacement_max"),
        own_mesh.displacement_max,
        has_moving_truth=True,
    ),
    Metric(
        "max_displacement",
        "error of the largest displacement",
        _LARGEST,
        _of_mesh("max_displacement"),
        own_mesh.max_displacement,
        has_moving_truth=True,
    ),
    Metric(
        "volume",
        "error of the deformed volume",
        "change of volume of the reference",
        _of_mesh("volume"),
        own_mesh.size_error("volume"),
        is_alone=True,
    ),
    Metric(
        "local_volume",
        "root mean square error of det F over the cells",
        "root mean square of the reference's det F - 1",
        fields.local_volume,
        own_mesh.local_volume,
        needs_same_mesh=True,
    ),
    Metric(
        "surface_area",
        "error of the deformed area",
        "change of area of the reference",
        _of_mesh("surface_area"),
        own_mesh.size_error("surface_area"),
        is_alone=True,
    ),
    Metric(
        "surface_hausdorff",
        "largest distance between the deformed surfaces",
        _LARGEST,
        surfaces.surface_hausdorff,
        own_mesh.surface_hausdorff,
    ),
    Metric(
        "surface_mean_distance",
        "mean distance between the deformed surfaces",
        _LARGEST,
        surfaces.surface_mean_distance,
        own_mesh.surface_mean_distance,
    ),
    Metric(
        "reaction_force",
        "largest error of a support's total force",
        "largest support force of the reference",
        fields.reaction_force,
        own_mesh.reaction_force,
        is_alone=True,
        needs_same_mesh=True,
    ),
    Metric(
        "tool_force",
        "largest error of the force on a tool",
        "largest force of the reference on a tool",
        fields.tool_force,
        has_moving_truth=True,
        needs_tools=True,
    ),
    Metric(
        "strain_energy",
        "error of the strain energy",
        "strain energy of the reference",
        fields.energy,
        own_mesh.energy,
        is_alone=True,
        needs_same_mesh=True,
    ),
    Metric(
        "stress_l2",
        "error of Cauchy's stress in a region, turned back by each cell's rotation",
        "L2 norm of the reference's stress there",
        of_part=stress.stress_l2,
    ),
    Metric(
        "traction_resultant",
        "error of the force of a support, or through the cut that bounds a region",
        "largest force of a load or support of the reference; 1 N where none has one",
        of_part=stress.traction_resultant,
        is_of_surface=True,
    ),
    Metric(
        "trajectory_l2",
        "largest error of displacement over time",
        "largest L2 norm of the reference's displacement over time",
        motion.trajectory_l2,
        own_mesh.trajectory_l2,
        has_moving_truth=True,
        needs_time=True,
    ),
    *(
        Metric(
            name,
            f"error of the {name.removeprefix('oscillation_')} of the point that swings most",
            "the reference's (phase: one period; damping: its frequency; mean: its amplitude)",
            partial(motion.oscillation, name),
            is_fitted=True,
            has_moving_truth=True,
            needs_time=True,
        )
        for name in motion.OSCILLATION
    ),
    Metric(
        "smallest_det_f",
        "smallest volume ratio of a cell",
        "none",
        own=fields.smallest_det_f,
        says="smallest det F {0.value:.4g}{0.when} {sign} {limit:g}",
        is_lower_limit=True,
    ),
    Metric(
        "inverted_cells",
        "cells turned inside out",
        "none",
        own=fields.most_inverted,
        says="{0.value:.0f} inverted cell(s){0.when}, at most {limit:g}",
        unit="cells",
    ),
    Metric(
        "published_displacement",
        "error of a point's displacement against a closed form or a published number",
        "the number expected",
        asks=("at", "component", "expected"),
        components=_AXES,
        bar_of="displacement_max",
        has_moving_truth=True,
    ),
    Metric(
        "published_oscillation",
        "error of a point's amplitude, frequency, damping or mean, closed form or published",
        "the number expected",
        asks=("at", "component", "quantity", "expected"),
        components=_AXES,
        is_fitted=True,
        has_moving_truth=True,
        needs_time=True,
    ),
    Metric(
        "published_reaction",
        "error of a support's force on the body against a closed form or a measurement",
        "the number expected",
        asks=("support", "component", "expected"),
        read=numbers.reaction,
        components=_AXES,
        dimension="force",
        bar_of="traction_resultant",
    ),
    Metric(
        "published_tool_force",
        "error of the force on a tool, at the end, against a closed form or a measurement",
        "the number expected",
        asks=("tool", "component", "expected"),
        read=numbers.tool_force,
        components=_AXES,
        dimension="force",
        bar_of="tool_force",
        has_moving_truth=True,
        needs_tools=True,
    ),
    Metric(
        "published_volume_change",
        "error of the change of volume against a closed form or a measurement",
        "the number expected",
        asks=("expected",),
        read=numbers.volume_change,
        dimension="volume",
        bar_of="volume",
    ),
    Metric(
        "published_energy",
        "error of the strain energy against a closed form or a published number",
        "the number expected",
        asks=("expected",),
        read=numbers.strain_energy,
        dimension="energy",
        bar_of="strain_energy",
    ),
    Metric(
        "published_stress",
        "error of the mean of Cauchy's stress in a region, closed form, published or measured",
        "the number expected",
        asks=("region", "component", "expected"),
        read=numbers.mean_stress,
        components=numbers.STRESSES,
        dimension="stress",
        bar_of="stress_l2",
    ),
)
CATALOGUE = {metric.name: metric for metric in _METRICS}
# What the truth of a motion carries error bars for.
MOVING_TRUTH_METRICS = tuple(m.name for m in _METRICS if m.has_moving_truth and m.compare)


def _in_part(metric: Metric, part: Part | None) -> Compare:
    of_part = metric.of_part
    if of_part is None or part is None:
        raise InputError(f"metric {metric.name!r} is of a part of the body: say which")
    return lambda problem, candidate, reference: of_part(problem, candidate, reference, part)


def measure(
    name: str, problem: Problem, candidate: State, reference: State, part: Part | None = None
) -> Difference:
    """A metric between two states of a problem; on its own mesh too where the candidate has one.

    Args:
        name: Of the metric.
        problem: Of both.
        candidate: Who is judged.
        reference: What it is held against.
        part: Of the body, for metrics of one.

    Raises:
        InputError: No such metric, one of the candidate alone, or one of a part without the part.
    """
    metric = CATALOGUE.get(name)
    if metric is None or not metric.is_compared:
        raise InputError(f"no metric {name!r} between two states")
    compare = metric.compare or _in_part(metric, part)
    if not are_measurable(*candidate.fields):
        return Difference(math.inf, math.nan, metric.scale)
    if not metric.needs_tools and all(is_still(problem.mesh, s) for s in (candidate, reference)):
        # Distances of surfaces and forces are then rounding, and nothing scales them.
        return Difference(0.0, 0.0, metric.scale)
    with np.errstate(over="ignore", invalid="ignore"):
        found = compare(problem, candidate, reference)
        if candidate.own is not None and metric.on_own_mesh is not None:
            found = own_mesh.measure_on_own_mesh(
                metric.on_own_mesh,
                found,
                problem,
                candidate,
                candidate.own,
                reference,
                is_alone=metric.is_alone,
            )
        other = candidate.other_reading
        # A fit is of the states as they were sent, not as they are read between them.
        if other is None or metric.is_fitted:
            return found
        apart = compare(problem, candidate, other)
        off = apart.value * apart.scale / found.scale if apart.value else 0.0
    return dataclasses.replace(found, uncertainty=found.uncertainty + off)
