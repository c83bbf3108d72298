"""A cached run is used where it is asked for and all that made it is as it was, and says so."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.material_law import Law
from palpate.validation import cached_results
from palpate.validation.cached_results import ResultCache
from palpate.validation.case import load_case
from palpate.validation.judging.case_references import find_references
from palpate.validation.peers import board_references, makers, registry
from palpate.validation.peers.board import Board, compute_board
from palpate.validation.peers.board_page import write_board
from palpate.validation.peers.board_references import find_truth
from palpate.validation.peers.makers import maker_of
from palpate.validation.peers.registry import Peer
from palpate.validation.states import in_silence

# It says in a file that it ran, and moves the body by as much as the module beside it says.
PROGRAM = """
import json, sys
from pathlib import Path
import numpy as np
from factor import FACTOR
with open({calls!r}, "a") as log: log.write("x")
key = json.loads(Path(sys.argv[1], "case.json").read_text("utf-8"))["case_key"]
np.savez(sys.argv[2], displacement=FACTOR * np.load({right!r}), case_key=key)
"""


class Bench:
    """A folder with a simulator, its results, and boards made of it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.calls, self.cache = folder, folder / "calls", folder / "cached"
        self.simulators = folder / "simulators"
        self.simulators.mkdir()
        right = folder / "right.npy"
        np.save(right, solve_static(load_case("stretch").problem).displacement)
        text = PROGRAM.format(calls=str(self.calls), right=str(right))
        (self.simulators / "mine.py").write_text(text, "utf-8")
        self.write_factor(1.0)
        self.lines: list[str] = []

    def write_factor(self, factor: float) -> None:
        (self.simulators / "factor.py").write_text(f"FACTOR = {factor}\n", "utf-8")

    def board(self, peer: Peer, *, cached: bool = True, time_limit: float = 60.0) -> Board:
        self.calls.write_text("")
        self.lines.clear()
        return compute_board(
            [peer],
            [load_case("stretch")],
            ResultCache(self.cache, is_read=cached),
            time_limit=time_limit,
            progress=self.lines.append,
        )

    def runs(self, peer: Peer, **how: Any) -> int:
        """How often the simulator runs for a board."""
        self.board(peer, **how)
        return len(self.calls.read_text())

    def distance(self, peer: Peer) -> float:
        (score,) = self.board(peer).scores.values()
        assert score.distance is not None
        return score.distance


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A simulator whose adapter is in a folder of its own, and no interpreter asked before."""
    made = Bench(tmp_path)
    monkeypatch.setattr(registry, "ADAPTERS", made.simulators)
    makers._installed.cache_clear()
    return made


ADAPTED = Peer(name="adapted", title="adapted", adapter="mine", module="numpy", packages=("numpy",))


def test_a_cached_run_is_used_where_it_is_asked_for_and_is_shown_with_its_date(
    bench: Bench, tmp_path: Path
) -> None:
    assert bench.runs(ADAPTED) == 1
    assert bench.runs(ADAPTED, cached=False) == 1  # nobody asked for it
    board = bench.board(ADAPTED)
    assert bench.calls.read_text() == ""
    (score,) = board.scores.values()
    assert score.run.is_cached
    assert score.distance is not None
    assert score.distance < 1e-6
    date = score.run.date
    assert any(line.endswith(f"(cached, of {date})") for line in bench.lines)
    write_board(board, tmp_path)
    for page in ("index", "simulator-adapted", "case-stretch"):
        assert date[:10] in (tmp_path / f"{page}.html").read_text("utf-8")
    for page in ("simulator-adapted", "case-stretch"):
        assert f"Cached, of {date}" in (tmp_path / f"{page}.html").read_text("utf-8")
    said = f"Cached: 1 of 1 runs, 0 truths and references, of {date}"
    assert said in (tmp_path / "index.html").read_text("utf-8")
    assert said in (tmp_path / "summary.md").read_text("utf-8")
    document = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert document["scores"][0]["cached"] is True
    assert list(document["cached"].values()) == [date]
    # A board that ran everything says nothing of the kind.
    write_board(bench.board(ADAPTED, cached=False), tmp_path)
    assert "Cached" not in (tmp_path / "index.html").read_text("utf-8")


def change_package(_: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    installed = makers._installed

    def other(interpreter: str) -> dict[str, str] | None:
        found = installed(interpreter)
        return found and {**found, "numpy": "0.0.1"}

    monkeypatch.setattr(makers, "_installed", other)


# What is changed, and the name that it has in the reason.
CHANGES: list[tuple[str, Callable[[Bench, pytest.MonkeyPatch], object]]] = [
    ("adapters", lambda bench, _: bench.write_factor(1.01)),
    ("variables", lambda _, patch: patch.setenv("OMP_NUM_THREADS", "7")),
    ("modules", lambda bench, _: (bench.folder / "lib/solver.py").write_text("GRAVITY = 1.6\n")),
    ("modules", lambda bench, _: (bench.folder / "sources/law.py").write_text("NU = 0.499\n")),
    (
        "packages of the system",
        lambda _, patch: patch.setattr(
            makers, "system_packages", lambda: {"packages of the system": "other"}
        ),
    ),
    ("numpy", change_package),
    ("palpate", lambda _, patch: patch.setattr(makers, "palpate_hash", lambda: "another")),
]


def test_where_what_made_it_has_changed_it_is_run_again_with_a_reason(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = bench.folder / "lib"
    library.mkdir()
    (library / "solver.py").write_text("GRAVITY = 9.81\n", "utf-8")
    (bench.folder / "sources").mkdir()
    (bench.folder / "sources" / "law.py").write_text("NU = 0.3\n", "utf-8")
    (library / "tissue").symlink_to(bench.folder / "sources")
    paths = [str(library), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    assert bench.runs(ADAPTED) == 1
    makers._installed.cache_clear()
    assert bench.runs(ADAPTED) == 0
    for named, change in CHANGES:  # one after another
        change(bench, monkeypatch)
        getattr(makers._installed, "cache_clear", lambda: None)()
        assert bench.runs(ADAPTED) == 1, named
        (reason,) = (line for line in bench.lines if "made again" in line)
        assert f" {named} changed since" in reason
    assert bench.runs(ADAPTED) == 0


def test_another_time_limit_option_or_case_is_another_run(bench: Bench) -> None:
    assert bench.runs(ADAPTED) == 1
    assert bench.runs(ADAPTED, time_limit=61.0) == 1
    assert bench.runs(ADAPTED.model_copy(update={"options": {"degree": 2}})) == 1
    assert bench.runs(ADAPTED, time_limit=61.0) == 0


def test_a_program_on_the_path_that_has_changed_or_is_a_script_is_run_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = bench.folder / "bin"
    folder.mkdir()
    program = folder / "solver"
    shutil.copy(shutil.which("true") or "/bin/true", program)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    peer = ADAPTED.model_copy(update={"program": "solver"})
    assert (bench.runs(peer), bench.runs(peer)) == (1, 0)
    with program.open("ab") as stream:
        stream.write(b"\0")
    assert (bench.runs(peer), bench.runs(peer)) == (1, 0)
    # A wrapper calls what it likes.
    program.write_text('#!/bin/sh\nexec true "$@"\n', "utf-8")
    assert maker_of(peer) is None
    assert (bench.runs(peer), bench.runs(peer)) == (1, 1)


def test_what_a_command_of_ones_own_imports_or_calls_is_not_known_so_it_is_always_run(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = bench.simulators / "mine.py"
    direct = Peer(name="a", title="a", command=f"{sys.executable} {script} {{case}} {{result}}")
    wrapper = bench.folder / "solve"
    wrapper.write_text(f'#!/bin/sh\nexec {sys.executable} {script} "$@"\n', "utf-8")
    wrapper.chmod(0o755)
    monkeypatch.setenv("PATH", f"{bench.folder}{os.pathsep}{os.environ['PATH']}")
    wrapped = Peer(name="b", title="b", command="solve {case} {result}")
    for peer in (direct, wrapped):
        bench.write_factor(1.0)
        assert bench.distance(peer) < 1e-6
        bench.write_factor(1.01)  # in a file that no command line names
        assert bench.distance(peer) == pytest.approx(0.01, rel=1e-3)
        assert bench.runs(peer) == 1


def test_a_package_that_is_linked_to_sources_elsewhere_is_not_known(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = bench.folder / "lib" / "elastic-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: elastic\nVersion: 1.0\n", "utf-8")
    paths = [str(info.parent), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    assert maker_of(ADAPTED) is not None
    url = {"url": "file:///home/me/elastic", "dir_info": {"editable": True}}
    (info / "direct_url.json").write_text(json.dumps(url), "utf-8")
    makers._installed.cache_clear()
    assert maker_of(ADAPTED) is None
    assert maker_of(ADAPTED.model_copy(update={"packages": ("not-there",)})) is None


def perturb_numbers(file: Path) -> None:
    with np.load(file.with_suffix(".npz")) as stored:
        arrays = dict(stored)
    np.savez_compressed(
        file.with_suffix(".npz"), **{**arrays, "displacement": 0.5 * arrays["displacement"]}
    )


def perturb_maker(file: Path) -> None:
    document = json.loads(file.read_text("utf-8"))
    document["made_by"]["palpate"] = "what is here now"
    file.write_text(json.dumps(document), "utf-8")


PERTURBED: dict[str, Callable[[Path], object]] = {
    "numbers": perturb_numbers,
    "status": lambda file: file.write_text(file.read_text().replace('"answered"', '"failed"')),
    "maker": perturb_maker,
    "no numbers": lambda file: file.with_suffix(".npz").unlink(),
    "cut off": lambda file: file.write_text(file.read_text()[:100]),
}


def test_a_cached_run_whose_content_has_not_its_hash_is_run_again(bench: Bench) -> None:
    assert bench.runs(ADAPTED) == 1
    for about, perturb in PERTURBED.items():
        (file,) = bench.cache.glob("adapted-*.json")
        perturb(file)
        assert bench.distance(ADAPTED) < 1e-6
        assert bench.calls.read_text() == "x", about
        assert any("made again; the cached result" in line for line in bench.lines)
    assert bench.runs(ADAPTED) == 0


def test_a_cached_truth_is_checked_as_runs_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = load_case("stretch")
    stored, solved = find_references(case, live=False, progress=in_silence), []

    def solve(*_: object) -> Any:
        solved.append(1)
        return stored

    monkeypatch.setattr(board_references, "_solve_truth", solve)
    under, lines = case.under(Law.NEO_HOOKEAN), []

    def truth() -> board_references.Truth:
        solved.clear()
        return find_truth(under, ResultCache(tmp_path, is_read=True), lines.append)

    assert truth().cached == ""
    again = truth()
    assert solved == []
    assert again.cached
    assert any(line == f"truth-{under.name}: cached, of {again.cached}" for line in lines)
    (file,) = tmp_path.glob("truth-*.npz")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    truth()
    assert solved == [1]
    monkeypatch.setattr(board_references, "made_here", lambda: {"palpate": "another"})
    truth()
    assert solved == [1]
    assert "palpate" in lines[-1]


def test_what_makes_a_reference_is_palpate_fenicsx_and_the_system() -> None:
    made = cached_results.made_here()
    assert {"palpate", "python"} <= set(made)
    assert ("packages of the system" in made) == Path("/var/lib/dpkg/status").is_file()


def test_what_this_call_has_made_is_used_without_being_asked_for(tmp_path: Path) -> None:
    cache, asked = ResultCache(tmp_path), "0" * 64
    cache.write("steps", asked, {"palpate": "1"}, {"value": 2.0})
    found = cache.read("steps", asked, {"palpate": "1"}, print)
    assert found is not None
    assert not found.is_from_before
    assert cache.used == {}
    assert ResultCache(tmp_path).read("steps", asked, {"palpate": "1"}, print) is None
    before = ResultCache(tmp_path, is_read=True).read("steps", asked, {"palpate": "1"}, print)
    assert before == dataclasses.replace(found, is_from_before=True)


def test_the_command_uses_cached_results_only_by_name(
    command_line: Callable[..., int], tmp_path: Path, bench: Bench, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(registry, "peers_on_board", lambda _names: (ADAPTED,))
    words = ["scoreboard", "-o", tmp_path / "board", "stretch"]
    ran = []
    for more in ([], [], ["--cached", tmp_path / "board-runs"]):
        bench.calls.write_text("")
        assert command_line(*words, *more) == 0
        ran.append(len(bench.calls.read_text()))
        said = capsys.readouterr().out
        assert ("Cached: 1 of 1 runs" in said) == bool(more)
    assert ran == [1, 1, 0]
    assert command_line(*words, "--cached", tmp_path / "nothing") == 2
    assert "leave it out to run everything" in capsys.readouterr().err
