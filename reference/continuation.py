"""Equilibria along an arc: past limit points, where a plain rise of the load has to stop.

The load factor t is an unknown beside the displacement. From an equilibrium the path leaves along
its tangent (K^-1 f, 1), with f the force of the full load; each Newton step then stays on the
plane across the tangent. E. Riks, "An incremental approach to the solution of snapping and
buckling problems", Int. J. Solids Structures 15 (1979); M. A. Crisfield, Non-linear Finite Element
Analysis of Solids and Structures, vol. 1, 1991, chapter 9. Each step solves with K twice instead of
with the bordered matrix: K is singular at the limit point itself, where no step ends but by chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.rigid_modes import require_supported
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import require_no_tools
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.linear_solver import LinearSolveError, LinearSolver

_MAX_CORRECTIONS = 10
_FEW_CORRECTIONS = 4
# Least cosine between the tangents at the ends of a step: more of a turn might miss something.
_LEAST_COSINE = 0.97
# A Newton step may take det F down to this fraction of what it was, not further.
_SHRINK_PER_STEP = 0.1
# The first step stretches nothing by more than about this, nor goes further than this in load.
_FIRST_GRADIENT = 0.1
_LARGEST_FIRST_STEP = 0.2
# Steps smaller than this part of the first end the path.
_SMALLEST_STEP = 1e-5

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class PathPoint:
    """An equilibrium on the path.

    Attributes:
        load_factor: Fraction of the loads and prescribed displacements [-]; not growing
            everywhere on the path.
        displacement: At the mesh's points [m], shape (num_points, 3).
        is_stable: Whether the tangent is positive definite; None under follower loads, whose
            tangent is not symmetric.
        smallest_det_f: At the sample points [-].
    """

    load_factor: float
    displacement: Points
    is_stable: bool | None
    smallest_det_f: float


@dataclass(frozen=True, eq=False)
class EquilibriumPath:
    """Equilibria in the order of the path.

    Attributes:
        points: The path, from the body at rest.
        reason: Why it ended; empty where it came to a stable equilibrium under the full load,
            then its last point.
        iterations: Linear solves in all.
    """

    points: tuple[PathPoint, ...]
    reason: str
    iterations: int

    @property
    def limit_points(self) -> tuple[int, ...]:
        """Points where the load factor is larger, or smaller, than on both sides."""
        t = np.array([p.load_factor for p in self.points])
        turns = np.flatnonzero(np.diff(t)[:-1] * np.diff(t)[1:] < 0.0) + 1
        return tuple(int(k) for k in turns)


def follow_path(
    problem: Problem,
    *,
    degree: int = 1,
    relative_tolerance: float = 1e-9,
    most_points: int = 200,
    progress: Progress | None = None,
) -> EquilibriumPath:
    """Follow the equilibria of a problem from rest to the full load, past limit points.

    Args:
        problem: Mesh, material, supports and loads; Green strain.
        degree: Polynomial degree of the displacement, 1 to 3.
        relative_tolerance: Out-of-balance nodal forces over the external or internal ones [-].
        most_points: Where to give up.
        progress: Called with one line of text for every point.

    Returns:
        The path; it ends under the full load, or says why not.

    Raises:
        InputError: The problem cannot be used.

    Note:
        One path only: at a bifurcation it goes straight on, onto the branch that is not stable.
        Of the equilibria under the full load it returns the first stable one along the path,
        which a body that snaps need not come to rest in.
    """
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: needs 1, 2 or 3")
    require_supported(problem)
    require_no_tools(problem, "continuation")
    arc = _Arc(problem, degree, relative_tolerance)
    return arc.follow(most_points, progress or _say_nothing)


@dataclass(frozen=True, eq=False)
class _State:
    u: Floats
    t: float
    det_f: float


class _Arc:
    """The equations of one problem with the load factor among the unknowns."""

    def __init__(self, problem: Problem, degree: int, relative_tolerance: float) -> None:
        self._discrete = DiscreteProblem(problem, strain=Strain.GREEN, degree=degree)
        self._sampler = DetFSampler(self._discrete)
        self._tolerance = relative_tolerance
        self._linear = LinearSolver(
            self._discrete.space.coordinates,
            is_symmetric=not self._discrete.has_followers,
            is_always_direct=True,
        )
        self._iterations = 0
        self._size = 1.0

    def follow(self, most_points: int, progress: Progress) -> EquilibriumPath:
        """From rest on; see `follow_path`."""
        now = _State(np.zeros(self._discrete.num_dofs), 0.0, 1.0)
        points = [self._point(now)]
        try:
            answer = self._answer_of_load(now)
        except LinearSolveError as error:
            return EquilibriumPath(tuple(points), str(error), self._iterations)
        # Displacements are measured by the answer to the load at rest: then they count like t.
        self._size = fenicsx.norm(answer) or 1.0
        tangent = self._tangent(answer)
        gradient = self._sampler.largest_gradient(answer)
        first = min(_LARGEST_FIRST_STEP, _FIRST_GRADIENT / max(gradient, 1e-300)) * math.sqrt(2.0)
        step, reason = first, ""
        while len(points) < most_points:
            ahead, reason, corrections = self._correct(now, tangent, step)
            if ahead is not None:
                new = self._tangent(self._answer_of_load(ahead))
                cosine = self._dot(new, tangent)
                if abs(cosine) >= _LEAST_COSINE:
                    if now.t < 1.0 <= ahead.t:
                        end = self._at_full_load(now, ahead)
                        if end is not None and end.is_stable is not False:
                            return EquilibriumPath((*points, end), "", self._iterations)
                    now, tangent = ahead, (new[0] * np.sign(cosine), new[1] * np.sign(cosine))
                    points.append(self._point(now))
                    progress(
                        f"point {len(points) - 1}: load {now.t:.4f}, smallest det F {now.det_f:.4f}"
                    )
                    if now.t < -1.0:
                        reason = "the path leads away from the load"
                        break
                    if corrections <= _FEW_CORRECTIONS:
                        step *= 1.5
                    continue
                reason = "the path turns sharply"
            step /= 2.0
            if step < _SMALLEST_STEP * first:
                break
        else:
            reason = f"no end in {most_points} points"
        return EquilibriumPath(tuple(points), reason, self._iterations)

    def _dot(self, a: tuple[Floats, float], b: tuple[Floats, float]) -> float:
        return float(fenicsx.total(float(a[0] @ b[0]))) / self._size**2 + a[1] * b[1]

    def _tangent(self, answer: Floats) -> tuple[Floats, float]:
        length = math.sqrt(self._dot((answer, 1.0), (answer, 1.0)))
        return answer / length, 1.0 / length

    def _answer_of_load(self, state: _State) -> Floats:
        """K^-1 f: what more load would do."""
        eq = self._discrete
        force = eq.external_force(state.u)
        matrix = eq.tangent(state.u, state.t)
        self._iterations += 1
        return self._linear.solve(matrix, force, eq.held.dofs, eq.held.values, tolerance=1e-12)

    def _correct(
        self, start: _State, tangent: tuple[Floats, float], step: float
    ) -> tuple[_State | None, str, int]:
        """Newton's method on the plane across the tangent, a step ahead of the start."""
        eq = self._discrete
        u, t, det_f = start.u + step * tangent[0], start.t + step * tangent[1], start.det_f
        if not self._sampler.smallest(u) > _SHRINK_PER_STEP * det_f:
            return None, "a cell would invert", 0
        first = math.inf
        for iteration in range(_MAX_CORRECTIONS + 1):
            internal, external = eq.internal_force(u), t * eq.external_force(u)
            residual = internal - external
            norm = fenicsx.norm(residual[eq.free])
            scale = max(fenicsx.norm(internal), fenicsx.norm(external))
            if not math.isfinite(norm) or norm > 1e6 * first:
                return None, "the iteration diverges", iteration
            if norm <= self._tolerance * scale:
                det_f = self._sampler.smallest(u)
                if not det_f > 0.0:
                    return None, "a cell is inverted", iteration
                return _State(u, t, det_f), "", iteration
            first = min(first, norm) if iteration < 2 else first
            try:
                answer = self._answer_of_load(_State(u, t, det_f))
                # The held entries are where they belong: the predictor and the answer move them.
                matrix = eq.tangent(u, t)
                rest = self._linear.solve(
                    matrix, -residual, eq.held.dofs, np.zeros(len(eq.held.dofs)), tolerance=1e-12
                )
            except LinearSolveError as error:
                return None, str(error), iteration
            self._iterations += 1
            dt = -self._dot((rest, 0.0), tangent) / self._dot((answer, 1.0), tangent)
            u, t = u + rest + dt * answer, t + dt
            now = self._sampler.smallest(u)
            if not now > _SHRINK_PER_STEP * min(det_f, 1.0):
                return None, "a cell would invert", iteration
            det_f = now
        return None, f"no convergence in {_MAX_CORRECTIONS} iterations", _MAX_CORRECTIONS

    def _at_full_load(self, before: _State, after: _State) -> PathPoint | None:
        """The equilibrium at t = 1 between two points: Newton's method at a fixed load."""
        eq = self._discrete
        s = (1.0 - before.t) / (after.t - before.t)
        u = before.u + s * (after.u - before.u)
        for _ in range(_MAX_CORRECTIONS):
            internal, external = eq.internal_force(u), eq.external_force(u)
            residual = internal - external
            scale = max(fenicsx.norm(internal), fenicsx.norm(external))
            if fenicsx.norm(residual[eq.free]) <= self._tolerance * scale:
                return self._point(_State(u, 1.0, self._sampler.smallest(u)))
            gap = eq.held.values - u[eq.held.dofs]
            matrix = eq.tangent(u, 1.0)
            try:
                u = u + self._linear.solve(matrix, -residual, eq.held.dofs, gap, tolerance=1e-12)
            except LinearSolveError:
                return None
            self._iterations += 1
            if not self._sampler.smallest(u) > 0.0:
                return None
        return None

    def _point(self, state: _State) -> PathPoint:
        eq = self._discrete
        is_stable = None
        if not eq.has_followers:
            matrix = eq.tangent(state.u, state.t)
            is_stable = self._linear.is_positive_definite(matrix, eq.held.dofs)
        return PathPoint(state.t, eq.space.at_points(state.u), is_stable, state.det_f)


def _say_nothing(_line: str) -> None:
    pass
