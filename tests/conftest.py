"""Settings shared by all tests."""

from __future__ import annotations

import functools
import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
_STARTED = time.time()


# What `make test` runs takes about so long on two cores [minutes].
EXPECTED_MINUTES = 10
_SECONDS = "palpate/seconds-of-make-test"


def _is_make_test(config: pytest.Config) -> bool:
    return bool(os.environ.get("PALPATE_MAKE_TEST")) and not hasattr(config, "workerinput")


def pytest_report_header(config: pytest.Config) -> str | None:
    """How long `make test` takes: here, where it has passed before."""
    if not _is_make_test(config):
        return None
    seconds = config.cache.get(_SECONDS, None) if config.cache else None
    here = "" if seconds is None else f"; here it took {seconds / 60.0:.0f} minutes"
    return (
        f"palpate: what a change waits for, about {EXPECTED_MINUTES} minutes on two cores{here}\n"
        "palpate: long, slow and browser tests are in .ci/run, nightly ones in .ci/nightly"
    )


@functools.cache
def _has_dolfinx() -> bool:
    return any(importlib.util.find_spec(name) for name in ("dolfinx", "dolfinx_solver"))


@pytest.hookimpl(tryfirst=True)  # before -m chooses by markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip, visibly, what needs FEniCSx where there is none; mark what runs `once`."""
    for item in items:
        marks = {mark.name for mark in item.iter_markers()}
        if "dolfinx" not in marks or marks & {"long", "slow"}:
            item.add_marker(pytest.mark.once)
        if "dolfinx" in marks and not _has_dolfinx():
            item.add_marker(pytest.mark.skip(reason="FEniCSx (dolfinx) is not installed"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of these sources, built once in a run: minutes on a busy machine.

    Who uses it takes `pytest.mark.timeout(0)`: a test's time limit counts its fixtures too.
    """
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*command, "--disable-pip-version-check", "-w", str(folder), str(ROOT)],
        capture_output=True,
        text=True,
        check=False,
        env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    (built,) = folder.glob("palpate-*.whl")
    return built


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A run in which every test was skipped has tested nothing: it ends as one without tests."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or session.config.option.collectonly or session.exitstatus != 0:
        return
    if not any(reporter.stats.get(word) for word in ("passed", "failed", "xfailed")):
        session.exitstatus = pytest.ExitCode.NO_TESTS_COLLECTED
    elif _is_make_test(session.config) and session.config.cache:
        session.config.cache.set(_SECONDS, time.time() - _STARTED)
