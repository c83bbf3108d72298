"""Problems in another form: loads multiplied; the rest is tried by the metamorphic relations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.problem import Material, Problem
from palpate.meshes.transforms import scale_loads


def test_every_kind_of_load_is_multiplied_and_nothing_else():
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    top = side(mesh, 2, 1.0)
    loads = (
        BodyForce((1.0, 0.0, -2.0)),
        Traction(top, (0.0, 3.0, 0.0)),
        Pressure(top, 5.0),
        PointForce(np.array([7], dtype=np.int32), np.array([[0.0, 0.0, 7.0]])),
    )
    foot = held(side(mesh, 2, 0.0), displacement=(0.1, 0.0, 0.0))
    problem = Problem(mesh, Material(1.0, 0.3), (foot,), loads)
    body, traction, pressure, point = scale_loads(problem, 0.5).loads
    assert body.force_density == (0.5, 0.0, -1.0)  # type: ignore[union-attr]
    assert traction.traction == (0.0, 1.5, 0.0)  # type: ignore[union-attr]
    assert pressure.pressure == pytest.approx(2.5)  # type: ignore[union-attr]
    assert point.forces.tolist() == [[0.0, 0.0, 3.5]]  # type: ignore[union-attr]
    scaled = scale_loads(problem, 0.5)
    assert dataclasses.replace(scaled, loads=loads).supports == problem.supports
    assert scaled.material == problem.material
