"""Metrics between two states: the error on a mesh, and the size of the reference that it is over.

Each error is measured on a `Pair`: the candidate beside the reference, on the case's mesh or on one
of the candidate's own, where the reference is read between its points (`own_mesh`). What that
reading may be off by is the comparison's uncertainty: it adds to the reference's error bar, so that
garbage fails, and an honest result does not. Each value is the worst of both meshes; of what needs
no reading (volume, area, energy), that of the candidate's own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import SMALLEST_CHANGE, l2_norm, l2_norms, size_of_change
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.exchange.point_location import nearest_on_surface
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.metrics.body import body_of, shape_gradients
from palpate.validation.metrics.difference import Difference, largest, ratio
from palpate.validation.metrics.own_mesh import Reading, own_reactions, problem_on, read_between
from palpate.validation.metrics.validity import det_f
from palpate.validation.states import OwnMesh, State

Array = NDArray[np.float64]
# Times are the same within this part of the span.
_SAME_TIME = 1e-9
# Facets this many times as large as those they are compared with are torn.
_TORN = 2.0
# Facets that are sampled at least.
_FEWEST = 64


@dataclass(frozen=True, eq=False)
class Pair:
    """A candidate beside the reference on one mesh: the case's, or the candidate's own (`is_own`).

    `displacement` is the candidate's there [m], `read` the reference there, and what reading it may
    be off by; `candidate` and `reference` are the states at the points of the `case`.
    """

    case: Problem
    mesh: TetMesh
    displacement: Points
    read: Reading
    candidate: State
    reference: State
    is_own: bool = False

    @property
    def error(self) -> Points:
        """Candidate less reference at the points of the mesh [m]."""
        return self.displacement - self.read.value

    @cached_property
    def problem(self) -> Problem:
        """The case's on that mesh; on a candidate's own its materials alone."""
        return problem_on(self.mesh, self.case) if self.is_own else self.case


# An error and what it may be off by, both in the metric's unit.
Measured = tuple[float, float]
ErrorOf = Callable[[Pair], Measured]
# The scale of errors, in their unit, and its name where that is not the metric's own.
ScaleOf = Callable[[Problem, State], tuple[float, str]]
# Size of a displacement field of a problem.
Norm = Callable[[Problem, Points], float]


def compare_states(
    error: ErrorOf,
    scale_of: ScaleOf,
    problem: Problem,
    candidate: State,
    reference: State,
    *,
    own: OwnMesh | None,
    is_alone: bool,
) -> Difference:
    """A metric of two states at the case's points: an error on a pair, over the reference's size.

    The candidate on a mesh of its own is looked at as well, or where it `is_alone` only: else the
    value is the worst of both meshes.
    """
    scale, name = scale_of(problem, reference)
    nothing = np.zeros_like(reference.displacement)
    there = Reading(reference.displacement, nothing, nothing[:, 0])
    mesh = problem.mesh
    pair = Pair(problem, mesh, candidate.displacement, there, candidate, reference)
    found = ratio(error(pair)[0], scale, name)
    if own is None:
        return found
    off, doubt = error(_own_pair(problem, candidate, own, reference))
    if scale == 0.0:
        # A reference that does not move is read as it is, and any error is too much.
        value = max(found.value, 0.0 if off == 0.0 else math.inf)
        return dataclasses.replace(found, value=value)
    low, high = max(off - doubt, 0.0) / scale, (off + doubt) / scale
    if not is_alone:
        low, high = max(low, found.value), max(high, found.value)
    value, uncertainty = _middle(low, high)
    return dataclasses.replace(found, value=value, uncertainty=uncertainty)


@lru_cache(maxsize=2)
def _own_pair(problem: Problem, candidate: State, own: OwnMesh, reference: State) -> Pair:
    """The pair at the last state; the last ones are cached, for all metrics of them."""
    read = read_between(problem.mesh, reference.displacement, reference.degree, own.mesh)
    return Pair(problem, own.mesh, own.displacements[-1], read, candidate, reference, is_own=True)


def displacement_l2(pair: Pair) -> Measured:
    """L2 norm of the error over the mesh, and of the reading's doubt [m^2.5]."""
    return l2_norm(pair.mesh, pair.error), l2_norm(pair.mesh, pair.read.doubt[:, None])


def l2_of(problem: Problem, state: State) -> tuple[float, str]:
    """L2 norm of the displacement over the rest volume [m^2.5]."""
    return l2_norm(problem.mesh, state.displacement), ""


def gradient_norm(problem: Problem, displacement: Points) -> float:
    """H1 seminorm: L2 norm of the displacement gradient over the rest volume [m^1.5]."""
    mesh = problem.mesh
    gradients = displacement[mesh.cells].transpose(0, 2, 1) @ shape_gradients(mesh)
    squared = np.einsum("cij,cij->c", gradients, gradients)
    return math.sqrt(float(signed_volumes(mesh.points, mesh.cells) @ squared))


def energy_norm(problem: Problem, displacement: Points) -> float:
    """Strain weighted by stiffness, in linear elasticity [J^(1/2)]."""
    return math.sqrt(2.0 * body_of(problem, Strain.LINEAR).energy(displacement))


def error_in(norm: Norm) -> ErrorOf:
    """Norm of the error, and of what a linear reading of the reference would not have."""

    def error(pair: Pair) -> Measured:
        doubt = norm(pair.problem, pair.read.added) if pair.is_own else 0.0
        return norm(pair.problem, pair.error), doubt

    return error


def size_in(norm: Norm) -> ScaleOf:
    """Norm of a state's displacement."""

    def scale(problem: Problem, state: State) -> tuple[float, str]:
        return norm(problem, state.displacement), ""

    return scale


def displacement_max(pair: Pair) -> Measured:
    """Largest error of a point [m]."""
    error, doubt = _lengths(pair.error), pair.read.doubt
    return _middle(float((error - doubt).max()), float((error + doubt).max()))


def largest_displacement_of(_problem: Problem, state: State) -> tuple[float, str]:
    """Largest displacement of a point [m]."""
    return state.max_displacement, ""


def max_displacement(pair: Pair) -> Measured:
    """Error of the largest displacement [m], of a point of the case or of the own mesh."""
    if not pair.is_own:
        return abs(pair.candidate.max_displacement - pair.reference.max_displacement), 0.0
    read, doubt = _lengths(pair.read.value), pair.read.doubt
    known = pair.reference.max_displacement
    low, high = (max(known, float((read + sign * doubt).max())) for sign in (-1.0, 1.0))
    middle, off = _middle(low, high)
    found = max(float(_lengths(u).max()) for u in (pair.displacement, pair.candidate.displacement))
    return abs(found - middle), off


def size_error(name: str) -> ErrorOf:
    """Error of the volume [m3] or surface area [m2]; another size at rest leaves it open."""

    def error(pair: Pair) -> Measured:
        rest, own = (float(getattr(mesh, name)) for mesh in (pair.case.mesh, pair.mesh))
        found, expected = (getattr(state, name) for state in (pair.candidate, pair.reference))
        return abs(found - expected), abs(own / rest - 1.0) * abs(found - rest)

    return error


def change_of(name: str) -> ScaleOf:
    """Change of the volume or area: one per cent of the rest value would pass almost anything."""

    def scale(problem: Problem, state: State) -> tuple[float, str]:
        rest = float(getattr(problem.mesh, name))
        size = size_of_change(getattr(state, name), rest)
        is_small = size == SMALLEST_CHANGE * rest
        return size, f"0.1 % of the rest {name.removeprefix('surface_')}" if is_small else ""

    return scale


def local_volume(pair: Pair) -> Measured:
    """Root mean square error of det F over the cells, by rest volume [-].

    Total volume can be right where half of the body is swollen and half is squeezed.
    """
    mesh, read = pair.mesh, pair.read
    theirs = det_f(mesh, read.value)
    error = _mean_square(mesh, theirs - det_f(mesh, pair.displacement))
    if not pair.is_own:
        return error, 0.0
    return error, _mean_square(mesh, theirs - det_f(mesh, read.value - read.added))


def local_change_of(problem: Problem, state: State) -> tuple[float, str]:
    """Root mean square of det F - 1 [-]."""
    change = _mean_square(problem.mesh, det_f(problem.mesh, state.displacement) - 1.0)
    if change < SMALLEST_CHANGE:
        return SMALLEST_CHANGE, "0.1 % of the rest volume"
    return change, ""


def _mean_square(mesh: TetMesh, values: Floats) -> float:
    rest = signed_volumes(mesh.points, mesh.cells)
    return math.sqrt(float(rest @ values**2 / rest.sum()))


def surface_hausdorff(pair: Pair) -> Measured:
    """Hausdorff distance of the deformed surfaces [m].

    What one sees and touches: sliding along the surface does not count.
    """
    doubt = pair.read.doubt[np.unique(pair.mesh.boundary_facets)]
    return _distances_of(pair)[0], float(doubt.max())


def surface_mean_distance(pair: Pair) -> Measured:
    """Mean distance of the same two [m]."""
    if not pair.is_own:
        return _distances_of(pair)[1], 0.0
    areas = np.linalg.norm(pair.mesh.surface().area_vectors, axis=1)
    doubt = pair.read.doubt[pair.mesh.boundary_facets].mean(axis=1)
    return _distances_of(pair)[1], float(np.average(doubt, weights=areas))


def _distances_of(pair: Pair) -> Measured:
    """Hausdorff and mean distance.

    The same facets on both sides: chords of a curved body at rest do not count.
    """
    return _distances(pair.mesh, pair.candidate, pair.reference, pair if pair.is_own else None)


@lru_cache(maxsize=2)
def _distances(mesh: TetMesh, candidate: State, reference: State, own: Pair | None) -> Measured:
    facets = mesh.boundary_facets
    fields = (candidate.displacement, reference.displacement)
    moved = [
        mesh.points + u for u in (fields if own is None else (own.displacement, own.read.value))
    ]
    return surface_distances(moved[0], facets, moved[1], facets)


def surface_distances(
    points: Points, facets: Indices, other_points: Points, other_facets: Indices
) -> tuple[float, float]:
    """Hausdorff and mean distance of two triangulated surfaces [m].

    Sampled at vertices, edge midpoints and centroids of every facet, each against the other
    surface's nearest facet, both ways. The sampled maximum is a lower bound of the Hausdorff
    distance; on flat facets it misses it by less than half the sampling distance. Both are the
    larger (mean: the average) of the two directions; the mean is by facet area.
    """
    farthest, means = [], []
    pairs = (
        (points, facets, other_points, other_facets),
        (other_points, other_facets, points, facets),
    )
    for pair in pairs:
        from_points, from_facets, to_points, to_facets = pair
        chosen = from_facets[:: _stride(pair)]
        samples = _samples(from_points[chosen])
        positions, first, index = np.unique(
            samples.reshape(-1, 3), axis=0, return_index=True, return_inverse=True
        )
        within = None
        if from_facets is to_facets and len(from_points) == len(to_points):
            # In two states of one body, a point's own position in the other state is near already.
            there = _samples(to_points[chosen]).reshape(-1, 3)[first]
            within = np.linalg.norm(positions - there, axis=1)
        distances = nearest_on_surface(positions, to_points, to_facets, within).distances
        farthest.append(largest(distances))
        by_facet = distances[index.reshape(samples.shape[:2])]
        areas = facet_areas(from_points, chosen)
        # Corners 1/20 each, midpoints 2/15, centroid 9/20: exact for cubics on a triangle.
        weights = np.array([0.05] * 3 + [2.0 / 15.0] * 3 + [0.45])
        means.append(float(areas @ (by_facet @ weights) / areas.sum()))
    return largest(farthest), sum(means) / 2.0


def _samples(corners: Array) -> Array:
    """Corners, edge midpoints and centroid of triangles (n, 3, 3): (n, 7, 3)."""
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    return np.concatenate([corners, middles, corners.mean(axis=1)[:, None]], axis=1)


def _stride(pair: tuple[Points, Indices, Points, Indices]) -> int:
    """Every how many facets are sampled: all, but towards facets torn much larger than they are.

    Each position is then near to very many of them, and a few show that the surfaces are apart.
    """
    sizes = [
        float(np.ptp(points[facets], axis=1).max(axis=1).mean())
        for points, facets in (pair[:2], pair[2:])
    ]
    torn = (sizes[1] / (_TORN * sizes[0])) ** 2 if sizes[0] > 0.0 else 1.0
    return int(min(max(torn, 1.0), max(len(pair[1]) / _FEWEST, 1.0)))


def strain_energy(pair: Pair) -> Measured:
    """Error of the strain energy by the case's law [J]."""
    body = body_of(pair.problem, pair.candidate.strain, pair.candidate.element)
    found = body.energy(pair.displacement)
    other = abs(pair.mesh.volume / pair.case.mesh.volume - 1.0)
    return abs(found - energy_of(pair.case, pair.reference)[0]), other * found


def energy_of(problem: Problem, state: State) -> tuple[float, str]:
    """Strain energy by the case's law [J]."""
    return body_of(problem, state.strain, state.element).energy(state.displacement), ""


def reaction_force(pair: Pair) -> Measured:
    """Largest error of a support's total force [N]."""
    case, ours, theirs = pair.case, pair.candidate, pair.reference
    if pair.is_own:
        return own_reactions(case, pair.problem, pair.displacement, ours, theirs)
    error = _reactions(case, ours) - _reactions(case, theirs)
    return float(np.linalg.norm(error, axis=1).max(initial=0.0)), 0.0


def largest_reaction_of(problem: Problem, state: State) -> tuple[float, str]:
    """Largest total force of a support [N]."""
    return float(np.linalg.norm(_reactions(problem, state), axis=1).max(initial=0.0)), ""


def _reactions(problem: Problem, state: State) -> Floats:
    """Total force of each support [N], (num_supports, 3)."""
    return body_of(problem, state.strain, state.element).support_reactions(state.displacement)


def tool_force(pair: Pair) -> Measured:
    """Largest error of the force on a tool [N]: at the end of its path, or over time.

    In motion of its means from output to output: with rigid contact the force of a single step
    chatters. Infinite where a simulator does not report the force on each tool of the problem.
    """
    ours, theirs = pair.candidate.tool_forces, pair.reference.tool_forces
    if ours is None or theirs is None or ours.shape != theirs.shape or not len(theirs):
        return math.inf, 0.0
    return float(np.linalg.norm(ours - theirs, axis=-1).max()), 0.0


def largest_tool_force_of(_problem: Problem, state: State) -> tuple[float, str]:
    """Largest force on a tool [N]; NaN where there is none."""
    forces = state.tool_forces
    if forces is None or not len(forces):
        return math.nan, ""
    return float(np.linalg.norm(forces, axis=-1).max()), ""


def trajectory_l2(pair: Pair) -> Measured:
    """The largest L2 error of the reference's times, and what reading the result may be off by."""
    ours, theirs = pair.candidate.trajectory, pair.reference.trajectory
    if ours is None or theirs is None:
        raise InputError("metrics of motion need a case with [time]")
    if not pair.is_own:
        return largest(l2_norms(pair.mesh, ours.displacements - theirs.displacements)), 0.0
    own, sent = pair.candidate.own, pair.candidate.sent
    assert own is not None
    assert sent is not None
    slack = _SAME_TIME * float(theirs.times[-1])
    given = read_at(sent.times, own.displacements, theirs.times, slack=slack)
    found = []
    for displacement, state, other in zip(
        theirs.displacements, given.states, given.others, strict=True
    ):
        read = read_between(pair.case.mesh, displacement, pair.reference.degree, own.mesh)
        error, doubt = displacement_l2(dataclasses.replace(pair, displacement=state, read=read))
        doubt += l2_norm(own.mesh, state - other)
        found.append((max(error - doubt, 0.0), error + doubt))
    low, high = np.max(found, axis=0).tolist()
    return _middle(low, high)


def largest_l2_of(problem: Problem, state: State) -> tuple[float, str]:
    """Largest L2 norm of the displacement over time [m^2.5]."""
    if state.trajectory is None:
        raise InputError("metrics of motion need a case with [time]")
    return largest(l2_norms(problem.mesh, state.trajectory.displacements)), ""


def _middle(low: float, high: float) -> Measured:
    """A range as its middle and its half width; an endless one stays so."""
    if not math.isfinite(high):
        return (low, math.inf) if math.isfinite(low) else (math.inf, 0.0)
    return 0.5 * (low + high), 0.5 * (high - low)


def _lengths(field: Points) -> Points:
    length: Points = np.linalg.norm(field, axis=1)
    return length
