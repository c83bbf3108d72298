"""What solving a problem will take, measured where that is quick, and guessed where not."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import SAFETY
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.viscosity import damped_time_step
from palpate.meshes.problem import Problem, Strain
from palpate.validation.solving import solve
from palpate.validation.states import CandidateFailedError, State

# A Newton solve in linear ones: 3 to 12 on the built-in kidney, beam and block.
_NEWTON = 8.0
# Seconds of the reference at 20 000 unknowns; 9 s (kidney) and 40 s (beam) were measured there.
_REFERENCE_SECONDS, _REFERENCE_UNKNOWNS, _REFERENCE_POWER = 20.0, 20_000, 1.2
_REFERENCE_START = 1.0
# Bytes of a block of 3 x 3 with its index, in the matrix and again in what is made of it.
_FAST_BLOCK, _REFERENCE_BLOCK = 2 * 76, 4 * 108
_BASE_BYTES = 100e6
# Nodes that share a cell with one, of quadratic tetrahedra.
_QUADRATIC_NEIGHBOURS = 28


@dataclass(frozen=True, eq=False)
class Costs:
    """Before solving.

    Attributes:
        critical_time_step: Of explicit steps about rest [s].
        num_steps: Of a motion, explicitly; 0 in statics.
        num_unknowns: Of linear tetrahedra.
        num_quadratic_unknowns: Of the truth on the same mesh.
        fast_seconds: Of fastsim with Green strain, None where nothing could be measured.
        fast_bytes: Its memory.
        truth_seconds: Of one quadratic solve by the reference; None for a motion.
        truth_bytes: Its memory.
        linear: The answer with linear strain, where it was quick: None for motions, tools.
        trouble: Why there is none though it was tried.
    """

    critical_time_step: float
    num_steps: int
    num_unknowns: int
    num_quadratic_unknowns: int
    fast_seconds: float | None
    fast_bytes: float
    truth_seconds: float | None
    truth_bytes: float
    linear: State | None = None
    trouble: str = ""


def expected_costs(problem: Problem) -> Costs:
    """Measure a step or a linear solve, and reckon from there."""
    body = Body.of(problem)
    mesh, span = problem.mesh, problem.time
    springs = PatchSprings(mesh.points, problem.springs) if problem.springs else None
    critical = damped_time_step(
        body.critical_time_step(springs=springs), 0.0 if span is None else span.stiffness_damping
    )
    ends = mesh.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1)
    num_edges = len(np.unique(low * mesh.num_points + high))
    num_nodes = mesh.num_points + num_edges
    linear, trouble, num_steps, seconds = None, "", 0, None
    if span is not None:
        step = span.time_step or SAFETY * critical
        num_steps = math.ceil(span.end_time / step)
        seconds = num_steps * _seconds_of_force(body)
    elif not problem.tools:
        try:
            linear = solve(dataclasses.replace(problem, time=None), strain=Strain.LINEAR)
            seconds = _NEWTON * linear.seconds
        except CandidateFailedError as error:
            trouble = str(error)
    ratio = 3 * num_nodes / _REFERENCE_UNKNOWNS
    truth = _REFERENCE_START + _REFERENCE_SECONDS * ratio**_REFERENCE_POWER
    return Costs(
        critical_time_step=critical,
        num_steps=num_steps,
        num_unknowns=3 * mesh.num_points,
        num_quadratic_unknowns=3 * num_nodes,
        fast_seconds=seconds,
        fast_bytes=_BASE_BYTES + _FAST_BLOCK * (mesh.num_points + 2 * num_edges),
        truth_seconds=truth if span is None else None,
        truth_bytes=_BASE_BYTES + _REFERENCE_BLOCK * _QUADRATIC_NEIGHBOURS * num_nodes,
        linear=linear,
        trouble=trouble,
    )


def _seconds_of_force(body: Body) -> float:
    """Of the internal forces, which are most of a step; the best of three."""
    rest = np.zeros_like(body.mesh.points)
    best = math.inf
    for _ in range(3):
        start = time.perf_counter()
        body.internal_force(rest)
        best = min(best, time.perf_counter() - start)
    return best
