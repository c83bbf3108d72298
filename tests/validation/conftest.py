"""Small cases written to a folder, and a small problem with its solution."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from case_texts import BLOCK, changed
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Material, Problem
from palpate.validation.references import stored
from palpate.validation.references.reference_set import ReferenceSet

BUILT_IN = stored.references_folder()


@pytest.fixture(scope="session", autouse=True)
def _built_in_references_are_checked_once() -> Iterator[None]:
    """What is stored for the built-in cases, which no test changes, is read and checked once."""
    checked, found = stored.load_checked, {}

    def load(path: Path, name: str, problem: Problem, *more: Any, **options: Any) -> ReferenceSet:
        if path.parent != BUILT_IN or not path.is_file():
            return checked(path, name, problem, *more, **options)
        key = (path, stored.problem_key(problem), *more, *options.items())
        if key not in found:
            found[key] = checked(path, name, problem, *more, **options)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stored, "load_checked", load)
        yield


@pytest.fixture
def write_case(tmp_path: Path) -> Callable[..., Path]:
    """Write the block case with some text replaced; returns its path."""

    def write(*changes: tuple[str, str], name: str = "block.toml") -> Path:
        path = tmp_path / name
        path.write_text(changed(BLOCK, *changes), encoding="utf-8")
        return path

    return write


@pytest.fixture
def palpate_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run `palpate` with some words in this process, from a folder; its exit code and words."""
    from palpate.validation.cli import main

    def run(*words: object, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
        capsys.readouterr()
        with monkeypatch.context() as patch:
            patch.setattr("sys.argv", ["palpate", *map(str, words)])
            patch.chdir(folder or Path.cwd())
            with pytest.raises(SystemExit) as ended:
                main()
        said = capsys.readouterr()
        return subprocess.CompletedProcess(words, int(ended.value.code or 0), said.out, said.err)

    return run


@pytest.fixture
def command_line(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run `palpate` with some words in this process; its exit code. The words are capsys's."""
    from palpate.validation.cli import main

    def run(*words: object) -> int:
        monkeypatch.setattr("sys.argv", ["palpate", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0)

    return run


@pytest.fixture(scope="session")
def problem() -> Problem:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.2)
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    fixed = facets[(x < 1e-9).all(axis=1)]
    pulled = facets[(x > 2.0 - 1e-9).all(axis=1)]
    return Problem(
        mesh,
        Material(1000.0, 0.3),
        (Support(np.unique(fixed).astype(np.int32), fixed),),
        (Traction(pulled, (60.0, 20.0, -10.0)),),
    )


@pytest.fixture(scope="session")
def solution(problem: Problem) -> NDArray[np.float64]:
    return solve_static(problem).displacement


LET_GO = """
schema = 1
title = "Let go"

[units]
length = "m"
stress = "Pa"

[geometry]
mesh = "bar.vtu"

[material]
youngs_modulus = 2e4
poissons_ratio = 0.4
density = 1000.0

[time]
end_time = 0.04
time_step = 5e-4
mass_damping = 1.0
num_outputs = 5

[[support]]
region = { half_space = { point = [1e-6, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }

[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -5.0]

[[check]]
metric = "trajectory_l2"
limit = 1e-6
reason = "the same scheme and step on the same mesh: what is left is the solver's"
"""


@pytest.fixture
def let_go(tmp_path: Path) -> Path:
    """A bar in motion of 18 cells, let go under its weight; its case file."""
    write_mesh(tmp_path / "bar.vtu", brick_box((3, 1, 1), (0.06, 0.02, 0.02)))
    (tmp_path / "bar.toml").write_text(LET_GO, "utf-8")
    return tmp_path / "bar.toml"


SCREEN = (1200, 3000)


def missing(what: str) -> None:
    """Without a browser these tests are skipped, except where one is required."""
    if os.environ.get("PALPATE_BROWSER_TESTS") == "required":
        pytest.fail(f"{what} is not installed")
    pytest.skip(f"{what} is not installed")


@pytest.fixture
def browser(chrome: Any) -> Any:
    """By day, on a screen of its usual size, whatever the test before did."""
    features = [{"name": "prefers-color-scheme", "value": "light"}]
    chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": features})
    chrome.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    chrome.set_window_size(*SCREEN)
    return chrome


@pytest.fixture(scope="session")
def chrome() -> Iterator[Any]:
    try:
        from selenium import webdriver
    except ImportError:
        missing("selenium")
    from palpate.validation.report.pdf import find_browser

    program, driver = find_browser(), shutil.which("chromedriver")
    if program is None or driver is None:
        missing("chromium or chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--enable-unsafe-swiftshader",
        f"--window-size={SCREEN[0]},{SCREEN[1]}",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # no network
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(executable_path=driver)
    chrome = webdriver.Chrome(options=options, service=service)
    yield chrome
    chrome.quit()


@pytest.fixture
def require_browser_tests() -> Callable[[str], None]:
    return missing
