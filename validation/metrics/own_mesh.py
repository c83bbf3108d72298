"""Metrics of an answer on a mesh of its own: judged there, and at the case's points as well.

The reference is known at the case's points, and is read between them at the points of the own
mesh (`between_points`). What that reading may be off by is the comparison's uncertainty: it adds
to the reference's error bar, so that garbage fails, and an honest answer does not. Each value is
the worst of both meshes; of what needs no reading (volume, area, energy), that of its own.

With inclusions a cell of the own mesh has the material of the case's cell that holds its middle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Inclusion, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.point_location import locate
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.metrics.between_points import Reading, read_between
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.fields import det_f, gradient_norm
from palpate.validation.metrics.own_reactions import own_reactions
from palpate.validation.metrics.pairs import Difference
from palpate.validation.metrics.surfaces import surface_distances
from palpate.validation.states import OwnMesh, State

# Times are the same within this part of the span.
_SAME_TIME = 1e-9
# What to do where the uncertainty leaves a verdict open.
OWN_MESH_REMEDY = (
    "too near the limit for an answer on a mesh of its own, where the reference is read between "
    "its points: send the answer at the case's points, or mesh the case finer and build its "
    "reference (palpate reference build)"
)


@dataclass(frozen=True, eq=False)
class OwnPair:
    """An answer on its own mesh at one time, beside the reference read there.

    Attributes:
        problem: The case's.
        mesh: The answer's own.
        displacement: Of the answer on it [m], (mesh.num_points, 3).
        read: The reference read at its points.
        candidate: The answer at the case's points.
        reference: There too.
    """

    problem: Problem
    mesh: TetMesh
    displacement: Points
    read: Reading
    candidate: State
    reference: State

    @property
    def error(self) -> Points:
        """Answer less reference at the own points [m]."""
        return self.displacement - self.read.value

    @property
    def own_problem(self) -> Problem:
        """The own mesh with the case's materials, without loads, springs, supports and tools."""
        return problem_on(self.mesh, self.problem)


def problem_on(mesh: TetMesh, problem: Problem) -> Problem:
    """Another mesh of a case's body with its materials; without loads, springs, supports, tools."""
    if not problem.inclusions:
        return dataclasses.replace(problem, mesh=mesh, supports=(), loads=(), springs=(), tools=())
    case = problem.mesh
    held = locate(case.points, case.cells, mesh.points[mesh.cells].mean(axis=1)).cells
    inclusions = tuple(
        Inclusion(np.flatnonzero(np.isin(held, part.cells)).astype(np.int32), part.material)
        for part in problem.inclusions
    )
    return dataclasses.replace(
        problem, mesh=mesh, supports=(), loads=(), springs=(), tools=(), inclusions=inclusions
    )


@lru_cache(maxsize=2)
def _pair(problem: Problem, candidate: State, own: OwnMesh, reference: State) -> OwnPair:
    """At the end; the last ones are remembered, for all metrics of them."""
    read = read_between(problem.mesh, reference.displacement, reference.degree, own.mesh)
    return OwnPair(problem, own.mesh, own.displacements[-1], read, candidate, reference)


# An error on the own mesh and what it may be off by, both in the metric's unit.
Measured = tuple[float, float]
Measure = Callable[[OwnPair], Measured]


def displacement_l2(pair: OwnPair) -> Measured:
    """L2 norm of the error over the own mesh, and of the reading's doubt [m^2.5]."""
    return l2_norm(pair.mesh, pair.error), l2_norm(pair.mesh, pair.read.doubt[:, None])


def displacement_h1(pair: OwnPair) -> Measured:
    """H1 seminorms of the error and of what a linear reading would not have [m^1.5]."""
    return gradient_norm(pair.mesh, pair.error), gradient_norm(pair.mesh, pair.read.added)


def energy_norm(pair: OwnPair) -> Measured:
    """Of the same two, in linear elasticity [J^(1/2)]."""
    body = body_of(pair.own_problem, Strain.LINEAR)
    error, doubt = (math.sqrt(2.0 * body.energy(field)) for field in (pair.error, pair.read.added))
    return error, doubt


def displacement_max(pair: OwnPair) -> Measured:
    """Largest error of a point [m]."""
    error, doubt = _lengths(pair.error), pair.read.doubt
    return _middle(float((error - doubt).max()), float((error + doubt).max()))


def max_displacement(pair: OwnPair) -> Measured:
    """Error of the largest displacement [m], of a point of the case or of the own mesh."""
    read, doubt = _lengths(pair.read.value), pair.read.doubt
    largest = pair.reference.max_displacement
    low, high = (max(largest, float((read + sign * doubt).max())) for sign in (-1.0, 1.0))
    middle, off = _middle(low, high)
    found = max(float(_lengths(u).max()) for u in (pair.displacement, pair.candidate.displacement))
    return abs(found - middle), off


def local_volume(pair: OwnPair) -> Measured:
    """Root mean square error of det F over the own cells [-]."""
    read = pair.read
    rest = signed_volumes(pair.mesh.points, pair.mesh.cells)
    ours, theirs, plain = (
        det_f(pair.mesh, field)
        for field in (pair.displacement, read.value, read.value - read.added)
    )
    error, doubt = (
        math.sqrt(float(rest @ (theirs - others) ** 2 / rest.sum())) for others in (ours, plain)
    )
    return error, doubt


def size_error(name: str) -> Measure:
    """Error of the volume [m3] or surface area [m2]; another size at rest leaves it open."""

    def measure(pair: OwnPair) -> Measured:
        rest, own = (float(getattr(mesh, name)) for mesh in (pair.problem.mesh, pair.mesh))
        found, expected = (getattr(state, name) for state in (pair.candidate, pair.reference))
        return abs(found - expected), abs(own / rest - 1.0) * abs(found - rest)

    return measure


def surface_hausdorff(pair: OwnPair) -> Measured:
    """Hausdorff distance of the own boundary as answered and as the reference moves it [m]."""
    doubt = pair.read.doubt[np.unique(pair.mesh.boundary_facets)]
    return _surfaces(pair)[0], float(doubt.max())


def surface_mean_distance(pair: OwnPair) -> Measured:
    """Mean distance of the same two [m]."""
    areas = np.linalg.norm(pair.mesh.surface().area_vectors, axis=1)
    doubt = pair.read.doubt[pair.mesh.boundary_facets].mean(axis=1)
    return _surfaces(pair)[1], float(np.average(doubt, weights=areas))


@lru_cache(maxsize=2)
def _surfaces(pair: OwnPair) -> Measured:
    """Hausdorff and mean distance.

    The same facets on both sides: chords of a curved body at rest do not count.
    """
    facets = pair.mesh.boundary_facets
    moved = [pair.mesh.points + u for u in (pair.displacement, pair.read.value)]
    return surface_distances(moved[0], facets, moved[1], facets)


def energy(pair: OwnPair) -> Measured:
    """Error of the strain energy [J]."""
    found = body_of(pair.own_problem, pair.candidate.strain, pair.candidate.element).energy(
        pair.displacement
    )
    expected = body_of(pair.problem, pair.reference.strain, pair.reference.element).energy(
        pair.reference.displacement
    )
    other = abs(pair.mesh.volume / pair.problem.mesh.volume - 1.0)
    return abs(found - expected), other * found


def reaction_force(pair: OwnPair) -> Measured:
    """Largest error of a support's total force [N]."""
    return own_reactions(
        pair.problem, pair.own_problem, pair.displacement, pair.candidate, pair.reference
    )


def trajectory_l2(pair: OwnPair) -> Measured:
    """The worst of the reference's times, with what reading the answer there may be off by."""
    own, sent, theirs = pair.candidate.own, pair.candidate.sent, pair.reference.trajectory
    assert own is not None
    assert sent is not None
    assert theirs is not None
    slack = _SAME_TIME * float(theirs.times[-1])
    ours = read_at(sent.times, own.displacements, theirs.times, slack=slack)
    found = []
    for displacement, state, other in zip(
        theirs.displacements, ours.states, ours.others, strict=True
    ):
        read = read_between(pair.problem.mesh, displacement, pair.reference.degree, own.mesh)
        there = dataclasses.replace(pair, displacement=state, read=read)
        error, doubt = displacement_l2(there)
        doubt += l2_norm(own.mesh, state - other)
        found.append((max(error - doubt, 0.0), error + doubt))
    low, high = np.max(found, axis=0).tolist()
    return _middle(low, high)


def measure_on_own_mesh(
    measure: Measure,
    at_points: Difference,
    problem: Problem,
    candidate: State,
    own: OwnMesh,
    reference: State,
    *,
    is_alone: bool,
) -> Difference:
    """A metric of an answer with a mesh of its own.

    Args:
        measure: Of the metric.
        at_points: What it is at the case's points.
        problem: The case's.
        candidate: At the case's points.
        own: Its mesh, and what it answered there.
        reference: At the case's points.
        is_alone: The own mesh alone answers; else the value is the worst of both meshes.
    """
    error, doubt = measure(_pair(problem, candidate, own, reference))
    scale = at_points.scale
    if scale == 0.0:
        # A reference that does not move is read as it is, and any error is too much.
        value = max(at_points.value, 0.0 if error == 0.0 else math.inf)
        return dataclasses.replace(at_points, value=value)
    low, high = max(error - doubt, 0.0) / scale, (error + doubt) / scale
    if not is_alone:
        low, high = max(low, at_points.value), max(high, at_points.value)
    value, uncertainty = _middle(low, high)
    return dataclasses.replace(at_points, value=value, uncertainty=uncertainty)


def _middle(low: float, high: float) -> Measured:
    """A range as its middle and its half width; an endless one stays so."""
    if not math.isfinite(high):
        return (low, math.inf) if math.isfinite(low) else (math.inf, 0.0)
    return 0.5 * (low + high), 0.5 * (high - low)


def _lengths(field: Points) -> Points:
    length: Points = np.linalg.norm(field, axis=1)
    return length
