"""What is passed on names no folder of the machine: not the case's, not home, not Python's."""

from __future__ import annotations

import html
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.files import write_mesh
from palpate.validation.case import builtin_folder
from palpate.validation.peers.bench import bench_json
from palpate.validation.quoting import for_json, texts_for_json, without_folders
from palpate.validation.references.stored import references_folder

Run = Callable[..., CompletedProcess[str]]
# It writes a result, and says where everything is; with a third word it fails, saying the same.
SIMULATOR = """
import json, sys
from pathlib import Path
import numpy as np

case, result = map(Path, sys.argv[1:3])
where = f"{sys.executable} in {Path.cwd()}, home {Path.home()}, {Path(__file__)}, {case}"
if sys.argv[3:]:
    sys.exit(where)
points = np.load(case / "rest.npz")["points"]
about = json.dumps({"tool": where, "version": str(case), "notes": [where]})
np.savez(result, displacement=1e-3 * points, about=np.array(about))
"""


@pytest.fixture
def folder(
    tmp_path: Path, write_case: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A folder with a case on a mesh, a simulator, and a home folder of its own."""
    write_mesh(tmp_path / "body.vtu", brick_box((4, 2, 2), (2.0, 1.0, 1.0)))
    write_case(('shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5', 'mesh = "body.vtu"'))
    (tmp_path / "sim.py").write_text(SIMULATOR, encoding="utf-8")
    (tmp_path / "home of mine").mkdir()
    # What others cache at home, fonts and forms, takes long to make anew.
    monkeypatch.setenv(
        "XDG_CACHE_HOME", os.environ.get("XDG_CACHE_HOME") or f"{Path.home()}/.cache"
    )
    monkeypatch.setenv("HOME", str(tmp_path / "home of mine"))
    return tmp_path


def require_no_folders(folder: Path, *files: Path) -> None:
    secret = [str(folder), str(Path.home()), sys.executable, str(Path(sys.executable).parent)]
    assert files
    for file in files:
        read = file.read_bytes().decode("utf-8", errors="replace")
        for text in (read, html.unescape(read), read.replace("\\/", "/")):
            found = [each for each in secret if each in text]
            assert found == [], (file.name, found)


@pytest.mark.parametrize("more", ["", " fail"])
@pytest.mark.parametrize("where", ["here", "elsewhere"])
def test_outputs_of_a_gate(palpate_run: Run, folder: Path, more: str, where: str) -> None:
    program = f"{sys.executable} {folder / 'sim.py'} {{case}} {{result}}{more}"
    names = {"--json": "r.json", "--junit": "j.xml", "--summary": "s.md"}
    outputs = [word for option, name in names.items() for word in (option, folder / name)]
    start = folder if where == "here" else folder / "home of mine"
    judged = ("block",) if more else (folder / "block.toml", "--metamorphic")
    done = palpate_run("gate", *judged, "--simulator", program, *outputs, folder=start)
    assert done.returncode == 1, done.stderr
    require_no_folders(folder, *(folder / name for name in names.values()))
    assert "sim" in (folder / "r.json").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_report(palpate_run: Run, folder: Path) -> None:
    program = f"{sys.executable} {folder / 'sim.py'} {{case}} {{result}}"
    for file in ("block.toml", "block.vtu"):
        shutil.copy(builtin_folder() / file, folder)
    (folder / "references").mkdir()
    shutil.copy(references_folder() / "block.npz", folder / "references")
    words = ("report", folder / "block.toml", "-o", folder / "out", "--simulator", program)
    assert palpate_run(*words, folder=folder).returncode == 1
    files = [file for file in (folder / "out").rglob("*") if file.is_file()]
    assert {"report.html", "results.json", "junit.xml", "summary.md"} <= {f.name for f in files}
    require_no_folders(folder, *files)
    found = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    assert found["cases"][0]["provenance"]["case_file"] == "block.toml"
    given = found["cases"][0]["provenance"]["command"]
    assert "--simulator 'python sim.py {case} {result}'" in given  # as it can be typed


def test_other_outputs(palpate_run: Run, folder: Path) -> None:
    assert palpate_run("solve", "block.toml", "-o", folder / "u.vtu", folder=folder).returncode == 0
    words = ("audit", folder / "block.toml", folder / "u.vtu", "--degree", "1", "--json")
    assert palpate_run(*words, folder / "a.json", folder=folder).returncode == 0
    assert palpate_run("export", folder / "block.toml", "-o", "case", folder=folder).returncode == 0
    exported = (folder / "case").iterdir()
    require_no_folders(folder, folder / "a.json", folder / "u.vtu", *exported)
    rows = bench_json({"left_out": {"x": f"{sys.executable} has no x"}, "rows": []})
    assert json.loads(rows)["left_out"] == {"x": "python has no x"}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("{here}/a/b.toml and {here}", "a/b.toml and ."),
        ("{here}2", "a b2"),
        ("{home}/x/y.py --data={home}", "~/x/y.py --data=~"),
        ("'/opt/tools/sim' -c /opt/etc/my.cfg", "'sim' -c my.cfg"),
        ("C:\\Users\\me\\case.toml, D:/me/case.toml", "case.toml, case.toml"),
        ("file://{here}/x", "file://x"),
        ("https://doi.org/10.1000/182 and/or 3 N/m, 1 / 2, ../../x", None),
        ("load[0]/x /a", None),
    ],
)
def test_files_are_named_by_the_working_folder_or_by_name(
    text: str, shown: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, home = tmp_path / "a b", tmp_path / "me"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HOME", str(home))
    filled = text.replace("{here}", str(here)).replace("{home}", str(home))
    expected = filled if shown is None else shown
    assert without_folders(filled) == expected
    assert for_json({filled: [filled, float("nan"), 1]}) == {expected: [expected, None, 1]}
    assert repr(texts_for_json([filled, float("nan")])) == repr([expected, float("nan")])


def test_a_working_folder_that_has_vanished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert without_folders("/opt/x/y") == "y"
