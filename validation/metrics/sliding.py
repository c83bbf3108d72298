"""What a hand feels of the mesh while a tool slides: force that ripples, and false lateral force.

A tool is pressed in along the first leg of its path and slides where it goes on at right angles to
that, at constant depth. Forces are the means from output to output. Each is divided by its own mean
over the slide: a force that is too low throughout is an error of `tool_force`, and no ripple. What
the body itself does (its edges, its waves) is the reference's as well and does not count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import RigidTool
from palpate.validation.metrics.comparison import Measured, Pair
from palpate.validation.metrics.difference import largest
from palpate.validation.states import State

# Cosine between the way of a slide and the way of the press, at most.
_ACROSS = 0.05
# Outputs that a range is of, at least.
_FEWEST = 3
# Part of the largest step between outputs from which on a tool moves: below it is rounding.
_STILL = 1e-6


@dataclass(frozen=True, eq=False)
class Slide:
    """Where a tool slides.

    Attributes:
        tool: Its number, from 0.
        outputs: Outputs of which the whole interval before is slid, (n,).
        outward: Unit vector against which it was pressed in, (3,).
        ways: Unit vectors of its way in each of those intervals, (n, 3).
    """

    tool: int
    outputs: Indices
    outward: Floats
    ways: Floats

    def forces(self, state: State, num_outputs: int) -> Floats | None:
        """Forces on the tool over the slide [N], (n, 3); None where a state does not have them."""
        forces = state.tool_forces
        if forces is None or forces.ndim != 3 or len(forces) <= self.tool:
            return None
        # The first is that at time 0.
        return forces[self.tool, self.outputs] if forces.shape[1] == num_outputs + 1 else None


def slides(problem: Problem) -> Iterator[Slide]:
    """The slides of a motion's tools, of those that have one."""
    if problem.time is None:
        return
    times = problem.time.output_times
    for number, tool in enumerate(problem.tools):
        outward = _outward(tool)
        if outward is None:
            continue
        steps = np.diff([tool.path.pose_at(time)[0] for time in times], axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        across = np.abs(steps @ outward) <= _ACROSS * lengths
        found = np.flatnonzero(across & (lengths > _STILL * lengths.max(initial=0.0)))
        if len(found) >= _FEWEST:
            ways = steps[found] / lengths[found, None]
            yield Slide(number, (found + 1).astype(np.int32), outward, ways)


def unfit(problem: Problem) -> str:
    """What a problem needs for these metrics and has not; "" where it has a slide."""
    if next(slides(problem), None) is not None:
        return ""
    return (
        "a motion in which a tool is pressed in, then slides at right angles to that, over three "
        "outputs or more"
    )


def force_ripple(pair: Pair) -> Measured:
    """Range over a slide of the error of the force against the press, of the worst tool [N].

    The error is f <f_ref> / <f> - f_ref, with the force f, that of the reference f_ref and <.> the
    mean over the slide. Infinite without such a force.
    """
    return _worst(pair, lambda slide, errors: float(np.ptp(errors @ slide.outward)))


def false_lateral_force(pair: Pair) -> Measured:
    """Largest force along the way of a slide that the reference does not have [N].

    Scaled as in `force_ripple`. Only along the way: in half of a symmetric problem the force across
    it is real, and that of the mirrored half balances it.
    """
    return _worst(
        pair, lambda slide, errors: float(np.abs((errors * slide.ways).sum(axis=1)).max())
    )


def mean_force_of(problem: Problem, state: State) -> tuple[float, str]:
    """Largest mean over a slide of the force against the press [N]; NaN where none is above 0."""
    count, means = _num_outputs(problem), []
    for slide in slides(problem):
        forces = slide.forces(state, count)
        means.append(0.0 if forces is None else _mean(slide, forces))
    return max((mean for mean in means if mean > 0.0), default=math.nan), ""


def _worst(pair: Pair, size: Callable[[Slide, Floats], float]) -> Measured:
    """The largest size of the errors of a slide, the candidate's forces scaled to the same mean."""
    count, found = _num_outputs(pair.case), []
    for slide in slides(pair.case):
        ours, theirs = (slide.forces(s, count) for s in (pair.candidate, pair.reference))
        if ours is None or theirs is None or not _mean(slide, ours) > 0.0:
            return math.inf, 0.0
        scale = _mean(slide, theirs) / _mean(slide, ours)
        found.append(size(slide, scale * ours - theirs))
    return largest(found), 0.0


def _mean(slide: Slide, forces: Floats) -> float:
    return float((forces @ slide.outward).mean())


def _outward(tool: RigidTool) -> Floats | None:
    """Against the first leg of a path, unit vector; None of a tool without one."""
    legs = np.diff(tool.path.positions, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    moving = np.flatnonzero(lengths > 0.0)
    if tool.drive is not None or not len(moving):
        return None
    unit: Floats = -legs[moving[0]] / lengths[moving[0]]
    return unit


def _num_outputs(problem: Problem) -> int:
    needed = unfit(problem)
    if needed:
        raise InputError(f"force_ripple and false_lateral_force are of {needed}: none does here")
    assert problem.time is not None
    return problem.time.num_outputs
