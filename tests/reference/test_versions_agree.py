"""dolfinx 0.5 and 0.11 give the same answer to 1e-9.

The other Python is named by the environment variable PALPATE_OTHER_PYTHON; PYTHONPATH must let it
import palpate too, where palpate is not installed for it.
"""

from __future__ import annotations

import dataclasses
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from bank import beyond, loaded_bar, pressure, support
from judged import case_of, large_by_night

from palpate.meshes.material_law import Law
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Inclusion, Problem, Strain, TimeSpan
from palpate.meshes.problem_files import save_problem
from palpate.meshes.rigid_tool import ContactRule, RigidTool, SphereShape, ToolPath
from palpate.meshes.spring import AnchorPath, Spring
from palpate.reference.result import Formulation
from palpate.reference.schemes import Integrator
from palpate.reference.tasks import ImplicitTask, StaticTask, SteppedTask
from palpate.validation.case import builtin_cases
from palpate.validation.diagnosis.law_simulators import example_material

OTHER = os.environ.get("PALPATE_OTHER_PYTHON", "")

pytestmark = [
    pytest.mark.dolfinx,
    pytest.mark.skipif(not OTHER, reason="PALPATE_OTHER_PYTHON names no second Python"),
]

MIXED, VERTICES, FACETS = Formulation.MIXED, ContactRule.VERTICES, ContactRule.FACETS
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


def furnished(rule=None, *, law=Law.SAINT_VENANT_KIRCHHOFF, nu=0.4):
    """Of two materials, with a pressure, a spring, a mass, and a slanted wall or a rough ball."""
    problem = loaded_bar(loads=(pressure,))
    mesh = problem.mesh
    wall = support(mesh, "x1", normal=(1.0, 0.2, 0.1))
    spring = Spring.on(mesh, (0.3, 0.0, 0.05), 0.08, 20.0, AnchorPath([0.0], [[0.0, 0.0, -0.01]]))
    way = np.array([[0.2, 0.05, -0.052], [0.2, 0.05, -0.045], [0.205, 0.05, -0.045]])
    if rule is not None:
        ball = RigidTool(SphereShape(0.05), ToolPath([0.0, 0.05, 0.1], way), 0.3, contact=rule)
    return dataclasses.replace(
        problem,
        material=example_material(law, nu),
        inclusions=(Inclusion(beyond(mesh, 0.2), example_material(law, 0.35)),),
        supports=(*problem.supports, wall) if rule is None else problem.supports,
        springs=(spring,),
        masses=(PointMass(mesh.facet_groups["x1"], 0.5),),
        tools=() if rule is None else (ball,),
        time=TimeSpan(0.1, 5e-4, 5.0, 5, stiffness_damping=1e-5),
    )


STILL = ("displacement", "cauchy_stress", "support_forces", "strain_energy")
MOVING = ("displacements", "kinetic_energies", "strain_energies")


@pytest.mark.parametrize(
    ("options", "task", "names"),
    [
        ({"rule": FACETS}, StaticTask(), STILL),
        ({"law": Law.OGDEN}, StaticTask(degree=2), STILL),
        ({"law": Law.NEO_HOOKEAN, "nu": 0.49}, StaticTask(degree=2, formulation=MIXED), STILL),
        (
            {"rule": VERTICES},
            SteppedTask(Integrator.CENTRAL_DIFFERENCES),
            (*MOVING, "tool_forces"),
        ),
        ({}, ImplicitTask(degree=1), MOVING),
    ],
    ids=["facets", "stretches", "mixed", "explicit", "implicit"],
)
def test_all_that_a_body_may_have_is_the_same_in_the_other_version(there, options, task, names):
    problem = furnished(**options)
    if names is STILL:
        problem = dataclasses.replace(problem, time=None)
    other, here = there(problem, task), task(problem, print)
    for name in names:
        found, expected = getattr(other, name), np.asarray(getattr(here, name))
        # Contact is settled to 1e-9 of the largest force.
        assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max(), name


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
