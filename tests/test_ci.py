"""CI itself: what fails turns it red, what it starts ends with it, no test is left out of it."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from _pytest.mark.expression import Expression

ROOT = Path(__file__).parent.parent
CI = ROOT / ".ci"

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def run(script: str, folder: Path) -> tuple[int, str]:
    """What a script made of these lines ends with, and says."""
    text = f"export OMP_NUM_THREADS=1\ncd {folder}\n. {CI / 'stages.sh'}\n{script}\nend_of_run\n"
    environment = {**os.environ, "TMPDIR": str(folder)}
    done = subprocess.run(
        ["bash", "-uo", "pipefail", "-c", text], env=environment, capture_output=True, text=True
    )
    return done.returncode, done.stdout + done.stderr


def test_a_run_is_as_good_as_its_worst_stage_and_all_are_told(tmp_path: Path) -> None:
    code, said = run("stage one true\nbeside two true\nbeside three true\nend_of_all", tmp_path)
    assert (code, "4 passed, 0 failed, 0 not run" in said) == (0, True), said
    for bad in ("stage two false", "beside two false\nend_of_all", "beside two kill -9 0"):
        code, said = run(f"beside one sleep 0\n{bad}\nend_of_all\nnot_run three because", tmp_path)
        assert code == 1, bad
        assert "FAILED  two" in said
        assert "2 passed, 1 failed, 1 not run" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core")
def test_two_run_beside_one_another(tmp_path: Path) -> None:
    """Each ends when the other has begun."""
    meets = "beside {0} timeout 20 sh -c 'touch {0}; until [ -e {1} ]; do sleep 0.05; done'"
    lines = [meets.format("one", "two"), meets.format("two", "one"), "end_of_all"]
    code, said = run("\n".join(lines), tmp_path)
    assert code == 0, said


def test_what_is_left_behind_fails_and_goes(tmp_path: Path) -> None:
    code, said = run("patience=1\nstage one setsid -f sleep 600", tmp_path)
    assert (code, "is left: sleep 600" in said) == (1, True), said
    left = re.findall(r"process (\d+) is left", said)
    assert [number for number in left if Path("/proc", number, "exe").exists()] == []
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    code, said = run('stage one touch solution.txt "$TMPDIR/more"', tmp_path)
    assert (code, "?? solution.txt" in said) == (1, True), said
    assert {path.name for path in tmp_path.iterdir()} == {".git", "solution.txt"}


def test_a_run_of_no_test_fails(tmp_path: Path) -> None:
    shutil.copy(ROOT / "tests/conftest.py", tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  dolfinx\n  once\n  slow\n")
    test = tmp_path / "test_it.py"
    skipped = "import pytest\ndef test_skipped():\n    pytest.skip('no')\n"
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    for text, code in ((skipped, 5), (f"{skipped}def test_passes():\n    pass\n", 0)):
        test.write_text(text)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert done.returncode == code, done.stdout + done.stderr


def test_every_test_is_run_whatever_its_marks() -> None:
    """By day what is not marked nightly; by night the rest, with dolfinx 0.11 the reference's."""

    def chosen(name: str) -> list[Expression]:
        text = re.sub(r"\$(\w+)", r"{\1}", (CI / name).read_text("utf-8"))
        words = dict(re.findall(r'(\w+)="(not nightly[^"]*)"', text))
        found = re.findall(r"-m (?:['\"]([^'\"]+)['\"]|(\w+))", text)
        return [
            Expression.compile((a or b).format(**words))
            for a, b in found
            if (a or b) not in ("pytest", "pip", "venv")
        ]

    by_day, by_night = chosen("run"), chosen("nightly")
    assert (len(by_day), len(by_night)) == (5, 3)
    assert "-m nightly tests/reference\n" in (CI / "nightly").read_text("utf-8")
    for marks in itertools.product((False, True), repeat=4):
        has = dict(zip(("nightly", "once", "browser", "dolfinx"), marks, strict=True))

        def matches(name: str, has: dict[str, bool] = has, **_: object) -> bool:
            return has[name]

        day = [e for e in by_day if e.evaluate(matches)]
        night = [e for e in by_night if e.evaluate(matches)]
        if has["nightly"]:
            assert (len(day), len(night)) == (0, 2), has
        else:
            assert day, has
            assert len(night) == 1, has
