"""Past the first critical load a truth is one of several: its images, and what checks say then."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from case_texts import BOX, END, FORCE

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.shapes import shape_box
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.metrics import make_state
from palpate.validation.references import statics
from palpate.validation.references.adaptive_truth import ADAPTIVE, TruthRequest
from palpate.validation.references.branches import (
    _same_vectors,
    load_over_critical,
    mirror_images,
    says_of_branches,
)
from palpate.validation.references.reference_set import SAME_MESH, TRUTH, ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.report import preview
from palpate.validation.report.buckling import Buckling
from palpate.validation.report.buckling import load_over_critical as load_of_check
from palpate.validation.report.preview import describe_case
from palpate.validation.states import Verdict, in_silence

if is_available():
    from palpate.reference.branches import find_stability, largest_eigenvalue
    from palpate.reference.linear_solver import LinearSolveError, LinearSolver
    from palpate.reference.statics import find_equilibrium

GREEN = Strain.GREEN
YOUNG = 1000.0
LENGTH, WIDE, THIN = 10.0, 1.0, 0.8


# pi^2 E I / (2 L)^2 of a column that is clamped at one end alone, over its section [Pa].
EULER = math.pi**2 * YOUNG * THIN**2 / 12.0 / (4.0 * LENGTH**2)


def column(factor, sideways=1e-6, count=12):
    """A column of 10 x 1 x 0.8 m, nu = 0, pressed along x at `factor` times Euler's load."""
    mesh = brick_box((count, 1, 1), (LENGTH, WIDE, THIN))
    pressure = factor * EULER
    end = Traction(side(mesh, 0, LENGTH), (-pressure, 0.0, sideways * pressure))
    return Problem(mesh, Material(YOUNG, 0.0), (support_of(side(mesh, 0, 0.0)),), (end,))


def bent(problem, size=1.0):
    """The first mode of a clamped column, and the shortening of order two with it."""
    x = problem.mesh.points[:, 0]
    moved = np.zeros_like(problem.mesh.points)
    moved[:, 2] = size * (1.0 - np.cos(math.pi * x / (2.0 * LENGTH)))
    moved[:, 0] = -0.05 * size**2 * x / LENGTH
    return moved


def state_of(problem, displacement, label="reference"):
    return make_state(problem.mesh, displacement, label=label, simulator=label, strain=GREEN)


def names(problem):
    return {image.label for image in mirror_images(problem, state_of(problem, bent(problem)))}


def test_the_images_are_those_that_box_and_loads_allow():
    problem = column(1.3)
    # The box has three mirror planes; the clamp at x = 0 leaves those along y and z.
    along = [f"mirror image along {axes}" for axes in ("y", "z", "y and z")]
    assert names(problem) == set(along)
    # A side force of a tenth of the axial one prefers a side: one mirror plane is left.
    assert names(column(1.3, sideways=0.1)) == {along[0]}


def test_forces_whose_sum_has_no_mirror_image_are_no_image_of_themselves():
    # At the centre, where their moments say nothing.
    at, mirror = np.zeros((1, 3)), np.diag([-1.0, 1.0, 1.0])
    assert _same_vectors(at, np.array([[0.0, 1.0, 2.0]]), mirror)
    assert not _same_vectors(at, np.array([[1.0, 0.0, 0.0]]), mirror)


def test_equal_sides_may_change_places():
    mesh = brick_box((6, 2, 2), (LENGTH, WIDE, WIDE))
    pressed = Traction(side(mesh, 0, LENGTH), (-1.0, 0.0, 0.0))
    square = Problem(mesh, Material(YOUNG, 0.0), (support_of(side(mesh, 0, 0.0)),), (pressed,))
    # Of the eight symmetries of a square all but the identity.
    assert len(names(square)) == 7
    image = next(
        image
        for image in mirror_images(square, state_of(square, bent(square)))
        if image.label == "image with x, z, y for x, y, z"
    )
    # A field of x alone is read exactly at mirrored points: bent along y, where it was along z.
    np.testing.assert_allclose(image.displacement, bent(square)[:, [0, 2, 1]], atol=1e-12)


def judged(write_case, share, candidate_of):
    """A same-mesh check of a candidate against a column that is bent to one side."""
    case = load_case(
        str(
            write_case(
                (BOX, f'shape = "box"\nsize = [{LENGTH}, {WIDE}, {THIN}]\nedge_length = 1.0'),
                (END, END.replace("1.999", "9.999")),
                (FORCE, 'kind = "force"\nforce = [-1.0, 0.0, 1e-6]'),
            )
        )
    )
    reference = state_of(case.problem, bent(case.problem))
    references = ReferenceSet(
        {(SAME_MESH, GREEN): reference},
        {},
        "made by hand",
        provenance={ADAPTIVE: {"green": {"load_over_critical": share}}},
    )
    candidate = state_of(case.problem, candidate_of(case.problem), "candidate")
    return CaseJudge(case, references).check(case.checks[0], candidate)


def other_side(problem):
    """The mirror image, 3 % too large, as on a coarse mesh."""
    return 1.03 * bent(problem, -1.0)


def test_the_other_branch_is_inconclusive_and_says_so(write_case):
    found = judged(write_case, 1.3, other_side)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "1.3 times the first critical one" in found.message
    assert "mirror image along z" in found.message


@pytest.mark.parametrize("share", [0.9, None, "two"])
def test_below_the_critical_load_or_without_a_record_there_is_one_branch(write_case, share):
    assert judged(write_case, share, other_side).verdict is Verdict.FAILED


@pytest.mark.parametrize(
    "wrong",
    [np.zeros_like, lambda points: 0.3 * points],
)
def test_a_wrong_result_is_no_other_branch(write_case, wrong):
    found = judged(write_case, 1.3, lambda problem: wrong(problem.mesh.points))
    assert found.verdict is Verdict.FAILED


def test_half_of_the_other_branch_is_none(write_case):
    found = judged(write_case, 1.3, lambda problem: bent(problem, -0.4))
    assert found.verdict is Verdict.FAILED


def test_the_reader_is_informed_of_what_the_record_says():
    record = {"load_over_critical": 1.3}
    (line,) = says_of_branches({ADAPTIVE: {"green": record}})
    assert "1.3 times the first critical one" in line
    assert "one of several" in line
    assert list(says_of_branches({ADAPTIVE: {"green": {"load_over_critical": 0.9}}})) == []
    assert list(says_of_branches({ADAPTIVE: "none"})) == []
    assert load_over_critical({"load_over_critical": None}) == 0.0


@pytest.mark.parametrize(("share", "number_of_lines"), [(0.9, 1), (1.3, 0)])
def test_another_branch_is_no_coarse_mesh(share, number_of_lines):
    problem = column(1.3)
    states = {
        (SAME_MESH, GREEN): state_of(problem, bent(problem)),
        (TRUTH, GREEN): state_of(problem, bent(problem, -1.0)),
    }
    run = SimpleNamespace(
        problem=problem, states=states, records={"green": {"load_over_critical": share}}
    )
    assert len(list(statics._LiveRun.coarse_meshes(run))) == number_of_lines


def slender(write_case, force):
    """`palpate check` of a column of 10 x 1 x 0.8 m: E = 1000 Pa, nu = 0.3."""
    changes = (
        (BOX, f'shape = "box"\nsize = [{LENGTH}, {WIDE}, {THIN}]\nedge_length = 0.4'),
        (END, END.replace("1.999", "9.999")),
        (FORCE, f'kind = "force"\nforce = [{force}, 0.0, 0.0]'),
    )
    return describe_case(load_case(str(write_case(*changes))))


def test_check_warns_of_a_load_past_eulers(write_case):
    # Euler's load is EULER times the section 0.8 m2; 1.3 times it is 1.37 N.
    force = 1.3 * EULER * WIDE * THIN
    (warning,) = [w for w in slender(write_case, -force).warnings if "buckling" in w]
    # On this mesh the column is too stiff by some per cent.
    assert 1.1 < float(warning.split()[3]) < 1.4
    for harmless in (-force / 2.0, force):
        assert not any("buckling" in w for w in slender(write_case, harmless).warnings)


def test_linear_buckling_of_the_case_is_eulers():
    # By 30 cells along it; they are too stiff by 1 %, and 12 by 27 %.
    found = load_of_check(column(1.3, count=30))
    assert found.ratio == pytest.approx(1.3, rel=0.02)
    assert found.is_settled
    assert load_of_check(column(-1.3, count=30)).ratio == 0.0
    # A side force that bends it by more than a fifth of its length leaves nothing to be said.
    assert load_of_check(column(1.3, sideways=1.0, count=30)) is None


def glued(flat):
    """A block of 6 x 4 x 3 cm under four times its weight, glued by a third of its base.

    If `flat`, one point is drawn to the edge of what is glued, so that a cell is nearly flat.
    """
    mesh = mesh_surface(shape_box((0.06, 0.04, 0.03), edge_length=0.01))
    if flat:
        points = mesh.points.copy()
        (row,) = np.flatnonzero(np.abs(points - [0.02, 0.0, 0.01]).max(axis=1) < 1e-9)
        points[row, 2] = 0.0005
        mesh = TetMesh(points, mesh.cells)
    base = side(mesh, 2, 0.0)
    part = base[mesh.points[base][:, :, 0].max(axis=1) <= 0.02 + 1e-9]
    weight = BodyForce((0.0, 0.0, -4.0 * 9810.0))
    return Problem(mesh, Material(2e5, 0.4), (support_of(part),), (weight,))


def test_a_flat_cell_does_not_buckle_the_body():
    """Where all displacements of the mesh counted, it made 0.42 of 0.12."""
    good, bad = load_of_check(glued(flat=False)), load_of_check(glued(flat=True))
    assert good.is_settled
    assert bad.ratio == pytest.approx(good.ratio, rel=0.1)


def test_what_more_shapes_change_is_said_as_a_range_without_a_warning(write_case, monkeypatch):
    monkeypatch.setattr(preview, "load_over_critical", lambda _problem: Buckling(0.4, 1.6))
    about = slender(write_case, -1e-3)
    (line,) = [line for line in about.lines if line.startswith("buckling")]
    assert "0.4 to 1.6 times its first critical load" in line
    assert "uncertain" in line
    assert not any("buckling" in warning for warning in about.warnings)


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_the_load_over_the_critical_one_is_eulers():
    found = find_equilibrium(column(0.5), strain=GREEN, degree=2)
    least, share = find_stability(found)
    # Euler's load is of a column without shear: 1 / (1 + P / (5/6 G A)) with P / (E A) = 1.3e-3,
    # and quadratic tetrahedra on one cell across are too stiff by up to 2 %.
    assert share == pytest.approx(0.5, rel=0.02)
    # Bending is left 1 - share of its stiffness, as the axial force is the load.
    assert least == pytest.approx(1.0 - share, abs=0.01)
    # In tension nothing buckles; the load's sign decides.
    found = find_equilibrium(column(-0.5), strain=GREEN, degree=2)
    assert find_stability(found)[1] < 0.1 * share
    found = find_equilibrium(column(0.5), strain=Strain.LINEAR, degree=2)
    assert all(math.isnan(value) for value in find_stability(found))


@pytest.mark.dolfinx
@pytest.mark.parametrize("largest", [0.05, 0.98, 1.3])
def test_eigenvalues_are_as_exact_as_their_distance_from_one_asks_for(largest):
    """Many alike below a single one; the metric has soft modes and stiff ones."""
    generator = np.random.default_rng(3)
    modes, _ = np.linalg.qr(generator.standard_normal((300, 300)))
    metric = (modes * np.geomspace(1.0, 1e4, 300)) @ modes.T
    root = np.linalg.cholesky(metric)
    values = np.append(np.linspace(-0.1, 0.9, 299) * min(largest, 0.9), largest)
    turned, _ = np.linalg.qr(generator.standard_normal((300, 300)))
    A = root @ (turned * values) @ turned.T @ root.T
    solves = []

    def solve(right):
        solves.append(right)
        return np.linalg.solve(metric, right)

    found = largest_eigenvalue(lambda v: A @ v, solve, 300)
    assert abs(found - largest) <= max(1e-3 * largest, 0.02 * abs(1.0 - largest))
    assert len(solves) < 100
    with pytest.raises(LinearSolveError, match="do not settle"):
        largest_eigenvalue(lambda v: A @ v, lambda v: -solve(v), 300)


@pytest.mark.dolfinx
def test_a_body_that_is_far_from_a_critical_load_takes_few_solves(monkeypatch):
    """Modes of a bar in tension are alike: digits that nobody asks for took 17 920 solves."""
    found = find_equilibrium(column(-0.5, count=24), strain=GREEN, degree=2)
    once, solves = LinearSolver.solve_once_more, []

    def counted(*arguments, **named):
        solves.append(1)
        return once(*arguments, **named)

    monkeypatch.setattr(LinearSolver, "solve_once_more", counted)
    _, share = find_stability(found)
    assert share < 0.02
    # Two Lanczos runs of at least eight solves, and two that smooth each start.
    assert 20 <= len(solves) <= 120


@pytest.mark.dolfinx
@pytest.mark.slow
def test_a_truth_past_eulers_load_is_one_of_several():
    problem = column(1.3)
    guess = find_equilibrium(column(1.3, sideways=0.05), strain=GREEN, degree=2)
    start = guess.discrete.at_points(guess.displacement)
    request = TruthRequest(0.05, 60.0, start=start)
    found = solve_live(
        problem, in_silence, request=request, strains=(GREEN,), has_stress=False, unknowns=9e3
    )
    record = found.provenance[ADAPTIVE]["green"]
    assert record["load_over_critical"] == pytest.approx(1.3, rel=0.02)
    # The bent state is stable.
    assert 0.0 < record["lowest_eigenvalue"] < 1.0
    truth = found.truth(GREEN)
    end = np.argmax(problem.mesh.points[:, 0])
    assert truth.displacement[end, 2] > 1.0
    images = {image.label: image for image in mirror_images(problem, truth)}
    # The image is an equilibrium too: Newton's method stays there.
    image = images["mirror image along z"].displacement
    again = find_equilibrium(problem, strain=GREEN, degree=2, start=image)
    assert again.discrete.at_points(again.displacement)[end, 2] < -1.0
