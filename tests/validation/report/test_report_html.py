"""The report: whole, offline, and unharmed by what stands in a case."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Problem
from palpate.meshes.shapes import shape_sphere
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import for_json
from palpate.validation.report import html
from palpate.validation.report.comparisons import choose_camera, comparisons_of
from palpate.validation.report.pdf import paper_size
from palpate.validation.report.tables import provenance_rows, record_text, state_table
from palpate.validation.report.truth_record import truth_record
from palpate.validation.report.viewer import viewer_json
from palpate.validation.states import Verdict

TEMPLATES = Path(html.__file__).parent / "templates"


def test_table_one_prints_the_paper_and_the_fitted_reference(kidney: CaseResult) -> None:
    table = state_table(kidney)
    assert table.columns[0] == "paper"
    assert table.columns[-1] == "fastsim"
    truth = table.columns.index("reference P2, refined")
    rows = {(row.quantity, row.state): row.cells for row in table.rows}
    for state, growth in (("linear strain", 9.51), ("Green strain", 5.92)):
        cells = rows["volume", state]
        assert cells[0][1] == pytest.approx(growth, abs=0.005)
        # The fit: to 0.05 percentage points.
        assert cells[truth][1] == pytest.approx(growth, abs=0.05)
    assert rows["surface area", "original"][0][0] == 208017.0
    assert rows["surface area", "original"][truth][0] == pytest.approx(26400.0, rel=0.01)


def test_the_page_is_whole_and_offline(kidney: CaseResult, tmp_path: Path) -> None:
    text = html.write_report([kidney], tmp_path).read_text("utf-8")
    assert "9 passed, 1 inconclusive, 1 failed" in text
    assert "Error budget" in text
    assert "calibration, not a validation" in re.sub(r"\s+", " ", text)
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    # The one script that may run is the one that is there.
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert len(script) == 1
    digest = base64.b64encode(hashlib.sha256(script[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in text
    assert text.count("data:image/png") == 3
    assert len(text) < 5_000_000
    assert (tmp_path / "kidney-states.csv").read_text().count("\n") == 7


@pytest.mark.usefixtures("no_pictures")
def test_a_hostile_title_is_text(kidney: CaseResult, tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>"
    check = dataclasses.replace(kidney.checks[0], reason=hostile, message=hostile)
    result = dataclasses.replace(
        kidney, title=hostile, checks=(check,), verdict=Verdict.FAILED, notes=(hostile,),
        provenance={**kidney.provenance, "command": hostile},
    )  # fmt: skip
    text = html.write_report([result], tmp_path).read_text("utf-8")
    # The scene's data and our own drawing program, nothing of the case.
    assert text.count("<script") == 2
    assert text.count("</script>") == 2
    assert hostile not in text
    assert text.count("&lt;script&gt;") >= 5


@pytest.mark.usefixtures("no_pictures")
def test_no_picture_is_said_and_the_verdict_stays(kidney: CaseResult, tmp_path: Path) -> None:
    text = html.write_report([kidney], tmp_path).read_text("utf-8")
    assert "could not be drawn" in text
    assert "9 passed, 1 inconclusive, 1 failed" in text


def test_the_scene_is_the_solution(kidney: CaseResult) -> None:
    """What the 3-D view draws, unpacked again, against the states it came from."""
    scene = json.loads(viewer_json(kidney))
    mesh = kidney.problem.mesh
    used = np.unique(mesh.boundary_facets)

    def unpack(text: str, kind: str, width: int) -> np.ndarray:
        return np.frombuffer(base64.b64decode(text), dtype=kind).reshape(-1, width)

    points = unpack(scene["points"], "<f4", 3)
    facets = unpack(scene["facets"], "<u4", 3)
    assert np.array_equal(used[facets], mesh.boundary_facets)
    apart = points - mesh.points[used] * 1e3
    assert np.ptp(apart, axis=0).max() < 1e-5 * scene["radius"]  # centred, float32
    for drawn, state in zip(scene["solutions"], kidney.states, strict=True):
        displacement = unpack(drawn["displacement"], "<i2", 3) * drawn["step"]
        difference = np.abs(displacement - state.displacement[used] * 1e3).max()
        assert difference <= 0.5 * drawn["step"] * (1 + 1e-9)
        assert drawn["is_reference"] == (state.simulator == "reference")
    names = [look["name"] for look in scene["looks"]]
    assert names == [look.name(kidney.states) for look in comparisons_of(kidney)]
    assert len(scene["errors"]) == len(names) == 6
    # The best truth of Green strain comes first, and the same mesh after all truths.
    assert names[0] == "fastsim, Green strain with reference P2, refined"
    assert names[2] == "fastsim, Green strain with reference P1"
    assert [list(view) for view in scene["looks"][0]["views"]] == [
        ["error", "name"], ["original"], ["solution"], ["solution"],
    ]  # fmt: skip
    first = scene["errors"][0]
    candidate, reference = (kidney.states[first[k]] for k in ("candidate", "reference"))
    length = np.linalg.norm((candidate.displacement - reference.displacement)[used], axis=1) * 1e3
    assert unpack(first["length"], "<f4", 1)[:, 0] == pytest.approx(length, rel=1e-6)
    arrows = unpack(scene["arrows"], "<f4", 6)
    assert len(arrows) == len(kidney.problem.loads)
    assert scene["tools"] == []
    marks = unpack(scene["marks"], "<i1", 1)[:, 0]
    assert np.array_equal(used[marks == 1], np.intersect1d(used, kidney.problem.supports[0].points))
    assert (marks == -1).any()


def test_a_scale_of_errors_keeps_rounding_dark(kidney: CaseResult) -> None:
    """The same mesh's error ends far below the end of its scale, the truth's at it."""
    scene = json.loads(viewer_json(kidney))
    used = np.unique(kidney.problem.mesh.boundary_facets)
    for error in scene["errors"]:
        reference = kidney.states[error["reference"]]
        length = np.frombuffer(base64.b64decode(error["length"]), "<f4")
        assert len(length) == len(used)
        if reference.degree == 1:
            assert length.max() < 0.1 * error["largest"]
            assert error["largest"] == pytest.approx(2e-8 * scene["radius"])
        else:
            assert length.max() == pytest.approx(error["largest"])


@pytest.mark.parametrize("along", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 1, 0), (0, 0, -1)])
def test_the_camera_sees_the_largest_error_and_no_axis(along: tuple[int, int, int]) -> None:
    """Of a ball that is wrong on one side."""
    ball = shape_sphere(1.0, edge_length=0.3)
    way = np.array(along) / np.linalg.norm(along)
    yaw, pitch = choose_camera(ball.points, ball.facets, np.maximum(ball.points @ way, 0.0) ** 4)
    level = np.cos(pitch)
    eye = np.array([level * np.sin(yaw), -level * np.cos(yaw), np.sin(pitch)])
    assert eye @ way > 0.25
    assert np.abs(eye).max() < 0.95


@pytest.mark.usefixtures("no_pictures")
def test_a_motion_is_shown_time_by_time(tmp_path: Path) -> None:
    block = judge_case(load_case("block-motion"))
    scene = json.loads(viewer_json(block))
    assert scene["times"] == pytest.approx(np.linspace(0.0, 0.5, 51))
    used = np.unique(block.problem.mesh.boundary_facets)
    drawn = scene["solutions"][0]
    packed = np.frombuffer(base64.b64decode(drawn["displacement"]), "<i2").reshape(51, -1, 3)
    motion = block.states[0].trajectory
    assert motion is not None
    apart = packed * drawn["step"] - motion.displacements[:, used] * 1e3
    assert np.abs(apart).max() <= 0.51 * drawn["step"]
    assert len(base64.b64decode(scene["errors"][0]["length"])) == 51 * len(used) * 4
    text = html.write_report([block], tmp_path).read_text("utf-8")
    assert "goes through the stored times" in text
    assert "in steps of 2.50e-04 s" in text
    assert "The motion over time" in text
    assert "to reference P1" in text
    assert "to reference P2, refined" in text
    assert "a quarter of the time step" in text
    # Under four times the weight the mesh cut in eight folds at its clamp: no budget, and why.
    strong = dataclasses.replace(
        block,
        problem=dataclasses.replace(block.problem, loads=(BodyForce((0.0, 0.0, -40000.0)),)),
    )
    text = html.write_report([strong], tmp_path).read_text("utf-8")
    assert "No budget: blew up after step" in text


@pytest.mark.usefixtures("no_pictures")
def test_fifty_thousand_cells_stay_under_five_megabytes(kidney: CaseResult, tmp_path: Path) -> None:
    """A mesh of 52 920 cells with every state a case can have, pictures apart (0.4 MB)."""
    mesh = brick_box((21, 21, 20), (0.1, 0.1, 0.1))
    assert mesh.num_cells > 50_000
    rng = np.random.default_rng(3)
    states = tuple(
        dataclasses.replace(state, displacement=rng.normal(size=mesh.points.shape))
        for state in kidney.states
    )
    problem = Problem(mesh, kidney.problem.material, (), ())
    result = dataclasses.replace(kidney, problem=problem, states=states)
    assert html.write_report([result], tmp_path).stat().st_size < 4_500_000


def credibility(result: CaseResult) -> tuple[str, dict[str, tuple[str, str]]]:
    """The words of the page's part, and evidence and state of each factor."""
    page = html.credibility_html(result)
    rows = re.findall(r"<tr.*?<td>(.*?)<span.*?<td>(.*?)</td><td class=.*?>(.*?)</td>", page)
    return page, {name: (evidence, state) for name, evidence, state in rows}


def test_the_credibility_table_says_what_is_whose(kidney: CaseResult) -> None:
    page, factors = credibility(kidney)
    assert len(factors) == 13
    assert factors["numerical code verification"][1] == "given"
    name, evidence = "relevance of the quantities of interest", kidney.evidence
    assert factors[name] == (evidence["quantities_of_interest"], "given")
    # What the case does not show says what to write where.
    for name, key in (("test samples", "[[measurement]]"), ("model inputs", "[[uncertainty]]")):
        assert factors[name][1] == "not given"
        assert f"Write {key} in the case" in factors[name][0]
    assert kidney.evidence["context_of_use"] in page
    fitted = "Fitted, as [evidence] says: Poisson&#39;s ratio, force of load 1."
    assert factors["model inputs"][0].endswith(fitted)
    # With its numbers, in per cent, and its date.
    assert "stress (Green strain) 11 % (allowed: 10 %)" in factors["discretisation error"][0]
    assert "error bar is 0.36 % at most" in factors["discretisation error"][0]
    assert f"Judged {kidney.provenance['time'][:10]} by palpate" in page
    # What was fitted is read from the author, not from the words of the file.
    page, factors = credibility(
        dataclasses.replace(kidney, evidence={}, case_text="# nothing here was fitted")
    )
    assert "Not stated: the case has no context_of_use" in page
    nothing = "[evidence] of the case names none that was fitted."
    assert factors["model inputs"][0].endswith(nothing)
    stated = dataclasses.replace(
        kidney,
        evidence={
            "context_of_use": "training", "model_influence": "low", "decision_consequence": "high",
            "quantities_of_interest": "volume",
        },
    )  # fmt: skip
    page, factors = credibility(stated)
    assert "<b>Context of use.</b> training" in page
    assert "decision: low; consequence of a wrong decision: high." in page
    assert factors["relevance of the quantities of interest"][1] == "given"
    bare = dataclasses.replace(kidney, evidence={}, checks=())
    _, absent = credibility(bare)
    assert {state for _, state in absent.values()} == {"not given", "in part"}
    for name in ("numerical code verification", "equivalency of input parameters"):
        assert absent[name][1] == "not given"
        assert "against = &#34;same_mesh&#34;" in absent[name][0]
    assert (
        "quantities_of_interest in [evidence]"
        in absent["relevance of the quantities of interest"][0]
    )
    failed = [dataclasses.replace(c, verdict=Verdict.FAILED) for c in kidney.checks]
    _, red = credibility(dataclasses.replace(kidney, checks=tuple(failed)))
    assert red["numerical code verification"][1] == "in part"


def test_where_a_body_was_measured_it_is_the_comparator(kidney: CaseResult) -> None:
    """A report of measurements does not say that it has none."""
    run = dataclasses.replace(
        kidney.checks[0], metric="measured run", against="measurement", unit="mm", value=1.5,
        limit=3.0, reference_error=1.2, verdict=Verdict.PASSED,
    )  # fmt: skip
    measured = dataclasses.replace(
        kidney, checks=(*kidney.checks, run), case_text="[[measurement]]\nname = 'run'\n"
    )
    page, factors = credibility(measured)
    assert "A real body, by 1 measurement, and for verification another simulator" in page
    found, state = factors["output comparison"]
    assert "1 of 1 checks against measurements passed: measured run: 1.5 mm ± 1.2 mm" in found
    assert "not against measurements" not in found
    assert state == "given"
    assert "Another simulator, not an experiment" in credibility(kidney)[0]


@pytest.mark.usefixtures("no_pictures")
def test_a_page_has_no_keys_where_a_reader_wants_words(kidney: CaseResult, tmp_path: Path) -> None:
    """Checks, bars, inputs, loads, times: in words, and errors against the truth in per cent."""
    page = html.write_report([kidney], tmp_path).read_text("utf-8")
    body = page.partition("<body>")[2].partition("The whole record")[0]
    body = re.sub(r"<(script|style).*?</\1>", "", body, flags=re.DOTALL)
    text = " ".join(re.sub(r"<[^>]+>", " ", body).split())
    for key in ("_l2", "_max", "det_f", "surface_area", "load[0]", "poissons_ratio", "support(s)",
                "Traction", "num points", "green strain", ", green)", "+00:00"):  # fmt: skip
        assert key not in text, key
    checks = body.partition('id="checks"')[2].partition("</table>")[0]
    cells = [re.sub(r"<[^>]+>", "", c) for c in re.findall(r"<td.*?</td>", checks)]
    row = cells.index("displacement (truth, Green strain)")
    assert cells[row + 2 : row + 5] == ["5.288 %", "5 %", "0.309 %"]
    # What is left on the same mesh is as small as its limit, which is stated in the same way.
    assert cells[cells.index("displacement (same mesh, Green strain)") + 3] == "1.00e-08"
    row = cells.index("smallest det F (own, Green strain)")
    assert cells[row + 3 : row + 6] == ["&gt; 0", "–", "–"]
    # Nor has the index of several cases.
    several = [kidney, dataclasses.replace(kidney, name="other")]
    index = html.write_report(several, tmp_path).read_text("utf-8").partition("<body>")[2]
    for key in ("_l2", "(+-", "+00:00"):
        assert key not in index, key


@pytest.mark.usefixtures("no_pictures")
def test_the_page_has_the_truth_s_record(kidney: CaseResult, tmp_path: Path) -> None:
    page = html.write_report([kidney], tmp_path).read_text("utf-8")
    part = page.partition("How the truth was found</h2>")[2].partition("<h2")[0]
    reference = kidney.provenance["reference"]
    green = reference["adaptive"]["green"]
    for words in (
        " → ".join(map(str, green["cells"])),
        f"{green['unknowns'][-1]} unknowns on the last",
        html.for_html(green["ended"]),
        reference["date"],
        reference["accepted"]["by"],
        reference["sha256"],
        "discretisation 0.31 %",
    ):
        assert words in part, words
    facts, bars = truth_record(dataclasses.replace(kidney, provenance={}))
    assert [name for name, _ in facts] == ["stored truth"]
    assert bars == ()


@pytest.mark.usefixtures("no_pictures")
def test_only_a_case_that_says_so_is_said_to_be_fitted(tmp_path: Path, kidney: CaseResult) -> None:
    page = html.write_report([kidney], tmp_path).read_text("utf-8")
    assert "Poisson&#39;s ratio, force of load 1" in page.partition("The states")[0]
    assert "208 017" in page
    mine = {**kidney.published, "how_to_read": "A table of mine."}
    other = dataclasses.replace(kidney, evidence={}, published=mine)
    page = html.write_report([other], tmp_path).read_text("utf-8").partition("The states")[0]
    assert "A table of mine." in page
    assert "itted" not in page


def test_paper_has_no_keys_that_are_commented_out() -> None:
    lines = {
        "# Prose of the case, E = 3 kPa.": True,
        "title = 'x'  # y = 2": True,
        "# [time]": False,
        "#end_time = 0.5": False,
        "  # a.b = 1": False,
        "#   volume: error of the deformed volume": False,
        "#   volume: my own words on it": True,
    }
    assert html.case_lines("\n".join(lines)) == list(lines.items())


@pytest.mark.parametrize(
    ("given", "size"),
    [
        ({"LANG": "en_US.UTF-8"}, "letter"),
        ({"LANG": "en_US.UTF-8", "LC_PAPER": "de_DE.UTF-8"}, "A4"),
        ({"LANG": "de_DE", "LC_ALL": "es_MX@x"}, "letter"),
        ({"LANG": "C.UTF-8"}, "A4"),
        ({}, "A4"),
    ],
)
def test_paper_is_that_of_the_locale(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], size: str
) -> None:
    for name in ("LC_ALL", "LC_PAPER", "LANG"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert paper_size() == size


def test_a_few_rows_say_where_a_result_comes_from(kidney: CaseResult) -> None:
    rows = dict(provenance_rows(kidney.provenance))
    assert rows["palpate"] == kidney.provenance["palpate"]
    hashes = [value for name, value in rows.items() if name.startswith("hash of")]
    assert hashes == [kidney.provenance[key] for key in ("case_key", "input_key")]
    assert "4860 cells" in rows["mesh"]
    assert f"dolfinx {kidney.provenance['reference']['versions']['dolfinx']}" in rows["with"]
    own = {name: value for name, value in rows.items() if name != "command"}  # pytest's here
    assert all(len(value) < 300 for value in own.values())
    assert provenance_rows({}) == []
    assert json.loads(record_text(kidney.provenance)) == for_json(kidney.provenance)


@pytest.mark.parametrize("path", sorted(TEMPLATES.glob("*.j2")), ids=lambda path: path.stem)
def test_what_scrolls_is_reached_by_keys_and_pages_have_their_landmark(path: Path) -> None:
    text = path.read_text("utf-8")
    scrolling = re.findall(r"<\w+[^>]*class=\"scroll\"[^>]*>", text)
    assert [tag for tag in scrolling if 'tabindex="0"' not in tag] == []
    assert ("<body" in text) == ("<main" in text)
