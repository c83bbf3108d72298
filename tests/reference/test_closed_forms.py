"""States of a block with closed forms: every law, every kind of tetrahedra."""

from __future__ import annotations

import numpy as np
import pytest
from bank import KINDS, confined, fixed, rollers, support
from scipy.optimize import brentq

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Material, Problem, Strain
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.reference.tasks import StaticTask
from palpate.validation.diagnosis.law_simulators import example_material

if is_available():
    from palpate.reference.laws import lame_parameters
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

SVK = Law.SAINT_VENANT_KIRCHHOFF
STRAINS = pytest.mark.parametrize("strain", list(Strain))
LAWS = [law for law in Law if law is SVK or not law.is_linear_in_strain]
# TARGETS: closed homogeneous states to 1e-10.
NEAR = {"mixed": 1e-9}


def nominal_stress(of, stretches):
    """dW/da of each of the three stretches."""
    lmbda, mu = lame_parameters(of)
    a = np.asarray(stretches)
    J, I, II = a.prod(), (a**2).sum(), ((a**2).sum() ** 2 - (a**4).sum()) / 2  # noqa: E741
    kappa = lmbda + 2 * mu / 3
    match of.law:
        case Law.SAINT_VENANT_KIRCHHOFF:
            return a * (lmbda * (I - 3) / 2 + mu * (a**2 - 1))
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
            for part, alpha in of.ogden_terms:
                powers = (a * J ** (-1 / 3)) ** alpha
                found = found + 2 * mu * part / alpha * (powers - powers.mean()) / a
            return found
    c10, c01 = mu / 2 - of.c01, of.c01
    first = 2 * c10 * J ** (-2 / 3) * (a - I / (3 * a))
    second = 2 * c01 * J ** (-4 / 3) * (a * (I - a**2) - 2 * II / (3 * a))
    change = np.log(J) if of.law is Law.MOONEY_RIVLIN_LOG else (J - 1) * J
    return first + second + kappa * change / a


def energy_density(of, stretches):
    """Work of the nominal stress along the straight path from rest, by Gauss's quadrature."""
    x, weights = np.polynomial.legendre.leggauss(30)
    change = np.asarray(stretches) - 1.0
    powers = [nominal_stress(of, 1.0 + t * change) @ change for t in 0.5 * (x + 1.0)]
    return 0.5 * float(weights @ powers)


def free_stretches(of, stretch, axes=1):
    """Stretches along so many axes, and those across, for which there is no stress across."""

    def across(b):
        return nominal_stress(of, [stretch] * axes + [b] * (3 - axes))[2]

    b = brentq(across, 0.3, 3.0, xtol=1e-15, rtol=1e-15)
    return np.array([stretch] * axes + [b] * (3 - axes))


@pytest.mark.parametrize(
    ("kind", "stretch", "stress_over_E", "lateral"),
    [  # P/E = l (l^2 - 1) / 2; lateral stretch sqrt(1 - nu (l^2 - 1)), nu = 0.3
        ("quadratic", 0.80, -0.144000, 1.0526158),
        ("smoothed", 0.90, -0.085500, 1.0281051),
        ("linear", 1.10, 0.115500, 0.9679876),
        ("mixed", 1.25, 0.3515625, 0.9117291),
        ("cubic", 1.50, 0.937500, 0.7905694),
    ],
)
def test_a_pulled_block_has_the_closed_form_by_hand(box, kind, stretch, stress_over_E, lateral):
    of = Material(3000.0, 0.3)
    stretches, P = free_stretches(of, stretch), 3000.0 * stretch * (stretch**2 - 1) / 2
    assert nominal_stress(of, stretches)[0] == pytest.approx(P, rel=1e-12)
    assert pytest.approx(stress_over_E, abs=5e-7) == P / 3000.0
    assert stretches[1] == pytest.approx(lateral, abs=5e-8)
    check_stretch(box, of, kind, stretches, 1, is_pulled=True)


STRETCHES = [
    ("linear", 0.8, 1),
    ("quadratic", 1.4, 1),
    ("smoothed", 0.8, 1),
    ("smoothed", 1.4, 1),
    ("quadratic", 0.8, 2),
    ("linear", 1.4, 2),
]
# A law and the degree of cells are put together in one way for each of these: a polynomial in E, a
# function of F, and one of stretches; and in the mixed form for each measure of volume.
OF_A_KIND = {
    "quadratic": (SVK, Law.NEO_HOOKEAN, Law.OGDEN),
    "mixed": (SVK, Law.NEO_HOOKEAN_STABLE, Law.NEO_HOOKEAN, Law.COROTATIONAL),
}


def by_night(law, kind):
    return () if law in OF_A_KIND.get(kind, LAWS) else pytest.mark.nightly


@pytest.mark.parametrize(
    ("law", "kind", "stretch", "axes"),
    [
        pytest.param(law, *row, marks=by_night(law, row[0]))
        for law in LAWS
        # Saint-Venant-Kirchhoff's law does not reach the last two.
        for row in (STRETCHES[:-2] if law is SVK else STRETCHES)
    ],
)
def test_free_stretch_is_the_closed_form(box, law, kind, stretch, axes):
    """Along one axis, or along two alike: pulled by a traction, pushed by a moved face.

    Under a dead push a free block shears away sooner, whatever its law.
    """
    of = example_material(law)
    check_stretch(box, of, kind, free_stretches(of, stretch, axes), axes, is_pulled=stretch > 1.0)


@pytest.mark.parametrize(
    ("law", "nu"),
    [(SVK, 0.3), *(pytest.param(law, 0.4999, marks=by_night(law, "mixed")) for law in LAWS)],
)
def test_the_mixed_form_has_the_same_closed_form(box, law, nu):
    of = example_material(law, nu)
    check_stretch(box, of, "mixed", free_stretches(of, 1.2 if law is SVK else 1.3), 1, True)


def check_stretch(box, of, kind, stretches, axes, is_pulled):
    mesh, stress = box((2, 2, 2), jitter=0.2), nominal_stress(of, stretches)
    supports, loads = rollers(mesh), ()
    for k, facets in enumerate(mesh.facet_groups[f"{axis}1"] for axis in "xyz"[:axes]):
        along = np.eye(3)[k]
        if is_pulled:
            loads += (Traction(facets, tuple(stress[k] * along)),)
        else:
            supports += (fixed(facets, tuple(along > 0.0), tuple((stretches[k] - 1.0) * along)),)
    options = {"degree": 3} if kind == "cubic" else KINDS[kind]
    result = solve_static(Problem(mesh, of, supports, loads), **options)
    near = NEAR.get(kind, 1e-10)
    exact = mesh.points * (stretches - 1.0)
    assert np.abs(result.displacement - exact).max() <= near
    sides = stretches * np.roll(stretches, 1)
    assert result.volume == pytest.approx(stretches.prod(), rel=near)
    assert result.surface_area == pytest.approx(2.0 * sides.sum(), rel=near)
    assert result.smallest_det_f == pytest.approx(stretches.prod(), rel=near)
    energy_near = 1e-7 if kind == "mixed" else 1e-9
    assert result.strain_energy == pytest.approx(energy_density(of, stretches), rel=energy_near)
    assert result.relative_residual <= 1e-10
    P = np.where(np.arange(3) < axes, stress, 0.0)
    sigma, size = P * stretches / stretches.prod(), np.abs(P).max()
    for found, expected in (
        (result.first_piola_kirchhoff_stress, P),
        (result.second_piola_kirchhoff_stress, P / stretches),
        (result.cauchy_stress, sigma),
    ):
        assert found.shape == (mesh.num_cells, 3, 3)
        assert np.abs(found - np.diag(expected)).max() <= (1e-7 if kind == "mixed" else 1e-8) * size
    von_mises = np.sqrt(1.5 * ((sigma - sigma.mean()) ** 2).sum())
    assert result.von_mises_stress == pytest.approx(von_mises, rel=1e-7)
    assert np.abs(result.support_forces[:3] + np.diag(P)).max() <= 1e-7 * size


@pytest.mark.parametrize("law", LAWS)
# Saint-Venant-Kirchhoff's law is unstable (shear) below a = 0.798,
# a^2 = (lmbda + 2 mu) / (lmbda + 4 mu).
@pytest.mark.parametrize("stretch", [0.85, 1.3])
def test_confined_stretch_has_the_closed_form_stress(box, law, stretch):
    of, mesh = example_material(law, 0.3), box(jitter=0.2)
    pushed = support(mesh, "x1", (True, False, False), (stretch - 1, 0.0, 0.0))
    result = solve_static(Problem(mesh, of, (*confined(mesh), pushed), ()))
    assert np.abs(result.displacement - mesh.points * [stretch - 1, 0, 0]).max() <= 1e-10
    P = np.diag(nominal_stress(of, (stretch, 1.0, 1.0)))
    assert np.abs(result.first_piola_kirchhoff_stress - P).max() <= 1e-9 * np.abs(P).max()
    # Over a face of 1 m2.
    assert result.support_forces[-1, 0] == pytest.approx(P[0, 0], rel=1e-9)


@pytest.mark.parametrize("kind", ["linear", "smoothed"])
@pytest.mark.parametrize("law", LAWS)
def test_simple_shear_is_the_closed_form(box, law, kind):
    """By principal stretches a, 1/a, 1; sigma_xx - sigma_yy = g sigma_xy (Rivlin 1948) for all.

    sigma_xy = mu g of the neo-Hookean laws without ln(I + 1) and of Mooney and Rivlin's.
    """
    of, mesh, g = example_material(law), box((2, 2, 2), jitter=0.2), 0.4
    _, mu = lame_parameters(of)
    sheared = tuple(
        Support(np.array([p]), displacement=(g * float(mesh.points[p, 1]), 0.0, 0.0))
        for p in np.unique(mesh.boundary_facets)
    )
    sigma = solve_static(Problem(mesh, of, sheared, ()), **KINDS[kind]).cauchy_stress
    a = (g + np.hypot(g, 2.0)) / 2
    stretches = np.array([a, 1 / a, 1.0])
    angle = 0.5 * np.arctan2(2.0, g)
    c, s = np.cos(angle), np.sin(angle)
    axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    expected = axes @ np.diag(stretches * nominal_stress(of, stretches)) @ axes.T
    assert np.abs(sigma - expected).max() < 1e-10 * mu
    assert np.abs(sigma[:, 0, 0] - sigma[:, 1, 1] - g * sigma[:, 0, 1]).max() < 1e-10 * mu
    if not (law.is_of_stretches or law in (Law.NEO_HOOKEAN_STABLE_LOG, SVK)):
        assert expected[0, 1] == pytest.approx(mu * g, rel=1e-12)


SOFT, STIFF = Material(1e4, 0.3, 1000.0), Material(5e4, 0.2, 3000.0)


@pytest.mark.parametrize("kind", ["linear", "smoothed", "quadratic"])
@pytest.mark.parametrize(("strain", "traction"), [(Strain.GREEN, -1500.0), (Strain.LINEAR, 2000.0)])
def test_layers_in_series_each_take_their_own_stretch(box, kind, traction, strain):
    mesh = box((4, 2, 2))
    beyond = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5
    inclusion = Inclusion(np.flatnonzero(beyond).astype(np.int32), STIFF)
    pull = Traction(mesh.facet_groups["x1"], (traction, 0.0, 0.0))
    problem = Problem(mesh, SOFT, confined(mesh), (pull,), inclusions=(inclusion,))
    u = solve_static(problem, strain=strain, **KINDS[kind]).displacement

    def stretched(material):
        modulus = lame_parameters(material) @ np.array([1.0, 2.0])
        if strain is Strain.LINEAR:
            return 1.0 + traction / modulus
        # P = a (lmbda + 2 mu) (a^2 - 1) / 2, the branch next to a = 1.
        return brentq(lambda a: a * modulus * (a**2 - 1) / 2 - traction, 0.6, 2.0, xtol=1e-15)

    a, b = stretched(SOFT), stretched(STIFF)
    assert abs(a - b) > 0.05
    x = mesh.points[:, 0]
    exact = (a - 1.0) * np.minimum(x, 0.5) + (b - 1.0) * np.maximum(x - 0.5, 0.0)
    # The linear solve's own residual of 1e-10, times a few.
    np.testing.assert_allclose(u[:, 0], exact, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(u[:, 1:], 0.0, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("kind", list(KINDS))
@STRAINS
def test_a_plane_presses_a_block_into_a_homogeneous_state(box, kind, strain):
    mesh, E = box((3, 3, 3), jitter=0.2), 1e4
    stretch, nu = (0.9, 0.4999) if kind == "mixed" else (0.8, 0.3)
    knots = np.array([[0.5, 0.5, z] for z in (1.0, 0.9, stretch)])
    down = np.tile((0.0, 1.0, 0.0, 0.0), (3, 1))
    tool = RigidTool(PlaneShape(), ToolPath(np.arange(3.0), knots, down))
    problem = Problem(mesh, Material(E, nu), rollers(mesh), (), tools=(tool,))
    result = solve_static(problem, strain=strain, **KINDS[kind])
    if strain is Strain.GREEN:  # P / E = l (l^2 - 1) / 2, lateral sqrt(1 - nu (l^2 - 1))
        lateral, stress = np.sqrt(1 - nu * (stretch**2 - 1)), stretch * (stretch**2 - 1) / 2
    else:
        lateral, stress = 1 - nu * (stretch - 1), stretch - 1
    exact = mesh.points * [lateral - 1, lateral - 1, stretch - 1]
    near = NEAR.get(kind, 1e-10)
    np.testing.assert_allclose(result.displacement, exact, rtol=0.0, atol=near)
    (felt,) = result.tools
    assert felt.times == (0.0, 1.0, 2.0)
    force = -stress * E
    np.testing.assert_allclose(felt.forces[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(
        felt.forces[2], [0.0, 0.0, force], rtol=10 * near, atol=1e-4 if kind == "mixed" else 1e-5
    )
    # Even pressure acts at the middle of the deformed top.
    lever = 0.5 * lateral - 0.5
    np.testing.assert_allclose(
        felt.moments[2],
        [lever * force, -lever * force, 0.0],
        rtol=1e-8,
        atol=1e-4 if kind == "mixed" else 1e-5,
    )
    # Of degree 2 the tool meets the middles of edges, and vertices follow.
    assert max(felt.penetrations) < (1e-9 if kind == "mixed" else 1e-10)
    assert felt.active_areas[0] == 0.0
    assert felt.active_areas[2] >= 1.0


@pytest.mark.parametrize(("kind", "least"), [("linear", 0.7678), ("smoothed", 0.6), ("mixed", 0.6)])
def test_compression_past_the_limit_ends_where_theory_says(box, kind, least):
    # Dead P/E = -0.25; equilibrium ends at the peak P/E = -0.1924501, load factor 0.7698.
    mesh = box() if kind == "linear" else box((1, 1, 1))
    push = Traction(mesh.facet_groups["x1"], (-750.0, 0.0, 0.0))
    with pytest.raises(ReferenceNotConvergedError) as caught:
        solve_static(Problem(mesh, Material(3000.0, 0.3), rollers(mesh), (push,)), **KINDS[kind])
    error = caught.value
    assert least <= error.load_factor <= 1 / (3 * np.sqrt(3)) / 0.25
    assert error.reason
    assert error.smallest_det_f > 0.0
    if kind == "linear":
        stretch = 1 + error.displacement[:, 0].min()
        assert stretch == pytest.approx(1 / np.sqrt(3), abs=0.05)
        assert error.smallest_stretch == pytest.approx(stretch, rel=1e-9)
        assert f"smallest principal stretch {stretch:.3f}" in str(error)


@pytest.mark.parametrize("kind", list(KINDS))
def test_the_kind_is_part_of_a_task_and_of_its_result(box, kind):
    mesh = box((1, 1, 1))
    pull = Traction(mesh.facet_groups["x1"], (10.0, 0.0, 0.0))
    task = StaticTask(**KINDS[kind])
    result = task(Problem(mesh, Material(1e4, 0.3), rollers(mesh), (pull,)), lambda _line: None)
    for name in ("degree", "element", "formulation"):
        assert getattr(result, name) == getattr(task, name)


def test_kinds_that_do_not_exist_are_refused(box):
    mesh = box((1, 1, 1))
    problem = Problem(mesh, SOFT, (support(mesh, "z0"),), ())
    smoothed, mixed = KINDS["smoothed"], KINDS["mixed"]
    for options, words in (
        ({**smoothed, "degree": 2}, "degree 1"),
        ({**mixed, **smoothed}, "no mixed form"),
        ({**mixed, "degree": 1}, "degree 2 or 3"),
    ):
        with pytest.raises(InputError, match=words):
            solve_static(problem, **options)
    stiff = Problem(mesh, Material(1e4, 0.0), problem.supports, ())
    with pytest.raises(InputError, match="above 0"):
        solve_static(stiff, **mixed)
