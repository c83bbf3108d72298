"""dolfinx 0.5 and 0.11 give the same answer to 1e-9.

The other Python is named by the environment variable PALPATE_OTHER_PYTHON; PYTHONPATH must let it
import palpate too, where palpate is not installed for it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from bank import loaded_bar, pressure
from judged import case_of, large_by_night

from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.problem_files import save_problem
from palpate.reference.tasks import StaticTask
from palpate.validation.case import builtin_cases

OTHER = os.environ.get("PALPATE_OTHER_PYTHON", "")

pytestmark = [
    pytest.mark.dolfinx,
    pytest.mark.skipif(not OTHER, reason="PALPATE_OTHER_PYTHON names no second Python"),
]

# At 1e-10 a single solve of the slenderest body is left as it is, with 5e-8 of its bending wrong.
SOLVED_TO = 1e-11


# In one process for all of them, since one that loads FEniCSx takes longer than most of the solves.
SOLVES = """
import pickle, sys
from pathlib import Path
import numpy as np
from palpate.meshes.problem_files import load_problem

for line in sys.stdin:
    problem, task, result = line.split()
    solve = pickle.loads(Path(task).read_bytes())
    found = vars(solve(load_problem(problem), lambda _line: None))
    # Not pickled: the other numpy need not know this one's arrays.
    numbers = {k: v for k, v in found.items() if isinstance(v, float | int | np.ndarray)}
    np.savez(result, dolfinx=found["versions"]["dolfinx"], **numbers)
    print("solved", flush=True)
"""
Solve = Callable[[Problem, StaticTask], SimpleNamespace]


@pytest.fixture(scope="module")
def there(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Solve]:
    """Solves in the other Python; after a failure in a new process."""
    folder = tmp_path_factory.mktemp("there")
    files = [folder / f"{name}.npz" for name in ("problem", "task", "result")]
    process: subprocess.Popen[str] | None = None

    def solve(problem: Problem, task: StaticTask) -> SimpleNamespace:
        nonlocal process
        if process is None or process.poll() is not None:
            process = subprocess.Popen(
                [OTHER, "-P", "-c", SOLVES],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                # Not the C environment, where this process's MPI has left its mark.
                env=dict(os.environ),
            )
        assert process.stdin is not None
        assert process.stdout is not None
        files[2].unlink(missing_ok=True)
        save_problem(files[0], problem)
        files[1].write_bytes(pickle.dumps(task))
        print(*files, file=process.stdin, flush=True)
        if "solved\n" not in process.stdout:  # reads on until it is said, or until the end
            pytest.fail(f"the other Python ended with {process.wait()}")
        with np.load(files[2]) as found:
            return SimpleNamespace(**{name: found[name] for name in found.files})

    yield solve
    if process is not None:
        process.communicate(timeout=60)


def largest_difference(there, problem, strain, degree, tolerance=1e-9, element=Element.LINEAR):
    task = StaticTask(strain, degree, SOLVED_TO, element=element)
    other, here = there(problem, task), task(problem, print)
    assert str(other.dolfinx) != here.versions["dolfinx"], f"{OTHER} and {sys.executable}"
    for name in ("volume", "surface_area", "strain_energy", "smallest_det_f"):
        assert getattr(other, name) == pytest.approx(getattr(here, name), rel=tolerance), name
    scale = np.abs(here.displacement).max()
    return float(np.abs(other.displacement - here.displacement).max() / scale)


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(
    ("degree", "element"), [(1, Element.LINEAR), (1, Element.SMOOTHED), (2, Element.LINEAR)]
)
def test_the_other_version_gives_the_same_answer(there, strain, degree, element):
    problem = loaded_bar(loads=(pressure,))
    assert largest_difference(there, problem, strain, degree, element=element) < 1e-9


# A hundred times as long as high: the last digits of what bends it are lost in what stretches it,
# which is (L / h)^2 as stiff.
TOLERANCES = {"sze": 1e-8}
STATIC = large_by_night(name for name in builtin_cases() if case_of(name).problem.time is None)


@pytest.mark.slow
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("name", STATIC)
def test_the_versions_agree_on_the_built_in_cases(there, name, element, strain):
    tolerance = TOLERANCES.get(name, 1e-9)
    problem = case_of(name).problem
    apart = largest_difference(there, problem, strain, 1, tolerance, element)
    assert apart < tolerance
