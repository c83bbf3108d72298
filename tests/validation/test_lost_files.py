"""Full disks, folders that vanish, names that clash, runs that meet: no file is lost or mixed."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from signals import PALPATE

from palpate.meshes import temporaries
from palpate.meshes.temporaries import atomic_path, scratch_folder
from palpate.validation import api
from palpate.validation.case import CaseError, load_case, load_cases
from palpate.validation.exchange import case_folder
from palpate.validation.judging.outputs import write_outputs

Run = Callable[..., CompletedProcess[str]]
# Outputs larger than a full disk takes, by the words that write them.
OUTPUTS = {
    "schema.json": "schema -o schema.json",
    "solved.vtu": "solve block.toml -o solved.vtu",
    "solved.npz": "solve block.toml -o solved.npz",
    "kidney.msh": "mesh kidney --size 20 -o kidney.msh",
    "found.json": "gate block.toml --metamorphic --json found.json",
    "case/rest.vtu": "export block.toml -o case",
}


@contextmanager
def small_files(most: int) -> Iterator[None]:
    """Files may not have more bytes: as on a full disk. No bytecode, which would be cut off."""
    before, sys.dont_write_bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), True
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the size of files")
# NumPy's archive is closed by the collector once more, which reports to nobody.
@pytest.mark.filterwarnings("ignore:.*ZipFile.__del__:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("output", OUTPUTS)
def test_a_full_disk_is_one_line_and_what_was_there_stays(
    palpate_run: Run, tmp_path: Path, write_case: Callable[..., Path], output: str
) -> None:
    write_case()
    path, old = tmp_path / output, b"" if output != "schema.json" else b'{"palpate": "0"}'
    if old:
        path.write_bytes(old)
    with small_files(500):
        done = palpate_run(*OUTPUTS[output].split(), folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1] == f"palpate: {output}: File too large"
    assert "Traceback" not in done.stderr
    left = {p.name for p in tmp_path.iterdir()}
    assert left == {"block.toml", *(["schema.json"] if old else [])}
    assert not old or path.read_bytes() == old


# A simulator that does something to the folder of the outputs.
SPOILER = """
import os, shutil, sys
import numpy as np
folder = sys.argv[3]
if os.path.isdir(folder) and not os.path.islink(folder):
    shutil.rmtree(folder)
    if sys.argv[4:]:
        os.symlink(sys.argv[4], folder)
points = np.load(sys.argv[1] + "/rest.npz")["points"]
np.savez(sys.argv[2], displacement=0.0 * points)
"""


@pytest.mark.parametrize("becomes", ["nothing", "a link"])
def test_a_folder_that_vanishes_during_a_run_takes_neither_verdict_nor_another_file(
    palpate_run: Run, tmp_path: Path, becomes: str
) -> None:
    (tmp_path / "sim.py").write_text(SPOILER, encoding="utf-8")
    out, other = tmp_path / "out", tmp_path / "other"
    for folder in (out, other):
        folder.mkdir()
    (other / "r.json").write_text("mine", encoding="utf-8")
    more = f" {other}" if becomes == "a link" else ""
    program = f"{sys.executable} {tmp_path / 'sim.py'} {{case}} {{result}} {out}{more}"
    done = palpate_run("gate", "block", "--simulator", program, "--json", out / "r.json")
    assert "block: failed" in done.stdout
    assert done.returncode == 2
    said = {"nothing": f"palpate: {out / 'r.json'}: No such file", "a link": "did not write has"}
    assert said[becomes] in done.stderr
    assert (other / "r.json").read_text(encoding="utf-8") == "mine"
    beside = 1 + (becomes == "a link")
    assert len(list(other.iterdir())) == beside


def test_an_export_that_breaks_off_is_no_case_and_no_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """rest.vtu of the new case beside case.json and rest.npz of the old one looks like a case."""
    folder = tmp_path / "case"
    api.export("block", folder)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(case_folder.np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space"):
        api.export("column", folder)
    assert not (folder / "case.json").exists()
    with pytest.raises(OSError, match="No space"):
        api.export("column", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_outputs_of_a_run_are_all_new_or_all_old(tmp_path: Path) -> None:
    """A new results.json beside the junit.xml of an earlier run is two verdicts."""
    paths = {name: tmp_path / name for name in ("json", "junit", "summary")}
    write_outputs([], **paths)
    numbers = {path: path.stat().st_ino for path in paths.values()}
    nowhere = tmp_path / "nowhere" / "s.md"
    with pytest.raises(OSError, match="No such file"):
        write_outputs([], **{**paths, "summary": nowhere})
    assert {path: path.stat().st_ino for path in paths.values()} == numbers
    assert sorted(path.name for path in tmp_path.iterdir()) == ["json", "junit", "summary"]
    write_outputs([], **paths)
    assert all(path.stat().st_ino != numbers[path] for path in paths.values())


def test_two_exports_at_once_leave_one_case(tmp_path: Path) -> None:
    code = "import sys; from palpate.validation import api\n" + (
        "case = api.load_case(sys.argv[1]); case.problem\n"
        "for _ in range(15): api.export(case, sys.argv[2])\n"
    )
    folder = tmp_path / "case"
    runs = [
        subprocess.Popen([sys.executable, "-c", code, name, str(folder)])
        for name in ("block", "column")
    ]
    assert [run.wait() for run in runs] == [0, 0]
    found = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    points = load_case(found["name"]).problem.mesh.points
    with np.load(folder / "rest.npz") as rest:
        assert np.array_equal(rest["points"], points)


@pytest.mark.parametrize(
    "words",
    [
        ("init", "-o", "my case.toml"),
        ("init", "-o", os.fsdecode(b"a\xff.toml")),
        ("import", "model.inp", "-o", "my case.toml"),
    ],
)
def test_no_file_is_written_whose_name_no_case_has(
    palpate_run: Run, tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "model.inp").write_text("*NODE\n", encoding="utf-8")
    done = palpate_run(*words, folder=tmp_path)
    assert (done.returncode, "a case's name may hold letters" in done.stderr) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["model.inp"]


def test_names_that_differ_in_capitals_alone_would_share_files(
    tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    write_case()
    write_case(name="BLOCK.toml")
    with pytest.raises(CaseError, match=r"given by .*block\.toml and .*BLOCK\.toml"):
        load_cases([str(tmp_path / "block.toml"), str(tmp_path / "BLOCK.toml")])


@pytest.mark.parametrize("words", [["cases"], ["gate", "block"]])
def test_a_working_folder_that_was_removed_is_an_error_before_anything_is_solved(
    tmp_path: Path, words: list[str]
) -> None:
    shell = "mkdir gone && cd gone && rmdir ../gone && exec " + " ".join([*PALPATE, *words])
    done = subprocess.run(
        ["sh", "-c", shell], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == (
        "palpate: the working folder cannot be used (No such file or directory): go to another\n"
    )


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs locks")
def test_what_a_killed_run_of_the_same_number_left_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In containers every run may have the process number 1."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(temporaries, "sweep_scratch", temporaries.sweep_scratch.__wrapped__)
    monkeypatch.setattr(temporaries, "_sweep_beside", temporaries._sweep_beside.__wrapped__)
    left = tmp_path / f"palpate-simulator-{os.getpid()}-0123abcd"
    half = tmp_path / f".r.palpate-{os.getpid()}-0123abcd.tmp.json"
    left.mkdir()
    half.touch()
    long_ago = temporaries._STARTED - 10.0
    for path in (left, half):
        os.utime(path, (long_ago, long_ago))
    with scratch_folder("own") as own, atomic_path(tmp_path / "r.json") as new:
        for _ in range(2):  # what is in use stays, also of other threads
            with scratch_folder("other"), atomic_path(tmp_path / "s.json"):
                assert own.exists()
                assert new.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.json", "s.json"]
