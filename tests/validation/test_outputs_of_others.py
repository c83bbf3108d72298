"""No output of any verb replaces a file that palpate did not write, unless it is forced to."""

from __future__ import annotations

import shlex
import typing
import zipfile
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import meshio
import numpy as np
import pytest
from typer.models import OptionInfo
from verbs import verbs

from palpate.meshes import own_files
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.files import read_mesh, write_mesh
from palpate.meshes.own_files import MARK, add_mark, guard, may_replace, write_own_text
from palpate.validation.case import load_case
from palpate.validation.output_files import OutputError, require_outputs

Run = Callable[..., CompletedProcess[str]]
# Words that write a file, by verb, option and ending; {} is the file.
FILES = {
    ("init", "--output", ".toml"): "init -o {}",
    ("schema", "--output", ".json"): "schema -o {}",
    ("schema", "--output", ".toml"): "schema -o {}",
    ("import", "--output", ".toml"): "import model.inp -o {}",
    ("check", "--picture", ".png"): "check block.toml --picture {}",
    ("gate", "--json", ".json"): "gate block.toml --metamorphic --json {}",
    ("gate", "--junit", ".xml"): "gate block.toml --metamorphic --junit {}",
    ("gate", "--summary", ".md"): "gate block.toml --metamorphic --summary {}",
    ("compare", "--json", ".json"): "compare block.toml solution.npz --json {}",
    ("compare-runs", "--summary", ".md"): "compare-runs old.json old.json --summary {}",
    ("audit", "--json", ".json"): "audit block.toml solution.npz --degree 1 --json {}",
    ("audit", "--cells", ".vtu"): "audit block.toml solution.npz --degree 1 --cells {}",
    ("law", "--json", ".json"): "law neo-hookean --json {}",
    ("law", "--json", ".txt"): "law neo-hookean --self-test --json {}",
    ("mesh", "--output", ".vtu"): "mesh kidney --size 20 -o {}",
    ("mesh", "--output", ".vtk"): "mesh kidney --size 20 -o {}",
    ("mesh", "--output", ".msh"): "mesh kidney --size 20 -o {}",
    ("solve", "--output", ".vtu"): "solve block.toml -o {}",
    ("solve", "--output", ".npz"): "solve block.toml -o {}",
    ("bench", "--json", ".json"): "bench delaunay --size 1000 --json {}",
}
# Of these the refusal alone is tried: the run takes long, needs a display or a real model.
REFUSAL_ALONE = {"bench", "check", "import", "init", "compare"}
FOLDERS = {
    ("report", "--output"): "report block.toml -o {}",
    ("study", "--output"): "study kidney -o {}",
    (
        "fit",
        "--output",
    ): "fit silicone-bar --parameter material.density -o {}",
    ("sweep", "--output"): "sweep block.toml --vary material.poissons_ratio=0.1,0.2 -o {}",
    ("scoreboard", "--output"): "scoreboard block.toml -o {}",
    ("export", "--output"): "export block.toml -o {}",
    ("history", "--output"): "history mujoco block.toml -o {}",
}
# New names alone (tests/validation/live/test_touched.py); names that are hashes.
NEW_NAMES = {("touch", "--output"), ("scoreboard", "--cached")}


def options_with_paths() -> set[tuple[str, str]]:
    """Verb and option of every option of the command line that takes a path."""
    found = set()
    for verb, command in verbs():
        called: Any = command.callback
        for name, hint in typing.get_type_hints(called, include_extras=True).items():
            kind, *more = typing.get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
            about = [each for each in more if isinstance(each, OptionInfo)]
            if Path in (kind, *typing.get_args(kind)) and about:
                given = (about[0].default, *(about[0].param_decls or ()))
                named = [word for word in given if str(word).startswith("--")]
                option = named[0] if named else f"--{name}"
                found.add((verb, option))
    return found


def test_every_option_that_takes_a_path_is_tried_here() -> None:
    tried = {key[:2] for key in FILES} | set(FOLDERS) | NEW_NAMES
    assert options_with_paths() == tried


@pytest.fixture
def project(tmp_path: Path, write_case: Callable[..., Path]) -> Path:
    """A case with a result, an earlier run, and a model of another simulator."""
    write_case()
    num_points = load_case(tmp_path / "block.toml").problem.mesh.num_points
    np.savez(tmp_path / "solution.npz", displacement=np.zeros((num_points, 3)))
    of = {"metric": "det_f", "against": "same_mesh", "strain": "green", "candidate": "x"}
    check = {"name": "x", "verdict": "passed", "value": 1.0, "limit": 2.0, "reason": "y", **of}
    case = {"name": "block", "verdict": "passed", "checks": [check]}
    own = {"palpate": "0", "schema": 1, "cases": [case]}
    (tmp_path / "old.json").write_text(str(own).replace("'", '"'), encoding="utf-8")
    (tmp_path / "model.inp").write_text("*NODE\n", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(("verb", "option", "suffix"), FILES)
def test_a_file_of_somebody_else_stays(
    palpate_run: Run, project: Path, verb: str, option: str, suffix: str
) -> None:
    output = project / f"liver{suffix}"
    mine = "# my own, of which there is no copy\n"
    output.write_text(mine, encoding="utf-8")
    words = shlex.split(FILES[verb, option, suffix].format(output))
    done = palpate_run(*words, folder=project)
    assert done.returncode == 2
    assert "--force" in done.stderr
    assert output.name in done.stderr
    assert output.read_text(encoding="utf-8") == mine
    if verb in REFUSAL_ALONE:
        return
    assert palpate_run(*words, "--force", folder=project).returncode < 2
    assert may_replace(output)
    assert mine.encode() not in output.read_bytes()
    # By its time: a gate removes the output of before, whose number a file system gives anew.
    first = output.stat().st_mtime_ns
    assert palpate_run(*words, folder=project).returncode < 2
    assert output.stat().st_mtime_ns > first
    assert sorted(p.name for p in project.iterdir() if p.name.startswith(".")) == []


@pytest.mark.parametrize("verb", [verb for verb, _ in FOLDERS])
def test_a_folder_of_somebody_else_stays(palpate_run: Run, project: Path, verb: str) -> None:
    folder = project / "mine"
    folder.mkdir()
    names = ("rest.vtu", "report.html", "case.json")
    for name in names:
        (folder / name).write_text("mine", encoding="utf-8")
    words = next(text for (name, _), text in FOLDERS.items() if name == verb)
    done = palpate_run(*shlex.split(words.format(folder)), folder=project)
    assert done.returncode == 2
    assert "name another" in done.stderr
    assert {name: (folder / name).read_text("utf-8") for name in names} == dict.fromkeys(
        names, "mine"
    )


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("reference build block.toml", "block.pending.npz"),
        ("reference accept block.toml --reason new", "block.npz"),
    ],
)
def test_what_is_no_reference_stays(palpate_run: Run, project: Path, words: str, name: str) -> None:
    (project / "references").mkdir()
    mine = project / "references" / name
    np.savez(mine, displacement=np.zeros(3))
    before = mine.read_bytes()
    done = palpate_run(*words.split(), folder=project)
    assert (done.returncode, "is no reference of palpate's" in done.stderr) == (2, True)
    assert mine.read_bytes() == before


def test_two_outputs_whose_names_differ_in_capitals_alone(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="name one file"):
        require_outputs({"--json": tmp_path / "r.É", "--junit": tmp_path / "R.e\u0301"})
    assert list(tmp_path.iterdir()) == []


def test_an_exported_case_in_which_somebody_put_a_file_of_his_own(
    palpate_run: Run, project: Path
) -> None:
    words = ("export", "block.toml", "-o", "case")
    assert [palpate_run(*words, folder=project).returncode for _ in range(2)] == [0, 0]
    mine = project / "case" / "rest.vtu"
    mine.write_text("mine", encoding="utf-8")
    done = palpate_run(*words, folder=project)
    assert (done.returncode, "rest.vtu" in done.stderr) == (2, True)
    assert mine.read_text(encoding="utf-8") == "mine"
    assert palpate_run(*words, "--force", folder=project).returncode == 0
    assert read_mesh(mine).num_cells


@pytest.mark.parametrize("verb", ["init", "schema"])
def test_a_case_that_was_edited_stays(palpate_run: Run, project: Path, verb: str) -> None:
    assert palpate_run("init", "-o", "first.toml", folder=project).returncode == 0
    written = (project / "first.toml").read_text(encoding="utf-8")
    assert palpate_run(verb, "-o", "first.toml", folder=project).returncode == 2
    assert (project / "first.toml").read_text(encoding="utf-8") == written
    assert palpate_run(verb, "-o", "first.toml", "--force", folder=project).returncode == 0


def test_an_empty_file_as_a_ci_system_prepares_it_is_taken(palpate_run: Run, project: Path) -> None:
    (project / "summary.md").touch()
    words = ("compare-runs", "old.json", "old.json", "--summary", "summary.md")
    assert palpate_run(*words, folder=project).returncode == 0
    assert (project / "summary.md").stat().st_size


def test_what_comes_there_during_the_run_stays_and_the_result_is_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "found.json"
    require_outputs({"--json": path})
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="beside it"):
        write_own_text(path, '{"palpate": "1"}')
    assert path.read_text(encoding="utf-8") == "mine"
    (beside,) = tmp_path.glob("found-*.json")
    assert beside.read_text(encoding="utf-8") == '{"palpate": "1"}'
    require_outputs({"--json": path}, force=True)
    write_own_text(path, '{"palpate": "2"}')
    assert may_replace(path)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh"])
def test_a_marked_mesh_is_read_by_others_as_before(tmp_path: Path, suffix: str) -> None:
    path, mesh = tmp_path / f"box{suffix}", brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    write_mesh(path, mesh, point_data={"u": mesh.points})
    assert MARK.encode() in path.read_bytes()
    read = meshio.read(path)
    assert np.array_equal(read.points, mesh.points)
    assert np.array_equal(read.point_data["u"], mesh.points)
    assert np.array_equal(read_mesh(path).cells, mesh.cells)


def test_a_mark_does_not_damage_an_archive_or_a_picture(tmp_path: Path) -> None:
    pyplot = pytest.importorskip("matplotlib.figure")
    np.savez(tmp_path / "a.npz", u=np.arange(3))
    pyplot.Figure().savefig(tmp_path / "a.png")
    for name in ("a.npz", "a.png"):
        assert not may_replace(tmp_path / name)
        add_mark(tmp_path / name)
        assert may_replace(tmp_path / name)
    assert np.load(tmp_path / "a.npz")["u"].tolist() == [0, 1, 2]
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.testzip() is None
    from PIL import Image

    with Image.open(tmp_path / "a.png") as picture:
        picture.verify()
        assert picture.info["Comment"] == MARK


@pytest.mark.parametrize(
    "mine",
    [
        b"x",
        b'{"cases": [], "palpate": "1"}',
        b"a text that says palpate wrote it",
        b"\x89PNG\r\n\x1a\n",
        b"PK\x05\x06" + bytes(18),
        b"\n" * 600 + MARK.encode() + b"\n" * 600,
    ],
)
def test_what_only_looks_like_palpates_is_not(tmp_path: Path, mine: bytes) -> None:
    (tmp_path / "a").write_bytes(mine)
    assert not may_replace(tmp_path / "a")
    with pytest.raises(OutputError, match="--force"):
        require_outputs({"--json": tmp_path / "a"})


def test_a_guarded_file_is_free_again_by_force(tmp_path: Path) -> None:
    guard(tmp_path / "a")
    assert tmp_path / "a" in own_files._guarded
    guard(tmp_path / "a", force=True)
    assert tmp_path / "a" not in own_files._guarded
