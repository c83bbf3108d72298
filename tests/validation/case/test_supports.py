"""Supports along slanted planes, turns and springs of cases."""

import json

import numpy as np
import pytest
from case_texts import BACK, CLAMP, END, FLOOR, LOAD, ROOT, SPRING

from palpate.fastsim.dynamics import simulate
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Rotation
from palpate.meshes.bricks import side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, InitialVelocity, Strain
from palpate.validation.case import load_case
from palpate.validation.case.regions import flat_normal
from palpate.validation.diagnosis.diagnose import diagnose
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.exchange.nodal_arrays import pushes_of_supports, sliding_points
from palpate.validation.metrics.audit import audit_on_own_mesh
from palpate.validation.metrics.body import Body, spring_force, spring_stiffness_times
from palpate.validation.metrics.difference import make_state
from palpate.validation.metrics.stepping import MotionHypothesis, Stepper
from palpate.validation.report.pictures import draw_case
from palpate.validation.report.preview import describe_case

TIME = "[time]\nend_time = 0.02\ntime_step = 1e-3\nnum_outputs = 4\n\n[[load]]"


def three_walls(how):
    return "".join(f"[[support]]\n{region}{how}\n" for region in (ROOT, FLOOR, BACK))


def test_a_flat_face_along_an_axis_is_a_support_of_that_component(write_case):
    problem = load_case(write_case((CLAMP, three_walls("sliding = true")))).problem
    assert [s.components for s in problem.supports] == [
        (True, False, False),
        (False, False, True),
        (False, True, False),
    ]
    assert sliding_points(problem) is None


def test_both_sides_of_a_slab_slide_as_one_support_in_plane_strain(write_case):
    both = "[[support]]\nregion = { box = { min = [-1, -1, -1], max = [3, 2, 2] } }\nsliding = true"
    with pytest.raises(InputError, match=r"support 1: sliding needs a flat face.*differ by"):
        assert load_case(write_case((CLAMP, both))).problem
    mesh = load_case(write_case()).problem.mesh
    sides = np.vstack([side(mesh, 1, 0.0), side(mesh, 1, 1.0)])
    assert flat_normal(mesh, sides, "support 1") in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0))


def slanted(write_case, *changes):
    walls = three_walls("").replace(BACK, BACK + "normal = [0.0, 3.0, 4.0]")
    return write_case((CLAMP, walls), *changes)


def test_a_normal_fixes_along_it_alone(write_case):
    case = load_case(slanted(write_case))
    problem = case.problem
    assert problem.supports[2].normal == pytest.approx((0.0, 0.6, 0.8))
    lines = "\n".join(describe_case(case).lines)
    assert "slides along its plane, normal [0, 0.6, 0.8], fixed" in lines
    slopes = sliding_points(problem)
    # On the clamped root and floor nothing slides any more.
    assert not np.isin(problem.supports[0].points, slopes.points).any()


TURNED = (
    CLAMP + f"\n[[support]]\n{END}"
    "rotation = { axis = [2.0, 0.0, 0.0], center = [2.0, 0.5, 0.5], angle_deg = 30.0 }"
)


def test_a_turned_face(write_case, tmp_path):
    case = load_case(write_case((CLAMP, TURNED)))
    support = case.problem.supports[1]
    assert support.rotation == Rotation((1.0, 0.0, 0.0), (2.0, 0.5, 0.5), np.deg2rad(30.0))
    lines = "\n".join(describe_case(case).lines)
    assert "turned by 30 degrees about [1, 0, 0] through [2, 0.5, 0.5] m" in lines
    draw_case(case, tmp_path / "case.png")
    balanced(case.problem)


def balanced(problem):
    """The judge's body and its equilibrium, which it finds in balance and on its supports."""
    found = solve_static(problem).displacement
    body = Body(problem, Strain.GREEN)
    assert body.miss(found) < 1e-12
    left, scale = body.out_of_balance(found)
    assert np.abs(left).max() < 1e-8 * scale
    return body, found, scale


def test_equilibrium_on_slanted_walls_is_judged_along_them(write_case):
    problem = load_case(slanted(write_case)).problem
    body, found, scale = balanced(problem)
    # And a wall that is not there is seen.
    off = found.copy()
    off[body.slopes.points] += 1e-3 * np.array([0.0, 0.6, 0.8])
    assert body.miss(off) > 1e-3
    assert np.abs(body.out_of_balance(off)[0]).max() > 1e-6 * scale
    # Root and floor fix all components here; what they have in common counts for both.
    wall = body.support_reactions(found)[2]
    assert np.abs(np.cross(wall, [0.0, 0.6, 0.8])).max() < 1e-12 * np.abs(wall).max()
    assert not pushes_of_supports(problem, np.zeros_like(found)).any()


def same_steps(case):
    """The motion by the judge's own steps, which fastsim's are."""
    ours = simulate(case.problem, strain=case.strain)
    stepper = Stepper(Body(case.problem, case.strain), 1e-3, 5, 4)
    theirs = np.array(list(stepper.outputs(MotionHypothesis())))
    assert np.abs(ours.displacements[1:] - theirs).max() < 1e-11 * np.abs(theirs).max()
    return theirs


def test_a_motion_starts_with_a_velocity_and_needs_no_support(write_case, tmp_path):
    start = "[initial_velocity]\nvelocity = [0.0, 0.0, 1.0]\nangular_velocity = [0.0, 2.0, 0.0]\n"
    start += "center = [1.0, 0.5, 0.5]\n\n"
    path = write_case((CLAMP, ""), ("[[load]]", start + TIME))
    case = load_case(path)
    problem = case.problem
    assert problem.initial_velocity == InitialVelocity((0, 0, 1), (0, 2, 0), (1.0, 0.5, 0.5))
    assert any(line.startswith("starts") for line in describe_case(case).lines)
    same_steps(case)
    write_case_folder(tmp_path / "out", problem, case.strain, name="free")
    document = json.loads((tmp_path / "out" / "case.json").read_text())
    assert document["time"]["starts"] == "at initial_velocity"
    with np.load(tmp_path / "out" / "rest.npz") as arrays:
        assert np.abs(arrays["initial_velocity"]).max() > 1.0


def test_steps_along_moving_slanted_walls_by_the_words_alone(write_case, tmp_path):
    ramp = "amplitude = { times = [0.0, 0.02], factors = [0.0, 1.0] }\ndisplacement = [0, 0, 0.05]"
    walls = three_walls("").replace(BACK, BACK + "normal = [0.0, 3.0, 4.0]\n" + ramp)
    walls = walls.replace("[[support]]\n" + FLOOR, "").replace(ROOT, ROOT + "components = ['x']")
    case = load_case(write_case((CLAMP, walls), ("[[load]]", TIME)))
    problem = case.problem
    last = same_steps(case)[-1]
    # What an outside simulator is given says where the walls are.
    write_case_folder(tmp_path / "out", problem, case.strain, name="slides")
    with np.load(tmp_path / "out" / "rest.npz") as arrays:
        normals = arrays["sliding_normals"].reshape(-1, 2, 3)
        moved, numbers = arrays["sliding_displacement"], arrays["sliding_support"]
        fixed = arrays["fixed"]
    along = np.einsum("nkj,nj->nk", normals, last)
    slides = np.abs(normals).any(axis=(1, 2))
    assert slides.any()
    # What slides keeps a direction; at the root, where x is fixed too, just one.
    assert fixed[slides].sum(axis=1).max() == 1
    assert np.abs(along - moved)[slides].max() < 1e-12
    assert set(numbers[slides]) == {1}


def test_what_slides_and_flies_is_drawn(write_case, tmp_path):
    start = "[initial_velocity]\nangular_velocity = [0.0, 2.0, 0.0]\n\n" + TIME
    draw_case(load_case(slanted(write_case)), tmp_path / "slides.png")
    flies = load_case(write_case((CLAMP, ""), ("[[load]]", start)))
    draw_case(flies, tmp_path / "flies.png")
    assert all((tmp_path / f"{name}.png").stat().st_size > 5000 for name in ("slides", "flies"))


@pytest.mark.dolfinx
def test_both_audits_know_slanted_walls(write_case):
    from palpate.reference.audit import audit_displacement

    problem = load_case(slanted(write_case)).problem
    found = solve_static(problem).displacement
    audit = audit_displacement(problem, found, strain=Strain.GREEN, degree=1)
    assert audit.residual_norm < 1e-6
    assert audit.support_gap < 1e-12
    perturbed = audit_displacement(problem, 1.01 * found, strain=Strain.GREEN, degree=1)
    assert perturbed.displacement_error == pytest.approx(0.01, rel=0.05)
    own = audit_on_own_mesh(problem, 1.01 * found, Strain.GREEN)
    assert own.displacement_error == pytest.approx(perturbed.displacement_error, rel=1e-6)


def case_of(write_case, spring=SPRING, units=""):
    return load_case(write_case((LOAD, spring), ("\n[geometry]", units + "\n[geometry]")))


def test_what_it_builds(write_case):
    (spring,) = case_of(write_case).problem.springs
    assert spring.path.end.tolist() == [0.1, 0.0, 0.3]
    assert spring.stiffness == 80.0
    path = SPRING.replace(
        "displacement = [0.1, 0.0, 0.3]",
        "smooth = true\npath = [{ time = 0.0, displacement = [0, 0, 0] }, "
        "{ time = 2.0, displacement = [0, 0, 1] }]\n"
        "amplitude = { times = [0, 1], factors = [0.5, 1] }",
    )
    (moved,) = case_of(write_case, path).problem.springs
    assert moved.path.at(1.0).tolist() == [0.0, 0.0, 0.5]
    assert moved.path.is_smooth
    assert moved.amplitude is not None
    milli = '\n[units]\nlength = "mm"\nforce = "mN"\nstress = "kPa"\n'
    (small,) = case_of(write_case, units=milli).problem.springs
    assert small.stiffness == pytest.approx(80.0)  # mN/mm
    assert small.path.end == pytest.approx([1e-4, 0.0, 3e-4])


def test_the_judge_has_the_same_force_by_its_own_quadrature(write_case):
    problem = case_of(write_case).problem
    mesh, spring = problem.mesh, problem.springs[0]
    patches = PatchSprings(mesh.points, problem.springs)
    u = 0.1 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    fast = patches.force(u, spring.path.end[None], np.ones(1))
    assert spring_force(mesh, spring, u) == pytest.approx(fast, abs=1e-13 * np.abs(fast).max())
    pushed = patches.multiply(u)
    assert spring_stiffness_times(mesh, problem.springs, u) == pytest.approx(pushed, abs=1e-12)


@pytest.mark.parametrize("element", list(Element))
def test_the_judge_finds_the_solution_in_balance(write_case, element):
    problem = case_of(write_case).problem
    found = solve_static(problem, element=element).displacement
    body = Body(problem, Strain.GREEN, element)
    left, scale = body.out_of_balance(found)
    assert np.abs(left).max() < 1e-9 * scale
    assert body.support_reactions(found).sum(axis=0) == pytest.approx(
        -body.pull_of_springs(found).sum(axis=0) - sum(body.loads(found)).sum(axis=0)
    )
    audit = audit_on_own_mesh(problem, found, Strain.GREEN, element)
    assert audit.displacement_error < 1e-8
    halfway = audit_on_own_mesh(problem, 0.99 * found, Strain.LINEAR, Element.LINEAR)
    assert halfway.relative_residual_norm > 1e-3


def test_a_spring_is_described_drawn_and_written_out(write_case, tmp_path):
    case = case_of(write_case)
    lines = describe_case(case).lines
    assert any(line.startswith("spring 1") and "80 N/m over" in line for line in lines), lines
    draw_case(case, tmp_path / "case.png")
    write_case_folder(tmp_path / "out", case.problem, Strain.GREEN, name="block")
    (spring,) = json.loads((tmp_path / "out" / "case.json").read_text())["springs"]
    assert spring["stiffness"] == 80.0
    assert spring["path"]["displacements"] == [[0.1, 0.0, 0.3]]


def test_a_wrong_result_is_not_explained_by_hypotheses_without_springs(write_case):
    problem = case_of(write_case).problem
    found = solve_static(problem).displacement
    state = make_state(problem.mesh, 1.3 * found, label="x", simulator="x", strain=Strain.GREEN)
    assert "springs" in diagnose(problem, state, None).hint
