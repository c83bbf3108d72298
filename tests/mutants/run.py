"""Mutation tests of the judge: a slip in its own sources must turn a test red.

    python tests/mutants/run.py [--number 400] [--jobs 2] [--list]

1. every test of the judge runs once, and which lines it runs is kept (coverage.py);
2. mutants are drawn by a fixed seed (draw.py);
3. each is put into a copy of the sources, and the tests that run its line are run there, those of
   its own package first, then the quickest of the others, until one fails;
4. a mutant that no test notices is a survivor. It needs a test, or a reason in explained.toml why
   nobody can notice it.

Exit code 0 when no survivor is without a reason, 1 otherwise, 2 when the tests fail unmutated.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import Queue

import coverage

sys.path.insert(0, str(Path(__file__).parent))
from draw import PACKAGES, ROOT, Mutant, all_mutants, draw

HERE = Path(__file__).parent
WORK = ROOT / "build" / "mutants"
TESTS = [f"tests/validation/{name}" for name in (*PACKAGES, "commands", "candidates", "case")]
# Longer tests are not the place where a slip of one line should be noticed, nor are those of other
# packages beyond so many seconds of them.
LONGEST, OTHERS = 20.0, 40.0
# Tests of the night that are long and not slow are among them.
# A mutant that makes the tests so many times as long hangs, and that is noticed.
SLOWER = 5.0
_PYTEST = [
    "-m",
    "pytest",
    "-q",
    "-x",
    "-p",
    "no:cacheprovider",
    "-m",
    "not slow and not browser and (not nightly or long)",
]
Lines = dict[str, dict[int, set[str]]]


def make_tree(folder: Path) -> Path:
    """The rooms as `palpate` with a copy of validation that may be spoiled."""
    view = folder / "palpate"
    for old in (folder, compiled_of(folder)):
        shutil.rmtree(old, ignore_errors=True)
    view.mkdir(parents=True)
    for room in ("meshes", "reference", "fastsim"):
        (view / room).symlink_to(ROOT / room)
    shutil.copytree(
        ROOT / "validation", view / "validation", ignore=shutil.ignore_patterns("__pycache__")
    )
    door = (ROOT / "validation" / "front_door.py.in").read_text(encoding="utf-8")
    (view / "__init__.py").write_text(door.replace("${version}", "dev"), encoding="utf-8")
    return folder


def environment(tree: Path) -> dict[str, str]:
    """For Python to find that tree and no other palpate; what it compiles is stored apart."""
    asked = {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    asked["PYTHONPYCACHEPREFIX"] = str(compiled_of(tree))
    return {**os.environ, **asked}


def compiled_of(tree: Path) -> Path:
    """Where the compiled files of a tree are; those of all sources, by the paths of these."""
    return tree.with_name(f"{tree.name}-compiled")


def forget_compiled(tree: Path, source: Path) -> None:
    """Let Python compile a source anew: two slips in one second have the same time."""
    folder = compiled_of(tree) / source.parent.relative_to(source.anchor)
    for file in folder.glob(f"{source.stem}.*.pyc"):
        file.unlink(missing_ok=True)


def run_once(tree: Path, jobs: int, *, again: bool) -> tuple[Lines, dict[str, float]]:
    """The tests without a mutant: lines run by each, and seconds; or those of the last run.

    Those of the last run are used where they are as they were written, of the same sources.
    """
    data, seconds, made = WORK / "coverage", WORK / "seconds.json", WORK / "made-by"
    if not (again and made.is_file() and made.read_text() == _made_by(data, seconds)):
        if again:
            print("lines and seconds are found anew: sources or files have changed", flush=True)
        for file in (made, data):
            file.unlink(missing_ok=True)
        _watch_tests(tree, data, seconds, jobs)
        made.write_text(_made_by(data, seconds))
    else:
        print(f"lines and seconds of {time.ctime(made.stat().st_mtime)}", flush=True)
    found = coverage.CoverageData(basename=str(data))
    found.read()
    lines: Lines = {}
    for file in found.measured_files():
        name = str(Path(file).relative_to(tree / "palpate"))
        by_line = found.contexts_by_lineno(file)
        lines[name] = {number: set(contexts) for number, contexts in by_line.items()}
    return lines, json.loads(seconds.read_text())


def _made_by(*files: Path) -> str:
    """SHA-256 over files and every source of the rooms and their tests."""
    rooms = ("meshes", "fastsim", "reference", "validation", "tests")
    sources = (f for r in rooms for f in (ROOT / r).rglob("*") if f.suffix in (".py", ".so"))
    digest = hashlib.sha256()
    for file in (*files, *sorted(sources)):
        digest.update(f"|{file}|".encode() + (file.read_bytes() if file.is_file() else b""))
    return digest.hexdigest()


def _watch_tests(tree: Path, data: Path, seconds: Path, jobs: int) -> None:
    """Run the tests, several folders at a time, and write what all of them cover and take."""
    asked = environment(tree)
    asked["PYTHONPATH"] += os.pathsep + str(HERE)

    def watch(folder: str) -> tuple[int, Path, Path]:
        part = WORK / folder.replace("/", "-")
        covered, taken = part.with_suffix(".coverage"), part.with_suffix(".seconds")
        command = [sys.executable, "-m", "coverage", "run", f"--data-file={covered}"]
        command += [f"--include={tree}/palpate/validation/*", *_PYTEST, "-p", "watch", folder]
        timed = {**asked, "PALPATE_SECONDS": str(taken)}
        done = subprocess.run(command, cwd=ROOT, env=timed, check=False)
        return done.returncode, covered, taken

    with ThreadPoolExecutor(jobs) as pool:
        parts = list(pool.map(watch, TESTS))
    if failed := [f"{TESTS[k]} ({parts[k][0]})" for k in range(len(TESTS)) if parts[k][0]]:
        sys.exit(f"tests fail without any mutant (pytest's exit code): {', '.join(failed)}")
    combine = [sys.executable, "-m", "coverage", "combine", f"--data-file={data}"]
    subprocess.run([*combine, *(str(covered) for _, covered, _ in parts)], cwd=ROOT, check=True)
    taken = {name: t for *_, file in parts for name, t in json.loads(file.read_text()).items()}
    seconds.write_text(json.dumps(taken))


def tests_of(mutant: Mutant, lines: Lines, seconds: dict[str, float]) -> list[str]:
    """Tests that run its line, its own package's first and the quick ones before the others.

    Of a constant that is made when the file is read, those that run any line of the file.
    """
    by_line = lines.get(mutant.path, {})
    found = by_line.get(mutant.line, set()) - {""}
    # Outside of functions, in a class too, it is the test that happens to import the file first.
    inside = mutant.location.removeprefix(f"{mutant.path}: ").split(": ")[0].lstrip("_")
    if not found or inside == "None" or inside[:1].isupper():
        found = set().union(*by_line.values()) - {""}
    quick = [name for name in found if seconds.get(name, 0.0) <= LONGEST]
    quick.sort(key=lambda name: seconds.get(name, 0.0))
    folder = f"tests/{Path(mutant.path).parent}/"
    own = [name for name in quick if name.startswith(folder)]
    spent = 0.0
    for name in quick:
        spent += 0.0 if name in own else seconds.get(name, 0.0)
        if name not in own and spent <= OTHERS:
            own.append(name)
    return own


def is_noticed(mutant: Mutant, tests: list[str], tree: Path, time_limit: float) -> bool:
    """Whether a test fails with the mutant in the tree, or they do not end in time [s]."""
    if not tests:
        return False
    target = tree / "palpate" / mutant.path
    whole = target.read_text(encoding="utf-8")
    target.write_text(mutant.source(), encoding="utf-8")
    forget_compiled(tree, target)
    try:
        done = subprocess.run(
            [sys.executable, *_PYTEST, *tests],
            cwd=ROOT, env=environment(tree), timeout=time_limit, check=False,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return True
    finally:
        target.write_text(whole, encoding="utf-8")
        forget_compiled(tree, target)
    return done.returncode != 0


def explained() -> dict[str, str]:
    """Why a survivor cannot be noticed, by its place."""
    text = (HERE / "explained.toml").read_text(encoding="utf-8")
    return {entry["mutant"]: entry["reason"] for entry in tomllib.loads(text).get("survivor", [])}


@contextmanager
def one_of(trees: Queue[Path]) -> Iterator[Path]:
    """A tree that nobody else uses."""
    tree = trees.get()
    try:
        yield tree
    finally:
        trees.put(tree)


def main() -> int:
    """Run them and say what survived."""
    parser = argparse.ArgumentParser(description="Mutation tests of the judge.")
    parser.add_argument("--number", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--again", action="store_true", help="lines and seconds of the last run, if nothing changed"
    )
    parser.add_argument("--list", action="store_true", help="print the draw and end")
    parser.add_argument("--only", default="", help="mutants whose place holds this text")
    given = parser.parse_args()
    everything = list(all_mutants())
    drawn = [m for m in draw(given.number, everything) if given.only in m.location]
    print(f"{len(drawn)} mutants drawn of {len(everything)}", flush=True)
    if given.list:
        print("\n".join(m.location for m in drawn))
        return 0
    trees: Queue[Path] = Queue()
    for k in range(given.jobs):
        trees.put(make_tree(WORK / f"tree-{k}"))
    with one_of(trees) as tree:
        lines, seconds = run_once(tree, given.jobs, again=given.again)
    known, outcomes = explained(), defaultdict(list)

    def try_one(mutant: Mutant) -> None:
        tests = tests_of(mutant, lines, seconds)
        limit = 60.0 + SLOWER * sum(seconds.get(name, 0.0) for name in tests)
        with one_of(trees) as tree:
            noticed = is_noticed(mutant, tests, tree, limit)
        word = "noticed" if noticed else "explained" if mutant.location in known else "SURVIVED"
        outcomes[word].append(mutant.location)
        print(f"{word:10}{mutant.location}", flush=True)

    with ThreadPoolExecutor(given.jobs) as pool:
        list(pool.map(try_one, drawn))
    tried = {location for locations in outcomes.values() for location in locations}
    for location in sorted(set(known) - set(outcomes["explained"])):
        if location in tried or not given.only:
            print(f"no longer needed in explained.toml: {location}")
    counts = [f"{len(outcomes[word])} {word.lower()}" for word in ("noticed", "explained")]
    print(f"{', '.join(counts)}, {len(outcomes['SURVIVED'])} survived without a reason")
    return 1 if outcomes["SURVIVED"] else 0


if __name__ == "__main__":
    sys.exit(main())
