"""Settings shared by all tests."""

from __future__ import annotations

import importlib.util

import pytest


def _has_dolfinx() -> bool:
    return any(importlib.util.find_spec(name) for name in ("dolfinx", "dolfinx_solver"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip, visibly, what needs FEniCSx where there is none."""
    if _has_dolfinx():
        return
    for item in items:
        if item.get_closest_marker("dolfinx"):
            item.add_marker(pytest.mark.skip(reason="FEniCSx (dolfinx) is not installed"))
