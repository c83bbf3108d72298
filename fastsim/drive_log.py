"""What a controller did to a body, step by step, and the problem that does the same."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, ToolPath
from palpate.meshes.spring import AnchorPath, Spring

ToolGoal = tuple[list[float], list[float] | None]


@dataclass
class _Held:
    """A spring, from when until when, and where its anchor was at some steps."""

    spring: Spring
    begin: int
    end: int | None = None
    knots: dict[int, Floats] = field(default_factory=dict)


class DriveLog:
    """Of one run from its start.

    Args:
        problem: As it was before anybody drove.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._tools: list[dict[int, ToolGoal]] = [{} for _ in problem.tools]
        self._springs = [_Held(spring, 0) for spring in problem.springs]
        self._left_its_path = ""

    def held(self, spring: Spring, step: int) -> None:
        """Somebody took hold."""
        self._springs.append(_Held(spring, step))

    def let_go(self, spring: Spring, step: int) -> None:
        """And let go."""
        self._of(spring).end = step

    def went(
        self, begin: int, end: int, tools: dict[int, ToolGoal], anchors: dict[Spring, Floats]
    ) -> None:
        """Tools and anchors went from where they were to these goals between two steps."""
        for number, goal in tools.items():
            knots, path = self._tools[number], self._problem.tools[number].path
            if not knots:
                if len(path.times) > 1:
                    self._left_its_path = f"tool {number + 1}"
                knots[0] = path.positions[0].tolist(), path.rotations[0].tolist()
            place, turn = knots[max(knots)]
            knots[begin] = place, turn
            knots[end] = goal[0], turn if goal[1] is None else goal[1]
        for spring, anchor in anchors.items():
            held = self._of(spring)
            if not held.knots:
                if len(spring.path.times) > 1:
                    self._left_its_path = "a spring"
                held.knots[begin] = spring.path.end
            held.knots[begin] = held.knots[max(held.knots)]
            held.knots[end] = anchor

    def problem(self, num_steps: int, time_step: float) -> Problem:
        """The problem whose paths do the same; see `LiveBody.recording`."""
        end_time = num_steps * time_step
        if not num_steps:
            raise InputError("nothing was recorded: step the body first")
        if self._left_its_path:
            raise InputError(
                f"{self._left_its_path} had a path of its own and was moved off it: no path tells "
                "both; give it a single knot to start from"
            )
        if end_time / num_steps != time_step:
            raise InputError(
                f"{num_steps} steps of {time_step!r} s are rounded, and divided again are no such "
                "steps: leave time_step to the body, or give one of at most 20 significant bits"
            )
        span = self._problem.time or TimeSpan(end_time, time_step)
        span = dataclasses.replace(
            span, end_time=end_time, time_step=time_step, num_outputs=num_steps
        )
        return dataclasses.replace(
            self._problem,
            time=span,
            tools=tuple(
                self._tool(tool, knots, time_step)
                for tool, knots in zip(self._problem.tools, self._tools, strict=True)
            ),
            springs=tuple(self._spring(held, num_steps, time_step) for held in self._springs),
        )

    def _tool(self, tool: RigidTool, knots: dict[int, ToolGoal], dt: float) -> RigidTool:
        if not knots:
            return tool
        places = [knots[step][0] for step in sorted(knots)]
        turns = [knots[step][1] for step in sorted(knots)]
        times = dt * np.array(sorted(knots))
        return dataclasses.replace(tool, path=ToolPath(times, np.array(places), np.array(turns)))

    def _spring(self, held: _Held, num_steps: int, dt: float) -> Spring:
        path = held.spring.path
        factors: dict[int, float] = {}
        if held.knots:
            steps = sorted(held.knots)
            path = AnchorPath(dt * np.array(steps), np.array([held.knots[k] for k in steps]))
        # On and off within the step before: forces are found at whole steps.
        if held.begin > 0:
            factors |= {held.begin - 1: 0.0, held.begin: 1.0}
        if held.end is not None and held.end < num_steps:
            if held.end <= held.begin:
                factors = {0: 0.0}
            else:
                factors |= {held.end - 1: 1.0, held.end: 0.0}
        if not factors:
            return dataclasses.replace(held.spring, path=path)
        knots = sorted(factors)
        amplitude = TabularAmplitude(tuple(dt * k for k in knots), tuple(factors[k] for k in knots))
        return dataclasses.replace(held.spring, path=path, amplitude=amplitude)

    def _of(self, spring: Spring) -> _Held:
        return next(held for held in self._springs if held.spring is spring)
