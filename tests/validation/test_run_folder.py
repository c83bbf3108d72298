"""A folder of results is the old one or the new one, never a mixture."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.run_folder import MARK, run_folder


def write_run(path: Path, word: str, pause: float = 0.0) -> None:
    with run_folder(path) as fresh:
        for name in ("a.txt", "b.txt", MARK):
            (fresh / name).write_text(word)
            time.sleep(pause)


def contents(path: Path) -> set[str]:
    return {file.read_text() for file in path.iterdir()}


def leftovers(path: Path) -> list[str]:
    return [p.name for p in path.parent.iterdir() if p != path]


def test_a_new_run_replaces_the_old_one(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    write_run(out, "old")
    (out / "extra.png").write_text("old")
    write_run(out, "new")
    assert contents(out) == {"new"}
    assert leftovers(out) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("bug")])
def test_a_failure_leaves_the_old_run(tmp_path: Path, error: BaseException) -> None:
    out = tmp_path / "out"
    write_run(out, "old")

    def broken() -> None:
        with run_folder(out) as fresh:
            (fresh / "a.txt").write_text("half")
            raise error

    with pytest.raises(type(error)):
        broken()
    assert contents(out) == {"old"}
    assert leftovers(out) == []


def test_a_full_disk_is_one_clear_line(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_run(out, "old")

    def full() -> None:
        with run_folder(out) as fresh:
            (fresh / "a.txt").write_text("half")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError, match=r"No space left on device.*unchanged"):
        full()
    assert contents(out) == {"old"}


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.doc").write_text("precious")
    with pytest.raises(InputError, match="another folder"):
        write_run(out, "new")
    assert contents(out) == {"precious"}
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write_run(tmp_path / "file", "new")


def test_a_parent_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot be written"):
        write_run(tmp_path / "file" / "out", "new")


def test_two_runs_at_once_leave_one_of_them_whole(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_run(out, "old")
    seen: list[set[str]] = []
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
        assert names == ["a.txt", "b.txt", MARK]
        assert len(words) == 1
        seen.append(words)
    for run in runs:
        run.join()
    assert len(contents(out)) == 1
    assert leftovers(out) == []
    assert seen


def test_ctrl_c_in_the_middle_of_a_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_run(out, "old")
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
    assert child.stdout is not None
    assert child.stdout.readline() == b"ready\n"
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=20) != 0
    child.stdout.close()
    assert contents(out) == {"old"}
    assert leftovers(out) == []
