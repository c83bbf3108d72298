"""Laws by energies in UFL: closed forms of homogeneous states, small strains, motion, refusals.

In principal stretches a, b, c with J = a b c, I = a^2 + b^2 + c^2, II = a^2 b^2 + b^2 c^2 + c^2 a^2
the nominal stress along a is dW/da, derived by hand below (R. W. Ogden, Non-linear Elastic
Deformations, 1984, section 4.3).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available
from palpate.validation.diagnosis.law_simulators import example_material as material

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.laws import lame_parameters
    from palpate.reference.result import Formulation
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

FINITE = [law for law in Law if not law.is_linear_in_strain]
LAWS = pytest.mark.parametrize("law", FINITE)


def nominal_stress(of, stretches):
    """dW/da of each of the three stretches."""
    lmbda, mu = lame_parameters(of)
    a = np.asarray(stretches)
    J, I, II = a.prod(), (a**2).sum(), ((a**2).sum() ** 2 - (a**4).sum()) / 2  # noqa: E741
    kappa = lmbda + 2 * mu / 3
    match of.law:
        case Law.NEO_HOOKEAN_STABLE:
            return mu * a + ((lmbda + mu) * (J - 1) - mu) * J / a
        case Law.NEO_HOOKEAN:
            return mu * (a - 1 / a) + lmbda * np.log(J) / a
        case Law.NEO_HOOKEAN_STABLE_LOG:
            m, own = 4 * mu / 3, lmbda + 5 * mu / 6
            slope = 1 - 1 / ((a**2).sum() + 1)
            return m * slope * a + (own * (J - 1) - 0.75 * m) * J / a
        case Law.COROTATIONAL:
            return 2 * mu * (a - 1) + lmbda * (a.sum() - 3)
        case Law.OGDEN:
            found = kappa * (J - 1) * J / a
            for share, alpha in of.ogden_terms:
                powers = (a * J ** (-1 / 3)) ** alpha
                found = found + 2 * mu * share / alpha * (powers - powers.mean()) / a
            return found
    c10, c01 = mu / 2 - of.c01, of.c01
    first = 2 * c10 * J ** (-2 / 3) * (a - I / (3 * a))
    second = 2 * c01 * J ** (-4 / 3) * (a * (I - a**2) - 2 * II / (3 * a))
    change = np.log(J) if of.law is Law.MOONEY_RIVLIN_LOG else (J - 1) * J
    return first + second + kappa * change / a


def lateral_stretch(of, along):
    """The other stretch, for which there is no stress across; by bisection."""
    num = 3 - along.count(None)
    known = along[0]

    def across(b):
        return nominal_stress(of, (known, known, b) if num == 2 else (known, b, b))[2]

    low, high = 0.3, 3.0
    assert across(low) < 0 < across(high)
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if across(middle) < 0 else (low, middle)
    return low


def rollers(mesh):
    held = []
    for k, name in enumerate(("x0", "y0", "z0")):
        facets = mesh.facet_groups[name]
        held.append(Support(np.unique(facets), facets, tuple(j == k for j in range(3))))
    return tuple(held)


@LAWS
@pytest.mark.parametrize(
    ("degree", "stretch", "axes"), [(1, 0.8, 1), (2, 0.8, 2), (2, 1.4, 1), (1, 1.4, 2)]
)
def test_free_stretch_is_the_closed_form(box, law, degree, stretch, axes):
    """Along one axis, or along two alike: pulled by a traction, pushed by a moved face.

    Under a dead push a free block shears away sooner, whatever its law.
    """
    of, mesh = material(law), box((2, 2, 2), jitter=0.2)
    b = lateral_stretch(of, [stretch] * axes + [None] * (3 - axes))
    stretches = [stretch] * axes + [b] * (3 - axes)
    stress = nominal_stress(of, stretches)
    supports, loads = rollers(mesh), ()
    for k, facets in enumerate(mesh.facet_groups[f"{axis}1"] for axis in "xyz"[:axes]):
        along = np.eye(3)[k]
        if stretch > 1.0:
            loads += (Traction(facets, tuple(stress[k] * along)),)
        else:
            moved = tuple((stretch - 1.0) * along)
            supports += (Support(np.unique(facets), facets, tuple(along > 0.0), moved),)
    result = solve_static(Problem(mesh, of, supports, loads), degree=degree)
    expected = mesh.points * (np.array(stretches) - 1.0)
    assert np.abs(result.displacement - expected).max() < 1e-10
    P = np.diag(stress * (np.arange(3) < axes))
    assert np.abs(result.first_piola_kirchhoff_stress - P).max() < 1e-8 * np.abs(P).max()


@LAWS
def test_simple_shear_is_the_closed_form(box, law):
    """By principal stretches a, 1/a, 1; sigma_xx - sigma_yy = g sigma_xy (Rivlin 1948) for all.

    sigma_xy = mu g of the neo-Hookean laws without ln(I + 1) and of Mooney and Rivlin's.
    """
    of, mesh, g = material(law), box((2, 2, 2), jitter=0.2), 0.4
    _, mu = lame_parameters(of)
    outside = mesh.boundary_facets
    places = mesh.points[np.unique(outside)]
    shear = [
        Support(np.array([p]), displacement=(g * float(x[1]), 0.0, 0.0))
        for p, x in zip(np.unique(outside), places, strict=True)
    ]
    sigma = solve_static(Problem(mesh, of, tuple(shear), ())).cauchy_stress
    a = (g + np.hypot(g, 2.0)) / 2
    stretches = np.array([a, 1 / a, 1.0])
    angle = 0.5 * np.arctan2(2.0, g)
    c, s = np.cos(angle), np.sin(angle)
    axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    expected = axes @ np.diag(stretches * nominal_stress(of, stretches)) @ axes.T
    assert np.abs(sigma - expected).max() < 1e-10 * mu
    assert np.abs(sigma[:, 0, 0] - sigma[:, 1, 1] - g * sigma[:, 0, 1]).max() < 1e-10 * mu
    if not (law.is_of_stretches or law is Law.NEO_HOOKEAN_STABLE_LOG):
        assert expected[0, 1] == pytest.approx(mu * g, rel=1e-12)


@LAWS
def test_small_strains_are_hookes(box, law):
    """The difference from linear strain falls with the load's square."""
    mesh, of = box((2, 2, 2), jitter=0.2), material(law)
    differences = []
    for size in (1.0, 0.1):
        pull = Traction(mesh.facet_groups["x1"], (50.0 * size, 0.0, 30.0 * size))
        problem = Problem(mesh, of, rollers(mesh), (pull,))
        u = solve_static(problem).displacement
        linear = solve_static(problem, strain=Strain.LINEAR).displacement
        differences.append(np.abs(u - linear).max())
    assert differences[0] / differences[1] == pytest.approx(100.0, rel=0.1)
    other = dataclasses.replace(problem, material=Material(1e4, 0.4))
    assert np.array_equal(solve_static(other, strain=Strain.LINEAR).displacement, linear)


@LAWS
@pytest.mark.parametrize("nu", [0.4, 0.4999])
def test_the_mixed_form_has_the_same_closed_form(box, law, nu):
    of, mesh, stretch = material(law, nu), box((2, 2, 2), jitter=0.2), 1.3
    b = lateral_stretch(of, [stretch, None, None])
    P = nominal_stress(of, (stretch, b, b))[0]
    pull = Traction(mesh.facet_groups["x1"], (P, 0.0, 0.0))
    problem = Problem(mesh, of, rollers(mesh), (pull,))
    result = solve_static(problem, degree=2, formulation=Formulation.MIXED)
    expected = mesh.points * (np.array([stretch, b, b]) - 1.0)
    assert np.abs(result.displacement - expected).max() < 1e-9
    stress = result.first_piola_kirchhoff_stress
    assert np.abs(stress - P * np.diag([1.0, 0.0, 0.0])).max() < 1e-7 * P


@LAWS
def test_implicit_motion_is_the_explicit_one(box, law):
    mesh = box((2, 1, 1), jitter=0.0)
    facets = mesh.facet_groups["x0"]
    held = Support(np.unique(facets), facets)
    pull = Traction(mesh.facet_groups["x1"], (0.0, 0.0, -400.0))
    span = TimeSpan(0.5, 2e-3, num_outputs=5)
    problem = Problem(mesh, material(law), (held,), (pull,), span)
    explicit = simulate_explicit(problem).displacements
    implicit = simulate_implicit(problem, degree=1, is_mass_lumped=True).displacements
    largest = np.abs(explicit).max()
    assert largest > 0.05
    assert np.abs(implicit - explicit).max() < 2e-3 * largest
    plain = dataclasses.replace(problem, material=Material(1e4, 0.4))
    assert np.abs(simulate_explicit(plain).displacements - explicit).max() > 5e-3 * largest


def test_what_knows_one_law_says_so(box):
    mesh, of = box((1, 1, 1)), material(Law.NEO_HOOKEAN)
    problem = Problem(mesh, of, rollers(mesh), (Traction(mesh.facet_groups["x1"], (1.0, 0, 0)),))
    with pytest.raises(InputError, match="inclusions follow the law"):
        dataclasses.replace(problem, inclusions=(Inclusion(np.array([0]), Material(1e4, 0.4)),))
