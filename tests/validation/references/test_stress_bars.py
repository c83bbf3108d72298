"""The bar of the truth's stress covers its error where the stress is known in closed form.

A bar of rectangular section |x| <= a, |y| <= b, held on its sides, sags along its own axis under a
body force f: antiplane shear, mu (w_xx + w_yy) = -f with w = 0 on the sides. As in S. P.
Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed. 1970, section 109 (torsion's stress
function, 2 G theta = f / mu),

    w = f / (2 mu) (a^2 - x^2) - 16 f a^2 / (mu pi^3) sum over odd n of (-1)^((n-1)/2) / n^3
        cosh(n pi y / 2a) / cosh(n pi b / 2a) cos(n pi x / 2a).

It is no polynomial, and no balance tells how the sides share the weight.
"""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.refinement import mean_over_parents, refine_uniformly
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics import Part, make_state, measure
from palpate.validation.references.adaptive_truth import TruthRequest, solve_truth
from palpate.validation.references.bars import name_of_part
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, TRUTH, ReferenceSet
from palpate.validation.references.runs import solve_state
from palpate.validation.references.statics import solve_live
from palpate.validation.states import State, StressIntegrals

pytestmark = pytest.mark.dolfinx

A, B, DEPTH, FORCE = 1.0, 0.6, 0.25, 40.0
# Asked of the stored truth.
BAR = 0.01
MATERIAL = Material(1000.0, 0.3)
MU = 1000.0 / 2.6


def side(mesh: TetMesh, axis: int, position: float, components: tuple[bool, bool, bool]) -> Support:
    facets = mesh.boundary_facets
    chosen = facets[(np.abs(mesh.points[facets][:, :, axis] - position) < 1e-9).all(axis=1)]
    return Support(np.unique(chosen).astype(np.int32), chosen, components)


@cache
def quarter() -> Problem:
    """A quarter of the section and a slice of the bar: what is sheared in the middle is not."""
    mesh = brick_box((4, 3, 1), (A, B, DEPTH))
    across = (True, True, False)
    supports = (
        side(mesh, 0, A, (True, True, True)),
        side(mesh, 1, B, (True, True, True)),
        *(side(mesh, axis, 0.0, across) for axis in range(3)),
        side(mesh, 2, DEPTH, across),
    )
    return Problem(mesh, MATERIAL, supports, (BodyForce((0.0, 0.0, FORCE)),))


def shear(points: np.ndarray) -> np.ndarray:
    """sigma_zx, sigma_zy in closed form [Pa], (n, 2)."""
    x, y = points[:, 0, None], points[:, 1, None]
    n = np.arange(1, 400, 2)
    k = n * np.pi / (2.0 * A)
    factor = 16.0 * FORCE * A**2 / np.pi**3 * (-1.0) ** ((n - 1) // 2) / n**3 * k
    # cosh(k y) / cosh(k b), without overflow.
    small, large = np.exp(k * (y - B)), np.exp(-k * (y + B))
    below = 1.0 + np.exp(-2.0 * k * B)
    of_x = factor * (small + large) / below * np.sin(k * x)
    of_y = -factor * (small - large) / below * np.cos(k * x)
    return np.column_stack([-FORCE * points[:, 0] + of_x.sum(axis=1), of_y.sum(axis=1)])


@cache
def closed_form() -> StressIntegrals:
    """Means over the cells by the middles of the 512 that each is cut into, and their forces."""
    mesh = finer = quarter().mesh
    for _ in range(3):
        finer = refine_uniformly(finer)
    fine = shear(finer.points[finer.cells].mean(axis=1))
    for _ in range(3):
        fine = mean_over_parents(fine)
    sigma = np.zeros((mesh.num_cells, 3, 3))
    sigma[:, 2, :2] = sigma[:, :2, 2] = fine
    x = mesh.points[mesh.cells]
    inverse = np.linalg.inv((x[:, 1:] - x[:, :1]).transpose(0, 2, 1))
    volumes = signed_volumes(mesh.points, mesh.cells)[:, None, None]
    nodal = volumes * (inverse @ sigma)
    force = np.zeros_like(mesh.points)
    for corner in range(3):
        np.add.at(force, mesh.cells[:, corner + 1], nodal[:, corner])
        np.add.at(force, mesh.cells[:, 0], -nodal[:, corner])
    return StressIntegrals(sigma, force)


@cache
def references() -> ReferenceSet:
    """As they are stored: P2 on meshes refined for the parts."""
    asked = [("stress_l2" if len(p.cells) else "traction_resultant", p) for p in parts().values()]
    request = TruthRequest(BAR, 300.0, 4.0, parts={Strain.LINEAR: asked})
    truth, bars, _ = solve_truth(quarter(), Strain.LINEAR, request, lambda _line: None)
    named = {(name, Strain.LINEAR): bar for name, bar in bars.items()}
    return ReferenceSet({(TRUTH, Strain.LINEAR): truth}, named, "here")


@cache
def on_the_spot() -> ReferenceSet:
    return solve_live(quarter(), lambda _line: None)


def exact() -> State:
    still = np.zeros_like(quarter().mesh.points)
    state = make_state(quarter().mesh, still, label="x", simulator="x", strain=Strain.LINEAR)
    return dataclasses.replace(state, integrals=closed_form(), degree=2)


def parts() -> dict[str, Part]:
    mesh, supports = quarter().mesh, quarter().supports
    centroids = mesh.points[mesh.cells].mean(axis=1)
    none, nothing = np.zeros(0, np.int32), np.zeros_like(mesh.points)
    inside = np.flatnonzero((centroids[:, 0] < 0.75 * A) & (centroids[:, 1] < 0.67 * B))
    fixed = nothing.copy()
    fixed[supports[0].points] = 1.0
    cut = nothing.copy()
    cut[mesh.points[:, 0] < 0.6 * A] = 1.0
    return {
        "all": Part(np.arange(mesh.num_cells, dtype=np.int32), nothing),
        "inside": Part(inside.astype(np.int32), nothing),
        "support": Part(none, fixed, support=0),
        "cut": Part(none, cut),
    }


PARTS = pytest.mark.parametrize(
    ("metric", "name"),
    [
        ("stress_l2", "all"),
        ("stress_l2", "inside"),
        ("traction_resultant", "support"),
        ("traction_resultant", "cut"),
    ],
)


@PARTS
@pytest.mark.long
def test_the_bar_covers_the_error_of_the_truth_and_is_not_idle(metric: str, name: str) -> None:
    part, known = parts()[name], references()
    truth = known.truth(Strain.LINEAR)
    assert truth is not None
    error = measure(metric, quarter(), truth, exact(), part).value
    bar = known.bar_of_part(quarter(), Strain.LINEAR, metric, part)
    assert 0.0 < error <= bar <= BAR
    # No hundred times too wide; forces settle far faster than any rate that is believed.
    assert bar < (100.0 * error if metric == "stress_l2" else 1e-3)
    # P2 on the case's own mesh is farther off.
    coarse = solve_state(quarter(), Strain.LINEAR, 2, lambda _line: None)
    assert measure(metric, quarter(), coarse, exact(), part).value > error


def test_a_part_that_was_not_asked_for_has_no_bar() -> None:
    known, inside = references(), parts()["inside"]
    other = dataclasses.replace(inside, cells=inside.cells[1:])
    assert known.bar_of_part(quarter(), Strain.LINEAR, "stress_l2", other) == float("inf")
    assert not known.was_asked(Strain.LINEAR, name_of_part("stress_l2", other))
    # In another order they are the same cells.
    turned = dataclasses.replace(inside, cells=inside.cells[::-1])
    assert known.was_asked(Strain.LINEAR, name_of_part("stress_l2", turned))


@PARTS
@pytest.mark.long
@pytest.mark.nightly
def test_a_truth_solved_on_the_spot_has_a_bar_that_covers_it_too(metric: str, name: str) -> None:
    part = parts()[name]
    live = on_the_spot()
    truth = live.stress_truth(Strain.LINEAR)
    # Graded meshes are better, but tell no stresses.
    assert truth is live.states[QUADRATIC, Strain.LINEAR]
    assert live.truth(Strain.LINEAR) is live.states[TRUTH, Strain.LINEAR]
    assert truth is not None
    error = measure(metric, quarter(), truth, exact(), part).value
    bar = live.bar_of_part(quarter(), Strain.LINEAR, metric, part)
    assert error <= bar < 1.0
    # Whoever is judged: linear tetrahedra tell it, though smoothed ones are not held against them.
    of_smoothed = live.of_element(Element.SMOOTHED)
    assert (SAME_MESH, Strain.LINEAR) not in of_smoothed.states
    assert of_smoothed.bar_of_part(quarter(), Strain.LINEAR, metric, part) == bar
    # Without linear tetrahedra beside it there is nothing to tell it from.
    alone = {key: state for key, state in live.states.items() if key[0] != SAME_MESH}
    lonely = dataclasses.replace(live, states=alone)
    assert lonely.bar_of_part(quarter(), Strain.LINEAR, metric, part) == float("inf")


def test_a_truth_without_stresses_has_no_bar() -> None:
    known, part = references(), parts()["all"]
    key = TRUTH, Strain.LINEAR
    mute = dataclasses.replace(known.states[key], integrals=None)
    without = dataclasses.replace(known, states={key: mute})
    assert without.bar_of_part(quarter(), Strain.LINEAR, "stress_l2", part) == float("inf")
