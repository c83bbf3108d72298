"""Two elastic bodies pressed together, against Hertz.

A ball's cap of radius R and a flat block of the same material, quarters of 200 contact radii, E and
nu: with the approach d of their far ends (K. L. Johnson, Contact Mechanics, 1985, section 4.2)

    F = 4/3 E* R^(1/2) d^(3/2),   1 / E* = 2 (1 - nu^2) / E

How far it may be off: with two edges to a contact radius a vertex of either body finds the other by
chance, and 8 % of the force are missing; the order is the second in the edge, which leaves 3.6 %
with three and 2 % with four. Bodies of 200 contact radii have 0.8 % more than half spaces
(`tests/validation/references/test_half_space.py`), a penalty three times as stiff 0.6 % more.

Explicit steps come to rest in a few thousand, as points on the surface have the same mass for
their area: what a body at rest weighs makes no difference.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import refine_to_size
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.bricks import rollers, side, support_of
from palpate.meshes.material_law import Inclusion
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.studies.grading import contact_radius, quarter_cube

RADIUS, APPROACH = 0.01, 1e-4  # [m]
E, NU = 5000.0, 0.3
CONTACT = contact_radius(APPROACH, RADIUS)
WIDTH = 200.0 * CONTACT
HERTZ = 4.0 / 3.0 * E / (2.0 * (1.0 - NU**2)) * np.sqrt(RADIUS) * APPROACH**1.5
# Penalty over the stiffness of a layer of the smallest cells; steps until the bodies rest, and the
# period of the slowest motion that is damped [steps].
LAYERS, STEPS, PERIOD = 10.0, 12_000, 4000


def block(edge: float, width: float) -> TetMesh:
    """A quarter block below z = 0 with such edges [m] near the origin."""
    graded = GradedMesh(quarter_cube(width))

    def size(places: Points) -> Floats:
        away = np.linalg.norm(places, axis=1) - 1.5 * CONTACT
        found: Floats = np.maximum(edge, edge + 0.5 * away)
        return found

    refine_to_size(graded, size, max_cells=100_000)
    return TetMesh(np.array(graded.mesh.points), np.array(graded.mesh.cells))


def ball_on_block(edge: float) -> TetMesh:
    """Both bodies, the block first; their surfaces do not share positions."""
    low, high = block(edge, WIDTH), block(edge / 1.07, 1.03 * WIDTH)
    points = high.points * [1.0, 1.0, -1.0]
    away = np.hypot(points[:, 0], points[:, 1])
    # A paraboloid over five contact radii, farther out level: what does not touch may be so.
    near = np.minimum(away, 0.5 * RADIUS)
    cap = near**2 / (2.0 * RADIUS) + 0.5 * RADIUS * (1.0 - np.exp(-(away - near) / RADIUS))
    points[:, 2] += cap * (1.0 - points[:, 2] / points[:, 2].max())
    cells = np.vstack([low.cells, high.cells[:, [0, 2, 1, 3]] + low.num_points])
    return TetMesh(np.vstack([low.points, points]), cells.astype(np.int32))


def pressed(edge: float) -> tuple[Problem, ContactLaw]:
    """The bodies with densities that go as 1 / edge, moved towards each other by the approach."""
    mesh = ball_on_block(edge)
    heights = mesh.points[:, 2]
    level = (False, False, True)
    bottom, top = (side(mesh, 2, float(z)) for z in (heights.min(), heights.max()))
    supports = (
        *rollers(mesh, ((0, 0.0), (1, 0.0))),
        support_of(bottom, level),
        support_of(top, level, (0.0, 0.0, -APPROACH)),
    )
    sizes = np.cbrt(signed_volumes(mesh.points, mesh.cells))
    halves = np.round(2.0 * np.log2(sizes.max() / sizes)).astype(np.int32)
    heavier = tuple(
        Inclusion(np.flatnonzero(halves == k).astype(np.int32), Material(E, NU, 2.0 ** (0.5 * k)))
        for k in np.unique(halves).tolist()
        if k
    )
    span = TimeSpan(1.0, num_outputs=1)
    problem = Problem(mesh, Material(E, NU, 1.0), supports, (), span, inclusions=heavier)
    law = ContactLaw(ContactForm.PENALTY, LAYERS * E / edge)
    body = ExplicitBody(problem, strain=Strain.LINEAR, body_contact=law)
    step = 0.9 * body.critical_time_step
    span = TimeSpan(STEPS * step, step, mass_damping=4.0 * np.pi / (PERIOD * step), num_outputs=4)
    return dataclasses.replace(problem, time=span), law


@pytest.mark.nightly
@pytest.mark.parametrize(("edges", "off"), [(3, 0.036), (4, 0.02)])
def test_an_elastic_ball_on_an_elastic_block_is_hertzs(edges: int, off: float) -> None:
    problem, law = pressed(CONTACT / edges)
    assert problem.time is not None
    found = simulate(
        problem,
        strain=Strain.LINEAR,
        body_contact=law,
        support_amplitude=smooth_ramp(0.5 * problem.time.end_time),
    )
    inside = Body.of(problem, Strain.LINEAR).internal_force(found.displacements[-1])
    low, high = (inside[support.points, 2].sum() for support in problem.supports[2:])
    # At rest, both ends carry the same.
    assert high == pytest.approx(-low, rel=5e-3)
    assert 4.0 * abs(low) == pytest.approx(HERTZ, rel=off)
