"""Linear and smoothed tetrahedra: each is judged by its own element on the same mesh.

Faults seeded into the smoothed element turn that check red: a candidate of NumPy alone solves the
linear case densely by the averages it is given, the right ones or with one mistake in them.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from judged import (
    GREEN,
    LINEAR,
    case_of,
    judged_by,
    on_same_mesh,
    references_of,
    sending,
    state_of,
    stored,
)

from palpate.meshes.problem import Element
from palpate.meshes.tet_mesh import EDGES, signed_volumes
from palpate.validation.candidates.candidate import (
    Candidate,
    fastsim_candidate,
    result_candidate,
)
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.checks import STATED
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.run_comparison import compare_runs
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.laws import strain_of
from palpate.validation.references.reference_set import SAME_MESH, SMOOTHED, ReferenceSet
from palpate.validation.report.html import write_report
from palpate.validation.states import Verdict


def solution(tmp_path, label, stated, asked=None):
    """A result file with a stored displacement that states its element, or nothing."""
    about = {} if stated is None else {"about": json.dumps({"element": stated})}
    np.savez(tmp_path / "mine.npz", displacement=stored("block", label).displacement, **about)
    return result_candidate(tmp_path / "mine.npz", asked)


@pytest.mark.parametrize(
    ("label", "stated", "asked", "verdict"),
    [
        (SMOOTHED, "smoothed", Element.SMOOTHED, Verdict.PASSED),
        (SMOOTHED, None, Element.SMOOTHED, Verdict.PASSED),
        (SMOOTHED, "linear", Element.SMOOTHED, Verdict.PASSED),
        (SMOOTHED, "smoothed", None, Verdict.FAILED),
        (SMOOTHED, None, None, Verdict.FAILED),
        (SAME_MESH, "smoothed", None, Verdict.PASSED),
        (SAME_MESH, None, Element.SMOOTHED, Verdict.FAILED),
        (SAME_MESH, "of my own making", None, Verdict.PASSED),
        (SAME_MESH, None, None, Verdict.PASSED),
    ],
)
def test_a_solution_is_compared_with_the_element_that_is_asked_for(
    tmp_path, label, stated, asked, verdict
):
    given = solution(tmp_path, label, stated, asked)
    result = judge_case(case_of("block"), candidate=given, diagnoses=False)
    is_smoothed = asked is Element.SMOOTHED
    for check in on_same_mesh(result):
        if check.strain is GREEN:
            assert check.verdict is verdict, check.name
            assert (check.element is Element.SMOOTHED) == is_smoothed
            assert ("smoothed" in check.name) == is_smoothed
    used, other = (SMOOTHED, SAME_MESH) if is_smoothed else (SAME_MESH, SMOOTHED)
    assert not any(state.label == other for state in result.states)
    assert any(name.endswith(f"- {used}, green") for name in result.error_fields)
    # Another element that palpate knows is a difference; words that it does not know are shown.
    differs = stated in ("linear", "smoothed") and (stated == "smoothed") != is_smoothed
    said = [check for check in result.checks if check.metric == STATED]
    assert [check.verdict for check in said] == [Verdict.FAILED] * differs
    if differs:
        assert f"--element {stated}" in said[0].message
    assert stated is None or any(stated in note for note in result.notes)


def test_without_a_reference_of_its_element_a_solution_is_inconclusive(tmp_path, monkeypatch):
    known = references_of("block")
    states = {key: state for key, state in known.states.items() if key[0] != SMOOTHED}
    without = dataclasses.replace(known, states=states)
    given = solution(tmp_path, SMOOTHED, "smoothed", Element.SMOOTHED)
    result = judged_by(without, monkeypatch, case_of("block"), candidate=given, diagnoses=False)
    checks = [check for check in on_same_mesh(result) if check.strain is GREEN]
    assert {check.verdict for check in checks} == {Verdict.INCONCLUSIVE}
    assert "palpate reference build block`" in checks[0].message
    assert result.verdict is Verdict.INCONCLUSIVE


@pytest.fixture(scope="module")
def both():
    """fastsim beside a candidate that sends the reference's smoothed solutions, 1 % too large."""

    def solve(problem, strain, _progress):
        right = stored("block", SMOOTHED, strain)
        moved, more = 1.01 * right.displacement, {"element": Element.SMOOTHED}
        return dataclasses.replace(state_of(problem, moved, strain, **more), volume=right.volume)

    mine = Candidate("mine", solve, has_both_strains=True, element=Element.SMOOTHED)
    return judge_case(case_of("block"), candidate=[fastsim_candidate(), mine])


def test_two_candidates_stand_beside_one_another(both):
    assert [(one.name, one.verdict) for one in both.candidates] == [
        ("fastsim", Verdict.PASSED),
        ("mine", Verdict.FAILED),
    ]
    assert both.verdict is Verdict.FAILED
    names = [check.name for check in both.checks]
    assert len(set(names)) == len(names) == 2 * len(case_of("block").checks)
    assert {"fastsim", "mine", SAME_MESH, SMOOTHED} <= {state.label for state in both.states}
    for key in ("green", "green.smoothed"):
        assert f"error.same_mesh.{key}.displacement_l2" in both.metrics
    # The mistake is found in the smoothed solution, by the equations and reference of its element.
    assert {found.element for found in both.diagnoses} == {Element.SMOOTHED}


def test_every_output_keeps_the_two_apart(both, tmp_path):
    document = json.loads(outputs.results_json([both], "1"))["cases"][0]
    assert [(c["name"], c["element"], c["verdict"]) for c in document["candidates"]] == [
        ("fastsim", "linear", "passed"),
        ("mine", "smoothed", "failed"),
    ]
    assert {check["element"] for check in document["checks"]} == {"linear", "smoothed"}
    tests = ET.fromstring(outputs.junit_xml([both])).iter("testcase")
    names = [test.get("name") for test in tests]
    assert len(set(names)) == len(names)
    summary = outputs.summary_markdown([both])
    assert "  - fastsim: passed" in summary
    assert "  - mine: failed" in summary
    path = tmp_path / "results.json"
    path.write_text(outputs.results_json([both], "1"), encoding="utf-8")
    pairs = compare_runs(path, path).pairs
    assert len(pairs) == len(both.checks)
    assert {pair.change for pair in pairs} == {"same"}


def test_the_page_shows_both_beside_the_reference(both, tmp_path):
    page = write_report([both], tmp_path).read_text("utf-8")
    for text in (
        "<strong>fastsim: same mesh only</strong>",
        "<strong>mine: failed</strong>",
        "Green strain: fastsim and mine with reference P2, refined",
        "Green strain: fastsim with reference P1, mine with reference smoothed",
    ):
        assert text in page
    assert "mine with reference P1" not in page
    table = (tmp_path / "block-states.csv").read_text("utf-8").splitlines()[0]
    assert "fastsim" in table
    assert "mine" in table


# ---------------------------------------------------------------- mistakes in the smoothed element
INCLUSION = """
[[inclusion]]
region = { box = { min = [20.0, -1.0, -1.0], max = [41.0, 26.0, 21.0] } }
material = { youngs_modulus = 40.0, poissons_ratio = 0.3, density = 1000.0 }
"""


def means(problem, kind, corners, values, mistake):
    """Mean over a cell's edges or nodes of the means around them, (num_cells, k).

    Args:
        kind: A number for each cell: cells of different ones are not averaged together.
        corners: The edges or nodes of each cell, by numbers of their own, (num_cells, 6 or 4).
        values: (num_cells, k).
    """
    mesh, (_, size) = problem.mesh, corners.shape
    _, patches = np.unique(corners * (kind.max() + 1) + kind[:, None], return_inverse=True)
    patches = patches.reshape(corners.shape)
    weights = np.repeat(signed_volumes(mesh.points, mesh.cells)[:, None], size, axis=1)
    if mistake == "one edge counts twice in one cell" and size == 6:
        weights[1, 1] *= 2.0
    volumes = np.bincount(patches.ravel(), weights.ravel())
    if mistake == "the volume of a node lacks one cell" and size == 4:
        volumes[patches[0, 0]] -= weights[0, 0]
    sums = np.zeros((len(volumes), values.shape[1]))
    np.add.at(sums, patches, weights[:, :, None] * values[:, None])
    return (sums / volumes[:, None])[patches].mean(axis=1)


def solve_smoothed(problem, mistake=""):
    """The linear equilibrium [m] by a dense matrix of the smoothed element."""
    body, mesh = Body(problem, LINEAR), problem.mesh
    _, kind = np.unique(np.column_stack([body.lmbda, body.mu]), axis=0, return_inverse=True)
    kind = np.zeros(mesh.num_cells, int) if mistake == "across materials" else kind.ravel()
    ends = np.sort(mesh.cells[:, EDGES].astype(np.int64), axis=2)
    edges, nodes = ends[:, :, 0] * mesh.num_points + ends[:, :, 1], mesh.cells.astype(np.int64)

    def force(u):
        strain = strain_of(body.gradient(u), LINEAR)
        of_edges = means(problem, kind, edges, strain.reshape(-1, 9), mistake).reshape(-1, 3, 3)
        traces = np.trace(strain, axis1=1, axis2=2)[:, None]
        theta = means(problem, kind, nodes, traces, mistake)[:, :, None]
        lmbda, mu = body.lmbda[:, None, None], body.mu[:, None, None]
        return body.force_of(2.0 * mu * of_edges + lmbda * theta * np.eye(3))

    shape, free = mesh.points.shape, np.flatnonzero(~body.fixed.ravel())
    unit = np.eye(mesh.points.size)
    K = np.stack([force(unit[k].reshape(shape)).ravel()[free] for k in free], axis=1)
    u = np.zeros(mesh.points.size)
    u[free] = np.linalg.solve(K, body.external(np.zeros(shape)).ravel()[free])
    return u.reshape(shape)


def verdict_on(case, mistake, references, monkeypatch):
    """Of the linear check on the same mesh; Green strain is answered by the reference."""

    def make(problem, strain):
        if strain is LINEAR:
            return solve_smoothed(problem, mistake)
        return stored("block", SMOOTHED).displacement

    mine = dataclasses.replace(
        sending(make, element=Element.SMOOTHED), has_both_strains=True, element=Element.SMOOTHED
    )
    result = judged_by(references, monkeypatch, case, candidate=mine, diagnoses=False)
    (check,) = [c for c in result.checks if c.strain is LINEAR]
    assert (check.against, check.element) == ("same_mesh", Element.SMOOTHED)
    return check.verdict


@pytest.mark.parametrize(
    ("mistake", "expected"),
    [
        ("", Verdict.PASSED),
        ("one edge counts twice in one cell", Verdict.FAILED),
        ("the volume of a node lacks one cell", Verdict.FAILED),
        # One material: there is nothing to smooth across.
        ("across materials", Verdict.PASSED),
    ],
)
def test_a_wrong_average_fails_on_the_same_mesh(mistake, expected, monkeypatch):
    references = references_of("block")
    assert verdict_on(case_of("block"), mistake, references, monkeypatch) is expected


def test_smoothing_across_a_material_fails_on_the_same_mesh(tmp_path, monkeypatch):
    shutil.copy(builtin_folder() / "block.vtu", tmp_path)
    text = case_of("block").text.replace("[[check]]", INCLUSION + "\n[[check]]", 1)
    (tmp_path / "two.toml").write_text(text, encoding="utf-8")
    case = load_case(str(tmp_path / "two.toml"))
    assert len(case.problem.inclusions) == 1
    # Split by material, as the judge's own smoothed tetrahedra are.
    right = solve_smoothed(case.problem)
    left, scale = Body(case.problem, LINEAR, Element.SMOOTHED).out_of_balance(right)
    assert np.abs(left).max() <= 1e-10 * scale
    about = {"label": SMOOTHED, "simulator": "reference", "element": Element.SMOOTHED}
    state = state_of(case.problem, right, LINEAR, **about)
    references = ReferenceSet({(SMOOTHED, LINEAR): state}, {}, "made here")
    for mistake, expected in (("", Verdict.PASSED), ("across materials", Verdict.FAILED)):
        assert verdict_on(case, mistake, references, monkeypatch) is expected
