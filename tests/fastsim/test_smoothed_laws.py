"""The smoothed element of every law: derivatives, small strains, constant ones, turns, motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

MakeBox = Callable[..., TetMesh]
LAWS = pytest.mark.parametrize("law", [law for law in Law if not law.is_linear_in_strain])
SMOOTHED = Element.SMOOTHED


def smoothed(mesh: TetMesh, law: Law, *, strain: Strain = Strain.GREEN) -> Body:
    """A body of two materials."""
    half = Inclusion(np.arange(mesh.num_cells // 2), example_material(law, 0.2, 3e4))
    return Body(mesh, example_material(law), strain, element=SMOOTHED, inclusions=(half,))


def ragged(make_box: MakeBox) -> TetMesh:
    return make_box((2, 2, 2), (1.0, 1.0, 1.0), ragged=0.2)


def shake(mesh: TetMesh, size: float) -> np.ndarray:
    return size * np.random.default_rng(3).standard_normal(mesh.points.shape)


@LAWS
def test_force_is_the_derivative_of_energy_and_tangent_that_of_force(
    make_box: MakeBox, law: Law
) -> None:
    mesh = ragged(make_box)
    body, u = smoothed(mesh, law), shake(mesh, 0.05)
    way = np.random.default_rng(4).standard_normal(u.shape)
    way /= np.linalg.norm(way)
    h = 1e-5
    force = body.internal_force(u)
    ahead, behind = u + h * way, u - h * way
    work = (body.strain_energy(ahead) - body.strain_energy(behind)) / (2 * h)
    assert abs(float(np.sum(force * way))) > 0.02 * np.linalg.norm(force)
    assert work == pytest.approx(float(np.sum(force * way)), rel=1e-6)
    change = (body.internal_force(ahead) - body.internal_force(behind)) / (2 * h)
    body.core.assemble_tangent(u)
    product = body.core.multiply(way)
    assert np.linalg.norm(product - change) < 1e-7 * np.linalg.norm(change)
    # Neighbours in patches have a part in it: it is not the plain element's.
    plain = Body(mesh, example_material(law))
    plain.core.assemble_tangent(u)
    assert np.linalg.norm(plain.core.multiply(way) - change) > 0.05 * np.linalg.norm(change)


@LAWS
def test_at_rest_it_is_the_smoothed_element_of_hookes_law(make_box: MakeBox, law: Law) -> None:
    """No stress, the stiffness of linear strain, and all digits of small displacements."""
    mesh = ragged(make_box)
    body, hooke = smoothed(mesh, law), smoothed(mesh, law, strain=Strain.LINEAR)
    assert not body.internal_force(np.zeros_like(mesh.points)).any()
    assert body.strain_energy(np.zeros_like(mesh.points)) == 0.0
    way = shake(mesh, 1.0)
    for b in (body, hooke):
        b.core.assemble_tangent(np.zeros_like(way))
    stiff = hooke.core.multiply(way)
    assert np.abs(body.core.multiply(way) - stiff).max() < 1e-13 * np.abs(stiff).max()
    # Of a displacement by 1e-9, terms of second order are 1e-9 of the force; rounding is 1e-14.
    for size in (1e-9, 1e-12):
        force = body.internal_force(size * way)
        assert np.abs(force / size - stiff).max() < (20 * size + 1e-13) * np.abs(stiff).max()


@LAWS
@pytest.mark.parametrize("stretch", [0.6, 1.7])
def test_a_constant_deformation_has_the_stress_and_energy_of_the_law(
    make_box: MakeBox, law: Law, stretch: float
) -> None:
    mesh = ragged(make_box)
    F = np.array([[stretch, 0.3, -0.1], [0.0, 1.1, 0.2], [0.1, -0.2, 0.9]])
    u = mesh.points @ (F - np.eye(3)).T
    plain, body = (Body(mesh, example_material(law), element=element) for element in Element)
    right = plain.first_piola_kirchhoff_stresses(u)
    found = body.first_piola_kirchhoff_stresses(u)
    assert np.abs(found - right).max() < 1e-12 * np.abs(right).max()
    assert body.strain_energy(u) == pytest.approx(plain.strain_energy(u), rel=1e-12)


@LAWS
def test_turned_bodies_have_turned_forces(make_box: MakeBox, law: Law) -> None:
    mesh = ragged(make_box)
    body, u = smoothed(mesh, law), shake(mesh, 0.05)
    Q, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    turned = (mesh.points + u) @ Q.T - mesh.points
    force = body.internal_force(u)
    assert np.abs(body.internal_force(turned) - force @ Q.T).max() < 1e-12 * np.abs(force).max()
    assert body.strain_energy(turned) == pytest.approx(body.strain_energy(u), rel=1e-12)


@LAWS
@pytest.mark.parametrize("is_single", [False, True])
def test_the_step_has_the_forces_of_the_plain_loop(
    make_box: MakeBox, law: Law, is_single: bool
) -> None:
    mesh = make_box((3, 3, 3), (1.0, 1.0, 1.0), ragged=0.2)
    body = smoothed(mesh, law)
    run = _core.ExplicitRun.make(
        body.core,
        body.lumped_mass,
        np.ones(mesh.points.shape, dtype=np.uint8),
        time_step=1e-3,
        mass_damping=0.0,
        displacement_limit=1e3,
        num_threads=2,
        at_most=_core.InstructionSet.avx512,
        stiffness_damping=0.0,
        is_single=is_single,
        tracks_energy=False,
    )
    limit = 1e-5 if is_single else 1e-12
    for stretch in (-0.25, 0.0, 0.3):
        u = shake(mesh, 0.02) + stretch * mesh.points
        run.set_state(u, np.zeros_like(u), 0.0)
        force = np.empty_like(u)
        run.internal_force(force)
        right = body.internal_force(u)
        assert np.abs(force - right).max() < limit * np.abs(right).max(), stretch
