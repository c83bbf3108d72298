"""Other equilibria of a truth past its critical load: its images that the case's symmetry allows.

A straight column past Euler's load bends to one side, and to the other just as well; which one a
solver finds is decided by rounding or a small imperfection. The truth's record says how far past
the first critical load it is. Its images are those by reflections, and by changes of equal sides,
of the box around the mesh, under which body, supports and loads are the same but for a few per
cent: a side force of 1e-6 is no reason to prefer a side.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.exchange.nodal_arrays import facet_areas, fixed_components
from palpate.validation.exchange.point_location import locate
from palpate.validation.metrics.body import dead_force
from palpate.validation.references.adaptive_truth import ADAPTIVE
from palpate.validation.states import State

# An image explains a distance that is at most this part of it from the image: on a coarse mesh a
# result is a few per cent from either branch, and the branches are about 1 apart or more.
EXPLAINED = 0.25
# Fraction of the body's size, of all forces, and of moments: what may differ between a body and its
# image, as by an unstructured mesh or an imperfection.
_ALIKE = 0.02


def load_over_critical(record: Any) -> float:
    """The load over the first critical one in a record that anybody may have written; 0 if none."""
    value = record.get("load_over_critical") if isinstance(record, Mapping) else None
    return float(value) if isinstance(value, int | float) else 0.0


def says_of_branches(provenance: Mapping[str, Any]) -> Iterator[str]:
    """A line for each strain measure whose truth is past its first critical load."""
    records = provenance.get(ADAPTIVE)
    for strain, record in records.items() if isinstance(records, Mapping) else ():
        share = load_over_critical(record)
        if share > 1.0:
            yield (
                f"Truth, {strain} strain: the load is {share:.3g} times the first critical one "
                "(linear buckling): it is one of several equilibria."
            )


def mirror_images(problem: Problem, state: State) -> Iterator[State]:
    """The images of a static state under which the problem is nearly the same, itself left out.

    They are read between the mesh's points, linearly; a point without an image in the body takes
    that of the nearest cell. None with tools, springs or a motion, of which this says nothing.
    """
    if problem.tools or problem.springs or state.trajectory is not None:
        return
    mesh = problem.mesh
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    centre, sides = (low + high) / 2.0, high - low
    for order in itertools.permutations(range(3)):
        if (np.abs(sides[list(order)] - sides) > _ALIKE * sides).any():
            continue
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.diag(signs) @ np.eye(3)[list(order)]
            if np.array_equal(turn, np.eye(3)) or not _is_alike(problem, turn, centre, sides):
                continue
            # The image at x is the turned displacement at the point that is turned to x.
            before = (mesh.points - centre) @ turn + centre
            moved = locate(mesh.points, mesh.cells, before).read(mesh.cells, state.displacement)
            yield dataclasses.replace(
                state,
                label=_name(order, signs),
                displacement=moved @ turn.T,
                stresses=None,
                integrals=None,
            )


def _name(order: tuple[int, ...], signs: tuple[float, ...]) -> str:
    axes = "".join("xyz"[k] for k in range(3) if signs[k] < 0.0)
    images = [f"mirror image along {' and '.join(axes)}"] if axes else []
    if order != (0, 1, 2):
        images.append(f"image with {', '.join('xyz'[k] for k in order)} for x, y, z")
    return ", ".join(images)


def _is_alike(problem: Problem, turn: Floats, centre: Floats, sides: Floats) -> bool:
    """Whether body, moduli, supports and loads have the moments of their images.

    In positions over half the sides of the box, so that a thin side counts as a long one does.
    """
    mesh = problem.mesh
    points = (mesh.points - centre) / (sides / 2.0)
    volumes = signed_volumes(mesh.points, mesh.cells)
    stiff = volumes.copy()
    for inclusion in problem.inclusions:
        stiff[inclusion.cells] *= (
            inclusion.material.youngs_modulus / problem.material.youngs_modulus
        )
    corners = points[mesh.cells]
    if not all(_is_same_body(corners, weights, turn) for weights in (volumes, stiff)):
        return False
    supports = [
        (support.directions.T @ support.directions, *_places(problem, support, points))
        for support in problem.supports
    ]
    whole = sum(weights.sum() for _, weights, _ in supports)
    held = sum((weights.sum() * along for along, weights, _ in supports), np.zeros((3, 3)))
    first = sum(
        (np.multiply.outer(weights @ x, along) for along, weights, x in supports),
        np.zeros((3, 3, 3)),
    )
    there = np.einsum("ai,bj,ck,ijk->abc", turn, turn, turn, first)
    gap = max(np.abs(turn @ held @ turn.T - held).max(), np.abs(there - first).max())
    if gap > _ALIKE * whole:
        return False
    moved = fixed_components(problem)[1]
    return all(_same_vectors(points, vectors, turn) for vectors in (dead_force(problem), moved))


def _places(problem: Problem, support: Support, points: Floats) -> tuple[Floats, Floats]:
    """Areas of a support's facets and their middles; of single points 1 cell's face each."""
    if len(support.facets):
        areas = facet_areas(problem.mesh.points, support.facets)
        return areas, points[support.facets].mean(axis=1)
    size = (problem.mesh.volume / problem.mesh.num_cells) ** (2.0 / 3.0)
    return np.full(len(support.points), size), points[support.points]


def _is_same_body(corners: Floats, weights: Floats, turn: Floats) -> bool:
    """First and second moments of tetrahedra of these weights; exact, 1/20 of sums of corners."""
    most = _ALIKE * float(np.abs(weights).sum())
    sums = corners.sum(axis=1)
    first = weights @ sums / 4.0
    second = np.einsum("c,cij,cik->jk", weights, corners, corners)
    second = (second + (weights[:, None] * sums).T @ sums) / 20.0
    is_first = np.abs(turn @ first - first).max() <= most
    return bool(is_first and np.abs(turn @ second @ turn.T - second).max() <= most)


def _same_vectors(x: Floats, vectors: Floats, turn: Floats) -> bool:
    most = _ALIKE * float(np.linalg.norm(vectors, axis=1).sum())
    whole, first = vectors.sum(axis=0), vectors.T @ x
    is_whole = np.abs(turn @ whole - whole).max() <= most
    return bool(is_whole and np.abs(turn @ first @ turn.T - first).max() <= most)
