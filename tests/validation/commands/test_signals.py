"""A signal at any moment ends every verb within 5 s, and no process or file is left of it."""

from __future__ import annotations

import os
import random
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from signals import PALPATE, default_signals, group_members
from verbs import verbs

from palpate.validation.case import load_case
from palpate.validation.run_folder import MARKER

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/environ").exists(), reason="looks for processes in /proc"
)
# The time that a verb has after the signal [s].
MOST_SECONDS = 5.0
# Latest moment of the signal [s]: imports, meshing, compilers and solves are before it.
LATEST = 15.0
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
WORDS = {
    "cases": "cases",
    "init": "init -o out/first.toml",
    "import": "import model.inp -o out/model.toml",
    "schema": "schema -o out/schema.json",
    "check": "check kidney",
    "mesh": "mesh kidney --size 4 --uniform -o out/kidney.vtu",
    "export": "export kidney -o out/case",
    "compare": "compare block.toml solution.npz --live --json out/found.json",
    "compare-runs": "compare-runs none.json none.json --summary out/found.md",
    "audit": "audit block.toml solution.npz --degree 3 --json out/found.json",
    "law": "law ogden --with reference --self-test --json out/found.json",
    "solve": "solve kidney --with reference --degree 2 -o out/solved.vtu",
    "sweep": "sweep block.toml --jobs 2 --with reference --vary "
    "material.poissons_ratio=0.1:0.4:20 -o out/sweep",
    "fit": "fit silicone-bar --parameter material.youngs_modulus --by-run -o out/fit",
    "touch": "touch block.toml --no-browser -o out/touch",
    "gate": "gate block.toml --live --json out/found.json",
    "report": "report block.toml -o out/report",
    "study": "study kidney -o out/study",
    "bench": "bench steps --json out/rows.json",
    "scoreboard": "scoreboard block.toml -o out/board",
    "history": "history mujoco --yes --disk 1e-9 -o out/history",
    "reference build": "reference build block.toml",
    "reference check": "reference check --solve",
    "reference accept": "reference accept block.toml --reason none",
}
# These are tried with every change; `.ci/nightly` tries all at several moments.
ALWAYS = ("bench", "gate", "sweep")


def test_every_verb_is_tried() -> None:
    assert {verb for verb, _ in verbs()} == set(WORDS)


def ended_by_a_signal(
    folder: Path, write_case: Callable[..., Path], verb: str, name: str, moment: float
) -> None:
    """Start a verb, send it the signal at the moment [s], and look at what is left."""
    write_case()
    mesh = load_case(folder / "block.toml").problem.mesh
    np.savez(folder / "solution.npz", displacement=1e-3 * mesh.points)
    (folder / "model.inp").write_text("*NODE\n1, 0, 0, 0\n", encoding="utf-8")
    scratch, out, said = folder / "t", folder / "out", folder / "said.txt"
    for made in (scratch, out):
        made.mkdir()
    with (
        said.open("w+b") as stream,
        subprocess.Popen(
            [*PALPATE, *shlex.split(WORDS[verb])],
            stdout=stream,
            stderr=stream,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(scratch)},
            start_new_session=True,
            preexec_fn=default_signals,
        ) as process,
    ):
        time.sleep(moment)
        process.send_signal(getattr(signal, name))
        sent = time.monotonic()
        try:
            process.wait(4 * MOST_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
        seconds = time.monotonic() - sent
    about = f"{verb}, {name} after {moment:.2f} s, {process.returncode}: {said.read_text()[-2000:]}"
    assert seconds <= MOST_SECONDS, f"{seconds:.1f} s: {about}"
    end = time.monotonic() + 2.0  # a supervisor sees that palpate has ended
    while group_members(scratch) and time.monotonic() < end:
        time.sleep(0.05)
    assert group_members(scratch) == [], about
    assert list(scratch.rglob("*")) == [], about
    # A run that was through before the signal has a marker.
    left = [p for p in folder.rglob(".*") if p.is_relative_to(out) and p.name != MARKER]
    assert left == [], about


@pytest.mark.parametrize("verb", ALWAYS)
def test_a_signal_ends_it_soon(tmp_path: Path, write_case: Callable[..., Path], verb: str) -> None:
    dice = random.Random()
    ended_by_a_signal(tmp_path, write_case, verb, dice.choice(SIGNALS), dice.uniform(1.0, 6.0))


@pytest.mark.nightly
@pytest.mark.parametrize("verb", WORDS)
@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("turn", range(3))
def test_a_signal_at_any_moment_ends_every_verb(
    tmp_path: Path, write_case: Callable[..., Path], verb: str, name: str, turn: int
) -> None:
    moment = random.Random().uniform(0.0, LATEST / 3 ** (2 - turn))
    ended_by_a_signal(tmp_path, write_case, verb, name, moment)


# What a verb does with a signal: it waits while it tidies up, or leaves a thread that runs on.
WAITING = """
import os, signal, sys, threading, time
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.commands import endings

endings._PATIENCE = 0.5
with endings.stoppable() as stop:
    try:
        with scratch_folder("wait"):
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            finally:
                time.sleep(60 if sys.argv[1] == "tidying" else 0)
    except KeyboardInterrupt:
        pass
threading.Thread(target=time.sleep, args=(60,)).start()
endings.end_soon(stop.number)
"""


@pytest.mark.parametrize("waits", ["tidying", "thread"])
def test_what_waits_after_a_signal_does_not_keep_the_process(tmp_path: Path, waits: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WAITING, waits],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        preexec_fn=default_signals,
        timeout=30,
        check=False,
    )
    assert done.returncode == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
