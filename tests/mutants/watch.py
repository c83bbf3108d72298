"""A plugin of pytest: which lines each test runs, by coverage's contexts, and how long it takes."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

_seconds: dict[str, float] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """One context for each test, its fixtures included."""
    watcher = coverage.Coverage.current()
    assert watcher is not None
    watcher.switch_context(item.nodeid)
    start = time.perf_counter()
    result = yield
    _seconds[item.nodeid] = time.perf_counter() - start
    watcher.switch_context("")
    return result


def pytest_sessionfinish() -> None:
    """Leave the seconds beside the lines."""
    Path(os.environ["PALPATE_SECONDS"]).write_text(json.dumps(_seconds), encoding="utf-8")
