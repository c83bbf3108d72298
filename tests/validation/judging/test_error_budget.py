"""A known seeded error lands in its own term: of strain, mesh, time step and solver tolerance."""

from __future__ import annotations

import dataclasses
import math
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from judged import case_of, judge, large_by_night, references_of, solved, state_of

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.newton import Iteration, Newton
from palpate.fastsim.statics import solve_static
from palpate.meshes.bricks import brick_box
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.meshes.transforms import scale_loads
from palpate.validation.candidates.candidate import fastsim_candidate, result_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.diagnosis.diagnose import equations_left
from palpate.validation.judging.error_budget import (
    DISCRETISATION,
    MODEL,
    SOLVER,
    TIME,
    UNEXPLAINED,
    Budget,
    budget_rows,
    case_budgets,
    farthest_probe,
    motion_budgets,
    static_budgets,
)
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.references.reference_set import TRUTH
from palpate.validation.report.case_plots import budget_svg
from palpate.validation.states import State, in_silence

CASES = large_by_night(("kidney", "beam", "csm1"), "beam")
# What the project promises: within a tenth of what was seeded.
WITHIN = 0.1


@cache
def problem_of(name: str) -> Problem:
    return case_of(name).problem


@cache
def solution_of(name: str, strain: Strain = Strain.GREEN) -> State:
    return solved(problem_of(name), strain)


def budgets_of(name: str, candidate: State) -> list[Budget]:
    return static_budgets(problem_of(name), candidate, references_of(name).states)


def assert_lands_in(term: str, seeded: list[Budget], healthy: list[Budget]) -> None:
    """The change of the value, measured on the candidates alone, is the change of that term."""
    for after, before in zip(seeded, healthy, strict=True):
        known = after.value - before.value
        assert abs(known) > 1e-9 * abs(before.truth)
        found = (after.terms[term] or 0.0) - (before.terms[term] or 0.0)
        assert found == pytest.approx(known, rel=WITHIN), (term, after.quantity)


@pytest.mark.parametrize("name", CASES)
def test_linear_strain_is_the_models_error(name: str) -> None:
    seeded = budgets_of(name, solution_of(name, Strain.LINEAR))
    assert_lands_in(MODEL, seeded, budgets_of(name, solution_of(name)))
    # Solved as well as before: nothing of it is the solver's.
    for budget in seeded:
        assert abs(budget.terms[SOLVER] or math.nan) < 1e-7 * abs(budget.truth)


@pytest.mark.parametrize("name", CASES)
def test_a_loose_tolerance_is_the_solvers_error(name: str) -> None:
    problem = problem_of(name)
    # One Newton step short of the solution: what a tolerance of a few per cent lets through.
    newton = Newton(problem, Strain.GREEN, 3e-2, 30, Iteration.NEWTON)
    start = solve_static(scale_loads(problem, 0.9)).displacement
    loose = newton.solve(start, 1.0).displacement
    assert loose is not None
    solution = state_of(problem, loose)
    # It says itself how far it went.
    said = {"relative_residual": equations_left(problem, solution)}
    seeded = budgets_of(name, dataclasses.replace(solution, details=said))
    assert_lands_in(SOLVER, seeded, budgets_of(name, solution_of(name)))
    # Who says nothing, or something else, is not believed to have stopped early.
    for details in ({}, {"relative_residual": 1e-3 * said["relative_residual"]}):
        silent = budgets_of(name, dataclasses.replace(solution, details=details))
        assert {b.rest for b in silent} == {UNEXPLAINED}
        assert [b.terms[UNEXPLAINED] for b in silent] == [b.terms[SOLVER] for b in seeded]


@pytest.mark.parametrize(
    ("fault", "rest"),
    [
        (Fault.SWAPPED_LAME, "explained: Lamé's parameters exchanged"),
        (Fault.UNIT_ERROR, "explained: displacement in millimetres"),
        (
            Fault.LINEAR_INSTEAD_OF_GREEN,
            "explained: linear strain instead of Green strain",
        ),
        (Fault.MIRRORED_MESH, UNEXPLAINED),
    ],
)
def test_a_wrong_law_is_not_booked_as_the_solvers_error(fault: Fault, rest: str) -> None:
    """A candidate that is asked for Green strain and solves something else."""
    candidate = with_fault(fastsim_candidate(), fault)
    whole = judge(case_of("kidney"), candidate=candidate, diagnoses=True)
    budgets = [b for b in case_budgets(whole) if "Green" in b.candidate]
    assert {b.rest for b in budgets} == {rest}
    for budget in budgets:
        assert abs(budget.terms[rest] or 0.0) > 1e-5 * abs(budget.truth)
        assert SOLVER not in budget.terms
    columns, rows = budget_rows(budgets)
    assert "solver [%]" not in columns
    assert all(f"({rest})" in " ".join(row) for row in rows)


@pytest.mark.parametrize("name", CASES)
def test_a_finer_mesh_takes_off_what_discretisation_says(name: str) -> None:
    problem, truth = problem_of(name), references_of(name).truth(Strain.GREEN)
    assert truth is not None
    finer = refine_problem(problem)
    fine = solve_static(finer).displacement[: problem.mesh.num_points]
    probe = farthest_probe(truth.displacement)
    coarse_value = probe.read(problem.mesh, solution_of(name).displacement)[0]
    gained = coarse_value - probe.read(problem.mesh, fine)[0]
    budget = budgets_of(name, solution_of(name))[0]
    term = budget.terms[DISCRETISATION]
    assert term is not None
    # Errors of linear tetrahedra fall as h^2 away from clamps, so halving h takes off 3/4.
    assert 0.5 * abs(term) < abs(gained) < abs(term)
    assert np.sign(gained) == np.sign(term)
    # Taken off, what is left on the finer mesh is what its own budget would say.
    left = probe.read(problem.mesh, fine)[0] - budget.truth
    assert term - gained == pytest.approx(left, rel=WITHIN)


@pytest.mark.parametrize("name", CASES)
def test_another_mesh_is_discretisations_error(name: str, tmp_path: Path) -> None:
    """A result on cells of half the size, brought as a file with its own mesh."""
    problem = problem_of(name)
    finer = refine_problem(problem)
    fine = solve_static(finer).displacement
    path = tmp_path / "other.npz"
    np.savez(path, points=finer.mesh.points, cells=finer.mesh.cells, displacement=fine)
    brought = result_candidate(path).solve(problem, Strain.GREEN, in_silence)
    seeded = budgets_of(name, brought)
    healthy = budgets_of(name, solution_of(name))
    for after, before in zip(seeded, healthy, strict=True):
        # Cells twice the size are what the case's own solution has more: all of it, in its term.
        known = after.value - before.value
        found = (after.terms[DISCRETISATION] or 0.0) - (before.terms[DISCRETISATION] or 0.0)
        assert abs(known) > 0.005 * abs(before.truth)
        assert found == pytest.approx(known, rel=WITHIN)
        assert after.terms[SOLVER] is None
        assert f"{finer.mesh.num_cells} cells" in after.candidate
        assert abs(after.interaction) < 1e-9 * abs(after.truth)


def on_bricks(name: str, divisions: tuple[int, int, int], folder: Path) -> Problem:
    """A case's problem on a mesh of bricks that shares no point inside with its own."""
    shutil.copy(builtin_folder() / f"{name}.toml", folder)
    size = np.ptp(problem_of(name).mesh.points, axis=0) * 1e3
    write_mesh(folder / f"{name}.vtu", brick_box(divisions, tuple(size.tolist())))
    return load_case(folder / f"{name}.toml").problem


def test_discretisation_of_csm1_is_the_distance_to_the_published_number() -> None:
    case = case_of("csm1")
    budget = budgets_of("csm1", solution_of("csm1"))[0]
    (check,) = (c for c in case.checks if c.against == "candidate" and c.component == "y")
    assert check.at is not None
    assert check.expected is not None
    apart = np.linalg.norm(1e3 * case.problem.mesh.points - check.at, axis=1)
    own = solution_of("csm1").displacement[int(apart.argmin())]
    known = own[1] - 1e-3 * check.expected
    # The probe is the bar's end, along the way that it goes; y is nearly all of it.
    assert abs(budget.terms[DISCRETISATION] or 0.0) == pytest.approx(abs(known), rel=WITHIN)


@pytest.mark.parametrize("name", large_by_night(("csm1", "beam"), "beam"))
def test_discretisation_is_what_meshes_without_the_reference_find(
    name: str, tmp_path: Path
) -> None:
    truth = references_of(name).truth(Strain.GREEN)
    assert truth is not None
    problem, probe = problem_of(name), farthest_probe(truth.displacement)
    position = problem.mesh.points[probe.point]
    # Three meshes of linear tetrahedra, extrapolated: neither the truth's degree nor, for the
    # beam, anything of its mesh.
    start = on_bricks(name, (24, 3, 3), tmp_path) if name == "beam" else problem
    sequence = [start, refine_problem(start)]
    sequence.append(refine_problem(sequence[1]))
    values = []
    for each in reversed(sequence):
        point = int(np.linalg.norm(each.mesh.points - position, axis=1).argmin())
        values.append(float(solve_static(each).displacement[point] @ probe.direction))
    limit = assess_grid_convergence(values, (1.0, 2.0, 4.0), expected_order=2.0).extrapolated
    assert limit is not None
    budget = budgets_of(name, solution_of(name))[0]
    known = budget.value - limit
    assert abs(known) > 0.05 * abs(limit)
    assert budget.terms[DISCRETISATION] == pytest.approx(known, rel=WITHIN)


@pytest.mark.long
@pytest.mark.nightly
def test_discretisation_of_the_kidney_is_found_within_the_bar_of_other_meshes() -> None:
    """Linear tetrahedra converge with order 0.8 here: too slowly to tell it to a tenth."""
    truth = references_of("kidney").truth(Strain.GREEN)
    assert truth is not None
    probe = farthest_probe(truth.displacement)
    sequence = [problem_of("kidney")]
    sequence.append(refine_problem(sequence[0]))
    sequence.append(refine_problem(sequence[1]))
    values = [
        float(solve_static(p).displacement[probe.point] @ probe.direction)
        for p in reversed(sequence)
    ]
    found = assess_grid_convergence(values, (1.0, 2.0, 4.0), expected_order=2.0)
    assert found.error_bar is not None
    budget = budgets_of("kidney", solution_of("kidney"))[0]
    term = budget.terms[DISCRETISATION]
    assert term is not None
    # The truth that the term leads to lies within the bar of the finest mesh ...
    assert abs(budget.value - term - found.value) <= found.error_bar
    # ... which is small enough to see the term, and which side it is on.
    assert found.error_bar < 0.6 * abs(term)
    assert abs(budget.value - found.value) > 0.5 * abs(term)


@pytest.mark.parametrize("name", CASES)
def test_a_long_time_step_is_the_error_of_time(name: str) -> None:
    still = problem_of(name)
    limit = Body(still.mesh, still.material).critical_time_step()
    # A swing of some hundred steps, damped, far from rest, at an instant at which what the step
    # costs is of second order on every case: on the kidney it passes through zero at 400.
    span = TimeSpan(300 * limit, 0.5 * limit, 1.0, 4)
    problem = dataclasses.replace(still, time=span)
    # What the step costs, measured on the candidate alone against an eighth of it.
    finest = dataclasses.replace(problem, time=dataclasses.replace(span, time_step=limit / 16.0))
    values = [simulate(p).displacements[-1] for p in (problem, finest)]
    budget = motion_budgets(problem, state_of(still, values[0]))[0]
    fine = simulate(dataclasses.replace(refine_problem(problem), time=finest.time))
    probe = farthest_probe(fine.displacements[-1][: still.mesh.num_points])
    known = float((values[0][probe.point] - values[1][probe.point]) @ probe.direction)
    assert budget.terms[TIME] == pytest.approx(known, rel=WITHIN)
    assert budget.terms[SOLVER] == 0.0


def test_terms_and_interaction_add_up_and_a_healthy_candidate_has_only_discretisation() -> None:
    for budget in budgets_of("kidney", solution_of("kidney")):
        terms = [t for t in budget.terms.values() if t is not None]
        assert sum(terms) + budget.interaction == pytest.approx(budget.total, rel=1e-12)
        assert abs(budget.interaction) < 1e-9 * abs(budget.truth)
        assert budget.terms[DISCRETISATION] == pytest.approx(budget.total, rel=1e-5)
        assert budget.terms[MODEL] is None
        assert budget.terms[TIME] is None


def test_table_and_figure_of_a_judged_case() -> None:
    budgets = case_budgets(judge(case_of("block")))
    assert {b.candidate for b in budgets} == {"fastsim, linear strain", "fastsim, Green strain"}
    columns, rows = budget_rows(budgets)
    assert len(rows) == 4
    assert all(len(row) == len(columns) for row in rows)
    # A spreadsheet reads the numbers: the unit stands at the head, what is not known is empty.
    error, time = columns.index("error [%]"), columns.index("time [%]")
    assert [float(row[error]) for row in rows] == pytest.approx(
        [100.0 * b.total / b.scale for b in budgets], rel=1e-2
    )
    assert all(row[time] == "" for row in rows)
    svg = budget_svg(budgets)
    for word in ("discretisation", "interaction", "change of volume"):
        assert word in svg
    # A legend has no colour that is not drawn: nothing here depends on time.
    assert ">time<" not in svg
    assert budget_svg([]) == ""


def test_without_a_probe_or_in_motion_there_is_no_budget() -> None:
    with pytest.raises(ValueError, match="nothing moves"):
        farthest_probe(np.zeros((4, 3)))
    motion = judge(case_of("block-motion"))
    assert case_budgets(motion) == []


def test_where_the_volume_hardly_changes_its_error_is_no_million_per_cent() -> None:
    """The change of volume of a nearly incompressible body is rounding beside its own volume."""
    problem, green = problem_of("block"), solution_of("block")
    still = references_of("block").truth(Strain.GREEN)
    assert still is not None
    same = dataclasses.replace(still, volume=problem.mesh.volume * (1.0 + 1e-9))
    budgets = static_budgets(problem, green, {(TRUTH, Strain.GREEN): same})
    (volume,) = (b for b in budgets if b.quantity == "change of volume")
    assert volume.scale == pytest.approx(1e-3 * problem.mesh.volume)
