"""Stored references that cannot be right are refused, hash or no hash."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest
from judged import large_by_night, solved

from palpate.fastsim.dynamics import simulate
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.metrics import make_state
from palpate.validation.references.bars import PARTS
from palpate.validation.references.reference_set import (
    QUADRATIC,
    SAME_MESH,
    SCALARS,
    SMOOTHED,
    TRUTH,
)
from palpate.validation.references.runs import at_points_of
from palpate.validation.references.soundness import (
    _gap_of_slopes,
    _wrong_balance,
    find_contradictions,
)
from palpate.validation.references.stored import (
    UnsoundReferenceError,
    accepted_path,
    load_stored,
    problem_key,
    read_reference,
    store,
    write_reference,
)
from palpate.validation.states import State, Trajectory


def references_of(name):
    return load_case(name).problem, read_reference(accepted_path(name))[0]


def changed(references, label, strain=Strain.GREEN, **fields):
    states = dict(references.states)
    states[label, strain] = dataclasses.replace(states[label, strain], **fields)
    return dataclasses.replace(references, states=states)


def measured_again(problem, references, label, displacement, strain=Strain.GREEN, **more):
    """Another displacement with header numbers that follow from it."""
    own = make_state(problem.mesh, displacement, label=label, simulator="", strain=strain)
    numbers = {name: getattr(own, name) for name in SCALARS}
    return changed(references, label, strain, displacement=displacement, **numbers, **more)


def contradictions(problem, references, **options):
    return " | ".join(find_contradictions(problem, references, **options))


@pytest.mark.parametrize("name", large_by_night(builtin_cases(), "wave", "decay"))
def test_the_built_in_references_hold_all_that_can_be_compared_with_them(name):
    problem, references = references_of(name)
    assert find_contradictions(problem, references, thoroughly=True) == []


@pytest.mark.parametrize("name", ["block", "kidney", "cantilever", "shear"])
@pytest.mark.parametrize("strain", Strain)
def test_halved_displacements_are_not_in_equilibrium(name, strain):
    """The block has a pressure that follows, the others tractions."""
    problem, references = references_of(name)
    half = 0.5 * references.states[SAME_MESH, strain].displacement
    spoiled = measured_again(problem, references, SAME_MESH, half, strain)
    assert "not in equilibrium" in contradictions(problem, spoiled)


def test_a_halved_displacement_of_a_motion_is_not_what_the_steps_of_the_case_give():
    problem, references = references_of("block-motion")
    state = references.states[SAME_MESH, Strain.GREEN]
    motion = Trajectory(state.trajectory.times, 0.5 * state.trajectory.displacements)
    spoiled = measured_again(
        problem, references, SAME_MESH, motion.displacements[-1], trajectory=motion
    )
    assert "from the case's own steps" in contradictions(problem, spoiled)


def test_a_motion_that_goes_wrong_late_is_found_when_all_steps_are_repeated():
    problem, references = references_of("block-motion")
    state = references.states[SAME_MESH, Strain.GREEN]
    moved = state.trajectory.displacements.copy()
    moved[40] *= 1.01
    late = Trajectory(state.trajectory.times, moved)
    spoiled = changed(references, SAME_MESH, trajectory=late)
    assert contradictions(problem, spoiled) == ""
    assert "from the case's own steps" in contradictions(problem, spoiled, thoroughly=True)


def test_the_motion_beside_a_tool_is_repeated_as_far_as_nothing_touches():
    """The probe of slide comes from farther away, and slower, as fastsim has it."""
    problem, references = references_of("slide")
    (tool,) = problem.tools
    from_afar = tool.path.positions.copy()
    from_afar[:, 2] += 1e-3 * np.maximum(0.0, 1.0 - tool.path.times / 0.12)
    path = dataclasses.replace(tool.path, positions=from_afar)
    problem = dataclasses.replace(problem, tools=(dataclasses.replace(tool, path=path),))
    run = simulate(problem)
    forces = np.array([track.mean_forces for track in run.tools])
    assert not forces[:, :2].any()

    def contradicted(displacements):
        moved = Trajectory(run.times, displacements)
        return contradictions(
            problem,
            measured_again(
                problem, references, SAME_MESH, displacements[-1], trajectory=moved,
                tool_forces=forces,
            ),
        )  # fmt: skip

    assert "own steps" not in contradicted(run.displacements)
    moved = run.displacements.copy()
    moved[1, :, 2] += 1e-5 * (problem.mesh.points[:, 2] > 0.01)
    assert "from the case's own steps" in contradicted(moved)


def test_forces_on_tools_are_what_the_body_pushes_back_with():
    problem, references = references_of("press")
    forces = references.states[SAME_MESH, Strain.GREEN].tool_forces
    softer = changed(references, SAME_MESH, tool_forces=0.99 * forces)
    assert "the forces on the tools are" in contradictions(problem, softer)
    assert "no force" in contradictions(problem, changed(references, SAME_MESH, tool_forces=None))


def test_the_force_at_vertices_is_found_wrong_where_fixed_points_may_be_touched_too():
    """The tool may touch all of the boundary, the fixed bottom among it, which it never reaches."""
    problem = load_case("press").problem
    anywhere = np.zeros((0, 3), dtype=np.int32)
    tools = [
        dataclasses.replace(tool, contact=ContactRule.VERTICES, contact_facets=anywhere)
        for tool in problem.tools
    ]
    problem = dataclasses.replace(problem, tools=tuple(tools))
    state = solved(problem)
    assert list(_wrong_balance(problem, state)) == []
    (found,) = _wrong_balance(
        problem, dataclasses.replace(state, tool_forces=0.9 * state.tool_forces)
    )
    assert "other than what the body pushes back with" in found


@pytest.mark.parametrize("number", SCALARS)
def test_a_header_number_that_its_displacement_does_not_give_is_refused(number):
    problem, references = references_of("block")
    reported = getattr(references.states[SAME_MESH, Strain.GREEN], number)
    spoiled = changed(references, SAME_MESH, **{number: reported * (1.0 + 1e-6)})
    assert f"{number} is said to be" in contradictions(problem, spoiled)


def test_what_the_header_says_of_a_truth_must_be_possible():
    problem, references = references_of("block")
    truth = references.states[TRUTH, Strain.GREEN]
    larger = changed(references, TRUTH, max_displacement=2.0 * truth.max_displacement)
    assert "max_displacement is said" in contradictions(problem, larger)
    # A ball of the truth's area, 4.70e-3 m2, holds A^1.5 / (6 sqrt(pi)) = 3.03e-5 m3.
    ball = truth.surface_area**1.5 / (6.0 * math.sqrt(math.pi))
    swollen = changed(references, TRUTH, volume=1.001 * ball)
    assert "isoperimetric" in contradictions(problem, swollen)
    assert "finite" in contradictions(problem, changed(references, TRUTH, volume=math.nan))


@pytest.mark.parametrize("name", ["block", "beam"])
def test_a_truth_far_from_its_own_sequence_of_meshes_is_refused(name):
    """Of three grids the kept differences bound it, of two the bar itself."""
    problem, references = references_of(name)
    half = 0.5 * references.states[TRUTH, Strain.GREEN].displacement
    largest = float(np.linalg.norm(half, axis=1).max())
    spoiled = changed(references, TRUTH, displacement=half, max_displacement=largest)
    assert "the file's own record of meshes" in contradictions(problem, spoiled)


def as_truth(references, label, strain=Strain.GREEN):
    """The file with a solution on the case's own mesh in the place of its truth."""
    own = references.states[label, strain]
    fields = ("displacement", "trajectory", *SCALARS)
    return changed(references, TRUTH, strain, **{name: getattr(own, name) for name in fields})


@pytest.mark.parametrize(
    ("name", "strain"), [("block", Strain.GREEN), ("shear", Strain.LINEAR), ("beam", Strain.GREEN)]
)
def test_a_truth_that_is_p2_on_the_cases_own_mesh_is_refused(name, strain):
    problem, references = references_of(name)
    spoiled = as_truth(references, QUADRATIC, strain)
    assert "by the file's own record of meshes at least" in contradictions(problem, spoiled)


@pytest.mark.parametrize("label", [SAME_MESH, SMOOTHED])
@pytest.mark.parametrize("name", ["block", "block-motion"])
def test_a_truth_that_is_what_linear_tetrahedra_give_on_the_cases_mesh_is_refused(name, label):
    problem, references = references_of(name)
    spoiled = as_truth(references, label)
    # Without P2 on the case's mesh, too, which would be too far from it.
    states = {key: s for key, s in spoiled.states.items() if key[0] != QUADRATIC}
    for forged in (spoiled, dataclasses.replace(spoiled, states=states)):
        assert f"the solution of {label} under another name" in contradictions(problem, forged)


def test_a_record_that_starts_from_another_mesh_is_refused():
    problem, references = references_of("block")
    records = copy.deepcopy(references.provenance["adaptive"])
    records["green"]["cells"][0] += 1
    provenance = {**references.provenance, "adaptive": records}
    reported = contradictions(problem, dataclasses.replace(references, provenance=provenance))
    assert f"the case has {problem.mesh.num_cells}" in reported


@pytest.mark.parametrize(
    ("gone", "words"),
    [
        *((key, f"says no {key}") for key in ("date", "command", "palpate", "versions")),
        ("adaptive", "with no record of meshes"),
    ],
)
def test_a_thorough_check_asks_for_provenance_and_a_record_of_every_bar(gone, words):
    problem, references = references_of("block")
    less = {key: value for key, value in references.provenance.items() if key != gone}
    spoiled = dataclasses.replace(references, provenance=less)
    assert words in contradictions(problem, spoiled, thoroughly=True)


def test_a_thorough_check_asks_for_p2_on_the_cases_mesh():
    problem, references = references_of("block")
    states = {key: s for key, s in references.states.items() if key[0] != QUADRATIC}
    spoiled = dataclasses.replace(references, states=states)
    assert f"without {QUADRATIC}" in contradictions(problem, spoiled, thoroughly=True)


@pytest.mark.parametrize("bar", [-0.01, math.nan, -math.inf])
def test_a_bar_below_zero_or_nan_is_refused(bar):
    problem, references = references_of("block")
    spoiled = dataclasses.replace(
        references, bars={**references.bars, ("volume", Strain.GREEN): bar}
    )
    assert "a bar is 0 or more" in contradictions(problem, spoiled)


@pytest.mark.parametrize("name", ["block", "beam", "block-motion"])
def test_a_bar_below_what_the_kept_meshes_and_steps_make_it_is_refused(name):
    problem, references = references_of(name)
    metric = "displacement_max" if problem.time is None else "trajectory_l2"
    key = (metric, Strain.GREEN)
    assert math.isfinite(references.bars[key])
    smaller = {**references.bars, key: 0.5 * references.bars[key]}
    spoiled = dataclasses.replace(references, bars=smaller)
    assert f"error bar of {metric}" in contradictions(problem, spoiled)


def test_supports_hold_in_every_stored_state():
    problem, references = references_of("stretch")
    moved = references.states[QUADRATIC, Strain.GREEN].displacement + 1e-4
    largest = float(np.linalg.norm(moved, axis=1).max())
    spoiled = changed(references, QUADRATIC, displacement=moved, max_displacement=largest)
    assert "a held point is 0.0001 m from" in contradictions(problem, spoiled)


def test_a_motion_starts_at_rest_and_has_the_times_of_its_case():
    problem, references = references_of("wave")
    motion = references.states[TRUTH, Strain.LINEAR].trajectory
    late = Trajectory(motion.times + 0.01, motion.displacements)
    reported = contradictions(problem, changed(references, TRUTH, Strain.LINEAR, trajectory=late))
    assert "are not the 101 outputs" in reported
    moved = motion.displacements.copy()
    moved[0] = moved[-1]
    begun = Trajectory(motion.times, moved)
    reported = contradictions(problem, changed(references, TRUTH, Strain.LINEAR, trajectory=begun))
    assert "start at rest" in reported
    short = Trajectory(motion.times[:-1], motion.displacements[:-1])
    reported = contradictions(problem, changed(references, TRUTH, Strain.LINEAR, trajectory=short))
    assert "does not fit the mesh and [time]" in reported
    reported = contradictions(problem, changed(references, TRUTH, Strain.LINEAR, trajectory=None))
    assert "no motion over [time]" in reported
    last = changed(references, TRUTH, Strain.LINEAR, displacement=0.5 * motion.displacements[-1])
    assert "not the last state of its motion" in contradictions(problem, last)


def test_a_state_that_does_not_fit_the_mesh_is_refused():
    problem, references = references_of("block")
    state = references.states[QUADRATIC, Strain.GREEN]
    short = changed(references, QUADRATIC, displacement=state.displacement[:-1])
    assert "does not fit the mesh" in contradictions(problem, short)
    nan = changed(references, QUADRATIC, displacement=state.displacement * math.nan)
    assert "does not fit the mesh" in contradictions(problem, nan)
    assert "stands for degree 2" in contradictions(problem, changed(references, TRUTH, degree=1))


def test_what_contradicts_itself_is_neither_written_nor_read(tmp_path):
    problem, references = references_of("block")
    half = 0.5 * references.states[SAME_MESH, Strain.GREEN].displacement
    spoiled = measured_again(problem, references, SAME_MESH, half)
    path = tmp_path / "block.npz"
    with pytest.raises(UnsoundReferenceError, match="nothing was written"):
        store("block", problem, spoiled, {}, path=path)
    assert not path.exists()
    # With a hash of its own, as somebody who means it would write it.
    write_reference(path, "block", problem_key(problem), spoiled, {})
    with pytest.raises(UnsoundReferenceError, match=r"cannot be right.*reference build") as caught:
        load_stored("block", problem, folder=tmp_path)
    assert len(caught.value.contradictions) == 1


def test_records_of_a_wrong_type_are_no_records():
    problem, references = references_of("block")
    for kept in ("often", ["green"], {"green": {"volume": 3.0}}, {"green": {"volume": {}}}):
        provenance = {"sequence": "degree 2", "grid_convergence": kept, "convergence": kept}
        reported = dataclasses.replace(references, provenance=provenance)
        assert all("error bar of" in line for line in find_contradictions(problem, reported))


@pytest.mark.parametrize("strain", Strain)
@pytest.mark.parametrize("name", ["block", "block-motion", "press"])
def test_another_elements_state_under_its_name_is_refused(name, strain):
    problem, stored = references_of(name)
    for label, other in ((SMOOTHED, SAME_MESH), (SAME_MESH, SMOOTHED)):
        element = stored.states[label, strain].element
        swapped = dataclasses.replace(stored.states[other, strain], label=label, element=element)
        states = {**stored.states, (label, strain): swapped}
        found = contradictions(problem, dataclasses.replace(stored, states=states))
        words = "not in equilibrium" if problem.time is None else "from the case's own steps"
        assert f"{label}, {strain} strain" in found
        assert words in found


def test_a_state_whose_name_stands_for_another_element_is_refused():
    problem, references = references_of("block")
    wrong = changed(references, SMOOTHED, element=Element.LINEAR)
    assert "its name stands for smoothed ones" in contradictions(problem, wrong)


def test_refined_states_are_read_at_the_first_points():
    mesh, few = brick_box((2, 1, 1), (0.2, 0.1, 0.1)), brick_box((1, 1, 1), (0.1, 0.1, 0.1))
    field = np.zeros((mesh.num_points, 3))
    field[:, 0] = 0.3 * mesh.points[:, 0]
    many = State("made up", "reference", Strain.GREEN, 2, field, 1.1e-3, 0.05, 1.0, 0.06)
    found = at_points_of(few, many)
    assert found.displacement.shape == (few.num_points, 3)
    assert found.max_displacement == np.linalg.norm(found.displacement, axis=1).max()
    assert found.volume == many.volume


def test_a_reference_cut_in_eight_carries_its_orders():
    _, stored = references_of("block-fine")
    convergence = stored.provenance["grid_convergence"]
    for strain in Strain:
        order = convergence[strain.value]["displacement_l2"]["order"]
        assert 1.0 < order < 3.0
        bar = stored.bars["displacement_l2", strain]
        assert bar == convergence[strain.value]["displacement_l2"]["error_bar"]
    # This area does not converge yet, and so decides nothing.
    assert convergence["green"]["surface_area"]["behaviour"] == "order out of range"
    assert stored.bars["surface_area", Strain.GREEN] == math.inf


@pytest.mark.parametrize(("factor", "is_other"), [(1.0 + 1e-13, False), (1.01, True), (0.99, True)])
def test_parts_of_a_bar_add_up_to_it_but_for_rounding(factor, is_other):
    problem, references = references_of("block")
    table = copy.deepcopy(references.provenance[PARTS])
    table["displacement_l2|green"]["discretisation"] *= factor
    other = dataclasses.replace(references, provenance={**references.provenance, PARTS: table})
    assert ("add up to" in contradictions(problem, other)) is is_other


def test_the_gap_of_a_slope_is_the_part_of_a_displacement_across_it():
    """A wall whose normal is (0, 3, 4) / 5: of (1, 2, 3) m, 18 / 5 m go through it."""
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    wall = Support(np.arange(3, dtype=np.int32), normal=(0.0, 0.6, 0.8))
    pushing = dataclasses.replace(wall, displacement=(0.0, 0.3, 0.4))
    problem = Problem(mesh, Material(1.0, 0.3), (wall,), ())
    moved = np.zeros_like(mesh.points)
    assert _gap_of_slopes(problem, None, moved) == 0.0
    moved[1] = [1.0, 2.0, 3.0]
    pushed = Problem(mesh, Material(1.0, 0.3), (pushing,), ())
    assert _gap_of_slopes(pushed, None, np.tile([9.0, 0.3, 0.4], (8, 1))) <= 1e-15
    # Its largest component is that along z: 0.8 times 18 / 5.
    assert _gap_of_slopes(problem, None, moved) == pytest.approx(0.8 * 18.0 / 5.0)
