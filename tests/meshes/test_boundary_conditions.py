"""A support names all that it holds, however it is given."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import IndexRangeError
from palpate.meshes.problem import Material, Problem
from palpate.validation.exchange.nodal_arrays import fixed_components
from palpate.validation.metrics.audit import audit_on_own_mesh


def test_the_corners_of_held_facets_are_held_points() -> None:
    facets = np.array([[4, 2, 7], [2, 4, 9]])
    assert Support([], facets).points.tolist() == [2, 4, 7, 9]  # type: ignore[arg-type]
    assert Support(np.array([5, 2]), facets).points.tolist() == [2, 4, 5, 7, 9]
    # What is complete stays as it was given: the key of a problem depends on it.
    given = np.array([9, 7, 4, 2], dtype=np.int32)
    assert Support(given, facets).points is given
    assert Support(given).points is given


def test_whoever_reads_a_problem_sees_points_that_only_facets_name() -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    held = facets[(mesh.points[facets][:, :, 0] == 0.0).all(axis=1)]
    loads = (BodyForce((0.0, 0.0, -50.0)),)
    problem = Problem(mesh, Material(1e4, 0.3), (Support((), held),), loads)  # type: ignore[arg-type]
    found = solve_static(problem)
    assert (
        np.flatnonzero(fixed_components(problem)[0].all(axis=1)).tolist()
        == np.unique(held).tolist()
    )
    audit = audit_on_own_mesh(problem, found.displacement, found.strain)
    assert audit.relative_residual_norm < 1e-8


@pytest.mark.parametrize(
    ("supports", "loads", "words"),
    [
        ((Support([5000]),), (), "points of support 1"),  # type: ignore[arg-type]
        ((Support([0], [[0, 1, -2]]),), (), "points of support 1"),  # type: ignore[arg-type]
        ((), (BodyForce((0.0, 0.0, 1.0)), Traction([[0, 1, 99]], (1.0, 0.0, 0.0))), "load 2"),  # type: ignore[arg-type]
        ((), (Pressure([[0, -1, 2]], 1.0),), "facets of load 1"),  # type: ignore[arg-type]
        ((), (PointForce([12], [[0.0, 0.0, 1.0]]),), "points of load 1"),  # type: ignore[arg-type]
    ],
)
def test_a_point_that_the_mesh_does_not_have_is_refused_by_the_problem(
    supports: tuple[Support, ...], loads: tuple[Load, ...], words: str
) -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))  # 12 points
    with pytest.raises(IndexRangeError, match=words):
        Problem(mesh, Material(1e4, 0.3), supports, loads)


def test_lists_of_points_and_facets_are_as_good_as_arrays() -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    held, pulled = (
        facets[(mesh.points[facets][:, :, 0] == x).all(axis=1)].tolist() for x in (0.0, 2.0)
    )
    load = Traction(pulled, (20.0, 0.0, 0.0))
    problem = Problem(mesh, Material(1e4, 0.3), (Support([], held),), (load,))  # type: ignore[arg-type]
    assert solve_static(problem).displacement[:, 0].max() > 0.0
    given = problem.loads[0]
    assert dataclasses.replace(problem).loads[0] is given
