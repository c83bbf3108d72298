"""No verb writes over what it reads, nor two results into one file; refused before solving."""

import json
import os
import shlex
from collections.abc import Callable

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.files import write_mesh, write_surface
from palpate.meshes.kidney import shape_kidney
from palpate.validation.case import load_case
from palpate.validation.output_files import OutputError, input_files, require_outputs

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def palpate(palpate_run, project):
    """Run the command line in the project's folder; exit code and standard error."""

    def run(*words):
        done = palpate_run(*words, folder=project)
        return done.returncode, done.stderr

    return run


@pytest.fixture
def project(tmp_path, write_case):
    """A case on a mesh file, with a reference, a solution and links to some of them."""
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    write_case((shape, 'mesh = "body.vtu"'))
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    write_mesh(tmp_path / "body.vtu", mesh)
    write_surface(tmp_path / "organ.msh", shape_kidney(edge_length=14e-3))
    np.savez(tmp_path / "solution.npz", displacement=np.zeros(mesh.points.shape))
    (tmp_path / "references").mkdir()
    (tmp_path / "references" / "block.npz").write_bytes(b"accepted with a reason")
    accepted = '{"schema": 1, "palpate": "0", "cases": []}'
    (tmp_path / "old.json").write_text(accepted, encoding="utf-8")
    (tmp_path / "mysim.py").write_text("my work", encoding="utf-8")
    (tmp_path / "soft").symlink_to("block.toml")
    os.link(tmp_path / "block.toml", tmp_path / "hard")
    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


def everything(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        "gate block.toml --json block.toml",
        "gate block.toml --junit body.vtu",
        "gate block.toml --summary references/block.npz",
        "gate block.toml --json sub/../block.toml",
        "gate block.toml --json soft",
        "gate block.toml --json hard",
        "compare-runs old.json block.toml --summary old.json",
        "gate block.toml --json mysim.py --simulator 'python mysim.py {case} {result}'",
        "gate block.toml --json x --junit x",
        "gate block.toml --json x --junit sub/../x",
        "gate block.toml --json nowhere/x",
        "gate block.toml --json sub",
        "gate block.toml --json pipe",
        "gate block.toml --metamorphic --json block.toml",
        "solve block.toml -o body.vtu",
        "compare block.toml solution.npz --json solution.npz",
        "compare block.toml solution.npz --json block.toml",
        "audit block.toml solution.npz --json solution.npz",
        "audit block.toml solution.npz --cells body.vtu",
        "audit block.toml solution.npz --cells x.vtu --json ./x.vtu",
        "audit block.toml solution.npz --cells x.npz",
        "mesh organ.msh -o organ.msh",
        "export block.toml -o .",
        "export block -o .",
        "export block -o ..",
        "export block.toml -o mysim.py",
        "bench delaunay --json nowhere/x.json",
        "report block.toml -o .",
        "report block.toml -o sub/..",
        "study kidney -o .",
    ],
)
def test_an_output_over_an_input_or_another_is_refused_and_nothing_is_touched(
    palpate, project, words
):
    before = everything(project)
    code, said = palpate(*shlex.split(words))
    assert code == 2, said
    assert "name" in said or "make it first" in said or "give each its own" in said
    assert "strain" not in said  # nothing was solved
    assert everything(project) == before
    assert (project / "soft").is_symlink()


def test_the_projects_own_folder_with_results_in_it_is_never_swapped(palpate, project):
    """What lost a user's case: a gate's results.json beside it made its folder look like a run."""
    (project / "results.json").write_text('{"palpate": "0.1.0", "cases": []}', encoding="utf-8")
    before = everything(project)
    for where in (".", project, project / "sub" / ".."):
        code, said = palpate("report", "block.toml", "-o", where)
        assert (code, "current folder" in said) == (2, True), said
    assert everything(project) == before


def test_outputs_that_are_new_are_written_and_a_link_stays_a_link(palpate, project):
    (project / "latest.vtu").symlink_to("sub/u.vtu")
    code, said = palpate("solve", "block.toml", "-o", "latest.vtu")
    assert code == 0, said
    assert (project / "latest.vtu").is_symlink()
    assert (project / "sub" / "u.vtu").is_file()
    for _ in range(2):  # an exported case may be written again
        assert palpate("export", "block.toml", "-o", "case")[0] == 0
    (project / "case" / "case.json").write_text(json.dumps({"mine": 1}), encoding="utf-8")
    code, said = palpate("export", "block.toml", "-o", "case")
    assert (code, "no exported case's" in said) == (2, True)


def test_every_file_of_a_case_is_an_input(project, write_case):
    files = {path.name for path in input_files([load_case(project / "block.toml")], "old.json")}
    assert files == {"block.toml", "body.vtu", "block.npz", "block.pending.npz", "old.json"}
    tool = (
        '[tool]\nshape = "surface"\nsurface = "organ.msh"\n'
        "pose = [{ time = 0.0, position = [0.0, 0.0, 0.0] }]\n\n[[support]]"
    )
    path = write_case(("[[support]]", tool), name="pushed.toml")
    assert {p.name for p in load_case(path).files} == {"pushed.toml", "organ.msh"}


def test_paths_that_cannot_be_are_input_errors(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    for bad in (tmp_path / "loop", tmp_path / "a\0b", tmp_path / "loop" / "x"):
        with pytest.raises(OutputError):
            require_outputs({"--json": bad})


def test_two_cases_of_one_name_are_refused(palpate, project):
    (project / "sub" / "block.toml").write_bytes((project / "block.toml").read_bytes())
    for verb in (["gate"], ["report", "-o", "out"]):
        code, said = palpate(*verb, "block.toml", "sub/block.toml")
        assert code == 2
        assert "case 'block' is given by block.toml and sub/block.toml" in said
        code, said = palpate(*verb, "block.toml", "block.toml")
        assert (code, "twice" in said) == (2, True)


def test_a_case_called_index_does_not_take_the_first_page_of_a_report(palpate, project):
    (project / "index.toml").write_bytes((project / "block.toml").read_bytes())
    code, said = palpate("report", "block.toml", "index.toml", "-o", "out")
    assert (code, "rename case 'index'" in said) == (2, True), said
    assert not (project / "out").exists()
