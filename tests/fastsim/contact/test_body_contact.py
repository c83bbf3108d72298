"""Bodies that touch: force and energy, balances, nothing passes through, loud refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import overlap_depths
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_modes import parts_of_mesh
from palpate.meshes.tet_mesh import TetMesh

MakeBox = Callable[..., TetMesh]
SOFT = Material(1e4, 0.3, 1000.0)
PENALTY = ContactLaw(ContactForm.PENALTY)


def two_bodies(make_box: MakeBox, gap: float) -> TetMesh:
    """Two cubes above each other, a little aside, of different meshes."""
    low, high = make_box((4, 4, 4), (0.4, 0.4, 0.4)), make_box((5, 5, 5), (0.4, 0.4, 0.4))
    return TetMesh(
        np.vstack([low.points, high.points + np.array([0.03, 0.05, 0.4 + gap])]),
        np.vstack([low.cells, high.cells + low.num_points]).astype(np.int32),
    )


def folded_bar(make_box: MakeBox) -> TetMesh:
    """A bar folded once: two arms 0.05 m apart, joined at one end."""
    block = make_box((12, 4, 9), (0.6, 0.2, 0.45))
    middle = block.points[block.cells].mean(axis=1)
    slot = (middle[:, 0] > 0.15) & (middle[:, 2] > 0.2) & (middle[:, 2] < 0.25)
    cells = block.cells[~slot]
    used, numbered = np.unique(cells, return_inverse=True)
    return TetMesh(block.points[used], numbered.reshape(cells.shape).astype(np.int32))


def test_parts(make_box: MakeBox) -> None:
    labels = parts_of_mesh(two_bodies(make_box, 0.1))
    # The first point of the part that each point is of.
    part = np.unique(labels, return_index=True)[1][labels]
    assert np.array_equal(part, np.repeat([0, 125], [125, 216]))


def energy(mesh: TetMesh, displacement: Points, weight: Points) -> float:
    """Sum of k A d^2 / 2, by the detector and the rest surface."""
    vertices, depths = overlap_depths(mesh, displacement)
    return float(0.5 * np.sum(weight[vertices] * depths**2))


def test_depths_of_a_cube_in_a_cube(make_box: MakeBox) -> None:
    # The upper cube's bottom is 0.04 below the lower one's top, and aside by 0.03 and 0.05.
    mesh = two_bodies(make_box, -0.04)
    vertices, depths = overlap_depths(mesh, np.zeros_like(mesh.points))
    x, y, z = mesh.points[vertices].T
    upper = vertices >= 125
    sides = np.minimum.reduce([x, 0.4 - x, y, 0.4 - y, 0.4 - z])
    assert upper.sum() == 25
    assert np.abs(depths[upper] - sides[upper]).max() < 1e-15
    assert depths.max() == pytest.approx(0.04)


def test_the_force_is_minus_the_slope_of_the_energy(make_box: MakeBox) -> None:
    mesh = two_bodies(make_box, -0.04)
    problem = Problem(mesh, SOFT, (), (), TimeSpan(1.0))
    stiffness = 3e4
    law = ContactLaw(ContactForm.PENALTY, stiffness)
    body = ExplicitBody(problem, strain=Strain.LINEAR, time_step=1e-5, body_contact=law)
    body.set_state(2e-3 * np.random.default_rng(0).standard_normal(mesh.points.shape))
    body.step()
    u = body.displacement.copy()
    force = body.load()
    corners = mesh.points[mesh.boundary_facets]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    weight = np.zeros(mesh.num_points)
    for k in range(3):
        np.add.at(weight, mesh.boundary_facets[:, k], stiffness * area / 3.0)
    way = np.random.default_rng(1).standard_normal(u.shape)
    step = 1e-7
    slope = energy(mesh, u + step * way, weight) - energy(mesh, u - step * way, weight)
    slope /= 2.0 * step
    assert body.self_overlap()[0] > 5
    assert abs(slope) > 1.0
    assert float(np.sum(force * way)) == pytest.approx(-slope, rel=1e-5)
    eps = np.finfo(float).eps
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 16 * eps * size
    moment = np.cross(mesh.points + u, force).sum(axis=0)
    assert np.abs(moment).max() < 64 * eps * size


@pytest.mark.parametrize(("element", "fast"), [(Element.LINEAR, 1.0), (Element.SMOOTHED, 0.5)])
@pytest.mark.parametrize("num_threads", [1, 2])
@pytest.mark.parametrize("precision", list(Precision))
def test_two_bodies_bounce(
    make_box: MakeBox, precision: Precision, num_threads: int, element: Element, fast: float
) -> None:
    mesh = two_bodies(make_box, 0.01)
    speed = np.zeros_like(mesh.points)
    upper = parts_of_mesh(mesh) != 0
    speed[upper, 2] = -fast
    problem = Problem(mesh, SOFT, (), (), TimeSpan(0.4 / fast, num_outputs=20))
    run = simulate(
        problem,
        element=element,
        velocity=speed,
        body_contact=PENALTY,
        precision=precision,
        num_threads=num_threads,
        tracks_energy=True,
    )
    mass = Body(mesh, SOFT).lumped_mass[:, None]
    eps = 2.0**-23 if precision is Precision.SINGLE else 2.0**-52
    momentum = (mass * (run.velocity - speed)).sum(axis=0)
    assert np.abs(momentum).max() < run.num_steps * eps * 64.0
    positions = mesh.points + run.displacements[-1]
    moment = np.cross(positions, mass * run.velocity) - np.cross(mesh.points, mass * speed)
    assert np.abs(moment.sum(axis=0)).max() < 10 * run.num_steps * eps * 16.0
    # Equal masses change their speeds, but for what is left ringing.
    after = [float((mass * run.velocity)[p, 2].sum() / mass[p].sum()) for p in (~upper, upper)]
    assert after[0] < -0.8 * fast
    assert after[1] > -0.2 * fast
    assert run.energies is not None
    assert np.ptp(run.energies.balance) < 3e-3 * run.energies.balance[0]
    through = simulate(problem, velocity=speed).velocity
    assert np.abs(through - speed).max() < 1e-9


def test_a_folded_bar_rests_on_itself(make_box: MakeBox) -> None:
    mesh = folded_bar(make_box)
    fixed = Support(np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32))
    span = TimeSpan(1.2, num_outputs=4, mass_damping=8.0)
    problem = Problem(mesh, SOFT, (fixed,), (BodyForce((0.0, 0.0, -1000.0)),), span)

    def deepest(law: ContactLaw | None) -> float:
        run = simulate(problem, body_contact=law, amplitude=smooth_ramp(0.6))
        return float(overlap_depths(mesh, run.displacements[-1])[1].max())

    free, soft, stiff = deepest(None), deepest(PENALTY), deepest(ContactLaw(PENALTY.form, 2e6))
    assert free > 0.05
    assert soft < 0.025
    assert 0.0 < stiff < 0.2 * soft


def test_what_cannot_touch_is_told(make_box: MakeBox) -> None:
    mesh = two_bodies(make_box, 0.01)
    problem = Problem(mesh, SOFT, (), (), TimeSpan(0.1, num_outputs=1))
    with pytest.raises(InputError, match="penalty"):
        simulate(problem, body_contact=ContactLaw())
    span = TimeSpan(0.1, time_step=simulate(problem).critical_time_step, num_outputs=1)
    with pytest.raises(UnstableStepError):
        simulate(replace(problem, time=span), body_contact=PENALTY)
