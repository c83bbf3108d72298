"""A folder of results is the old or the new one, never a mixture; whose files in it stay."""

import ctypes
import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.run_folder import MARKER, RESULTS, require_run_folder, run_folder


def write_run(path, word, pause=0.0):
    with run_folder(path) as fresh:
        for name in ("a.txt", "b.txt", RESULTS):
            (fresh / name).write_text(word)
            time.sleep(pause)


def contents(path):
    return {file.read_text() for file in path.iterdir() if file.name != MARKER}


@pytest.fixture
def out(tmp_path):
    """The folder of an old run."""
    write_run(tmp_path / "out", "old")
    return tmp_path / "out"


def leftovers(path):
    return [p.name for p in path.parent.iterdir() if p != path]


def test_a_new_run_replaces_the_old_one(tmp_path):
    out = tmp_path / "deep" / "out"
    write_run(out, "old")
    write_run(out, "new")
    assert contents(out) == {"new"}
    assert leftovers(out) == []


@pytest.mark.parametrize(
    ("error", "reported", "why"),
    [
        (KeyboardInterrupt(), KeyboardInterrupt, ""),
        (ValueError("bug"), ValueError, "bug"),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), InputError, "No space .* unchanged"),
    ],
)
def test_a_failure_leaves_the_old_run(out, error, reported, why):
    def broken():
        with run_folder(out) as fresh:
            (fresh / "a.txt").write_text("half")
            raise error

    with pytest.raises(reported) as caught:
        broken()
    assert re.search(why, str(caught.value))
    assert contents(out) == {"old"}
    assert leftovers(out) == []


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.doc").write_text("precious")
    with pytest.raises(InputError, match="another folder"):
        write_run(out, "new")
    assert contents(out) == {"precious"}
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write_run(tmp_path / "file", "new")
    with pytest.raises(InputError, match="cannot be written"):
        write_run(tmp_path / "file" / "out", "new")


def test_two_runs_at_once_leave_one_of_them_whole(out):
    seen = []
    runs = [
        threading.Thread(target=write_run, args=(out, word, 0.01))
        for word in ("one", "two", "three")
    ]
    for run in runs:
        run.start()
    while any(run.is_alive() for run in runs):
        try:
            before = out.stat().st_ino
            names, words = sorted(p.name for p in out.iterdir()), contents(out)
            if out.stat().st_ino != before:
                continue  # swapped between two looks
        except FileNotFoundError:
            continue
        assert names == sorted(["a.txt", "b.txt", RESULTS, MARKER])
        assert len(words) == 1
        seen.append(words)
    for run in runs:
        run.join()
    assert len(contents(out)) == 1
    assert leftovers(out) == []
    assert seen


def test_ctrl_c_in_the_middle_of_a_report(out):
    code = (
        "import signal, sys, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from palpate.validation.run_folder import run_folder\n"
        "with run_folder(sys.argv[1]) as fresh:\n"
        "    (fresh / 'a.txt').write_text('half'); print('ready', flush=True); time.sleep(60)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(out)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert child.stdout.readline() == b"ready\n"
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=20) != 0
    child.stdout.close()
    assert contents(out) == {"old"}
    assert leftovers(out) == []


def test_files_of_the_users_own_beside_a_report_stay(out):
    (out / "notes.txt").write_text("mine")
    (out / "mine" / "empty").mkdir(parents=True)
    (out / "mine" / "plot.py").write_text("mine")
    (out / "link").symlink_to("notes.txt")
    (out / "gone").symlink_to("nowhere")
    for word in ("new", "newer"):
        write_run(out, word)
        assert (out / "a.txt").read_text() == word
        assert (out / "notes.txt").read_text() == "mine"
        assert (out / "mine" / "plot.py").read_text() == "mine"
        assert (out / "mine" / "empty").is_dir()
        assert (out / "link").readlink() == Path("notes.txt")
        assert (out / "gone").readlink() == Path("nowhere")
        assert leftovers(out) == []


def test_a_file_of_ones_own_stays_where_there_are_no_hard_links_and_no_exchange(out, monkeypatch):
    def refuse(*_given, **_named):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    (out / "notes.txt").write_text("mine")
    monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr(ctypes, "CDLL", lambda *_given, **_named: object())  # no renameat2
    write_run(out, "new")
    assert contents(out) == {"new", "mine"}
    assert leftovers(out) == []


def test_what_an_old_run_wrote_and_the_new_one_does_not_goes(tmp_path):
    out = tmp_path / "out"
    with run_folder(out) as fresh:
        (fresh / "pages").mkdir()
        (fresh / "pages" / "old.html").write_text("old")
        (fresh / RESULTS).write_text("old")
    write_run(out, "new")
    assert contents(out) == {"new"}


def test_an_empty_folder_and_one_of_a_killed_run_are_taken(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    write_run(out, "new")
    assert contents(out) == {"new"}
    code = (
        "import os, signal, sys\n"
        "from palpate.validation.run_folder import run_folder\n"
        "with run_folder(sys.argv[1]) as fresh:\n"
        "    (fresh / 'a.txt').write_text('half'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(out)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(leftovers(out)) == 1
    assert contents(out) == {"new"}
    (tmp_path / f".out.palpate-run-{os.getpid()}-01234567").mkdir()  # of a living process
    write_run(out, "newer")
    assert contents(out) == {"newer"}
    assert leftovers(out) == [f".out.palpate-run-{os.getpid()}-01234567"]


def test_a_run_killed_in_the_swap_loses_nothing(tmp_path):
    out, old = tmp_path / "out", tmp_path / "old"
    write_run(out, "new")
    write_run(old, "old")
    (old / "notes.txt").write_text("mine")
    os.link(old / "notes.txt", out / "notes.txt")  # carried before the swap
    (old / "late.txt").write_text("written in the very moment")
    dead = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                          capture_output=True, text=True, check=True).stdout.strip()  # fmt: skip
    old.rename(tmp_path / f".out.palpate-run-{dead}-01234567")
    write_run(out, "newer")
    assert contents(out) == {"newer", "mine"}
    (left,) = (path for path in tmp_path.iterdir() if path != out)
    assert left.name.startswith("out-")
    assert sorted(path.name for path in left.iterdir()) == [MARKER, "late.txt"]


def test_a_file_that_is_edited_while_the_run_is_made_is_not_replaced(out, tmp_path):
    def run_and_edit():
        with run_folder(out) as fresh:
            (fresh / "a.txt").write_text("new")
            (out / "a.txt").write_text("my remarks")

    with pytest.raises(InputError, match=r"so it is in .*out-.*changed since \(a\.txt\)"):
        run_and_edit()
    assert (out / "a.txt").read_text() == "my remarks"
    (beside,) = (path for path in tmp_path.iterdir() if path != out)
    assert contents(beside) == {"new"}


def test_a_results_file_alone_does_not_make_a_folder_a_runs(tmp_path):
    project = tmp_path / "project"
    project.mkdir()
    for name in (RESULTS, "block.toml", "block.msh"):
        (project / name).write_text("precious")
    with pytest.raises(InputError, match=r"no \.palpate-run\.json.*remove it yourself"):
        write_run(project, "new")
    assert contents(project) == {"precious"}
    assert len(list(project.iterdir())) == 3


def test_a_changed_file_of_an_old_run_is_somebodys_own(out):
    (out / "a.txt").write_text("my remarks")
    with pytest.raises(InputError, match=r"changed since \(a\.txt\).*move them"):
        write_run(out, "new")
    assert (out / "a.txt").read_text() == "my remarks"
    (out / "a.txt").unlink()  # and what was removed is nobody's
    write_run(out, "new")
    assert contents(out) == {"new"}


def test_a_marker_that_was_copied_along_gives_no_right_to_other_files(tmp_path):
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
def test_a_marker_that_cannot_be_read_is_no_permission_to_replace(tmp_path, text):
    out = tmp_path / "out"
    out.mkdir()
    (out / MARKER).write_text(text)
    (out / "x").write_text("precious")
    with pytest.raises(InputError, match=r"\.palpate-run\.json: (damaged|of another version)"):
        write_run(out, "new")
    assert (out / "x").read_text() == "precious"


def test_a_name_of_ones_own_that_the_new_run_needs_leaves_both(tmp_path):
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


def test_folders_with_more_than_a_run_are_refused(tmp_path, monkeypatch):
    home, here = tmp_path / "home", tmp_path / "home" / "work" / "here"
    here.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(here)
    repository = tmp_path / "repository"
    (repository / ".git").mkdir(parents=True)
    (tmp_path / "link").symlink_to(repository)
    for position, why in (
        (Path(), "current folder"),
        (Path(".."), "current folder"),
        (here, "current folder"),
        (Path("/"), "current folder"),
        (home, "current folder"),
        (repository, "root of a repository"),
        (tmp_path / "link", "root of a repository"),
    ):
        with pytest.raises(InputError, match=why):
            require_run_folder(position)
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
