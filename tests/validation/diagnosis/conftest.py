"""The one-file simulator, and a case's problem as it solves it with a seeded mistake."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from judged import case_of, stored

from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.states import State, in_silence

SIMULATOR = Path(__file__).parent / "one_file_simulator.py"


def load_simulator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("one_file_simulator", SIMULATOR)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Solutions:
    """Solutions of the one-file simulator to built-in cases, each asked for once."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._simulator = folder, load_simulator()
        self._states: dict[tuple[str, str], State] = {}

    def of(self, name: str, mistake: str = "") -> State:
        key = (name, mistake)
        if key not in self._states:
            case = case_of(name)
            self._states[key] = self.to(case.problem, case.strain, mistake)
        return self._states[key]

    def to(self, problem: Problem, strain: Strain, mistake: str = "") -> State:
        folder = self._folder / str(len(list(self._folder.iterdir())))
        write_case_folder(folder / "case", problem, strain, name="case")
        result = folder / "result.npz"
        self._simulator.solution(folder / "case", result, mistake)
        return result_candidate(result).solve(problem, strain, in_silence)


@pytest.fixture(scope="session")
def solutions(tmp_path_factory: pytest.TempPathFactory) -> Solutions:
    return Solutions(tmp_path_factory.mktemp("solutions"))


@pytest.fixture(scope="session")
def reference() -> Callable[[str], State]:
    """A case's reference on its own mesh, with its strain measure."""
    return lambda name: stored(name, SAME_MESH, case_of(name).strain)
