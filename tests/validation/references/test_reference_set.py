"""The reference of a case when it honestly has none: a load beyond the material's limit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from judged import judge, references_of

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceFailedError,
    ReferenceNotConvergedError,
)
from palpate.validation.case import load_case
from palpate.validation.judging.case_references import find_references
from palpate.validation.metrics.numbers import Number
from palpate.validation.references import solved_again, statics
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, TRUTH
from palpate.validation.references.runs import solve_reference
from palpate.validation.references.solved_again import Comparison
from palpate.validation.references.statics import solve_live
from palpate.validation.states import CellStresses, State, Verdict

WriteCase = Callable[..., Path]
LOST = ReferenceNotConvergedError(0.504, "a cell would invert", 0.33)


def crash() -> None:
    """No graded meshes here."""
    raise ReferenceCrashedError(-9, "")


def fake_solves(
    monkeypatch: pytest.MonkeyPatch, failure: ReferenceFailedError
) -> list[tuple[Strain, int]]:
    """Replace the solves: P1 with Green strain fails, the others answer rest; returns the calls."""
    calls: list[tuple[Strain, int]] = []

    def solve(problem: Problem, strain: Strain, degree: int, *_: object, **_words: object) -> State:
        calls.append((strain, degree))
        if strain is Strain.GREEN and degree == 1:
            raise failure
        return State(
            label=SAME_MESH if degree == 1 else QUADRATIC,
            simulator="reference",
            strain=strain,
            degree=degree,
            displacement=np.full_like(problem.mesh.points, 1e-3),
            volume=problem.mesh.volume,
            surface_area=problem.mesh.surface_area,
            smallest_det_f=1.0,
            max_displacement=1e-3,
            seconds=0.0,
            details={"versions": {}},
        )

    monkeypatch.setattr(statics, "solve_state", solve)
    monkeypatch.setattr(statics, "refine_truth", lambda *_args, **_words: crash())
    return calls


def test_p2_is_not_tried_where_p1_lost_equilibrium(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = fake_solves(monkeypatch, LOST)
    references = solve_live(load_case(str(write_case())).problem, lambda _line: None)
    assert (Strain.GREEN, 2) not in calls
    assert {(Strain.LINEAR, 1), (Strain.LINEAR, 2), (Strain.GREEN, 1)} == set(calls)
    assert references.truth(Strain.GREEN) is None
    why = references.failure("truth", Strain.GREEN)
    assert "not tried" in why
    assert "0.504 of the load" in why


def test_p2_is_still_tried_where_p1_only_crashed(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = fake_solves(monkeypatch, ReferenceCrashedError(-9, ""))
    references = solve_live(load_case(str(write_case())).problem, lambda _line: None)
    assert (Strain.GREEN, 2) in calls
    assert references.truth(Strain.GREEN) is not None


def test_the_result_says_that_there_is_no_equilibrium_to_compare_with(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.reference import availability

    fake_solves(monkeypatch, LOST)
    monkeypatch.setattr(availability, "is_available", lambda: True)
    result = judge(load_case(str(write_case())), live=True)
    assert result.verdict is Verdict.INCONCLUSIVE
    assert any("not tried" in note and "0.504" in note for note in result.notes)
    assert any("0.504 of the load" in check.message for check in result.checks)


@pytest.mark.dolfinx
@pytest.mark.long
@pytest.mark.nightly
def test_a_crushed_block_costs_one_search_for_the_limit(write_case: WriteCase) -> None:
    """Free compression to P/E = -0.6, three times the limit of 0.19245: both strains, P1 and P2."""
    case = load_case(str(write_case(("force = [60.0, 20.0, -10.0]", "force = [-600.0, 0.0, 0.0]"))))
    lines: list[str] = []
    references = solve_live(case.problem, lines.append)
    why = references.failure("truth", Strain.GREEN)
    assert "not tried" in why
    assert references.truth(Strain.LINEAR) is not None
    assert not any(line.startswith(f"{QUADRATIC}, green") for line in lines)


@pytest.mark.parametrize(("live", "words"), [(False, "--live"), (True, "FENICSX=")])
def test_a_case_without_any_reference_says_what_to_do(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch, live: bool, words: str
) -> None:
    from palpate.reference import availability

    monkeypatch.setattr(availability, "is_available", lambda: False)
    with pytest.raises(InputError, match="no reference is stored") as caught:
        judge(load_case(str(write_case())), live=live)
    assert words in str(caught.value)


@pytest.mark.dolfinx
def test_a_motion_solved_here_comes_as_a_set_of_motions() -> None:
    problem = load_case("wave").problem
    assert problem.time is not None
    span = dataclasses.replace(problem.time, end_time=problem.time.end_time / 50, num_outputs=2)
    short = dataclasses.replace(problem, time=span)
    found = solve_live(short, lambda _line: None, wanted={"same_mesh"})
    states = [found.states[SAME_MESH, strain] for strain in Strain]
    assert all(state.trajectory is not None for state in states)


def test_states_of_one_mesh_are_compared_or_said_to_be_absent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What allows nothing lets no distance pass but none."""
    assert Comparison("volume", 0.0).verdict is Verdict.PASSED
    assert Comparison("volume", 1e-30).verdict is Verdict.FAILED
    assert Comparison("volume", None, why="absent").verdict is Verdict.INCONCLUSIVE
    case = load_case("block")
    stored = find_references(case, live=False, progress=lambda _line: None)
    for found, verdict in (
        (stored, Verdict.PASSED),
        (dataclasses.replace(stored, states={}), Verdict.INCONCLUSIVE),
    ):
        monkeypatch.setattr(solved_again, "solve_live", lambda *_, found=found, **__: found)
        compared = solved_again.compare_anew(
            case.problem, stored, TruthRequest(), 1.0, lambda _line: None
        )
        assert {c.verdict for c in compared} == {verdict}
        assert all(("absent" in str(c)) is (verdict is not Verdict.PASSED) for c in compared)


def test_degree_three_is_for_statics() -> None:
    problem = load_case("block-motion").problem
    with pytest.raises(InputError, match="degree 3 is for statics"):
        solve_reference(problem, Strain.GREEN, 3, lambda _line: None)


def test_a_number_that_a_solution_does_not_have_has_no_finite_bar() -> None:
    references, problem = references_of("block"), load_case("block").problem
    solved_here = {key: s for key, s in references.states.items() if key[0] != TRUTH}
    key = QUADRATIC, Strain.GREEN
    none = np.zeros((problem.mesh.num_cells, 3, 3))
    solved_here[key] = dataclasses.replace(solved_here[key], stresses=CellStresses(none, none))
    here = dataclasses.replace(references, states=solved_here)
    asked = problem, Strain.GREEN, "published_energy", "energy"
    known = here.bar_of_number(*asked, lambda _state: Number(2.0, scale=4.0))
    assert 0.0 <= known < 1e-6
    assert here.bar_of_number(*asked, lambda _state: None) == math.inf
    assert here.bar_of_number(*asked, lambda _state: Number(2.0, scale=0.0)) == math.inf
