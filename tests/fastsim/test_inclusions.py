"""Bodies of several materials, with both elements."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import layer_stiffness
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

SOFT, STIFF = Material(1e4, 0.0, 1000.0), Material(9e4, 0.0, 3000.0)
BOTH = pytest.mark.parametrize("element", list(Element))
STRAINS = pytest.mark.parametrize("strain", list(Strain))


def rod(mesh: TetMesh, *, inclusions: bool = True) -> Problem:
    """A rod along x, its second half stiffer; fixed so that it may narrow, and pulled by 800 Pa."""
    x = mesh.points[:, 0]
    length = float(x.max())
    centres = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    stiff = np.flatnonzero(centres > 0.5 * length).astype(np.int32)
    return Problem(
        mesh,
        SOFT,
        (Support(np.flatnonzero(x < 1e-9).astype(np.int32)),),
        (Traction(side(mesh, 0, length), (800.0, 0.0, 0.0)),),
        inclusions=(Inclusion(stiff, STIFF),) if inclusions else (),
    )


@BOTH
@STRAINS
def test_a_rod_of_two_materials_stretches_by_each_ones_own_part(
    element: Element, strain: Strain
) -> None:
    """In series each half bears the same stress: l (l^2 - 1) / 2 = 800 Pa / E for Green strain.

    Poisson's ratio is 0, so that nothing narrows and both elements have the exact solution: strains
    are constant in each half, and not averaged across.
    """
    problem = rod(brick_box((6, 2, 2), (2.0, 1.0, 1.0)))
    u = solve_static(problem, strain=strain, element=element).displacement
    stretches = []
    for material in (SOFT, STIFF):
        ratio = 800.0 / material.youngs_modulus
        roots = np.roots([0.5, 0.0, -0.5, -ratio])
        green = float(roots[np.abs(roots.imag) < 1e-12].real.max())
        stretches.append(1.0 + ratio if strain is Strain.LINEAR else green)
    x = problem.mesh.points[:, 0]
    expected = (stretches[0] - 1.0) * np.minimum(x, 1.0)
    expected += (stretches[1] - 1.0) * np.maximum(x - 1.0, 0.0)
    np.testing.assert_allclose(u[:, 0], expected, rtol=0.0, atol=1e-9)
    assert np.abs(u[:, 1:]).max() < 1e-9


@BOTH
def test_every_cell_counts_with_its_own_constants(ragged_box: TetMesh, element: Element) -> None:
    """A stretch of the whole body has the energy of each part, whatever the element."""
    problem = rod(ragged_box)
    body = Body.of(problem, element=element)
    u = ragged_box.points @ np.diag([0.2, 0.0, 0.0])
    volumes = signed_volumes(ragged_box.points, ragged_box.cells)
    modulus = np.full(len(volumes), SOFT.youngs_modulus)
    modulus[problem.inclusions[0].cells] = STIFF.youngs_modulus
    E11 = (1.2**2 - 1.0) / 2.0
    expected = 0.5 * float(volumes @ modulus) * E11**2  # lmbda = 0, mu = E / 2
    assert body.strain_energy(u) == pytest.approx(expected, rel=1e-13)
    density = np.where(modulus == SOFT.youngs_modulus, SOFT.density, STIFF.density)
    assert body.lumped_mass.sum() == pytest.approx(float(volumes @ density), rel=1e-13)


def test_the_stable_step_is_that_of_the_fastest_material(ragged_box: TetMesh) -> None:
    """Waves of the inclusion are faster by root(9 / 3), stiffness over density."""
    alone = Body(ragged_box, STIFF)
    mixed = Body.of(rod(ragged_box))
    soft = Body(ragged_box, SOFT)
    ratio = np.sqrt(3.0)
    assert soft.critical_time_step_bound() == pytest.approx(
        ratio * alone.critical_time_step_bound(), rel=1e-12
    )
    bound = mixed.critical_time_step_bound()
    assert alone.critical_time_step_bound() <= bound < soft.critical_time_step_bound()
    assert bound <= mixed.critical_time_step() * (1.0 + 1e-9)


def test_a_layer_is_as_stiff_as_the_cells_behind_the_facets() -> None:
    problem = rod(brick_box((6, 2, 2), (2.0, 1.0, 1.0)))
    near, far = (side(problem.mesh, 0, x) for x in (0.0, 2.0))
    # lmbda + 2 mu = E for a Poisson's ratio of 0; the same edges at both ends.
    ratio = layer_stiffness(problem, far) / layer_stiffness(problem, near)
    assert ratio == pytest.approx(9.0, rel=1e-12)
