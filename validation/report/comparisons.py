"""Which candidate is shown beside which reference, and the first direction of view."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Strain
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.plots import BLUE, GREEN, OCHRE, PURPLE, RED
from palpate.validation.states import State

STRAIN_NAMES = {Strain.LINEAR: "linear strain", Strain.GREEN: "Green strain"}
# Colours of candidates: linear tetrahedra are red, smoothed ones blue, as in the studies.
_BESIDE = (RED, BLUE, PURPLE, GREEN, OCHRE)
# Smallest upper end of a scale of errors, as a fraction of the body's diagonal.
_LEAST_TOP = 1e-8


@dataclass(frozen=True, eq=False)
class Comparison:
    """Candidates and what they are compared with.

    Attributes:
        strain: Strain measure of all of them.
        pairs: Each candidate's and its reference's number among the states of the result.
        is_truth: Whether the reference has elements of a higher degree, and serves all candidates;
            otherwise each candidate has the reference of its own tetrahedra on the same mesh.
    """

    strain: Strain
    pairs: tuple[tuple[int, int], ...]
    is_truth: bool

    @property
    def references(self) -> list[int]:
        """Numbers of the references, each once."""
        return list(dict.fromkeys(reference for _, reference in self.pairs))

    def name(self, states: Sequence[State]) -> str:
        """The name of the comparison in a list to choose from."""
        strain = STRAIN_NAMES[self.strain]
        parts = [(states[one].label, states[other].label) for one, other in self.pairs]
        if len(parts) == 1:
            return f"{parts[0][0]}, {strain} with {parts[0][1]}"
        if self.is_truth:
            return f"{strain}: {' and '.join(one for one, _ in parts)} with {parts[0][1]}"
        return f"{strain}: " + ", ".join(f"{one} with {other}" for one, other in parts)


def comparisons_of(result: CaseResult) -> list[Comparison]:
    """Every candidate beside its own reference on the same mesh, and beside each truth.

    A truth comes first, that of Green strain if there is one; then Green strain before linear.
    """
    states = result.states
    found: dict[tuple[Strain, str], list[tuple[int, int]]] = {}
    for other, reference in enumerate(states):
        if not reference.is_reference:
            continue
        is_truth = reference.degree > 1
        against = reference.label if is_truth else ""
        for one, candidate in enumerate(states):
            if (
                not candidate.is_reference
                and candidate.strain is reference.strain
                and (is_truth or candidate.element is reference.element)
                and candidate.displacements.shape == reference.displacements.shape
            ):
                found.setdefault((candidate.strain, against), []).append((one, other))
    compared = [
        Comparison(strain, tuple(sorted(pairs)), bool(against))
        for (strain, against), pairs in found.items()
    ]
    # The finer truth has the longer name, and comes first.
    compared.sort(
        key=lambda pairs: (
            pairs.strain is not Strain.GREEN,
            not pairs.is_truth,
            -len(states[pairs.references[0]].label),
        ),
    )
    first = next((pairs for pairs in compared if pairs.is_truth), None)
    return sorted(compared, key=lambda pairs: pairs is not first)


def error_top(result: CaseResult, largest: float) -> float:
    """The upper end of a scale of errors, in the unit of the largest, >= 1e-8 of the body's size.

    Below that, rounding errors would be painted like wrong solutions.
    """
    size = float(np.linalg.norm(np.ptp(result.problem.mesh.points, axis=0)))
    return max(largest, _LEAST_TOP * size)


def colours_of(result: CaseResult) -> dict[str, str]:
    """A colour for each candidate, by its label."""
    labels = list(dict.fromkeys(s.label for s in result.states if not s.is_reference))
    if len(labels) == 1:
        return {labels[0]: BLUE}
    return {label: _BESIDE[k % len(_BESIDE)] for k, label in enumerate(labels)}


# Elevation and azimuth of the eye [degrees], none along an axis of the case.
_PITCHES = (18.0, 35.0, -18.0)
_YAWS = tuple(range(-160, 180, 20))
_AXES_APART = 10
# Distance in front of the largest error, and beside it, that counts, as fractions of the size.
_BEFORE, _NEXT_TO = 0.03, 0.04
# A view from below has to score this much more.
_BELOW = 0.25


def first_eye(result: CaseResult) -> tuple[float, float]:
    """Azimuth and elevation of the first view of a case [rad], on pages and in pictures."""
    mesh, compared = result.problem.mesh, comparisons_of(result)
    moved = [state.displacements for state in result.states]
    # The largest error at each point, of all compared pairs and all times.
    seen = np.zeros(mesh.num_points)
    for one, other in compared[0].pairs if compared else ():
        seen = np.maximum(seen, np.linalg.norm(moved[one] - moved[other], axis=2).max(axis=0))
    first = result.states[0] if result.states else None
    shown = mesh.points + (first.displacement if first else 0.0)
    return choose_camera(shown, mesh.boundary_facets, seen)


def choose_camera(points: Points, facets: Indices, errors: Floats) -> tuple[float, float]:
    """Azimuth and elevation of the eye [rad]: at 0 and 0 it looks along y, from below 0, z up.

    Every direction of a grid is scored by how much of the error it shows, whether the largest error
    faces it and is not hidden, and how broad the body looks from there (facets are oriented
    outwards); the best one is returned. Where all errors (n,) are zero, only the breadth counts.
    """
    areas = area_vectors(points, facets)
    size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    weights = errors[facets].mean(axis=1)
    worst = int(np.argmax(errors))
    normal = areas[(facets == worst).any(axis=1)].sum(axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0.0 else normal
    total = float(weights @ np.linalg.norm(areas, axis=1)) or 1.0
    breadth = float(np.linalg.norm(areas, axis=1).sum()) / 4.0 or 1.0

    def marks(yaw: float, pitch: float) -> float:
        eye = way_to_eye(yaw, pitch)
        faces = np.maximum(areas @ eye, 0.0)
        apart = points - points[worst]
        depth = apart @ eye
        beside = np.linalg.norm(apart - depth[:, None] * eye, axis=1)
        is_hidden = bool(((depth > _BEFORE * size) & (beside < _NEXT_TO * size)).any())
        seen = float(weights @ faces) / total
        facing = float(min(normal @ eye, 0.7)) - is_hidden if errors.any() else 0.0
        return seen + facing + 0.6 * float(faces.sum()) / breadth - _BELOW * (pitch < 0.0)

    pairs = [
        (math.radians(yaw + _AXES_APART * (yaw % 90 == 0)), math.radians(pitch))
        for yaw, pitch in itertools.product(_YAWS, _PITCHES)
    ]
    return max(pairs, key=lambda pair: marks(*pair))


def way_to_eye(yaw: float, pitch: float) -> Points:
    """Unit vector from the body to the eye, (3,)."""
    level = math.cos(pitch)
    return np.array([level * math.sin(yaw), -level * math.cos(yaw), math.sin(pitch)])
