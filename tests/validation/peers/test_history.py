"""History of released versions: a fake index of wheels in a folder, and a simulator in them."""

import json
import os
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.reference.availability import is_available
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


def write_wheel(folder, version, times, name="fakesim"):
    """A wheel of the package fakesim, or of another."""
    info = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as wheel:
        wheel.writestr(f"{name}.py", f"LAMBDA = {times}\n")
        wheel.writestr(
            f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
        )
        wheel.writestr(
            f"{info}/WHEEL",
            "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        wheel.writestr(f"{info}/RECORD", f"{name}.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n")


def see_wheels(folder, cache, monkeypatch):
    """pip sees wheels of these versions alone, and environments are stored in `cache`."""
    folder.mkdir(exist_ok=True)
    for version, times in VERSIONS.items():
        write_wheel(folder, version, times)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    return folder


@pytest.fixture
def index(tmp_path, monkeypatch):
    """The wheels and environments of one test."""
    return see_wheels(tmp_path / "wheels", tmp_path / "cache", monkeypatch)


@pytest.fixture
def shared_index(tmp_path_factory, monkeypatch):
    """The same wheels and environments for all who do not ask how they are installed."""
    folder = tmp_path_factory.getbasetemp()
    return see_wheels(folder / "wheels", folder / "released", monkeypatch)


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


@pytest.mark.usefixtures("shared_index")
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


def test_the_change_is_found_between_its_versions_and_named(shared_index, peer):
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
    wheel = shared_index / "fakesim-1.0.0-py3-none-any.whl"
    assert page.tables["wheels"].rows[0][1:] == (wheel.name, released.file_hash(wheel))
    again = trace(peer, "fakesim", ["1.0.0"], load_cases(["stretch"]), gigabytes=0.1)
    assert [e.is_new for e in again.environments] == [False]


def test_a_bisection_installs_only_what_it_needs(index, peer):
    for k in range(11, 15):
        write_wheel(index, f"1.{k}.0", 1.0)
    versions = released.in_range(released.released_versions("fakesim"), ":")
    cases = load_cases(["stretch"])
    found = trace(peer, "fakesim", versions, cases, gigabytes=0.1, bisects=True)
    (change,) = found.changes
    assert (change.before.version, change.after.version) == ("1.1.0", "1.2.0")
    assert len(found.environments) == len(versions) - len(found.not_tried) < 6
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
    assert sorted(p.name for p in released.cache_folder().iterdir() if p.is_dir()) == [
        f"fakesim-1.0.0-py{sys.version_info.major}{sys.version_info.minor}"
    ]


@pytest.mark.usefixtures("index")
def test_two_installs_at_once_are_one_after_the_other():
    with ThreadPoolExecutor(3) as pool:
        asked = [pool.submit(released.installed, "fakesim", "1.0.0", (), 10**8) for _ in range(3)]
        found = [each.result() for each in asked]
    assert sorted(each.is_new for each in found) == [False, False, True]
    assert len({each.python for each in found}) == 1


@pytest.mark.usefixtures("peer")
def test_what_pip_prints_reaches_neither_terminal_nor_page(tmp_path, monkeypatch, index, capfd):
    # An index that does not exist, whose name is a secret; pip names it in its warnings.
    secret = "user:secret@no-such-index.invalid"
    monkeypatch.delenv("PIP_NO_INDEX")
    monkeypatch.setenv("PIP_INDEX_URL", f"https://{secret}/simple")
    monkeypatch.setenv("PIP_RETRIES", "0")
    out = tmp_path / "out"
    words = ["history", "fakesim", "stretch", "--versions", "1.1:1.2", "--yes", "-o", str(out)]
    done = CliRunner().invoke(app, words)
    said = [done.output, str(done.exception), "".join(capfd.readouterr())]
    said += [f.read_text() for f in out.iterdir() if f.suffix in {".html", ".csv", ".json"}]
    assert done.exit_code == 1, said
    assert "changed between 1.1.0 and 1.2.0" in "".join(said)
    for text in said:
        assert "no-such-index" not in text
        assert "secret" not in text
        assert str(index) not in text


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


def test_versions_that_were_not_judged_are_no_change_and_one_that_ends_without_a_result_is():
    def one(error, verdict=Verdict.SKIPPED):
        return Judgement("1", "c", verdict, error)

    assert differ(one(None, Verdict.FAILED), one(0.1))
    assert differ(one(1e-9), one(None, Verdict.FAILED))
    assert not differ(one(None, Verdict.FAILED), one(None))
    assert not differ(one(None, Verdict.FAILED), one(None, Verdict.FAILED))

    assert differ(one(0.1), one(0.2))
    assert not differ(one(0.1), one(0.1001))
    assert not differ(one(1e-9), one(1e-6))
    assert not differ(one(None), one(0.1))


def test_simulators_are_known_by_package_or_row_and_others_are_refused():
    assert peer_of("mujoco")[1] == peer_of("mujoco-flex")[1] == "mujoco"
    with pytest.raises(InputError, match="no released simulator 'none'; there are mujoco"):
        peer_of("none")


def test_a_simulator_in_single_precision_scatters_by_more_before_it_is_another():
    a, b = (Judgement("1", "c", Verdict.FAILED, e, scatter=2e-3) for e in (0.9e-3, 1.8e-3))
    assert not differ(a, b)
    assert differ(a, Judgement("2", "c", Verdict.FAILED, 5e-3, scatter=2e-3))


@pytest.mark.usefixtures("shared_index")
def test_a_version_that_the_adapter_is_not_written_for_is_skipped_with_a_word(peer):
    cases = load_cases(["stretch"])
    newer = peer.model_copy(update={"works_with": "1.2:"})
    found = trace(newer, "fakesim", ["1.1.0", "1.2.0"], cases, gigabytes=0.1)
    old, new = found.judgements
    assert (old.outcome, old.words) == ("skipped", "the adapter is written for 1.2: alone")
    assert (new.outcome, new.words) == ("number", "agrees")
    assert not found.changes


def test_a_range_of_versions_may_need_others_beside_it(index, peer):
    write_wheel(index, "2.0.0", 1.0, name="beside")
    write_wheel(index, "3.0.0", 1.0, name="beside")
    old = peer.model_copy(update={"beside": {"1.0:1.1": ("beside<3",)}, "packages": ("fakesim",)})
    found = trace(old, "fakesim", ["1.1.0", "1.2.0"], load_cases(["stretch"]), gigabytes=0.1)
    wheels = [sorted(name.split("-py3")[0] for name in e.wheels) for e in found.environments]
    assert wheels == [["beside-2.0.0", "fakesim-1.1.0"], ["fakesim-1.2.0"]]
    assert released.is_cached("fakesim", "1.1.0", ["beside<3"])
    assert not released.is_cached("fakesim", "1.1.0", [])


@pytest.mark.usefixtures("shared_index")
def test_options_go_to_the_adapter_and_onto_the_page(peer, tmp_path):
    adapter = tmp_path / "fake_adapter.py"
    text = adapter.read_text().replace("RATIO = 1.5", "RATIO = float(sys.argv[3][6:]) * 1.5")
    adapter.write_text(text)
    given = history.with_options(peer, ["ratio=0.5"])
    found = trace(given, "fakesim", ["1.0.0", "1.2.0"], load_cases(["stretch"]), gigabytes=0.1)
    # lmbda is 2 and 1 times what was asked, and half of that: the change is the other way round.
    assert [j.words[:25] for j in found.judgements] == ["agrees", "Lamé's lmbda 0.500 times "]
    assert "Options of the adapter: ratio=0.5" in page_of(found)[1].tables["settings"].rows[0]
    for wrong in ("ratio", "=1", "a b=1"):
        with pytest.raises(InputError, match="needs NAME=VALUE"):
            history.with_options(peer, [wrong])


def test_cases_are_posed_under_the_law_that_a_simulator_solves():
    (stretch,) = load_cases(["stretch"])
    assert history.of_its_law(peer_of("mujoco")[0], [stretch]) == [stretch]
    if is_available():
        (posed,) = history.of_its_law(peer_of("newton-vbd")[0], [stretch])
        assert posed.problem.material.law is Law.NEO_HOOKEAN_STABLE


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("words", "versions", "code", "said"),
    [
        ("mujoco shear --option turned=60", "3.10:3.11", 1, "changed between 3.10.0 and 3.11.0"),
        # Its lambda was twice what was asked.
        ("mujoco stretch", "3.17:4.0", 1, "changed between 3.17.0 and 4.0.0"),
        ("mujoco shear", "3.17:4.0", 1, "lmbda 2.000 times what was asked"),
        ("felupe-neo-hooke turned", "8.5.0:8.5.1", 1, "changed between 8.5.0 and 8.5.1"),
        ("newton-xpbd shear", "1.8.0", 1, "shear-neo-hookean-stable: no change"),
        ("newton shear --option constants=lame", "1.8.0", 1, "30.2"),
        # No result, and so nothing to judge: a fifth of the load is out of balance.
        ("newton-vbd shear --time-limit 500", "1.0.0", 3, "no version has a result"),
    ],
)
def test_what_was_found_in_released_software_is_found_again(words, versions, code, said, tmp_path):
    command = [sys.executable, "-m", "palpate.validation.cli", "history", *words.split()]
    command += ["--versions", versions, "--yes", "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    assert said in done.stdout
