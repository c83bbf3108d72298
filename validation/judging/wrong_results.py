"""Results that are plainly wrong, by which a case is judged too: what it cannot see is named.

A check that the null result passes says nothing about a candidate: a body that nobody pushes, a
limit of 1, a change of volume too small to matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.faults import Fault, corrupt_displacement
from palpate.validation.metrics import make_state
from palpate.validation.metrics.difference import measures_of
from palpate.validation.states import State, Trajectory

_Change = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def null_result(problem: Problem, strain: Strain, reference: State | None) -> State:
    """The result of a simulator that does nothing, at the reference's times, with no force."""
    still = np.zeros_like(problem.mesh.points)
    motion = None if reference is None else reference.trajectory
    if motion is None and problem.time is not None:
        times = np.linspace(0.0, problem.time.end_time, problem.time.num_outputs + 1)
        motion = Trajectory(times, np.zeros((len(times), *still.shape)))
    elif motion is not None:
        motion = Trajectory(motion.times, np.zeros_like(motion.displacements))
    forces = None if reference is None else reference.tool_forces
    return make_state(
        problem.mesh,
        still,
        label="nothing moves",
        simulator="null result",
        strain=strain,
        trajectory=motion,
        tool_forces=None if forces is None else np.zeros_like(forces),
    )


def wrong_results(problem: Problem, reference: State) -> Iterator[State]:
    """Results made from the right one by a plain mistake; each is labelled with it."""
    yield null_result(problem, reference.strain, reference)
    yield _from(problem, reference, "turned round", lambda u: -u)
    yield _from(problem, reference, "twice as large", lambda u: 2.0 * u)
    yield _from(problem, reference, "axes exchanged", lambda u: u[..., [1, 2, 0]])
    if reference.trajectory is None:
        return
    for label, fault in (
        ("last state repeated", Fault.LAST_STATE_REPEATED),
        ("every second state still", Fault.EVERY_SECOND_STATE),
    ):
        change = partial(corrupt_displacement, problem.mesh, fault=fault)
        yield _from(problem, reference, label, change, keeps_tool_forces=True)


def _from(
    problem: Problem,
    reference: State,
    label: str,
    change: _Change,
    *,
    keeps_tool_forces: bool = False,
) -> State:
    states, motion, forces = change(reference.displacements), reference.trajectory, None
    if reference.tool_forces is not None:
        forces = reference.tool_forces if keeps_tool_forces else change(reference.tool_forces)
    return replace(
        reference,
        label=label,
        simulator="wrong result",
        stresses=None,
        integrals=None,
        trajectory=None if motion is None else Trajectory(motion.times, states),
        tool_forces=forces,
        **measures_of(problem.mesh, states[-1]),
    )
