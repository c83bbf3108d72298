"""Loads, springs and supports with their amplitudes, for motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.fenicsx import ufl
from palpate.reference.loads import FollowerLoad, apply_loads, spring_forces
from palpate.reference.supports import hold

Amplitude: TypeAlias = Callable[[float], float]
Amplitudes: TypeAlias = Amplitude | Sequence[Amplitude | None] | None


class LoadsOverTime:
    """What pushes and holds a body, each by its own factor over time.

    Args:
        body: The body.
        problem: Its supports, loads and springs.
        loads_by: Factor over time [-] on all loads, or one for each (None is 1); None takes each
            load's own.
        supports_by: The same for the supports' displacements.

    Raises:
        InputError: A load or support that cannot be used, or a wrong number of factors.
    """

    def __init__(
        self,
        body: ElasticBody,
        problem: Problem,
        loads_by: Amplitudes = None,
        supports_by: Amplitudes = None,
    ) -> None:
        space = body.space
        self._body = body
        self._dead: list[tuple[Amplitude, Floats]] = []
        self._followers: list[tuple[Amplitude, FollowerLoad]] = []
        own: Amplitudes = [load.amplitude for load in problem.loads]
        factors = _one_each(own if loads_by is None else loads_by, len(problem.loads), "loads")
        self._supports = hold(space, problem.supports)
        self.held: Indices = self._supports.dofs
        self.free: Indices = np.setdiff1d(np.arange(body.num_dofs), self.held)
        body.frames = self._supports.frames
        du = ufl.TrialFunction(space.space)
        for load, factor in zip(problem.loads, factors, strict=True):
            applied = apply_loads(space, [load], body.u, body.v, body.strain)
            self._dead.append((factor, body.to_local(applied.dead)))
            for work in applied.followers:
                follower = FollowerLoad(space.transferred.mesh, work, body.u, du)
                self._followers.append((factor, follower))
        self._springs = spring_forces(
            space, problem.springs, u=body.u, v=body.v, unknown=body.u, trial=du
        )
        own = [support.amplitude for support in problem.supports]
        self._support_factors = _one_each(
            own if supports_by is None else supports_by, len(problem.supports), "supports"
        )

    @property
    def has_followers(self) -> bool:
        """Whether a load's direction follows the body, which makes tangents unsymmetric."""
        return bool(self._followers)

    @property
    def is_linear(self) -> bool:
        """Whether the derivative of the forces by the displacement is always the same."""
        return not self._followers and all(spring.is_steady for spring in self._springs)

    def force(self, displacement: Floats, time: float) -> Floats:
        """Nodal forces of all loads and springs [N], flat."""
        force = np.zeros_like(displacement)
        for factor, dead in self._dead:
            force += factor(time) * dead
        if self._followers or self._springs:
            self._body.set_displacement(displacement)
        for factor, follower in self._followers:
            force += factor(time) * self._body.to_local(follower.force())
        for spring in self._springs:
            spring.move_to(time)
            force += spring.factor(time) * self._body.to_local(spring.force())
        return force

    def add_tangent(self, matrix: Any, weight: float, time: float) -> None:
        """Add minus the derivative of the forces, times a weight; the body holds its place."""
        for factor, follower in self._followers:
            follower.add_tangent(matrix, weight * factor(time))
        for spring in self._springs:
            spring.add_tangent(matrix, weight * spring.factor(time))

    def at_supports(self, displacement: Floats, time: float) -> Floats:
        """The displacement with its held components where they are at that time [m]."""
        moved = displacement.copy()
        moved[self.held] = self._supports.at([factor(time) for factor in self._support_factors])
        return moved


def _one_each(given: Amplitudes, count: int, what: str) -> list[Amplitude]:
    if given is None or callable(given):
        return [given or _always] * count
    if len(given) != count:
        raise InputError(f"{len(given)} amplitudes for {count} {what}; give one for each, or one")
    return [factor or _always for factor in given]


def _always(_time: float) -> float:
    return 1.0
