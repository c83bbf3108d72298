"""What an impact does to the body as a whole: its momentum, and its energy before and after.

Two statements that hold for every simulator, mesh and step, computed from the trajectory and the
forces on the tools alone. Between the middles of the first and the last interval of n outputs, h
apart,

    m (V_n - V_1) = (n - 1) h f - h (F_1 / 2 + F_2 + ... + F_(n-1) + F_n / 2)

with the mean velocities V of the middle of mass over an interval, the weight f, and the mean forces
F on the tools: exact where a body begins and ends in flight, for there it falls with an even
acceleration. And a body that nothing else does work on has in the end the energy of its start,

    1/2 v . M v + W(u) - f . u + what stiffness damping took = 1/2 v_0 . M v_0

with velocities by differences of the outputs and the work of viscous stresses from output to
output. Mass is lumped, as a quarter of each cell's at its corners.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.exchange.nodal_arrays import (
    fixed_components,
    lumped_mass,
    nodal_force,
    sliding_points,
)
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.metrics.body import Body, body_of
from palpate.validation.metrics.difference import are_measurable
from palpate.validation.metrics.own_mesh import problem_on
from palpate.validation.metrics.validity import Worst
from palpate.validation.states import State

# Outputs that a velocity is read from, and differences for it in steps of an output, the sharper
# one first: of fourth and of second order.
_STENCIL = 5
_DIFFERENCES = (np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0, np.array([0, -1.0, 0, 1.0, 0]) / 2.0)
# Times are the same within this part of the span.
_SAME_TIME = 1e-9
Balance = Callable[[Problem, Problem, Floats, State], tuple[float, float]]


def unfit(problem: Problem) -> str:
    """Why nothing can be said of a problem's balances; "" where something can."""
    span, tools, start = problem.time, problem.tools, problem.initial_velocity
    thrown = np.zeros(3) if start is None else np.abs(start.at(problem.mesh.points)).max(axis=0)
    if span is None or span.num_outputs < _STENCIL or not thrown.any():
        return f"a body that is thrown, with an initial_velocity and {_STENCIL} outputs or more"
    if span.mass_damping or problem.springs or problem.masses:
        return "a motion without mass_damping, springs and masses"
    if not all(isinstance(one, BodyForce) and one.amplitude is None for one in problem.loads):
        return "a body on which a constant weight alone acts"
    if any(tool.drive or tool.friction_coefficient or len(tool.path.times) > 1 for tool in tools):
        return "tools that are still and without friction"
    if sliding_points(problem) is not None or fixed_components(problem)[1].any():
        return "supports that do not move, along x, y or z"
    if not tools or thrown[~_free(problem)].any():
        return "a body that is thrown at a tool along x, y or z free of supports"
    return ""


def impulse_balance(problem: Problem, state: State) -> Worst:
    """Impulse of the forces on the tools against that which the body's momentum shows [-].

    Over the latter, along the axes that no support fixes. The doubt is half of what the tools'
    forces give in the first and the last interval. Infinite where a result has no such forces.

    Raises:
        InputError: See `unfit`.
    """
    return _worst(problem, state, _impulse)


def energy_balance(problem: Problem, state: State) -> Worst:
    """Energy that the body has gained or lost over the motion [-], over that of its throw.

    At the last output but two. The doubt is the difference to what second-order velocities say, and
    of the work of damping that to what every second output says.

    Raises:
        InputError: See `unfit`.
    """
    return _worst(problem, state, _energy)


def _worst(problem: Problem, state: State, balance: Balance) -> Worst:
    """A balance of a state where it was solved, with what reading its times adds to the doubt."""
    needed = unfit(problem)
    if needed:
        raise InputError(f"impulse_balance and energy_balance are of {needed}: not so here")
    if not are_measurable(*state.fields):
        return Worst(math.inf)
    there = problem if state.own is None else problem_on(state.own.mesh, problem)
    with np.errstate(over="ignore", invalid="ignore"):
        found = [balance(problem, there, states, state) for states in _readings(problem, state)]
    value, doubt = found[0]
    doubt += max((abs(value - other) for other, _ in found[1:]), default=0.0)
    return Worst(value, doubt=doubt)


def _readings(problem: Problem, state: State) -> Iterator[Floats]:
    """Displacements at the output times, on the mesh they were sent on [m], in each reading."""
    assert problem.time is not None
    if state.own is None:
        yield state.displacements
        if state.other_reading is not None:
            yield state.other_reading.displacements
        return
    given, times = state.given, problem.time.output_times
    assert given is not None
    slack = _SAME_TIME * float(times[-1])
    read = read_at(given.times, state.own.displacements, times, slack=slack)
    yield read.states
    if not read.were_sent.all():
        yield read.others


def _impulse(case: Problem, there: Problem, states: Floats, state: State) -> tuple[float, float]:
    assert case.time is not None
    forces, count = state.tool_forces, case.time.num_outputs
    if forces is None or forces.shape != (len(case.tools), count + 1, 3):
        return math.inf, 0.0
    free, step = _free(case), case.time.end_time / count
    momenta = np.einsum("p,tpi->ti", lumped_mass(there), np.diff(states, axis=0)) / step
    given = momenta[-1] - momenta[0] - (count - 1) * step * _weight(case, there).sum(axis=0)
    felt = forces.sum(axis=0)[1:]
    weights = np.ones(count)
    weights[[0, -1]] = 0.5
    size = float(np.linalg.norm(given[free]))
    error = float(np.linalg.norm((given + step * (weights @ felt))[free]))
    doubt = 0.5 * step * float(np.linalg.norm(felt[[0, -1]], axis=1).sum())
    return (error / size, doubt / size) if size > 0.0 else (math.inf, 0.0)


def _energy(case: Problem, there: Problem, states: Floats, state: State) -> tuple[float, float]:
    assert case.time is not None
    assert case.initial_velocity is not None
    step = case.time.end_time / case.time.num_outputs
    mass, body = lumped_mass(there)[:, None], body_of(there, state.strain, state.element)
    thrown = case.initial_velocity.at(there.mesh.points)
    start = 0.5 * float((mass * thrown**2).sum())
    last = states[-_STENCIL:]
    sharp, coarse = (
        0.5 * float((mass * np.einsum("k,kpi->pi", weights, last / step) ** 2).sum())
        for weights in _DIFFERENCES
    )
    middle = last[_STENCIL // 2]
    until = len(states) - _STENCIL // 2
    spent = body.energy(middle) - float((_weight(case, there) * middle).sum())
    beta, lost, coarsely = case.time.stiffness_damping, 0.0, 0.0
    if beta > 0.0:
        lost = beta / step * _work_of_change(body, states[:until])
        coarsely = beta / (2.0 * step) * _work_of_change(body, states[:until][::-2])
    doubt = abs(sharp - coarse) + abs(lost - coarsely)
    return abs(sharp + spent + lost - start) / start, doubt / start


def _work_of_change(body: Body, states: Floats) -> float:
    """Sum over the intervals of dE : C : dE over the rest volume [J], dE the change of strain."""
    work = 0.0
    for one, other in pairwise(states):
        # A force is linear in F: the mean of both ends' is that at the middle, whose work is exact.
        force = 0.5 * (body.viscous(other, one) - body.viscous(one, other))
        work += float((force * (other - one)).sum())
    return work


def _free(problem: Problem) -> NDArray[np.bool_]:
    """Which of x, y, z no support fixes anywhere, (3,)."""
    free: NDArray[np.bool_] = ~fixed_components(problem)[0].astype(bool).any(axis=0)
    return free


def _weight(case: Problem, there: Problem) -> Points:
    """Force of the weight at the points of a mesh of the case's body [N], (n, 3)."""
    nothing = np.zeros_like(there.mesh.points)
    return sum((nodal_force(there.mesh, load) for load in case.loads), nothing)
