"""Programs as candidates: judged by their numbers; crashes, hangs and NaN are failures."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import CommandError, OutsideSimulator
from palpate.validation.exchange.result_files import ResultFileError
from palpate.validation.peers import adapters
from palpate.validation.states import CandidateFailedError, in_silence

NUMPY_DENSE = Path(adapters.__file__).parent / "numpy_dense.py"
Run = Callable[..., subprocess.CompletedProcess[str]]
HEAD = "import sys, json, os, time, numpy as np\ncase, result = sys.argv[1:3]\n"


@pytest.fixture
def script(tmp_path: Path) -> Callable[..., OutsideSimulator]:
    def make(body: str, time_limit: float = 60.0) -> OutsideSimulator:
        path = tmp_path / "mysim.py"
        path.write_text(HEAD + body, encoding="utf-8")
        return OutsideSimulator(f"{sys.executable} {path} {{case}} {{result}}", time_limit)

    return make


@pytest.mark.parametrize("strain", list(Strain))
def test_the_smallest_adapter_gives_fastsims_solution(problem: Problem, strain: Strain) -> None:
    simulator = OutsideSimulator(f"{sys.executable} {NUMPY_DENSE} {{case}} {{result}}")
    assert simulator.name == "numpy_dense"
    solution = outside_candidate(simulator).solve(problem, strain, in_silence)
    expected = solve_static(problem, strain=strain).displacement
    found = solution.displacement
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()
    assert solution.says["tool"] == "numpy"


def test_a_crash_an_exit_code_and_silence_are_failures(
    problem: Problem, script: Callable[..., OutsideSimulator]
) -> None:
    for body, message in (
        ("print('out of luck'); sys.exit(3)", 'ended with 3, its last line: "out of luck"'),
        ("os.kill(os.getpid(), 11)", "crashed \\(signal 11\\)"),
        ("pass", "without writing a result"),
        ("raise ValueError('no mesh')", "no mesh"),
    ):
        with pytest.raises(CandidateFailedError, match=message):
            outside_candidate(script(body)).solve(problem, Strain.GREEN, in_silence)


def test_at_the_time_limit_the_whole_process_group_ends(
    tmp_path: Path, problem: Problem, script: Callable[..., OutsideSimulator]
) -> None:
    mark = tmp_path / "child"
    body = (
        "import subprocess\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(mark)!r}, 'w').write(str(child.pid))\n"
        "print('still at it', flush=True)\ntime.sleep(60)\n"
    )
    with pytest.raises(CandidateFailedError, match="no result within 5 s"):
        script(body, 5.0).run(problem, Strain.GREEN, in_silence)
    child = int(mark.read_text())
    for _ in range(100):
        if not is_running(child):
            break
        time.sleep(0.05)
    assert not is_running(child)


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text("utf-8")
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_a_solution_to_another_case_or_of_the_wrong_size_is_an_input_error(
    problem: Problem, script: Callable[..., OutsideSimulator]
) -> None:
    for body in (
        "np.savez(result, displacement=np.zeros((5, 3)))",
        f"np.savez(result, displacement=np.zeros({problem.mesh.points.shape}), case_key='old')",
        "open(result, 'w').write('?')",
    ):
        with pytest.raises(ResultFileError):
            outside_candidate(script(body)).solve(problem, Strain.GREEN, in_silence)


@pytest.mark.parametrize(
    "command", ["", "mysim", "mysim {case}", "mysim {result}", "a {case} {result} {result}", "'a"]
)
def test_a_command_without_its_places_is_refused(command: str) -> None:
    with pytest.raises(CommandError):
        OutsideSimulator(command)


def test_a_program_that_is_not_there_is_an_input_error(problem: Problem) -> None:
    simulator = OutsideSimulator("no-such-simulator {case} {result}")
    with pytest.raises(CommandError, match="no-such-simulator"):
        outside_candidate(simulator).solve(problem, Strain.GREEN, in_silence)


def verdicts_in(document: Path) -> dict[str, set[str]]:
    """Of the checks of one judged case, by what they are held against."""
    found: dict[str, set[str]] = {}
    for check in json.loads(document.read_text("utf-8"))["cases"][0]["checks"]:
        found.setdefault(check["against"], set()).add(check["verdict"])
    return found


@pytest.mark.long
def test_compare_on_the_command_line(palpate_run: Run, tmp_path: Path) -> None:
    solved = tmp_path / "r.vtu"
    assert palpate_run("solve", "kidney", "-o", str(solved)).returncode == 0
    done = palpate_run("compare", "kidney", str(solved), "--json", str(tmp_path / "r.json"))
    # Linear tetrahedra are right on their mesh, and too far from the truth.
    assert done.returncode == 1, done.stdout + done.stderr
    # The case has checks of linear strain too: this result has none.
    assert "skipped" in done.stdout
    from palpate.meshes.files import read_result_arrays

    points, _, fields, _ = read_result_arrays(solved)
    for factor, name in ((1000.0, "unit"), (np.nan, "nan"), (0.98, "soft")):
        np.savez(tmp_path / f"{name}.npz", displacement=factor * fields["displacement"])
        perturbed = tmp_path / f"{name}.json"
        done = palpate_run(
            "compare", "kidney", str(tmp_path / f"{name}.npz"), "--json", str(perturbed)
        )
        assert done.returncode == 1, done.stdout + done.stderr
        assert verdicts_in(perturbed)["same_mesh"] >= {"failed"}
    np.savez(tmp_path / "short.npz", displacement=points[:7])
    done = palpate_run("compare", "kidney", str(tmp_path / "short.npz"))
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    verdicts = verdicts_in(tmp_path / "r.json")
    assert "failed" in verdicts["truth"]
    assert verdicts["same_mesh"] == {"passed", "skipped"}


def test_a_case_is_exported_on_the_command_line(palpate_run: Run, tmp_path: Path) -> None:
    assert palpate_run("export", "kidney", "-o", str(tmp_path / "c")).returncode == 0
    assert json.loads((tmp_path / "c" / "case.json").read_text("utf-8"))["name"] == "kidney"


def test_the_gate_judges_a_program(palpate_run: Run, tmp_path: Path) -> None:
    sim = tmp_path / "mysim.py"
    sim.write_text(HEAD + "sys.exit('diverged')", encoding="utf-8")
    done = palpate_run(
        "gate", "kidney", "--simulator", f"{sys.executable} {sim} {{case}} {{result}}",
        "--time-limit", "20",
    )  # fmt: skip
    assert done.returncode == 1, done.stdout + done.stderr
    assert "diverged" in done.stdout
