"""Columns that buckle: an equilibrium that is not stable is no truth."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Pressure, Support, Traction
from palpate.meshes.problem import Material, Problem
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

E = 3000.0


def support(mesh, face, components=(True, True, True)):
    facets = mesh.facet_groups[face]
    return Support(np.unique(facets).astype(np.int32), facets, components)


def test_a_straight_column_ends_at_eulers_load(box):
    # Clamped-free: P = pi^2 E I / (4 L^2); nothing bends it, so only stability tells.
    mesh = box((10, 1, 1), (1.0, 0.1, 0.1))
    euler = np.pi**2 * E * 0.1**4 / 12 / 4
    loads = (Traction(mesh.facet_groups["x1"], (-2.0 * euler / 0.01, 0.0, 0.0)),)
    problem = Problem(mesh, Material(E, 0.0), (support(mesh, "x0"),), loads)
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(problem, degree=2)
    # 2 %: shear and shortening, (h / L)^2 each, and the coarse mesh.
    assert 2.0 * caught.value.load_factor == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("kind", ["pushed by the pressure", "beside a small one"])
def test_follower_pressure_does_not_hide_that_a_column_buckles(box, kind):
    mesh = box((10, 1, 1), (1.0, 0.1, 0.1))
    if kind == "pushed by the pressure":
        # The top may slide and turn, so that the pressure has a potential: 20.19 E I / L^2.
        critical = 20.19 * E * 0.1**4 / 12
        supports = (support(mesh, "x0"), support(mesh, "x1", (False, True, True)))
        loads = (Pressure(mesh.facet_groups["x1"], 2.0 * critical / 0.01),)
    else:
        critical = np.pi**2 * E * 0.1**4 / 12 / 4
        supports = (support(mesh, "x0"),)
        loads = (
            Traction(mesh.facet_groups["x1"], (-2.0 * critical / 0.01, 0.0, 0.0)),
            Pressure(mesh.facet_groups["y1"], 1e-9 * E),
        )
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(Problem(mesh, Material(E, 0.0), supports, loads), degree=2)
    # Shear and shortening, some (pi h / l)^2 of the half wave l, which is 0.7 L where it is short.
    assert 2.0 * caught.value.load_factor == pytest.approx(1.0, rel=0.08)
