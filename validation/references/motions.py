"""References of a case in motion: the same steps on the same mesh, and a truth in time and space.

The explicit run takes the case's own steps by central differences, so that a candidate with the
same ones must equal it to rounding. The truth is implicit (generalised-alpha) on quadratic
tetrahedra; its error bars come from three time steps, each half the last, and from finer meshes.
It asks nothing of the candidate's step, mesh or method.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.errors import (
    ReferenceFailedError,
    ReferenceTooLongError,
    ReferenceUnavailableError,
)
from palpate.validation.metrics.motion import OSCILLATION, oscillation_offsets
from palpate.validation.references.bar_parts import GEOMETRY, PARTS, BarParts, as_record, with_bar
from palpate.validation.references.limits import without_limits
from palpate.validation.references.live import saturated
from palpate.validation.references.motion_runs import TIME_LIMIT, solve_explicit, solve_implicit
from palpate.validation.references.motion_sequences import (
    difference,
    truth_metrics,
)
from palpate.validation.references.sequences import SAFETY_FACTOR
from palpate.validation.references.sets import (
    BOTH,
    OF_ELEMENT,
    QUADRATIC,
    TRUTH,
    ReferenceSet,
)
from palpate.validation.references.stored_motions import refine_where_rough, solve_motion_truth
from palpate.validation.states import REFERENCE, Progress, State

Bars = dict[tuple[str, Strain], float]
# Steps from one output to the next; the last is the truth's.
LIVE_STEPS = (1, 2)


def solve_motion_set(
    problem: Problem,
    progress: Progress,
    *,
    wanted: Collection[str] = BOTH,
    stored: ReferenceSet | None = None,
    is_for_storing: bool = False,
    elements: Collection[Element] = (Element.LINEAR,),
    strains: Collection[Strain] = tuple(Strain),
    truth_strains: Collection[Strain] | None = None,
    seconds: float = TIME_LIMIT,
) -> ReferenceSet:
    """The explicit runs and the truth of a dynamic case, one for each strain measure.

    Args:
        problem: With a time span.
        progress: Called with one line for each run.
        wanted: What checks ask for: "same_mesh", "truth".
        stored: Where it has a truth, that is taken instead of solving here.
        is_for_storing: Three time steps and three meshes for the error bars; otherwise two steps,
            and one mesh refined where the body bends.
        elements: Of the explicit runs.
        strains: Of which.
        truth_strains: Of the truth, where those are fewer.
        seconds: That an explicit run, and the runs of a truth that is not for storing together,
            may take [s], > 0.

    Returns:
        States, bars, and why one is missing: a run that found no answer leaves the others be.

    Raises:
        InputError: A tool that the reference cannot move.
        ReferenceUnavailableError: No FEniCSx here.
        ReferenceFailedError: A run failed, and the set is for storing: nothing incomplete is.
    """
    states: dict[tuple[str, Strain], State] = {}
    bars: Bars = {}
    parts: dict[tuple[str, Strain], BarParts] = {}
    failures: dict[tuple[str, Strain], str] = {}
    origin: list[str] = []
    convergence: dict[str, Any] = {}
    if "same_mesh" in wanted:
        for element in Element:
            if element not in elements:
                continue
            label = OF_ELEMENT[element]
            name = label.removeprefix(f"{REFERENCE} ")
            origin.append(f"{name} in motion by central differences on the case's mesh")
            for strain in strains:
                with _failure_kept(failures, (label, strain), is_for_storing):
                    states[label, strain] = solve_explicit(
                        problem, strain, progress, element=element, time_limit=seconds
                    )
    held = {} if stored is None else _truths(stored)
    if "truth" in wanted and held and stored is not None:
        origin.append("the truth stored: P2 in motion, implicit")
        states |= held
        bars |= stored.bars
    elif "truth" in wanted:
        here = functools.partial(_truth_here, seconds=seconds)
        solve = solve_motion_truth if is_for_storing else here
        for strain in strains if truth_strains is None else truth_strains:
            with _failure_kept(failures, (QUADRATIC, strain), is_for_storing):
                truth, made_of, details = solve(problem, strain, progress)
                states[truth.label, strain] = truth
                found = {metric: one.whole for metric, one in made_of.items()}
                found = without_limits(problem, strain, found)
                bars |= {(metric, strain): bar for metric, bar in found.items()}
                parts |= {(m, strain): with_bar(made_of[m], bar) for m, bar in found.items()}
                convergence[strain.value] = details
        is_refined = any(label == TRUTH for label, _ in states)
        cut = " refined where it bends" if is_refined else ""
        origin.append(f"P2 in motion, implicit, on the case's mesh{cut} as the truth")
        if not is_for_storing:
            origin.append("its error bars: from a longer step and one finer mesh")
    versions = next((dict(s.versions) for s in states.values() if s.versions), {})
    provenance: dict[str, Any] = {"versions": versions}
    if convergence:
        provenance["convergence"] = convergence
    if parts:
        provenance[PARTS] = as_record(parts)
    elif bars and stored is not None:
        provenance |= {key: stored.provenance.get(key, {}) for key in (PARTS, GEOMETRY)}
    return ReferenceSet(states, bars, "; ".join(origin), failures, provenance)


@contextmanager
def _failure_kept(
    failures: dict[tuple[str, Strain], str], place: tuple[str, Strain], is_for_storing: bool
) -> Iterator[None]:
    """A run that fails is reported, unless its answer is for storing, or none can succeed here."""
    try:
        yield
    except ReferenceFailedError as error:
        if is_for_storing or isinstance(error, ReferenceUnavailableError):
            raise
        failures[place] = f"{place[0]} in motion: {error}"


def _truths(stored: ReferenceSet) -> dict[tuple[str, Strain], State]:
    on_mesh = OF_ELEMENT.values()
    return {place: state for place, state in stored.states.items() if place[0] not in on_mesh}


def _truth_here(
    problem: Problem, strain: Strain, progress: Progress, *, seconds: float
) -> tuple[State, dict[str, BarParts], dict[str, Any]]:
    """Two time steps, and one finer mesh: Roache's rule for two grids of each.

    The coarse run tells what all three take together, cells times steps: where that is more than
    they may, the others are not begun.

    In time of second order, which generalised-alpha has: 3 d / (2^2 - 1) = d. In space of first,
    because clamped edges are singular, and from a mesh on which only the cells with a part b of the
    roughness are cut, so that d is that part of what halving all would find: 3 d / b. Where two
    runs are more than half apart neither tells anything, as in statics (`live`): no bar.
    """
    begin, (few, more) = time.monotonic(), LIVE_STEPS

    def left() -> float:
        return max(1.0, seconds - (time.monotonic() - begin))

    coarse = solve_implicit(problem, strain, few, progress, time_limit=left())
    finer, bulk = refine_where_rough(problem, coarse)
    growth = 1.0 + more / few + finer.mesh.num_cells / problem.mesh.num_cells
    if coarse.seconds * growth > seconds:
        raise ReferenceTooLongError(coarse.seconds * growth, seconds)
    fine = solve_implicit(problem, strain, more, progress, time_limit=left())
    graded = solve_implicit(finer, strain, few, progress, at=problem.mesh, time_limit=left())
    bars = {
        metric: BarParts(
            discretisation=SAFETY_FACTOR
            / bulk
            * saturated(difference(metric, problem, coarse, graded)),
            time=saturated(difference(metric, problem, coarse, fine)),
        )
        for metric in truth_metrics(problem)
    }
    try:
        _, uncertainty = oscillation_offsets((fine,))
    except InputError:
        return fine, bars, {}
    for metric in OSCILLATION:
        fitted = float(getattr(uncertainty, metric.removeprefix("oscillation_")))
        bars[metric] = replace(bars[metric], time=bars[metric].time + fitted)
    return fine, bars, {}
