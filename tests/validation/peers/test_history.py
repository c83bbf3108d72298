"""History of released versions: a fake index of wheels in a folder, and a simulator in them."""

import json
import os
import subprocess
import sys
import zipfile

import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import InputError
from palpate.validation.case import load_cases
from palpate.validation.cli import app
from palpate.validation.peers import history, released
from palpate.validation.peers.history import Judgement, differ, page_of, peer_of, trace
from palpate.validation.peers.registry import Peer
from palpate.validation.states import Verdict

# What lambda is in each version, in times of what was asked.
VERSIONS = {"1.0.0": 2.0, "1.1.0": 2.0, "1.2.0": 1.0, "1.10.0": 1.0}
ADAPTER = """
import sys
from pathlib import Path

import fakesim

RATIO = 1.5 * fakesim.LAMBDA  # of lambda over mu, where Poisson's ratio is 0.3
X = [line.split() for line in Path({points!r}).read_text().splitlines()]
side = (1.0 - 0.5 * RATIO / (RATIO + 1.0) * (1.25**2 - 1.0)) ** 0.5 - 1.0
rows = ["point,ux,uy,uz"]
for k, (x, y, z) in enumerate(X):
    rows.append(",".join(repr(v) for v in (k, 0.25 * float(x), side * float(y), side * float(z))))
Path(sys.argv[2]).write_text("\\n".join(rows))
"""


def write_wheel(folder, version, times):
    """A wheel of the package fakesim."""
    info = f"fakesim-{version}.dist-info"
    with zipfile.ZipFile(folder / f"fakesim-{version}-py3-none-any.whl", "w") as wheel:
        wheel.writestr("fakesim.py", f"LAMBDA = {times}\n")
        wheel.writestr(
            f"{info}/METADATA", f"Metadata-Version: 2.1\nName: fakesim\nVersion: {version}\n"
        )
        wheel.writestr(
            f"{info}/WHEEL",
            "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        wheel.writestr(f"{info}/RECORD", f"fakesim.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n")


@pytest.fixture
def index(tmp_path, monkeypatch):
    """pip sees these wheels alone, and environments are stored in the test's folder."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    for version, times in VERSIONS.items():
        write_wheel(folder, version, times)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return folder


@pytest.fixture
def peer(tmp_path, monkeypatch):
    (case,) = load_cases(["stretch"])
    points = tmp_path / "points.txt"
    rows = (" ".join(map(repr, map(float, row))) for row in case.problem.mesh.points)
    points.write_text("\n".join(rows))
    adapter = tmp_path / "fake_adapter.py"
    adapter.write_text(ADAPTER.format(points=str(points)))
    row = Peer(
        name="fakesim", title="Fake", module="fakesim", packages=("fakesim",),
        adapter=str(adapter.with_suffix("")), options={},
    )  # fmt: skip
    monkeypatch.setattr(history, "_RESULT", "{result:csv}")
    monkeypatch.setattr(history, "read_peers", lambda: (row,))
    return row


@pytest.mark.usefixtures("index")
def test_versions_are_sorted_by_their_numbers_and_the_last_takes_in_its_repairs():
    assert released.released_versions("fakesim") == ["1.10.0", "1.2.0", "1.1.0", "1.0.0"]
    known = [*VERSIONS, "2.0.0rc1", "1.2.0.post1"]
    assert released.in_range(known, "1.1:1.2") == ["1.1.0", "1.2.0", "1.2.0.post1"]
    assert released.in_range(known, ":1.1") == ["1.0.0", "1.1.0"]
    assert released.in_range(known, "1.3:") == ["1.10.0"]
    assert released.in_range(known, "1.2.0") == ["1.2.0", "1.2.0.post1"]
    for wrong in ("3:", "one:two", "1.2:1.0", "../x"):
        with pytest.raises(InputError, match="--versions"):
            released.in_range(known, wrong)


def test_the_change_is_found_between_its_versions_and_named(index, peer):
    cases = load_cases(["stretch"])
    found = trace(peer, "fakesim", list(VERSIONS), cases, gigabytes=0.1)
    (change,) = found.changes
    assert (change.before.version, change.after.version) == ("1.1.0", "1.2.0")
    assert change.before.words.startswith("Lamé's lmbda 2.000 times what was asked, or Poisson's")
    assert (change.after.words, change.after.verdict) == ("agrees", Verdict.PASSED)
    findings, page = page_of(found)
    assert [f.claim for f in findings] == ["stretch: changed between 1.1.0 and 1.2.0"]
    assert len(page.tables["wheels"].rows) == len(VERSIONS)
    assert all(len(row[2]) == 64 for row in page.tables["wheels"].rows)
    wheel = index / "fakesim-1.0.0-py3-none-any.whl"
    assert page.tables["wheels"].rows[0][1:] == (wheel.name, released.file_hash(wheel))
    again = trace(peer, "fakesim", ["1.0.0"], load_cases(["stretch"]), gigabytes=0.1)
    assert [e.is_new for e in again.environments] == [False]


def test_a_bisection_installs_only_what_it_needs(index, peer):
    for k in range(11, 20):
        write_wheel(index, f"1.{k}.0", 1.0)
    versions = released.in_range(released.released_versions("fakesim"), ":")
    cases = load_cases(["stretch"])
    found = trace(peer, "fakesim", versions, cases, gigabytes=0.1, bisects=True)
    (change,) = found.changes
    assert (change.before.version, change.after.version) == ("1.1.0", "1.2.0")
    assert len(found.environments) == len(versions) - len(found.not_tried) < 7
    assert "Not tried by the bisection: " in page_of(found)[1].remarks[0]


def test_what_cannot_be_installed_or_takes_too_much_space_is_skipped_with_a_word(index, peer):
    cases = load_cases(["stretch"])
    found = trace(peer, "fakesim", ["0.9.0", "1.0.0"], cases, gigabytes=0.1)
    first, second = found.judgements
    assert (first.verdict, first.error) == (Verdict.SKIPPED, None)
    assert "pip finds no wheels" in first.words
    assert str(index) not in first.words
    assert second.error == pytest.approx(0.0643, rel=1e-2)
    (tight,) = trace(peer, "fakesim", ["1.1.0"], cases, gigabytes=1e-9).judgements
    assert (tight.verdict, tight.words) == (
        Verdict.SKIPPED,
        "it takes more space than --disk leaves",
    )
    assert sorted(p.name for p in released.cache_folder().iterdir()) == [
        f"fakesim-1.0.0-py{sys.version_info.major}{sys.version_info.minor}"
    ]


@pytest.mark.usefixtures("index", "peer")
def test_the_command_asks_before_it_downloads_and_writes_the_page(tmp_path):
    out = tmp_path / "out"
    words = ["history", "fakesim", "stretch", "--versions", "1.1:1.2", "-o", str(out)]
    refused = CliRunner().invoke(app, words)
    assert isinstance(refused.exception, InputError)
    assert "--yes downloads 2 version(s) of fakesim: 1.1.0, 1.2.0" in str(refused.exception)
    assert not out.exists()
    assert not released.cache_folder().exists()
    done = CliRunner().invoke(app, [*words, "--yes"])
    assert done.exit_code == 1, done.output
    text = (out / "report.html").read_text()
    assert "changed between 1.1.0 and 1.2.0" in text
    assert "lmbda 2.000 times" in text
    assert (out / "history.csv").read_text().count("\n") == 3
    assert json.loads((out / "results.json").read_text())["verdict"] == "failed"


def test_versions_without_a_number_are_no_change():
    def one(error):
        return Judgement("1", "c", Verdict.FAILED, error)

    assert differ(one(0.1), one(0.2))
    assert not differ(one(0.1), one(0.1001))
    assert not differ(one(1e-9), one(1e-6))
    assert not differ(one(None), one(0.1))


def test_simulators_are_known_by_package_or_row_and_others_are_refused():
    assert peer_of("mujoco")[1] == peer_of("mujoco-flex")[1] == "mujoco"
    with pytest.raises(InputError, match="no released simulator 'none'; there are mujoco"):
        peer_of("none")


@pytest.mark.nightly
def test_mujocos_lambda_was_twice_what_was_asked_until_4_0_0(tmp_path):
    command = [sys.executable, "-m", "palpate.validation.cli", "history", "mujoco", "stretch"]
    command += ["shear", "--versions", "3.17:4.0", "--yes", "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert done.stdout.count("changed between 3.17.0 and 4.0.0") == 2
    assert done.stdout.count("lmbda 2.000 times what was asked") == 2
