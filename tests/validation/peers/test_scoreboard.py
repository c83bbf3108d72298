"""Seeded errors land in their own column; failures and refusals are shown; pages need no server."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.statics import solve_static
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain, with_law
from palpate.validation.cached_results import ResultCache
from palpate.validation.candidates.candidate import candidates_for, fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.cli import main
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.error_budget import farthest_probe
from palpate.validation.peers import adapters
from palpate.validation.peers.board import compute_board
from palpate.validation.peers.board_judge import CONTACT, LAW, MESH, SOLVER, STEP, Score, judge_run
from palpate.validation.peers.board_page import reason, write_board
from palpate.validation.peers.board_references import OwnSteps, Truth
from palpate.validation.peers.board_runs import Run, Status
from palpate.validation.peers.registry import Peer, peers_on_board, read_peers
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.states import State, Verdict, in_silence

FOLDER = Path(adapters.__file__).parent
DESCENT = (
    f"{sys.executable} {FOLDER / 'vertex_block_descent.py'} {{case}} {{result}} {{iterations}}"
)
COPY = Peer(name="copy", title="copy", command="copy {case} {result}")
NUMPY = f"{sys.executable} {FOLDER / 'numpy_dense.py'} {{case}} {{result}}"
# Somebody else's program: it solves every case by `solution`.
PROGRAM = """
import json, sys
from pathlib import Path
{solution}
import numpy as np
key = json.loads(Path(sys.argv[1], "case.json").read_text("utf-8"))["case_key"]
np.savez(sys.argv[2], displacement=u, case_key=key)
"""
FAULTS = {
    "crashes": "sys.exit('out of rubber')",
    "nan": "import numpy; u = numpy.full((12, 3), numpy.nan)",
    "refuses": "print('no blocks today'); sys.exit(77)",
    "sleeps": "import time; time.sleep(60)",
}


def program(folder: Path, name: str, solution: str | NDArray[np.float64]) -> Peer:
    path = folder / f"{name}.py"
    if not isinstance(solution, str):
        np.save(folder / f"{name}.npy", solution)
        solution = f"import numpy; u = numpy.load({str(folder / name) + '.npy'!r})"
    path.write_text(PROGRAM.format(solution=solution), encoding="utf-8")
    return Peer(name=name, title=name, command=f"{sys.executable} {path} {{case}} {{result}}")


def board_of(folder, entries, cases, time_limit=60.0, processes=None):
    loaded = [load_case(name) for name in cases]
    return compute_board(
        entries,
        loaded,
        ResultCache(folder / "cached"),
        time_limit=time_limit,
        progress=in_silence,
        processes=processes,
    )


def at_vertices(problem):
    """The same with its tools' contact taken at vertices."""
    tools = tuple(dataclasses.replace(tool, contact="vertices") for tool in problem.tools)
    return dataclasses.replace(problem, tools=tools)


def seeded(case, displacement):
    """What an solution adds to that of the same mesh, as the board reads it."""
    references = find_references(case, live=False, progress=in_silence)
    truth = references.truth(case.strain).displacement
    probe = farthest_probe(truth)
    added = displacement - references.same_mesh(case.strain).displacement
    return float(added[probe.point] @ probe.direction) / float(truth[probe.point] @ probe.direction)


@pytest.mark.parametrize(
    ("name", "cause", "solution"),
    [
        ("shear", LAW, lambda p: solve_static(with_law(p, Law.NEO_HOOKEAN))),
        ("cantilever", SOLVER, lambda p: relax(p, relative_tolerance=0.1)),
        ("cantilever", MESH, solve_static),
        ("press", CONTACT, lambda p: solve_static(at_vertices(p))),
    ],
)
def test_a_seeded_error_lands_in_its_own_column(tmp_path, name, cause, solution) -> None:
    case = load_case(name)
    wrong = solution(case.problem).displacement
    board = board_of(tmp_path, [program(tmp_path, "copy", wrong)], [name])
    (score,) = board.scores.values()
    added = seeded(case, wrong)
    if cause == MESH:  # nothing was seeded: linear tetrahedra are stiff, and that is all
        assert score.causes[MESH] < -0.3
        assert abs(added) < 1e-6
    else:
        assert abs(added) > 0.03
        assert score.causes[cause] == pytest.approx(added, rel=0.1)
    assert (score.follows != "") == (cause == LAW)
    assert (SOLVER in score.causes) == (cause != CONTACT)
    # A program that states no force on a tool has it wrong by any measure.
    assert score.tool_force == (np.inf if cause == CONTACT else None)
    for other in {LAW, SOLVER} & set(score.causes) - {cause}:
        assert abs(score.causes[other]) < 0.1 * max(abs(added), 1e-6)
    assert sum(score.causes.values()) == pytest.approx(added + score.causes[MESH], abs=1e-9)


def test_a_failure_a_refusal_and_a_hang_are_shown_and_stop_nothing(tmp_path) -> None:
    everybody = [program(tmp_path, name, solution) for name, solution in FAULTS.items()]
    right = solve_static(load_case("stretch").problem).displacement
    everybody.append(program(tmp_path, "right", right))
    sleeper = everybody.pop(list(FAULTS).index("sleeps"))
    (slept,) = board_of(tmp_path, [sleeper], ["stretch"], time_limit=1.0).scores.values()
    board = board_of(tmp_path, everybody, ["stretch"])
    crashed, nan, refused, right = board.of_case(board.cases[0])
    assert (crashed.verdict, nan.verdict, slept.verdict) == (Verdict.FAILED,) * 3
    assert "out of rubber" in crashed.why
    assert "NaN" in nan.why
    assert "no result within 1 s" in slept.why
    assert refused.run.status is Status.NOT_POSED
    assert "no blocks today" in refused.why
    assert right.distance < 1e-6
    write_board(board, tmp_path)
    page = (tmp_path / "simulator-crashes.html").read_text("utf-8")
    assert "out of rubber" in page
    index = (tmp_path / "index.html").read_text("utf-8")
    assert len(re.findall(r'<td class="failed"[^>]*>failed', index)) == 2


def test_who_is_not_run_stands_there_with_the_reason_and_no_number(tmp_path) -> None:
    right = program(tmp_path, "right", solve_static(load_case("stretch").problem).displacement)
    missing = Peer(name="far", title="Far", adapter="febio", program="no-such", install="far.org")
    never = Peer(name="never", title="Never", not_run="it has no body", homepage="https://x.org")
    assert never.command_line() is None
    board = board_of(tmp_path, [right, missing, never], ["stretch"])
    assert [entry.name for entry in board.absent] == ["far", "never"]
    write_board(board, tmp_path)
    index = (tmp_path / "index.html").read_text("utf-8")
    asked = index[index.index("<h2>Not run here") :]
    assert 'Far: not installed. <span class="soft">far.org</span>' in asked
    assert '<a href="https://x.org">Never</a>: it has no body.' in asked
    lines = (tmp_path / "summary.md").read_text("utf-8").splitlines()
    for title in ("Far", "Never"):
        (line,) = [line for line in lines if line.startswith(f"| {title} ")]
        assert not re.search(r"\d", line), line
        assert "not run here" in line
    assert "far" not in (tmp_path / "scores.csv").read_text("utf-8")


def test_a_simulator_that_compiles_runs_once_for_nothing_on_a_case_it_takes(
    tmp_path,
) -> None:
    calls = tmp_path / "calls"
    solution = f"""
key = json.loads(Path(sys.argv[1], "case.json").read_text("utf-8"))
with open({str(calls)!r}, "a") as log: log.write(key["name"] + " ")
if key["name"] == "stretch": sys.exit(77)
sys.exit("no")"""
    entry = program(tmp_path, "compiles", solution).model_copy(update={"compiles": True})
    board_of(tmp_path, [entry], ["stretch", "shear"], processes=1)
    asked = calls.read_text().split()
    # Once for nothing and once for its solution; a refusal compiles nothing.
    assert asked.count("shear") == 2


def test_simulators_run_side_by_side(tmp_path) -> None:
    meet = """
import pathlib, time
here = pathlib.Path({folder!r})
(here / "{name}.there").touch()
for _ in range(500):
    if (here / "{other}.there").exists(): break
    time.sleep(0.02)
else: sys.exit("alone")
sys.exit("met")"""
    pair = [
        program(tmp_path, name, meet.format(folder=str(tmp_path), name=name, other=other))
        for name, other in (("a", "b"), ("b", "a"))
    ]
    board = board_of(tmp_path, pair, ["stretch"], processes=2)
    assert all("met" in score.why for score in board.scores.values())


class Links(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(text)

    def handle_starttag(self, _tag, attributes):
        self.found += [value for name, value in attributes if name in ("href", "src") and value]


def test_the_command_leaves_pages_that_lead_to_one_another_and_data(tmp_path, monkeypatch) -> None:
    out = tmp_path / "board"
    words = ["scoreboard", "-o", out, "stretch", "block", "--entry", "fastsim-linear"]
    words += ["--simulator", NUMPY]
    monkeypatch.setattr("sys.argv", ["palpate", *map(str, words)])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 0
    pages = sorted(out.glob("*.html"))
    assert {page.stem for page in pages} == {
        "index", "simulator-fastsim-linear", "simulator-mine", "case-stretch", "case-block",
    }  # fmt: skip
    for page in pages:
        for link in Links(page.read_text("utf-8")).found:
            assert (out / link).is_file(), (page.name, link)
    document = json.loads((out / "results.json").read_text("utf-8"))
    scores = {(row["simulator"], row["case"]): row for row in document["scores"]}
    assert scores["mine", "stretch"]["distance"] < 1e-6
    assert scores["mine", "block"]["status"] == "not posed"
    assert "follower pressure" in scores["mine", "block"]["why"]
    assert "not posed: time, tools" in (out / "case-block.html").read_text("utf-8")
    assert len((out / "scores.csv").read_text("utf-8").splitlines()) == 1 + len(scores)
    assert len((out / "summary.md").read_text("utf-8").splitlines()) == 4


@pytest.mark.parametrize(
    ("status", "why", "short"),
    [
        (
            Status.NOT_POSED,
            'the case cannot be posed to it: "time, tools: not handed to this simulator here"',
            "asks for motion, tools, which its adapter does not pass on",
        ),
        (
            Status.NOT_POSED,
            'the case cannot be posed to it: "it has no blocks"',
            "it has no blocks",
        ),
        (Status.FAILED, 'no result within 90 s, its last line: "loaded"', "no result within 90 s"),
        (Status.FAILED, 'it ended with 1, its last line: "not at rest"', "not at rest"),
    ],
)
def test_the_reason_for_no_distance_is_short(status, why, short) -> None:
    run = Run("who", "what", status, why)
    assert reason(Score(run, Law.NEO_HOOKEAN, why=why)) == short


def test_every_entry_states_its_settings_and_their_sources() -> None:
    everybody = [entry for entry in peers_on_board() if entry.is_outside]
    assert len({entry.title.split(",")[0].split()[0] for entry in everybody}) >= 9
    for entry in everybody:
        assert bool(entry.not_run) != bool(entry.adapter), entry.name
        if entry.not_run:
            continue
        assert entry.settings, entry.name
        assert entry.better, entry.name
        assert entry.install, entry.name
        # One file for all that is done with a simulator: statics, motions, steps on devices; of
        # Newton three solvers, whose bodies are built alike.
        assert entry.adapter_lines <= (250 if entry.adapter == "newton_soft" else 200), entry.name
    with pytest.raises(InputError, match="no entry 'sofa'"):
        peers_on_board(["sofa"])


def test_a_file_of_entries_that_is_none_is_refused(tmp_path) -> None:
    path = tmp_path / "registry.toml"
    path.write_text('[[peer]]\nname = "a"\ntitle = "A"\nspeed = 3\n', encoding="utf-8")
    with pytest.raises(FileFormatError, match="speed"):
        read_peers(path)
    path.write_text('[[peer]]\nname = "fastsim-linear"\ntitle = "A"\n', encoding="utf-8")
    with pytest.raises(FileFormatError, match="two simulators"):
        read_peers(path)


# ------------------------------------------------------------- simulators of others on the board
def entry_of(name: str) -> Peer:
    entry = next(entry for entry in read_peers() if entry.name == name)
    if entry.command_line() is None:
        pytest.skip(entry.why_missing())
    return entry.model_copy(update={"compiles": False})


def score_of(folder: Path, entry: Peer) -> Score:
    (score,) = board_of(folder, [entry], ["shear"], time_limit=120.0).scores.values()
    assert score.distance is not None, score.why
    return score


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", ["mujoco-flex", "newton-semi-implicit", "newton-vbd"])
def test_under_its_own_law_a_simulator_has_no_error_of_law(tmp_path: Path, name: str) -> None:
    entry = entry_of(name)
    score = score_of(tmp_path, entry)
    assert score.law is entry.law
    assert score.follows == ""
    assert score.causes[LAW] == 0.0
    # Single precision, to rest within 1e-3 of the load.
    assert abs(score.causes[SOLVER]) < 2e-3
    if name == "mujoco-flex":  # a homogeneous state, which every mesh has
        assert abs(score.causes[MESH]) < 1e-6
    else:
        assert score.causes[MESH] < -0.03


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("newton-semi-implicit", Law.NEO_HOOKEAN_STABLE_LOG),
        ("newton-vbd", Law.NEO_HOOKEAN_STABLE),
    ],
)
def test_compared_with_another_law_it_is_found_to_follow_its_own(
    tmp_path: Path, name: str, law: Law
) -> None:
    entry = entry_of(name)
    score = score_of(tmp_path, entry.model_copy(update={"law": Law.SAINT_VENANT_KIRCHHOFF}))
    assert score.follows == f"{law} law"
    # Of each part's difference none is the mesh's: Saint-Venant-Kirchhoff's is homogeneous here.
    assert abs(score.causes[LAW]) > 0.05
    assert abs(score.causes[SOLVER]) < 0.1 * abs(score.causes[LAW])
    assert abs(score.causes[MESH]) < 1e-6


# ------------------------------------------------------------------------- causes of a motion
def by_descent(problem: Problem, iterations: int) -> State:
    """Backward Euler with steps of eight of the case's, solved more or less."""
    (candidate,) = candidates_for(DESCENT, 300.0, time_step=4e-3, iterations=iterations)
    return candidate.solve(problem, Strain.GREEN, in_silence)


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_errors_of_step_iterations_and_law_land_in_their_own_columns(let_go: Path) -> None:
    case = load_case(let_go)
    problem = case.problem
    truth = Truth(case, solve_motion_set(problem, in_silence, strains=(Strain.GREEN,)))
    assert truth.references is not None
    best = truth.references.truth(Strain.GREEN)
    same = truth.references.same_mesh(Strain.GREEN)
    assert best is not None
    assert same is not None
    lengths = np.linalg.norm(best.displacements, axis=2)
    most = np.unravel_index(int(lengths.argmax()), lengths.shape)
    direction = best.displacements[most] / lengths[most] ** 2

    def apart(one: State, other: State) -> float:
        return float((one.displacements - other.displacements)[most] @ direction)

    lines: list[str] = []
    own_steps = OwnSteps(ResultCache(let_go.parent / "cached"), lines.append)

    def score(state: State) -> Score:
        return judge_run(
            Run("copy", case.name, Status.ANSWERED, state=state), COPY, truth, truth, own_steps
        )

    solved, few = by_descent(problem, 300), by_descent(problem, 12)
    law = fastsim_candidate().solve(with_law(problem, Law.NEO_HOOKEAN), Strain.GREEN, in_silence)
    seeded = {
        STEP: (solved, apart(solved, same)),
        SOLVER: (few, apart(few, solved)),
        LAW: (law, apart(law, same)),
    }
    for cause, (state, added) in seeded.items():
        found = score(state)
        assert abs(added) > 0.005, cause
        assert found.causes[cause] == pytest.approx(added, rel=0.1), cause
        # A step has been seeded into what is solved too little as well.
        others = {LAW, STEP, SOLVER} - {cause, *([STEP] if cause == SOLVER else [])}
        for other in others:
            assert abs(found.causes.get(other, 0.0)) < 0.1 * abs(added), (cause, other)
        total = apart(state, same) + found.causes[MESH]
        assert sum(found.causes.values()) == pytest.approx(total, abs=1e-12)
        assert found.follows == (Law.NEO_HOOKEAN if cause == LAW else "")
    # A second look solves nothing again.
    before = len(lines)
    score(few)
    assert len(lines) == before
