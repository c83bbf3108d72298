"""Which folder a run may replace, and whose files in it stay."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.run_folder import MARKER, RESULTS, require_run_folder, run_folder


def write_run(path: Path, word: str, pause: float = 0.0) -> None:
    with run_folder(path) as fresh:
        for name in ("a.txt", "b.txt", RESULTS):
            (fresh / name).write_text(word)
            time.sleep(pause)


def contents(path: Path) -> set[str]:
    return {file.read_text() for file in path.iterdir() if file.name != MARKER}


def leftovers(path: Path) -> list[str]:
    return [p.name for p in path.parent.iterdir() if p != path]


def test_a_results_file_alone_does_not_make_a_folder_a_runs(tmp_path: Path) -> None:
    project = tmp_path / "project"
    project.mkdir()
    for name in (RESULTS, "block.toml", "block.msh"):
        (project / name).write_text("precious")
    with pytest.raises(InputError, match=r"no \.palpate-run\.json.*remove it yourself"):
        write_run(project, "new")
    assert contents(project) == {"precious"}
    assert len(list(project.iterdir())) == 3


def test_a_changed_file_of_an_old_run_is_somebodys_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_run(out, "old")
    (out / "a.txt").write_text("my remarks")
    with pytest.raises(InputError, match=r"changed since \(a\.txt\).*move them"):
        write_run(out, "new")
    assert (out / "a.txt").read_text() == "my remarks"
    (out / "a.txt").unlink()  # and what was removed is nobody's
    write_run(out, "new")
    assert contents(out) == {"new"}


def test_a_marker_that_was_copied_along_gives_no_right_to_other_files(tmp_path: Path) -> None:
    out, project = tmp_path / "out", tmp_path / "project"
    write_run(out, "old")
    project.mkdir()
    (project / MARKER).write_bytes((out / MARKER).read_bytes())
    (project / "case.toml").write_text("precious")
    (project / "b.txt").write_text("precious")
    with pytest.raises(InputError, match=r"changed since \(b\.txt\)"):
        write_run(project, "new")
    (project / "b.txt").unlink()
    write_run(project, "new")
    assert (project / "case.toml").read_text() == "precious"


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"palpate_run": 1, "files": {"../x": "0"}}', '{"palpate_run": 1, "files": [1]}',
     '{"palpate_run": 1, "files": {"/etc/passwd": "0"}}', '{"palpate_run": 9, "files": {}}',
     "[" * 100_000],
)  # fmt: skip
def test_a_marker_that_cannot_be_read_is_no_leave_to_replace(tmp_path: Path, text: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / MARKER).write_text(text)
    (out / "x").write_text("precious")
    with pytest.raises(InputError, match=r"\.palpate-run\.json: (damaged|of another version)"):
        write_run(out, "new")
    assert (out / "x").read_text() == "precious"


def test_a_name_of_ones_own_that_the_new_run_needs_leaves_both(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with run_folder(out) as fresh:
        (fresh / RESULTS).write_text("old")
    (out / "a.txt").write_text("mine")
    with pytest.raises(InputError, match=r"your own files.*\(a\.txt\)"):
        write_run(out, "new")
    assert (out / "a.txt").read_text() == "mine"
    (beside,) = (path for path in tmp_path.iterdir() if path != out)
    assert beside.name.startswith("out-")
    assert contents(beside) == {"new"}


def test_places_that_hold_more_than_a_run_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, here = tmp_path / "home", tmp_path / "home" / "work" / "here"
    here.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(here)
    repository = tmp_path / "repository"
    (repository / ".git").mkdir(parents=True)
    (tmp_path / "link").symlink_to(repository)
    for place, why in (
        (Path(), "current folder"),
        (Path(".."), "current folder"),
        (here, "current folder"),
        (Path("/"), "current folder"),
        (home, "current folder"),
        (repository, "root of a repository"),
        (tmp_path / "link", "root of a repository"),
    ):
        with pytest.raises(InputError, match=why):
            require_run_folder(place)
    monkeypatch.chdir(repository)
    with pytest.raises(InputError, match="home folder"):
        require_run_folder(home)
    case = tmp_path / "cases" / "deep" / "block.toml"
    case.parent.mkdir(parents=True)
    case.write_text("x")
    (tmp_path / "also").symlink_to(case)
    for file in (case, tmp_path / "also"):
        with pytest.raises(InputError, match="which this run reads"):
            require_run_folder(tmp_path / "cases", inputs=[file])
    require_run_folder(here / "out", inputs=[case])
    with pytest.raises(InputError, match="name"):
        require_run_folder("a\0b")
