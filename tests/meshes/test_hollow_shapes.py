"""Hollow shapes: closed, oriented outwards, of the right volume, and filled by the mesher."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_hollow_octant, shape_hollow_sphere, shape_tube
from palpate.meshes.tri_surface import TriSurface

BALL = 4.0 / 3.0 * math.pi * (1.0 - 0.5**3)
SHAPES = {
    "hollow sphere": (shape_hollow_sphere, (1.0, 0.5), BALL),
    "octant": (shape_hollow_octant, (1.0, 0.5), BALL / 8.0),
    "tube": (shape_tube, (1.0, 0.5, 0.8), math.pi * (1.0 - 0.25) * 0.8),
}


def enclosed(surface: TriSurface) -> float:
    a, b, c = (surface.points[surface.facets[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6.0)


@pytest.mark.parametrize("name", SHAPES)
def test_each_is_closed_and_nears_its_volume_at_second_order(name):
    make, sizes, volume = SHAPES[name]
    errors = []
    for h in (0.2, 0.1):
        surface = make(*sizes, edge_length=h)
        pairs = surface.facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        # Every edge once in each direction.
        assert len(np.unique(pairs, axis=0)) == len(pairs)
        assert {tuple(p) for p in pairs.tolist()} == {tuple(p[::-1]) for p in pairs.tolist()}
        errors.append(1.0 - enclosed(surface) / volume)
    assert 0.0 < errors[1] < 0.3 * errors[0] < 0.03


@pytest.mark.parametrize("name", SHAPES)
def test_our_mesher_fills_each_and_leaves_the_hollow_empty(name):
    make, sizes, _ = SHAPES[name]
    surface = make(*sizes, edge_length=0.25)
    mesh = mesh_surface(surface)
    mesh = getattr(mesh, "mesh", mesh)
    assert mesh.volume == pytest.approx(enclosed(surface), rel=1e-12)


def test_bodies_without_a_wall_are_refused():
    for make, sizes, _ in SHAPES.values():
        with pytest.raises(InputError, match="no wall"):
            make(1.0, 1.0, *sizes[2:], edge_length=0.2)
        with pytest.raises(InputError, match="above 0"):
            make(1.0, 0.0, *sizes[2:], edge_length=0.2)
