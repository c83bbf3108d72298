"""`palpate gate --versus`: two simulators without a reference; `--law`: another than the case's."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import palpate
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.candidate import fastsim_candidate, function_candidate
from palpate.validation.judging.versus import _are_identical, judge_versus, read_limits
from palpate.validation.peers import adapters
from palpate.validation.states import Verdict

NUMPY = f"{sys.executable} {Path(adapters.__file__).parent / 'numpy_dense.py'} {{case}} {{result}}"


def stretched_by(factor):
    def mine(problem):
        return factor * palpate.solve(problem).displacement

    return function_candidate(mine)


def checked(result, metric):
    return next(check for check in result.checks if check.metric == metric)


def test_the_difference_is_a_part_of_the_second_solution() -> None:
    case = palpate.load_case("block")
    limits = {"displacement_l2": 0.02, "displacement_max": 0.005}
    result = judge_versus(case, stretched_by(1.01), fastsim_candidate(), limits=limits)
    assert checked(result, "displacement_l2").value == pytest.approx(0.01, rel=1e-9)
    assert checked(result, "displacement_l2").verdict is Verdict.PASSED
    assert checked(result, "displacement_max").verdict is Verdict.FAILED
    assert result.verdict is Verdict.FAILED
    # What nobody set a limit for is told, and decides nothing.
    reported = checked(result, "strain_energy")
    assert reported.verdict is Verdict.SKIPPED
    assert reported.value > 0.01


def test_the_cases_own_limits_on_the_same_mesh_are_taken_where_none_is_given() -> None:
    case = palpate.load_case("block")
    near = judge_versus(case, stretched_by(1.0 + 1e-12), fastsim_candidate())
    assert near.verdict is Verdict.PASSED
    assert judge_versus(case, stretched_by(1.0 + 1e-6), fastsim_candidate()).verdict == "failed"


def test_who_fails_is_named_and_two_that_stand_still_prove_nothing() -> None:
    case, limits = palpate.load_case("block"), {"displacement_l2": 0.1}

    def broken(_problem):
        raise RuntimeError("out of rubber")

    for pair in ((broken, np.copy), (np.copy, broken)):
        one, other = (function_candidate(each) for each in pair)
        if one.name == "copy":
            one = fastsim_candidate()
        else:
            other = fastsim_candidate()
        result = judge_versus(case, one, other, limits=limits)
        assert result.verdict is Verdict.FAILED
        assert "broken: RuntimeError: out of rubber" in result.checks[0].message
    still = judge_versus(case, stretched_by(0.0), stretched_by(0.0), limits=limits)
    assert still.verdict is Verdict.INCONCLUSIVE


def test_garbage_against_itself_is_no_pass_and_the_cases_own_checks_are_made() -> None:
    case, limits = palpate.load_case("block"), {"displacement_l2": 0.1}
    garbage = np.random.default_rng(3).uniform(-1.0, 1.0, case.problem.mesh.points.shape)
    garbage *= 0.1 * np.ptp(case.problem.mesh.points)

    def noisy(scale):
        return function_candidate(lambda _problem: scale * garbage)

    for other in (1.0, 1.001):
        result = judge_versus(case, noisy(1.0), noisy(other), limits=limits)
        assert checked(result, "displacement_l2").verdict is Verdict.PASSED
        own = checked(result, "inverted_cells")
        assert (own.verdict, own.against) == (Verdict.FAILED, "candidate")
        assert result.verdict is Verdict.FAILED
    # Whichever of the two it is.
    for pair in ((noisy(1.0), fastsim_candidate()), (fastsim_candidate(), noisy(1.0))):
        own = checked(judge_versus(case, *pair, limits=limits), "inverted_cells")
        assert own.verdict is Verdict.FAILED
        assert own.message.startswith("<lambda>: ")


def test_a_published_number_is_checked_of_both() -> None:
    case, limits = palpate.load_case("cantilever"), {"displacement_l2": 0.01}
    number = next(s for s in case.checks if s.against == "candidate" and s.about.is_published)
    pair = stretched_by(3.0), stretched_by(3.01)
    found = checked(judge_versus(case, *pair, limits=limits), number.metric)
    assert found.verdict is Verdict.FAILED


@pytest.mark.parametrize(("noise", "verdict"), [(0.0, "inconclusive"), (1e-16, "inconclusive"),
                                                (1e-12, "passed")])  # fmt: skip
def test_two_identical_results_are_said_to_be_and_are_no_evidence(noise, verdict) -> None:
    case = palpate.load_case("block")
    result = judge_versus(case, stretched_by(1.0 + noise), stretched_by(1.0))
    assert result.verdict == verdict
    said = any("identical to rounding" in note for note in result.notes)
    assert said == (verdict == "inconclusive")


@pytest.mark.parametrize(
    "word",
    ["displacement_l2", "displacement_l2=-1", "displacement_l2=nan", "inverted_cells=1", "x=1"],
)
def test_a_limit_that_is_none_is_refused(word) -> None:
    with pytest.raises(InputError, match="--limit"):
        read_limits([word])
    with pytest.raises(InputError, match="already"):
        read_limits(["volume=1", "volume=2"])


def test_the_gate_ends_by_the_limits_of_the_command_line(command_line, tmp_path) -> None:
    path = tmp_path / "r.json"
    given = ("gate", "stretch", "--simulator", NUMPY, "--versus", "fastsim", "--json", path)
    assert command_line(*given, "--limit", "volume=1e-9") == 0
    (case,) = json.loads(path.read_text("utf-8"))["cases"]
    assert 0.0 < case["checks"][0]["value"] < 1e-9
    same = ("gate", "stretch", "--simulator", NUMPY, "--versus", NUMPY)
    assert command_line(*same, "--limit", "volume=1e-9") == 3
    # Linear tetrahedra on a bent body are not smoothed ones.
    block = ("gate", "shear", "--element", "smoothed", "--versus", NUMPY)
    assert command_line(*block, "--limit", "displacement_l2=1e-9", "--fault", "softer") == 1
    assert command_line(*block, "--limit", "trajectory_l2=1e-9") == 2
    assert command_line("gate", "stretch", "--limit", "volume=1") == 2
    assert command_line(*given, "--live") == 2


def test_a_case_under_another_law_keeps_its_moduli_and_drops_published_numbers() -> None:
    case = palpate.load_case("column")
    other = case.under(Law.NEO_HOOKEAN)
    assert other.name == "column-neo-hookean"
    old, new = case.problem.material, other.problem.material
    assert (new.youngs_modulus, new.poissons_ratio) == (old.youngs_modulus, old.poissons_ratio)
    assert new.law is Law.NEO_HOOKEAN
    assert len(other.checks) == 5
    assert case.under(Law.SAINT_VENANT_KIRCHHOFF) is case
    with pytest.raises(InputError, match="c10"):
        case.under(Law.MOONEY_RIVLIN)


def test_no_stored_reference_is_taken_for_another_law(command_line, monkeypatch, capsys) -> None:
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: False)
    assert command_line("gate", "block", "--law", "neo-hookean-stable") == 2
    assert "FEniCSx" in capsys.readouterr().err


@pytest.mark.nightly  # two truths: a minute and a half
@pytest.mark.dolfinx
def test_one_simulator_is_judged_under_two_laws_side_by_side(
    command_line, tmp_path, write_case
) -> None:
    path = tmp_path / "r.json"
    laws = ("--law", "neo-hookean", "--law", "saint-venant-kirchhoff")
    case = write_case(("edge_length = 0.5", "edge_length = 1.0"))
    code = command_line("gate", case, *laws, "--live", "--simulator", NUMPY, "--json", path)
    assert code == 1  # it knows but one of them
    other, own = json.loads(path.read_text("utf-8"))["cases"]
    assert (other["name"], other["verdict"]) == ("block-neo-hookean", "failed")
    assert (own["name"], own["verdict"]) == ("block", "passed")


def test_each_of_the_two_is_named_and_own_checks_are_those_of_the_cases_strain(tmp_path) -> None:
    case = palpate.load_case("block")
    result = judge_versus(case, stretched_by(1.01), fastsim_candidate(), limits={"volume": 0.1})
    assert [c.name for c in result.candidates] == ["mine against fastsim"]
    path = tmp_path / "straight.toml"
    shutil.copy(case.path.parent / "block.vtu", tmp_path)
    path.write_text(
        case.path.read_text("utf-8").replace('strain = "green"', 'strain = "linear"', 1)
        + '[[check]]\nmetric = "smallest_det_f"\nagainst = "candidate"\nstrain = "green"\n'
        'limit = 0.0\nreason = "of the other strain measure"\n',
        "utf-8",
    )
    linear = palpate.load_case(path)
    found = judge_versus(linear, stretched_by(1.01), fastsim_candidate(), limits={"volume": 0.1})
    assert {c.strain for c in found.checks} == {"linear"}


def test_results_on_meshes_of_their_own_of_other_sizes_are_not_identical() -> None:
    def of(*shapes: int) -> Any:
        fields = [np.zeros((number, 3)) for number in shapes]
        return SimpleNamespace(max_displacement=1.0, fields=fields)

    assert _are_identical(of(8), of(8))
    for one, other in ((of(8), of(9)), (of(1), of(8)), (of(8), of(1)), (of(8, 8), of(8))):
        assert not _are_identical(one, other)
