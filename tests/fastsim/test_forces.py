"""Loads and mass on meshes, and what the core refuses."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import rotation

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.errors import CrowdedPointError
from palpate.fastsim.forces import external_force
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Traction,
)
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh

TISSUE = Material(1e4, 0.4, 1000.0)


def random_displacement(mesh: TetMesh, amplitude: float = 0.03, seed: int = 1) -> np.ndarray:
    return amplitude * np.random.default_rng(seed).standard_normal(mesh.points.shape)


def loaded(mesh: TetMesh, *loads: Load) -> Problem:
    return Problem(mesh, TISSUE, (), loads)


def test_every_load_gives_its_resultant(ragged_box: TetMesh) -> None:
    """Resultants: traction times area, force density times volume, the point forces."""
    top = ragged_box.boundary_facets[
        (ragged_box.points[ragged_box.boundary_facets][:, :, 2] > 1.2 - 1e-9).all(axis=1)
    ]
    traction = external_force(loaded(ragged_box, Traction(top, (1.0, -2.0, 3.0))))
    np.testing.assert_allclose(traction.sum(axis=0), np.array([1.0, -2.0, 3.0]) * 1.6, rtol=1e-13)
    body = external_force(loaded(ragged_box, BodyForce((0.0, 5.0, -9.0))))
    np.testing.assert_allclose(
        body.sum(axis=0), np.array([0.0, 5.0, -9.0]) * 1.6 * 1.2, rtol=0.0, atol=1e-12
    )
    twice = np.array([3, 3], dtype=np.int32)
    point = external_force(
        loaded(ragged_box, PointForce(twice, np.array([[1.0, 0, 0], [2, 0, 1]])))
    )
    np.testing.assert_array_equal(point[3], [3.0, 0.0, 1.0])
    assert np.count_nonzero(point) == 2


def test_pressure_pushes_inwards_and_follows_the_body(ragged_box: TetMesh) -> None:
    top = ragged_box.boundary_facets[
        (ragged_box.points[ragged_box.boundary_facets][:, :, 2] > 1.2 - 1e-9).all(axis=1)
    ]
    problem = loaded(ragged_box, Pressure(top, 7.0))
    # 7 Pa on 1.6 m2, downwards.
    rest = external_force(problem).sum(axis=0)
    np.testing.assert_allclose(rest, [0.0, 0.0, -11.2], rtol=0.0, atol=1e-12)
    R = rotation(0.9)
    turned = external_force(problem, ragged_box.points @ (R - np.eye(3)).T).sum(axis=0)
    np.testing.assert_allclose(turned, R @ rest, rtol=0.0, atol=1e-12)
    everywhere = loaded(ragged_box, Pressure(ragged_box.boundary_facets, 7.0))
    closed = external_force(everywhere, random_displacement(ragged_box)).sum(axis=0)
    np.testing.assert_allclose(closed, 0.0, rtol=0.0, atol=1e-12)


def test_lumped_mass_sums_to_the_mass(ragged_box: TetMesh) -> None:
    mass = Body(ragged_box, TISSUE).lumped_mass
    assert mass.min() > 0.0
    assert mass.sum() == pytest.approx(1000.0 * 1.6 * 1.2, rel=1e-13)


@pytest.mark.parametrize("bad", [np.zeros((4, 3)), np.zeros(12)])
def test_wrong_shape_is_refused(ragged_box: TetMesh, bad: np.ndarray) -> None:
    with pytest.raises(InputError, match="displacement has shape"):
        Body(ragged_box, TISSUE).internal_force(bad)


def test_nan_is_refused_with_its_point(ragged_box: TetMesh) -> None:
    u = np.zeros_like(ragged_box.points)
    u[5, 1] = np.nan
    with pytest.raises(InputError, match="point 5"):
        Body(ragged_box, TISSUE).internal_force(u)


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_the_core_takes_no_other_type_silently(ragged_box: TetMesh, kind: type) -> None:
    u = np.zeros(ragged_box.points.shape, dtype=kind)
    with pytest.raises(TypeError):
        Body(ragged_box, TISSUE).core.internal_force(u)
    cells = ragged_box.cells.astype(np.int64)
    lame, number = np.ones((1, 3)), np.zeros(len(cells), dtype=np.int32)
    rest = (
        lame,
        number,
        _core.StrainMeasure.green,
        "saint_venant_kirchhoff",
        _core.Element.linear,
    )
    _core.ElasticBody(ragged_box.points, ragged_box.cells, *rest)
    with pytest.raises(TypeError):
        _core.ElasticBody(ragged_box.points, cells, *rest)


def test_a_point_with_too_many_neighbours_is_named() -> None:
    """Cells around an axis, like the segments of an orange; neighbours are counted in 16 bits."""
    count = 65_536
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle), 0.5 + 0.0 * angle], axis=1)
    points = np.vstack([np.zeros(3), [[0.0, 0.0, 1.0]], ring])
    k = np.arange(count)
    cells = np.stack([0 * k, 2 + k, 2 + (k + 1) % count, 0 * k + 1], axis=1)
    body = Body(TetMesh(points, cells), TISSUE)
    with pytest.raises(CrowdedPointError, match="point 0 ") as caught:
        body.core.assemble_tangent(np.zeros_like(points))
    assert caught.value.point == 0
