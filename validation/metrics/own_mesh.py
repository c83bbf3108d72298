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
from palpate.meshes.problem import Inclusion, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.point_location import locate
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.metrics.between_points import Reading, read_between
from palpate.validation.metrics.elasticity import strain_energy
from palpate.validation.metrics.fields import det_f, gradient_norm
from palpate.validation.metrics.own_reactions import own_reactions
from palpate.validation.metrics.pairs import Difference, l2_norm
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
        reference: Read at its points.
        strain: That the answer was asked for.
    """

    problem: Problem
    mesh: TetMesh
    displacement: Points
    reference: Reading
    strain: Strain

    @property
    def error(self) -> Points:
        """Answer less reference at the own points [m]."""
        return self.displacement - self.reference.value

    @property
    def own_problem(self) -> Problem:
        """The own mesh with the case's materials, without loads and supports."""
        if not self.problem.inclusions:
            return dataclasses.replace(self.problem, mesh=self.mesh, supports=(), loads=())
        case = self.problem.mesh
        middles = self.mesh.points[self.mesh.cells].mean(axis=1)
        held = locate(case.points, case.cells, middles).cells
        inclusions = tuple(
            Inclusion(np.flatnonzero(np.isin(held, part.cells)).astype(np.int32), part.material)
            for part in self.problem.inclusions
        )
        return dataclasses.replace(
            self.problem, mesh=self.mesh, supports=(), loads=(), inclusions=inclusions
        )


@lru_cache(maxsize=2)
def _pair(problem: Problem, candidate: State, own: OwnMesh, reference: State) -> OwnPair:
    """At the end; the last ones are remembered, for all metrics of them."""
    read = read_between(problem.mesh, reference.displacement, reference.degree, own.mesh)
    return OwnPair(problem, own.mesh, own.displacements[-1], read, candidate.strain)


# An error on the own mesh and what it may be off by, both in the metric's unit.
Measured = tuple[float, float]
Measure = Callable[[OwnPair, State, State], Measured]


def _displacement_l2(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    return own_l2(pair)


def own_l2(pair: OwnPair) -> Measured:
    """L2 norm of the error over the own mesh, and of the reading's doubt [m^2.5]."""
    return l2_norm(pair.mesh, pair.error), l2_norm(pair.mesh, pair.reference.doubt[:, None])


def _displacement_h1(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    return gradient_norm(pair.mesh, pair.error), gradient_norm(pair.mesh, pair.reference.added)


def _energy_norm(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    own = pair.own_problem
    error, doubt = (
        math.sqrt(2.0 * strain_energy(own, field, Strain.LINEAR))
        for field in (pair.error, pair.reference.added)
    )
    return error, doubt


def _displacement_max(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    error, doubt = _lengths(pair.error), pair.reference.doubt
    return _middle(float((error - doubt).max()), float((error + doubt).max()))


def _max_displacement(pair: OwnPair, candidate: State, reference: State) -> Measured:
    read, doubt = _lengths(pair.reference.value), pair.reference.doubt
    # The largest of the reference lies at a point of the case or at one of the own mesh.
    largest = reference.max_displacement
    low, high = (max(largest, float((read + sign * doubt).max())) for sign in (-1.0, 1.0))
    middle, off = _middle(low, high)
    found = max(float(_lengths(u).max()) for u in (pair.displacement, candidate.displacement))
    return abs(found - middle), off


def _local_volume(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    read = pair.reference
    rest = signed_volumes(pair.mesh.points, pair.mesh.cells)
    ours, theirs, plain = (
        det_f(pair.mesh, field)
        for field in (pair.displacement, read.value, read.value - read.added)
    )
    error, doubt = (
        math.sqrt(float(rest @ (theirs - others) ** 2 / rest.sum())) for others in (ours, plain)
    )
    return error, doubt


def _volume(pair: OwnPair, candidate: State, reference: State) -> Measured:
    rest = pair.problem.mesh.volume
    change = abs(candidate.volume - rest)
    other = abs(pair.mesh.volume / rest - 1.0)
    return abs(candidate.volume - reference.volume), other * change


def _surface_area(pair: OwnPair, candidate: State, reference: State) -> Measured:
    rest = pair.problem.mesh.surface_area
    change = abs(candidate.surface_area - rest)
    other = abs(pair.mesh.surface_area / rest - 1.0)
    return abs(candidate.surface_area - reference.surface_area), other * change


def _surface_hausdorff(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    doubt = pair.reference.doubt[np.unique(pair.mesh.boundary_facets)]
    return _surfaces(pair)[0], float(doubt.max())


def _surface_mean_distance(pair: OwnPair, _candidate: State, _reference: State) -> Measured:
    facets = pair.mesh.boundary_facets
    areas = pair.mesh.surface().area_vectors
    share = np.linalg.norm(areas, axis=1)
    doubt = pair.reference.doubt[facets].mean(axis=1)
    return _surfaces(pair)[1], float(share @ doubt / share.sum())


@lru_cache(maxsize=2)
def _surfaces(pair: OwnPair) -> Measured:
    """Hausdorff and mean distance of the own boundary as answered and as the reference moves it.

    The same facets on both sides: chords of a curved body at rest do not count.
    """
    facets = pair.mesh.boundary_facets
    moved = [pair.mesh.points + u for u in (pair.displacement, pair.reference.value)]
    return surface_distances(moved[0], facets, moved[1], facets)


def _strain_energy(pair: OwnPair, _candidate: State, reference: State) -> Measured:
    found = strain_energy(pair.own_problem, pair.displacement, pair.strain)
    expected = strain_energy(pair.problem, reference.displacement, reference.strain)
    other = abs(pair.mesh.volume / pair.problem.mesh.volume - 1.0)
    return abs(found - expected), other * found


def _reaction_force(pair: OwnPair, candidate: State, reference: State) -> Measured:
    return own_reactions(pair.problem, pair.own_problem, pair.displacement, candidate, reference)


def _trajectory_l2(pair: OwnPair, candidate: State, reference: State) -> Measured:
    """The worst of the reference's times, with what reading the answer there may be off by."""
    own, sent, theirs = candidate.own, candidate.sent, reference.trajectory
    assert own is not None
    assert sent is not None
    assert theirs is not None
    slack = _SAME_TIME * float(theirs.times[-1])
    ours = read_at(sent.times, own.displacements, theirs.times, slack=slack)
    found = []
    for displacement, state, other in zip(
        theirs.displacements, ours.states, ours.others, strict=True
    ):
        read = read_between(pair.problem.mesh, displacement, reference.degree, own.mesh)
        error, doubt = own_l2(OwnPair(pair.problem, own.mesh, state, read, pair.strain))
        doubt += l2_norm(own.mesh, state - other)
        found.append((max(error - doubt, 0.0), error + doubt))
    low, high = np.max(found, axis=0).tolist()
    return _middle(low, high)


# Metrics whose value is the worst of both meshes.
_ON_BOTH: dict[str, Measure] = {
    "displacement_l2": _displacement_l2,
    "displacement_h1": _displacement_h1,
    "energy_norm": _energy_norm,
    "displacement_max": _displacement_max,
    "max_displacement": _max_displacement,
    "local_volume": _local_volume,
    "surface_hausdorff": _surface_hausdorff,
    "surface_mean_distance": _surface_mean_distance,
    "trajectory_l2": _trajectory_l2,
}
# Metrics that the own mesh alone answers.
_ON_OWN: dict[str, Measure] = {
    "volume": _volume,
    "surface_area": _surface_area,
    "strain_energy": _strain_energy,
    "reaction_force": _reaction_force,
}
MEASURED_ON_OWN_MESH = frozenset({*_ON_BOTH, *_ON_OWN})


def measure_on_own_mesh(
    name: str, at_points: Difference, problem: Problem, candidate: State, reference: State
) -> Difference:
    """A metric of an answer with a mesh of its own.

    Args:
        name: Of the metric.
        at_points: What it is at the case's points.
        problem: The case's.
        candidate: With `own`.
        reference: At the case's points.

    Returns:
        As it was where the metric does not depend on a mesh: a tool's force, a point's swing.
    """
    own = candidate.own
    measure = _ON_BOTH.get(name) or _ON_OWN.get(name)
    if own is None or measure is None:
        return at_points
    pair = _pair(problem, candidate, own, reference)
    error, doubt = measure(pair, candidate, reference)
    scale = at_points.scale
    if scale == 0.0:
        # A reference that does not move is read as it is, and any error is too much.
        value = max(at_points.value, 0.0 if error == 0.0 else math.inf)
        return dataclasses.replace(at_points, value=value)
    low, high = max(error - doubt, 0.0) / scale, (error + doubt) / scale
    if name in _ON_BOTH:
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
