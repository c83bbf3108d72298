"""Models written by hand, imported, and solved."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from palpate.meshes.problem import Problem
from palpate.validation.case import Case, load_case
from palpate.validation.importing import Imported, UnitSystem, import_model

Bring = Callable[..., tuple[Case, Imported]]


@pytest.fixture(scope="session")
def bars() -> ModuleType:
    """The file bars.py beside this one."""
    path = Path(__file__).with_name("bars.py")
    spec = importlib.util.spec_from_file_location("bars", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["bars"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def bring(tmp_path: Path) -> Bring:
    """Write a model's text to a file, import it, and load the case."""

    def bring(
        text: str, ending: str, units: UnitSystem = UnitSystem.MILLIMETRE_NEWTON
    ) -> tuple[Case, Imported]:
        path = tmp_path / f"model{ending}"
        path.write_text(text, encoding="utf-8")
        target = tmp_path / "case.toml"
        imported = import_model(path, target, units)
        return load_case(target), imported

    return bring


@pytest.fixture
def displacement() -> Callable[[Problem], object]:
    """Of the equilibrium, by fastsim."""
    from palpate.fastsim.statics import solve_static

    return lambda problem: solve_static(problem).displacement
