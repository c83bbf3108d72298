"""From a result to the state that is judged: at the case's points and times, and on its mesh."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.equations import AskedSteps, steps_of_result
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.exchange.placement import MatchedResult, match_points
from palpate.validation.exchange.result_files import ResultFile, ResultFileError
from palpate.validation.exchange.time_reading import TimeReading, read_at, to_the_end
from palpate.validation.metrics import make_state
from palpate.validation.metrics.difference import largest, measures_of
from palpate.validation.states import OwnMesh, State, Trajectory


def state_of_result(
    result: ResultFile,
    problem: Problem,
    name: str,
    strain: Strain,
    *,
    element: Element = Element.LINEAR,
    asked: AskedSteps | None = None,
    seconds: float = 0.0,
    details: Mapping[str, object] | None = None,
) -> State:
    """What a simulator sent, as a state of the problem: its last one where it has times.

    Args:
        result: What it sent.
        problem: The problem.
        name: The label of its state.
        strain: The strain measure that it was asked for.
        element: The tetrahedra that it is judged by, whatever it states.
        asked: The scheme and step that it was asked for, its own where it states none.
        seconds: Of its run [s].
        details: See `State`.

    Raises:
        ResultFileError: It is of another case, cannot be matched, or its times do not fit.
        CandidateFailedError: NaN, or a body of quite another size.
    """
    if result.case_key and result.case_key != case_key(problem, strain):
        raise ResultFileError(
            result.path, "belongs to another case (its `case_key` differs): run it again"
        )
    matched = match_points(result, problem)
    stated = dict(result.about)
    state = make_state(
        problem.mesh,
        matched.displacement[-1],
        label=name,
        simulator=name,
        strain=strain,
        seconds=seconds,
        details=details or {},
        remarks=matched.notes,
        tool_forces=_tool_forces(result, stated.pop("tool_forces", None)),
        element=element,
        says=stated,
        sent_stress=matched.cauchy_stress if matched.own_mesh is None else None,
        steps=steps_of_result(problem, stated, asked or AskedSteps()),
    )
    if problem.time is not None:
        return _with_motion(state, problem.mesh, problem.time, result, matched)
    if matched.own_mesh is None or matched.own_displacement is None:
        return state
    own = OwnMesh(matched.own_mesh, matched.own_displacement, matched.cauchy_stress)
    return with_own_mesh(state, problem.mesh, own)


def _with_motion(
    state: State, mesh: TetMesh, span: TimeSpan, result: ResultFile, matched: MatchedResult
) -> State:
    """A dynamic case's trajectory at its output times: the states sent, or read between them.

    Raises:
        ResultFileError: No times, or they do not cover the case's.
    """
    wanted = span.output_times
    given = result.times
    slack = 1e-9 * span.end_time
    if given is None or abs(given[0]) > slack or given[-1] < span.end_time - slack:
        raise ResultFileError(
            result.path,
            f"needs `times` from 0 to {span.end_time:g} s, (num_times,), with their displacement",
        )
    read = read_at(given, matched.displacement, wanted, slack=slack)
    states = [
        dataclasses.replace(
            state, trajectory=Trajectory(wanted, motion), **measures_of(mesh, motion[-1])
        )
        for motion in (read.states, read.others)
    ]
    if matched.own_mesh is not None and matched.own_displacement is not None:
        end = read_at(given, matched.own_displacement, wanted[-1:], slack=slack)
        for k, last in enumerate((end.states, end.others)):
            there = to_the_end(given, matched.own_displacement, last, wanted[-1], slack)
            own = OwnMesh(matched.own_mesh, there.displacements, matched.cauchy_stress)
            states[k] = with_own_mesh(states[k], mesh, own)
    return dataclasses.replace(
        states[0],
        sent=to_the_end(given, matched.displacement, read.states[-1:], wanted[-1], slack),
        other_reading=None if read.were_sent.all() else states[1],
        remarks=(*state.remarks, *_remarks_on_times(given, read, span.end_time + slack)),
    )


def _remarks_on_times(times: Points, read: TimeReading, end: float) -> list[str]:
    """A note on the parts of a motion that could be compared, and those that could not."""
    remarks = []
    num_outputs, num_compared = len(read.were_sent), int(read.were_sent.sum())
    if num_compared < num_outputs:
        remarks.append(
            f"{num_outputs - num_compared} of {num_outputs} output times were not sent: read there "
            "by cubics between the states that were; how far that may be off counts as an error "
            "bar. Send states at the output times of case.json."
        )
    num_late = int((times > end).sum())
    num_between = len(times) - num_compared - num_late
    if num_between > 0:
        remarks.append(
            f"{num_between} of {len(times)} states were sent at other times than the outputs: "
            "there is nothing to compare them with; they are looked at for inverted cells, and for "
            "positions that the body cannot get to in time."
        )
    if num_late:
        remarks.append(f"{num_late} of {len(times)} states come after the end: not judged.")
    return remarks


def _tool_forces(result: ResultFile, given: object) -> NDArray[np.float64] | None:
    """What the result says of the force on its tools, as numbers.

    Raises:
        ResultFileError: It is no array of numbers.
    """
    if given is None:
        return None
    try:
        forces = np.array(given)
    except ValueError as error:
        raise ResultFileError(result.path, f"`tool_forces` is ragged ({error})") from error
    if forces.dtype.kind not in "fiu" or forces.ndim not in (2, 3) or forces.shape[-1] != 3:
        raise ResultFileError(
            result.path,
            f"`tool_forces` holds {forces.dtype} of shape {forces.shape}; it needs numbers, "
            "(num_tools, 3) or (num_tools, num_outputs + 1, 3) [N]",
        )
    return forces.astype(np.float64)


def with_own_mesh(state: State, mesh: TetMesh, own: OwnMesh) -> State:
    """A state at the points of the case's mesh, with what its own mesh says at its end.

    Volume and area are the case's at rest plus the change on its own, so that a slightly
    different body at rest is no error; det F is that of its own cells; the largest displacement
    is looked for at the points of both.
    """
    there = measures_of(own.mesh, own.displacements[-1])
    return dataclasses.replace(
        state,
        own=own,
        volume=mesh.volume + (there["volume"] - own.mesh.volume),
        surface_area=mesh.surface_area + (there["surface_area"] - own.mesh.surface_area),
        smallest_det_f=there["smallest_det_f"],
        max_displacement=largest((state.max_displacement, there["max_displacement"])),
    )
