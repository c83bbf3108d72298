"""Every metric by name: what it says, what it needs, and how it is measured.

Nobody else compares names: what sets a metric apart is a property of it here. A new one is a row of
the table and, where no function of `comparison`, `stress` or `numbers` does, its error there.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.metrics import (
    balance,
    comparison,
    motion,
    numbers,
    sliding,
    stress,
    validity,
)
from palpate.validation.metrics.difference import (
    Difference,
    are_measurable,
    is_still,
    other_readings,
)
from palpate.validation.metrics.stress import Part
from palpate.validation.states import OwnMesh, State

Compare = Callable[[Problem, State, State], Difference]
CompareInPart = Callable[[Problem, State, State, Part], Difference]
Read = Callable[[Problem, State, Part, str], numbers.Number | None]

# Metrics whose error bars are of stress and energy.
_OF_INTEGRALS = ("stress_l2", "traction_resultant", "strain_energy")


@dataclass(frozen=True)
class Metric:
    """One metric.

    Attributes:
        name: The name, as in a case file.
        meaning: Its meaning, in one line.
        scale: What the error is divided by.
        error: Of a candidate beside the reference on one mesh, and what reading may add to it.
        scale_of: Size of the reference that `error` is divided by.
        compare: Used instead of these two: from candidate and reference the relative error at the
            case's points.
        of_part: As `compare`, of a part of the body that a check names.
        own: The value, from the candidate alone.
        says: What was found and the limit, of the candidate alone.
        unit: Unit of the value.
        asks: Keys of a check that say which number is compared with one of the case file, the
            candidate's or the truth's own; empty of what compares two states.
        read: Reads that number; None of a displacement at a point, over time or at the end.
        components: Which `component` such a check may name.
        dimension: Dimension of that number: "length", "force", "stress", "volume" or "energy".
        bar_of: Name of the metric whose error bar the truth's number has.
        is_alone: Measured on the candidate's own mesh only, not at the case's points too.
        is_of_surface: A metric of a part of the surface (a support or a cut), not of cells.
        is_fitted: Its number is fitted to a motion, and is as good as the samples.
        is_lower_limit: The limit is the least that it may be, not the most.
        has_moving_truth: The truth of a motion has an error bar of it: points over time, not
            integrals of the last state.
        has_whole_bar: The truth of every static case has an error bar of it.
        has_limit_at_points: It tends to something under forces on single points, under linear
            strain: an integral, or a number from elsewhere in the body.
        needs_same_mesh: Judged against the reference on the same mesh only: a quadratic solution
            read at the points does not carry it.
        needs_time: For cases with [time] only.
        needs_tools: For cases with tools only.
        unfit: Says what a problem needs for it that this one has not; "" where it has all.
        where: Says of a candidate that fails when and by how much it leaves the reference.
    """

    name: str
    meaning: str
    scale: str
    error: comparison.ErrorOf | None = None
    scale_of: comparison.ScaleOf | None = None
    compare: Compare | None = None
    of_part: CompareInPart | None = None
    own: Callable[[Problem, State], validity.Worst] | None = None
    says: str = ""
    unit: str = "-"
    asks: tuple[str, ...] = ()
    read: Read | None = None
    components: tuple[str, ...] = ()
    dimension: str = "length"
    bar_of: str = ""
    is_alone: bool = False
    is_of_surface: bool = False
    is_fitted: bool = False
    is_lower_limit: bool = False
    has_moving_truth: bool = False
    has_whole_bar: bool = False
    has_limit_at_points: bool = False
    needs_same_mesh: bool = False
    needs_tools: bool = False
    needs_time: bool = False
    unfit: Callable[[Problem], str] | None = None
    where: Callable[[Problem, State, State], str] | None = None

    @property
    def is_published(self) -> bool:
        """Whether it is compared with a number of the case file."""
        return bool(self.asks)

    @property
    def is_of_integrals(self) -> bool:
        """Whether a quadratic truth has it by integrals stored beside its displacement."""
        return self.of_part is not None or self.bar_of in _OF_INTEGRALS

    @property
    def is_own(self) -> bool:
        """Whether it is of the candidate alone, without any number to compare with."""
        return self.own is not None

    @property
    def is_compared(self) -> bool:
        """Whether it is an error between two states."""
        return self.is_of_whole or self.of_part is not None

    @property
    def is_of_whole(self) -> bool:
        """Whether it is an error between two states of the whole body."""
        return self.error is not None or self.compare is not None

    def fits(self, problem: Problem) -> bool:
        """Whether the problem has the time, the tools and whatever else the metric needs."""
        has_time, has_tools = problem.time is not None, bool(problem.tools)
        has_all = (has_time or not self.needs_time) and (has_tools or not self.needs_tools)
        return has_all and (self.unfit is None or not self.unfit(problem))


_AXES = ("x", "y", "z")
_LARGEST = "largest displacement of the reference"
_METRICS = (
    Metric(
        "displacement_l2",
        "error of displacement over the whole body, by rest volume",
        "L2 norm of the reference's displacement",
        comparison.displacement_l2,
        comparison.l2_of,
        has_whole_bar=True,
        has_limit_at_points=True,
        has_moving_truth=True,
    ),
    Metric(
        "displacement_h1",
        "error of the displacement's gradient: local strain and rotation",
        "H1 seminorm of the reference's displacement",
        comparison.error_in(comparison.gradient_norm),
        comparison.size_in(comparison.gradient_norm),
        needs_same_mesh=True,
    ),
    Metric(
        "energy_norm",
        "error of strain weighted by stiffness",
        "energy norm of the reference's displacement",
        comparison.error_in(comparison.energy_norm),
        comparison.size_in(comparison.energy_norm),
        needs_same_mesh=True,
    ),
    Metric(
        "displacement_max",
        "largest error of displacement at a point",
        _LARGEST,
        comparison.displacement_max,
        comparison.largest_displacement_of,
        has_whole_bar=True,
        has_moving_truth=True,
    ),
    Metric(
        "max_displacement",
        "error of the largest displacement",
        _LARGEST,
        comparison.max_displacement,
        comparison.largest_displacement_of,
        has_whole_bar=True,
        has_moving_truth=True,
    ),
    Metric(
        "volume",
        "error of the deformed volume",
        "change of volume of the reference",
        comparison.size_error("volume"),
        comparison.change_of("volume"),
        has_whole_bar=True,
        is_alone=True,
    ),
    Metric(
        "local_volume",
        "root mean square error of det F over the cells",
        "root mean square of the reference's det F - 1",
        comparison.local_volume,
        comparison.local_change_of,
        needs_same_mesh=True,
    ),
    Metric(
        "surface_area",
        "error of the deformed area",
        "change of area of the reference",
        comparison.size_error("surface_area"),
        comparison.change_of("surface_area"),
        has_whole_bar=True,
        is_alone=True,
    ),
    Metric(
        "surface_hausdorff",
        "largest distance between the deformed surfaces",
        _LARGEST,
        comparison.surface_hausdorff,
        comparison.largest_displacement_of,
    ),
    Metric(
        "surface_mean_distance",
        "mean distance between the deformed surfaces",
        _LARGEST,
        comparison.surface_mean_distance,
        comparison.largest_displacement_of,
    ),
    Metric(
        "reaction_force",
        "largest error of a support's total force",
        "largest support force of the reference",
        comparison.reaction_force,
        comparison.largest_reaction_of,
        is_alone=True,
        needs_same_mesh=True,
    ),
    Metric(
        "tool_force",
        "largest error of the force on a tool",
        "largest force of the reference on a tool",
        comparison.tool_force,
        comparison.largest_tool_force_of,
        has_limit_at_points=True,
        has_moving_truth=True,
        needs_tools=True,
    ),
    Metric(
        "force_ripple",
        "range of the error of a tool's force while it slides at constant depth",
        "mean force of the reference against the press; the result's is scaled to it",
        sliding.force_ripple,
        sliding.mean_force_of,
        has_moving_truth=True,
        needs_time=True,
        needs_tools=True,
        unfit=sliding.unfit,
    ),
    Metric(
        "false_lateral_force",
        "largest force along a slide at constant depth that is not there",
        "mean force of the reference against the press; the result's is scaled to it",
        sliding.false_lateral_force,
        sliding.mean_force_of,
        has_moving_truth=True,
        needs_time=True,
        needs_tools=True,
        unfit=sliding.unfit,
    ),
    Metric(
        "strain_energy",
        "error of the strain energy",
        "strain energy of the reference",
        comparison.strain_energy,
        comparison.energy_of,
        is_alone=True,
        needs_same_mesh=True,
    ),
    Metric(
        "stress_l2",
        "error of Cauchy's stress in a region, turned back by each cell's rotation",
        "L2 norm of the reference's stress there",
        of_part=stress.stress_l2,
        has_limit_at_points=True,
    ),
    Metric(
        "traction_resultant",
        "error of the force of a support, or through the cut that bounds a region",
        "largest force of a load or support of the reference; 1 N where none has one",
        of_part=stress.traction_resultant,
        has_limit_at_points=True,
        is_of_surface=True,
    ),
    Metric(
        "trajectory_l2",
        "largest error of displacement over time",
        "largest L2 norm of the reference's displacement over time",
        comparison.trajectory_l2,
        comparison.largest_l2_of,
        has_limit_at_points=True,
        has_moving_truth=True,
        needs_time=True,
        where=motion.departure,
    ),
    *(
        Metric(
            name,
            f"error of the {name.removeprefix('oscillation_')} of the point that swings most",
            "the reference's (phase: one period; damping: its frequency; mean: its amplitude)",
            compare=partial(motion.oscillation, name),
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
        own=lambda problem, state: validity.smallest_det_f(problem.mesh, state),
        says="smallest det F {0.value:.4g}{0.when} {sign} {limit:g}",
        is_lower_limit=True,
    ),
    Metric(
        "inverted_cells",
        "cells turned inside out",
        "none",
        own=lambda problem, state: validity.most_inverted(problem.mesh, state),
        says="{0.value:.0f} inverted cell(s){0.when}, at most {limit:g}",
        unit="cells",
    ),
    Metric(
        "impulse_balance",
        "impulse of the forces on the tools against the change of the body's momentum",
        "the impulse that the trajectory shows",
        own=balance.impulse_balance,
        says="impulse off by {0.value:.3g}{bar} {sign} {limit:g}",
        needs_time=True,
        needs_tools=True,
        unfit=balance.unfit,
    ),
    Metric(
        "energy_balance",
        "energy won or lost between the throw and the end, damping counted",
        "kinetic energy of the initial velocity",
        own=balance.energy_balance,
        says="energy off by {0.value:.3g}{bar} {sign} {limit:g}",
        needs_time=True,
        needs_tools=True,
        unfit=balance.unfit,
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
        has_limit_at_points=True,
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
        has_limit_at_points=True,
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
        has_limit_at_points=True,
    ),
)
CATALOGUE = {metric.name: metric for metric in _METRICS}
# Metrics that the truth of a motion has error bars for.
MOVING_TRUTH_METRICS = tuple(m.name for m in _METRICS if m.has_moving_truth and m.is_of_whole)
# Metrics that the truth of every static case has error bars for.
WHOLE_BODY_METRICS = tuple(m.name for m in _METRICS if m.has_whole_bar)


def measure(
    name: str, problem: Problem, candidate: State, reference: State, part: Part | None = None
) -> Difference:
    """A metric between two states of a problem; on its own mesh too where the candidate has one.

    Raises:
        InputError: No such metric, one of the candidate alone, or one of a part without the part.
    """
    metric = CATALOGUE.get(name)
    if metric is None or not metric.is_compared:
        raise InputError(f"no metric {name!r} between two states")
    if metric.of_part is not None and part is None:
        raise InputError(f"metric {name!r} is of a part of the body: say which")
    if not are_measurable(*candidate.fields):
        return Difference(math.inf, math.nan, metric.scale)
    if not metric.needs_tools and all(is_still(problem.mesh, s) for s in (candidate, reference)):
        # Distances of surfaces and forces are then rounding, and nothing scales them.
        return Difference(0.0, 0.0, metric.scale)

    def compare(candidate: State, other: State, own: OwnMesh | None) -> Difference:
        if part is not None and metric.of_part is not None:
            return metric.of_part(problem, candidate, other, part)
        if metric.compare is not None:
            return metric.compare(problem, candidate, other)
        assert metric.error is not None
        assert metric.scale_of is not None
        return comparison.compare_states(
            metric.error, metric.scale_of, problem, candidate, other, own=own,
            is_alone=metric.is_alone,
        )  # fmt: skip

    with np.errstate(over="ignore", invalid="ignore"):
        found, off = compare(candidate, reference, candidate.own), 0.0
        # A fit is of the states as they were sent, not as they are read between them.
        if not metric.is_fitted:
            for read, other in other_readings(problem.mesh, candidate, reference):
                apart = compare(read, other, None)
                off += apart.value * apart.scale / found.scale if apart.value else 0.0
    return dataclasses.replace(
        found, scale_name=found.scale_name or metric.scale, uncertainty=found.uncertainty + off
    )
