"""dolfinx 0.5 and 0.11 give the same answer to 1e-9.

The other Python is named by the environment variable PALPATE_OTHER_PYTHON; PYTHONPATH must let it
import palpate too, where palpate is not installed for it.
"""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.problem_files import save_problem
from palpate.reference.child import run_task
from palpate.reference.result import ReferenceResult, load_result, save_result
from palpate.reference.tasks import StaticTask
from palpate.validation.case import builtin_cases, load_case

OTHER = os.environ.get("PALPATE_OTHER_PYTHON", "")

pytestmark = [
    pytest.mark.dolfinx,
    pytest.mark.skipif(not OTHER, reason="PALPATE_OTHER_PYTHON names no second Python"),
]

# At 1e-10 a single solve of the slenderest body is left as it is, with 5e-8 of its bending wrong.
SOLVED_TO = 1e-11


def largest_difference(problem, tmp_path, strain, degree, tolerance=1e-9, element=Element.LINEAR):
    files = [tmp_path / f"{name}.npz" for name in ("problem", "task", "result")]
    save_problem(files[0], problem)
    task = StaticTask(strain, degree, SOLVED_TO, element=element)
    save_result(files[1], task)
    subprocess.run(
        [OTHER, "-P", "-m", "palpate.reference.child", *map(str, files)],
        check=True,
        timeout=500,
        stdout=subprocess.DEVNULL,
        # Not the C environment, where this process's MPI has left its mark.
        env=dict(os.environ),
    )
    there = load_result(files[2], ReferenceResult)
    here = run_task(task, problem, time_limit=500)
    assert there.versions["dolfinx"] != here.versions["dolfinx"], f"{OTHER} and {sys.executable}"
    for name in ("volume", "surface_area", "strain_energy", "smallest_det_f"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=tolerance), name
    scale = np.abs(here.displacement).max()
    return float(np.abs(there.displacement - here.displacement).max() / scale)


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(
    ("degree", "element"), [(1, Element.LINEAR), (1, Element.SMOOTHED), (2, Element.LINEAR)]
)
def test_the_other_version_gives_the_same_answer(box, tmp_path, strain, degree, element):
    mesh = box((4, 2, 2), (0.4, 0.1, 0.1), jitter=0.2)
    held = mesh.facet_groups["x0"]
    problem = Problem(
        mesh,
        Material(2e4, 0.4),
        (Support(np.unique(held).astype(np.int32), held),),
        (
            BodyForce((0.0, 200.0, -600.0)),
            Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
            Pressure(mesh.facet_groups["z1"], 80.0),
        ),
    )
    assert largest_difference(problem, tmp_path, strain, degree, element=element) < 1e-9


# A hundred times as long as high: the last digits of what bends it are lost in what stretches it,
# which is (L / h)^2 as stiff.
TOLERANCES = {"sze": 1e-8}
STATIC = [name for name in builtin_cases() if load_case(name).problem.time is None]


@pytest.mark.slow
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("name", STATIC)
def test_the_versions_agree_on_the_built_in_cases(tmp_path, name, element, strain):
    tolerance = TOLERANCES.get(name, 1e-9)
    problem = load_case(name).problem
    apart = largest_difference(problem, tmp_path, strain, 1, tolerance, element)
    assert apart < tolerance
