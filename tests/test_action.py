"""The GitHub Action: its shell steps, run here with what GitHub would put into them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ACTION = ROOT / ".github" / "actions" / "palpate-gate" / "action.yml"
TOY = ROOT / "validation" / "examples" / "gate_your_simulator"

pytestmark = pytest.mark.once


def judge(folder: Path, simulator: str, cases: str = "bar.toml") -> tuple[int, str]:
    """The exit code of the step that judges, and the job's summary."""
    yaml = pytest.importorskip("yaml")
    (step,) = (
        s for s in yaml.safe_load(ACTION.read_text())["runs"]["steps"] if "Judge" in s["name"]
    )
    shutil.copytree(TOY, folder, dirs_exist_ok=True)
    program = folder / "bin" / "palpate"
    program.parent.mkdir(exist_ok=True)
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m palpate.validation.cli "$@"\n')
    program.chmod(0o755)
    summary = folder / "step-summary.md"
    inputs = {"CASES": cases, "SIMULATOR": simulator, "TIME_LIMIT": "60"}
    assert set(inputs) == set(step["env"])  # nothing else of the caller's reaches the shell
    assert "${{" not in step["run"]
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, **inputs, "PATH": path, "GITHUB_STEP_SUMMARY": str(summary)}
    done = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, summary.read_text() if summary.exists() else done.stderr


def test_a_simulator_that_passes_passes_the_job_and_its_table_is_shown(tmp_path: Path) -> None:
    code, summary = judge(tmp_path, f"{sys.executable} toy_simulator.py {{case}} {{result}}")
    assert code == 0, summary
    assert "passed" in summary
    assert (tmp_path / "results.json").is_file()


def test_one_that_fails_turns_the_job_red_and_its_table_is_shown_too(tmp_path: Path) -> None:
    code, summary = judge(
        tmp_path, f"{sys.executable} -c 'raise SystemExit(3)' {{case}} {{result}}"
    )
    assert code == 1, summary
    assert "failed" in summary


def test_words_of_an_input_are_no_commands(tmp_path: Path) -> None:
    code, _ = judge(tmp_path, "none {case} {result}", cases="bar.toml; touch stolen")
    assert code not in (0, 1)
    assert not (tmp_path / "stolen").exists()
