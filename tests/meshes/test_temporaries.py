"""What a killed run leaves is swept by the next one; what is in use, or another's, is not."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate.meshes import temporaries
from palpate.meshes.temporaries import atomic_path, locked, scratch_folder, write_text_atomically

KILL = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)\n"


@pytest.fixture(autouse=True)
def parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder for temporaries of its own, as at the start of a process."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    temporaries.sweep_scratch.cache_clear()
    temporaries._sweep_beside.cache_clear()
    yield tmp_path
    temporaries.sweep_scratch.cache_clear()


def killed(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code + KILL], check=False)
    assert done.returncode == -signal.SIGKILL


def dead_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        pass
    return process.pid


def test_a_scratch_folder_is_private_and_gone_afterwards(parent: Path) -> None:
    with scratch_folder("simulator") as folder:
        assert folder.parent == parent
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("x")
        (folder / "deep").chmod(0)  # a simulator may do such things
    assert list(parent.iterdir()) == []


def test_a_scratch_folder_is_gone_where_a_signal_interrupts_the_removing(
    parent: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = shutil.rmtree
    asked: list[Path] = []

    def interrupted(folder: Path, **options: bool) -> None:
        asked.append(folder)
        if len(asked) == 1:
            (folder / "one").unlink()
            raise KeyboardInterrupt
        whole(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    scratch = scratch_folder("gmsh")
    folder = scratch.__enter__()
    for name in ("one", "two"):
        (folder / name).write_text(name, encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        scratch.__exit__(None, None, None)
    assert asked == [folder, folder]
    assert list(parent.iterdir()) == []


def test_the_scratch_folder_of_a_killed_run_is_swept_by_the_next(parent: Path) -> None:
    killed(
        "from palpate.meshes.temporaries import scratch_folder\n"
        "made = scratch_folder('simulator'); (made.__enter__() / 'big').write_text('x')\n"
    )
    (left,) = parent.iterdir()
    with scratch_folder("gmsh") as folder:
        assert list(parent.iterdir()) == [folder]
    assert not left.exists()


def test_what_is_in_use_or_somebody_elses_is_not_swept(parent: Path) -> None:
    dead = dead_process()
    living = parent / f"palpate-simulator-{os.getpid()}-01234567"
    in_use = parent / f"palpate-simulator-{dead}-01234567"  # in another container, say
    linked = parent / f"palpate-simulator-{dead}-76543210"
    other = parent / f"palpate-simulator-{dead}-mine"
    thesis = parent / "thesis"
    for folder in (living, in_use, other, thesis):
        folder.mkdir()
    linked.symlink_to(thesis)
    with locked(in_use), scratch_folder("gmsh"):
        assert all(path.exists() for path in (living, in_use, linked, other, thesis))


def test_what_another_user_left_is_not_swept(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = parent / f"palpate-simulator-{dead_process()}-01234567"
    left.mkdir()
    me = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: me + 1)
    with scratch_folder("gmsh"):
        assert left.exists()


def test_the_text_of_an_error_is_kept_for_a_week(parent: Path) -> None:
    old, new, mine = (parent / f"palpate-error-{name}" for name in ("a1.txt", "b2.txt", "c.md"))
    for path in (old, new, mine):
        path.write_text("Traceback")
    # Eight days before now, by the file system's clock.
    week_ago = new.stat().st_mtime - 8 * 86400.0
    os.utime(old, (week_ago, week_ago))
    os.utime(mine, (week_ago, week_ago))
    with scratch_folder("gmsh"):
        assert (old.exists(), new.exists(), mine.exists()) == (False, True, True)


def test_a_half_written_file_of_a_killed_run_is_swept_by_the_next(parent: Path) -> None:
    killed(
        "from palpate.meshes.temporaries import atomic_path\n"
        f"made = atomic_path({str(parent / 'r.json')!r}); made.__enter__().write_text('half')\n"
    )
    (left,) = parent.iterdir()
    hidden = parent / ".r.mine.tmp.json"
    hidden.write_text("mine")
    write_text_atomically(parent / "other.txt", "whole")
    assert {p.name for p in parent.iterdir()} == {"other.txt", hidden.name}
    assert left.name.startswith(".r.palpate-")


def test_a_link_stays_a_link_and_what_it_points_to_is_replaced(parent: Path) -> None:
    (parent / "there").mkdir()
    (parent / "link.txt").symlink_to("there/file.txt")
    for text in ("one", "two"):
        write_text_atomically(parent / "link.txt", text)
        assert (parent / "there" / "file.txt").read_text() == text
    assert (parent / "link.txt").is_symlink()


def test_a_long_name_can_be_written(parent: Path) -> None:
    path = parent / ("ü" * 120 + ".txt")  # 244 bytes of 255
    with atomic_path(path) as temporary:
        temporary.write_text("x")
    assert path.read_text() == "x"
