"""What a file of references claims, compared with its own arrays and with the case.

A hash says whether a file is what was written; this says whether what was written can be right.
Everything here follows from the case and the arrays by the judge's own NumPy: nothing is solved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.validation.exchange.nodal_arrays import (
    fixed_components,
    sliding_points,
    touchable_points,
)
from palpate.validation.metrics import make_state, measure
from palpate.validation.metrics.body import body_of, dead_force
from palpate.validation.metrics.difference import largest
from palpate.validation.metrics.grid_convergence import SAFETY_FACTOR
from palpate.validation.metrics.stepping import MotionHypothesis, Stepper, steps_per_output
from palpate.validation.references.adaptive_truth import (
    ADAPTIVE,
    least_apart,
    most_apart,
    recorded_bars,
    why_without_limit,
)
from palpate.validation.references.bars import NOISE, PARTS, read_row
from palpate.validation.references.reference_set import (
    OF_ELEMENT,
    QUADRATIC,
    SAME_MESH,
    SCALARS,
    SMOOTHED,
    TRUTH,
    ReferenceSet,
)
from palpate.validation.states import State

_DEGREES = {SAME_MESH: 1, SMOOTHED: 1, QUADRATIC: 2, TRUTH: 2}
_ELEMENTS = {label: element for element, label in OF_ELEMENT.items()}
# Relative. Sums over some thousand cells in another order leave 1e-13; a volume that is 1e-9 off
# could not turn a verdict.
_ROUNDING = 1e-9
# Relative. A truth of a motion is stored in single precision, 6e-8.
_SINGLE = 1e-6
# The reference solves to this norm of the residual over that of the forces; a largest entry may
# be the square root of their number above that, and another order of summing takes the rest.
_SOLVED_TO = 1e-10
_SLACK = 10.0
# Fraction of the largest nodal force: solved to 1e-10, summed over a cell cut in eight twice.
_BALANCED_TO = 1e-7
# Fraction of a trajectory's largest displacement: rounding grows at most with the square of the
# number of steps, (1e4)^2 eps = 2e-8, and the least mistake worth finding is 1 %.
_REPLAY = 1e-6
# What a provenance says of how a file was made.
_PROVENANCE = ("date", "command", "palpate", "versions")
# Fraction of the least distance that a record allows: it is measured at the case's points here, and
# over the finer mesh there.
_READ_ELSEWHERE = 0.5
# Steps that are repeated whenever a motion is read: some milliseconds. `palpate reference check`
# repeats them all.
_STEPS_ON_READING = 100


def find_contradictions(
    problem: Problem, references: ReferenceSet, *, thoroughly: bool = False
) -> list[str]:
    """Everything that cannot be in a case's references; empty where nothing is wrong.

    Args:
        problem: The case's problem.
        references: The references as read from a file.
        thoroughly: Repeat every step of a motion on the same mesh, not the first few only; and
            ask for provenance, and a record that explains every bar.
    """
    found = []
    for (label, strain), state in references.states.items():
        wrong = list(_wrong_form(problem, label, state))
        if not wrong:
            wrong = [
                *_wrong_supports(problem, state),
                *_wrong_numbers(problem, state),
                *_wrong_motion(problem, state, thoroughly),
                *_wrong_balance(problem, state),
                *_wrong_stresses(problem, state),
            ]
        found += [f"{label}, {strain} strain: {line}" for line in wrong]
    # Bars compare states with one another, which needs states that can be.
    found = found or list(_wrong_bars(problem, references))
    return [*found, *_unexplained(problem, references)] if thoroughly else found


def _unexplained(problem: Problem, references: ReferenceSet) -> Iterator[str]:
    """What a file does not say: who made it, what a bar follows from, P2 on the case's mesh."""
    for key in _PROVENANCE:
        if not references.provenance.get(key):
            yield f"its provenance says no {key}"
    explained = _Records(references.provenance).least_bars(problem)
    for (metric, strain), bar in references.bars.items():
        if math.isfinite(bar) and not math.isfinite(explained.get((metric, strain), math.inf)):
            yield f"error bar of {metric}, {strain} strain: {bar:.4g}, with no record of meshes"
    for label, strain in references.states:
        is_alone = label == TRUTH and (QUADRATIC, strain) not in references.states
        if is_alone and problem.time is None:
            yield f"{label}, {strain} strain: without {QUADRATIC}, from which its meshes start"


def _wrong_truths(
    problem: Problem, references: ReferenceSet, records: _Records, strain: Strain
) -> Iterator[str]:
    """Truths that are the solution on the case's own mesh, not on the finer ones of the record.

    Truth and P2 on the case's mesh obey the triangle inequality over the meshes between them.
    """
    coarse, truth = (references.states.get((label, strain)) for label in (QUADRATIC, TRUTH))
    name = f"{TRUTH}, {strain} strain"
    best = references.truth(strain)
    for label in (SAME_MESH, SMOOTHED):
        linear, bar = references.states.get((label, strain)), ("displacement_l2", strain)
        if linear is None or best is None or references.bars.get(bar, 0.0) <= _SLACK * _SINGLE:
            continue
        # Of one mesh only fields that linear tetrahedra hold exactly are the same, without a bar.
        if measure(bar[0], problem, linear, best).value <= _SINGLE:
            yield f"{best.label}, {strain} strain: the solution of {label} under another name"
    cells = records.first_cells(strain)
    if cells is not None and cells != problem.mesh.num_cells:
        yield f"{name}: its record starts from {cells} cells, the case has {problem.mesh.num_cells}"
    if coarse is None or truth is None:
        return
    for metric in ("displacement_l2", "displacement_max"):
        least, most = records.apart(strain, metric)
        apart = measure(metric, problem, coarse, truth).value
        if not apart <= most * (1.0 + _SINGLE) + NOISE:
            yield (
                f"{name}: {apart:.3g} from {coarse.label} in {metric}, but the file's own record "
                f"of meshes allows {most:.3g}"
            )
        elif apart < _READ_ELSEWHERE * least - NOISE:
            yield (
                f"{name}: only {apart:.3g} from {coarse.label} in {metric}, but by the file's own "
                f"record of meshes at least {least:.3g}: it is not the solution on the last of them"
            )


def _wrong_bars(problem: Problem, references: ReferenceSet) -> Iterator[str]:
    """Bars below what the file's own record makes them, and truths that cannot be its."""
    yield from _wrong_parts(references)
    records = _Records(references.provenance)
    least = records.least_bars(problem)
    for (metric, strain), bar in references.bars.items():
        name = f"error bar of {metric}, {strain} strain"
        if math.isnan(bar) or bar < 0.0:
            yield f"{name}: {bar:g}; a bar is 0 or more"
        elif bar < (lowest := least.get((metric, strain), 0.0)) * (1.0 - _ROUNDING):
            yield f"{name}: {bar:.4g}, but the file's own record of meshes makes it {lowest:.4g}"
    for strain in Strain:
        yield from _wrong_truths(problem, references, records, strain)


def _wrong_parts(references: ReferenceSet) -> Iterator[str]:
    """Contradictions in a record of parts: rows without a bar, no numbers, other sums."""
    table = references.provenance.get(PARTS, {})
    if not isinstance(table, Mapping):
        yield f"{PARTS}: not a table"
        return
    known = {f"{metric}|{strain}": bar for (metric, strain), bar in references.bars.items()}
    for name, row in table.items():
        parts = read_row(row)
        if parts is None or name not in known:
            yield f"{PARTS} of {name}: not the parts of an error bar of this file"
            continue
        bar, whole = known[name], parts.whole
        if whole != bar and not abs(whole - bar) <= _ROUNDING * bar:
            yield f"{PARTS} of {name} add up to {whole:.4g}, but the bar is {bar:.4g}"


class _Records:
    """The sequences of meshes and steps in a provenance that anybody may have written."""

    def __init__(self, provenance: Mapping[str, Any]) -> None:
        self._adaptive = _table(provenance, ADAPTIVE)
        self._steps = _table(provenance, "convergence")
        # Records of three meshes, each cut in eight.
        self._eighths = _table(provenance, "grid_convergence")

    def least_bars(self, problem: Problem) -> dict[tuple[str, Strain], float]:
        """The least bar that they allow: their own, those of time and mesh together."""
        least: dict[tuple[str, Strain], float] = {}
        for strain in Strain:
            for table in (_table(self._eighths, strain), *_table(self._steps, strain).values()):
                for metric in _table({"": table}, ""):
                    bar = _number(_table(table, metric), "error_bar")
                    own = math.inf if bar is None else bar
                    least[metric, strain] = least.get((metric, strain), 0.0) + own
            record = _table(self._adaptive, strain)
            adaptive = recorded_bars(_table(record, "metrics"))
            least |= {
                (name, strain): math.inf if why_without_limit(record, problem, strain, name) else b
                for name, b in adaptive.items()
            }
        return least

    def first_cells(self, strain: Strain) -> float | None:
        """The cells of the first mesh; None where they are not recorded."""
        cells = _table(self._adaptive, strain).get("cells")
        return cells[0] if isinstance(cells, list) and cells else None

    def apart(self, strain: Strain, metric: str) -> tuple[float, float]:
        """How far they let the first and the last mesh be apart, at least and at most.

        Of three meshes, each cut in eight, norms obey |coarse - middle| -+ |middle - fine|: the
        second is the bar times (2^p - 1) over its safety factor, the first 2^p times that.
        """
        record = _table(_table(self._adaptive, strain), "metrics").get(metric)
        if isinstance(record, Mapping):
            return least_apart(record), most_apart(record)
        record = _table(_table(self._eighths, strain), metric)
        order, bar = _number(record, "order"), _number(record, "error_bar")
        if order is None or bar is None:
            return 0.0, math.inf
        last = bar * (2.0**order - 1.0) / SAFETY_FACTOR
        return last * (2.0**order - 1.0), last * (1.0 + 2.0**order)


def _table(holder: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table of a record; empty where it is none."""
    found = holder.get(key)
    return found if isinstance(found, Mapping) else {}


def _number(holder: Mapping[str, Any], key: str) -> float | None:
    found = holder.get(key)
    return float(found) if isinstance(found, int | float) else None


def _wrong_form(problem: Problem, label: str, state: State) -> Iterator[str]:
    """Errors that would make every other question pointless."""
    shape = problem.mesh.points.shape
    if _DEGREES.get(label, state.degree) != state.degree:
        yield f"degree {state.degree}; its name stands for degree {_DEGREES[label]}"
    element = _ELEMENTS.get(label, Element.LINEAR)
    if state.element is not element:
        yield f"{state.element} tetrahedra; its name stands for {element} ones"
    if state.displacement.shape != shape or not np.isfinite(state.displacement).all():
        yield f"displacement does not fit the mesh: shape {state.displacement.shape}, not {shape}"
    if (state.trajectory is None) != (problem.time is None):
        yield "a motion of a case without [time]" if state.trajectory else "no motion over [time]"
    if state.trajectory is None or problem.time is None:
        return
    count = problem.time.num_outputs + 1
    times, motion = state.trajectory.times, state.trajectory.displacements
    if motion.shape != (count, *shape) or not np.isfinite(motion).all():
        yield f"its motion does not fit the mesh and [time]: {motion.shape}, not {(count, *shape)}"
        return
    expected = np.linspace(0.0, problem.time.end_time, count)
    if times.shape != expected.shape or not np.allclose(
        times, expected, rtol=0.0, atol=_ROUNDING * problem.time.end_time
    ):
        last = f", to {times.flat[-1]:g} s," if times.size else ""
        yield (
            f"its {times.size} times{last} are not the {count} outputs of [time], to "
            f"{problem.time.end_time:g} s"
        )
    if not np.array_equal(motion[-1], state.displacement):
        yield "its displacement is not the last state of its motion"


def _wrong_supports(problem: Problem, state: State) -> Iterator[str]:
    fixed, full = fixed_components(problem)
    scale = largest(np.abs((state.displacement, full)).ravel())
    gap = float(np.abs((state.displacement - full) * fixed).max())
    gap = largest((gap, _gap_of_slopes(problem, None, state.displacement)))
    if state.trajectory is not None:
        motion = state.trajectory
        scale = largest((scale, float(np.abs(motion.displacements).max())))
        gap = largest(
            max(
                float(np.abs((placed - fixed_components(problem, float(time))[1]) * fixed).max()),
                _gap_of_slopes(problem, float(time), placed),
            )
            for time, placed in zip(motion.times, motion.displacements, strict=True)
        )
        slopes = sliding_points(problem)
        begins = motion.displacements[0] * (1 - fixed)
        start = float(np.abs(begins if slopes is None else slopes.without(begins)).max())
        if start > _SINGLE * scale:
            yield f"a free point is {start:.3g} m from rest at t = 0; motions start at rest"
    if gap > _SINGLE * scale:
        yield f"a held point is {gap:.3g} m from where its support holds it"


def _gap_of_slopes(problem: Problem, time: float | None, displacement: Points) -> float:
    slopes = sliding_points(problem, time)
    if slopes is None:
        return 0.0
    return float(np.abs(slopes.fixed_part(displacement) - slopes.displacements).max())


def _wrong_numbers(problem: Problem, state: State) -> Iterator[str]:
    """Header numbers against the arrays; of a static P2 state only what the points determine."""
    mesh = problem.mesh
    own = make_state(mesh, state.displacement, label=state.label, simulator="", strain=state.strain)
    follow = state.degree == 1 or state.trajectory is not None
    for name in SCALARS if follow else ("max_displacement",):
        stated, found = float(getattr(state, name)), float(getattr(own, name))
        size = abs(found) if name != "smallest_det_f" else max(abs(found), 1.0)
        if not abs(stated - found) <= _ROUNDING * size:
            yield f"{name} is said to be {stated:.9g}, but its displacement makes it {found:.9g}"
    values = [float(getattr(state, name)) for name in SCALARS]
    if not np.isfinite(values).all():
        yield f"{', '.join(SCALARS)} = {values}: not all finite"
    # Of all bodies of one area the ball has the largest volume: A^3 >= 36 pi V^2.
    elif state.surface_area**3 < 36.0 * math.pi * state.volume**2 * (1.0 - _ROUNDING):
        yield (
            f"no body of {state.surface_area:.6g} m2 holds {state.volume:.6g} m3 "
            "(isoperimetric inequality)"
        )


def _wrong_motion(problem: Problem, state: State, thoroughly: bool) -> Iterator[str]:
    """The explicit motion, stepped through once more; with tools as far as nothing touches."""
    steps = steps_per_output(problem)
    if state.trajectory is None or state.degree != 1 or not steps:
        return
    outputs = len(state.trajectory.times) - 1 if thoroughly else _STEPS_ON_READING // steps
    if problem.tools:
        forces = state.tool_forces
        if forces is None or forces.shape != (len(problem.tools), len(state.trajectory.times), 3):
            yield "no force over time for each tool"
            return
        touched = np.flatnonzero(np.abs(forces).max(axis=(0, 2)))
        outputs = min(outputs, int(touched[0]) - 1 if len(touched) else outputs)
    outputs = min(outputs, len(state.trajectory.times) - 1)
    if outputs < 1:
        return
    assert problem.time is not None
    assert problem.time.time_step is not None
    body = body_of(problem, state.strain, state.element)
    stepper = Stepper(body, problem.time.time_step, steps, outputs)
    own = np.array(list(stepper.outputs(MotionHypothesis())))
    stored = state.trajectory.displacements[1 : outputs + 1]
    scale = float(np.abs(stored).max())
    error = float(np.abs(own - stored).max()) if len(own) == outputs else math.inf
    if not error <= _REPLAY * scale:
        end = state.trajectory.times[outputs]
        yield (
            f"{error:.3g} m from the case's own steps until t = {end:g} s, "
            f"where {scale:.3g} m is the largest displacement"
        )


def _wrong_balance(problem: Problem, state: State) -> Iterator[str]:
    """Equilibrium of a static state of degree 1; with tools of what does not touch them."""
    if state.trajectory is not None:
        return
    if problem.tools and (
        state.tool_forces is None or state.tool_forces.shape != (len(problem.tools), 3)
    ):
        yield "no force for each tool"
        return
    if state.degree != 1:
        return
    body = body_of(problem, state.strain, state.element)
    residual, scale = body.out_of_balance(state.displacement)
    limit = _SLACK * _SOLVED_TO * math.sqrt(residual.size) * scale
    may_touch = touchable_points(problem)
    largest = float(np.abs(residual[~may_touch]).max(initial=0.0))
    if not largest <= limit:
        yield (
            f"not in equilibrium: {largest:.3g} N is left at a free point, where the largest "
            f"nodal force is {scale:.3g} N"
        )
    if state.tool_forces is None:
        return
    # A point that is fixed along one axis passes the tool's push there to its support; a facet
    # that a tool presses gives a part to its fixed corners.
    fixed = fixed_components(problem)[0].astype(bool)
    partly = may_touch & fixed.any(axis=1)
    if all(tool.contact is ContactRule.VERTICES for tool in problem.tools):
        partly &= ~fixed.all(axis=1)
    whole = ~fixed[partly].any(axis=0)
    gap = np.abs(residual[may_touch].sum(axis=0) - state.tool_forces.sum(axis=0))[whole]
    if not gap.max(initial=0.0) <= _SINGLE * scale:
        yield (
            f"the forces on the tools are {gap.max():.3g} N other than what the body "
            "pushes back with"
        )


def _wrong_stresses(problem: Problem, state: State) -> Iterator[str]:
    """Shapes of the stresses of a truth, and their balance with the loads.

    The case's linear shape functions lie among those that the truth was solved with, so that it is
    in balance with the loads at the case's points too.
    """
    stress, mesh = state.integrals, problem.mesh
    if stress is None:
        return
    wanted = ((mesh.num_cells, 3, 3), (mesh.num_points, 3))
    shapes = (stress.cauchy.shape, stress.internal_force.shape)
    if shapes != wanted or not all(
        np.isfinite(field).all() for field in (stress.cauchy, stress.internal_force)
    ):
        yield f"stresses do not fit the mesh: shapes {shapes}, not {wanted}, all finite"
        return
    if stress.strain_energy is not None and not 0.0 <= stress.strain_energy < math.inf:
        yield f"a strain energy of {stress.strain_energy:g} J"
    free = (fixed_components(problem)[0] == 0) & ~touchable_points(problem)[:, None]
    for load in problem.loads:
        if isinstance(load, Pressure):
            # It follows the truth's own surface, which is not stored.
            free[load.facets] = False
    for spring in problem.springs:
        # It pulls at the edges of a quadratic truth too.
        free[spring.facets] = False
    slopes = sliding_points(problem)
    if slopes is not None:
        free[slopes.points] = False
    dead = dead_force(problem)
    scale = float(np.abs(np.concatenate([stress.internal_force, dead])).max())
    left = float(np.abs(stress.internal_force - dead)[free].max(initial=0.0))
    if not left <= _BALANCED_TO * scale:
        yield (
            f"its stresses leave {left:.3g} N at a free point, where the largest nodal force is "
            f"{scale:.3g} N"
        )
