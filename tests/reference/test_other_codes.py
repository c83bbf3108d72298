"""Other codes on the same tetrahedra: FElupe and CalculiX know nothing of dolfinx or of palpate.

Linear tetrahedra, the Saint-Venant-Kirchhoff material, the same nodal forces; what is compared is
the displacement of every point.
"""

from __future__ import annotations

import importlib
import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Support, Traction
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.peers import adapters

if is_available():
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.statics import solve_static

pytestmark = [pytest.mark.dolfinx, pytest.mark.slow]


def bent_and_twisted_bar(box):
    mesh = box((8, 2, 2), (0.4, 0.1, 0.1), jitter=0.2)
    held = mesh.facet_groups["x0"]
    corners = np.flatnonzero(
        (mesh.points[:, 0] == 0.4) & (np.abs(mesh.points[:, 1:] - 0.05) == 0.05).all(axis=1)
    )
    spin = np.cross([1.0, 0.0, 0.0], mesh.points[corners] - [0.4, 0.05, 0.05])
    return Problem(
        mesh,
        Material(2e4, 0.4),
        (Support(np.unique(held).astype(np.int32), held),),
        (
            BodyForce((0.0, 200.0, -600.0)),
            Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
            PointForce(corners.astype(np.int32), 20.0 * spin),
        ),
    )


def job_of(problem, strain):
    """What every code is given, with the reference's own nodal forces."""
    discrete = DiscreteProblem(problem, strain=strain, degree=1)
    dead = discrete.external_force(np.zeros(discrete.num_dofs))
    return rest_arrays(problem) | {
        "external_force": discrete.space.at_points(dead),
        "strain": strain.value,
        "relative_tolerance": 1e-11,
        "load_parts": 1,
    }


def largest_difference(problem, strain, adapter, monkeypatch):
    monkeypatch.syspath_prepend(Path(adapters.__file__).parent)
    code = importlib.import_module(adapter).Static(job_of(problem, strain))
    code.advance(1)
    ours = solve_static(problem, strain=strain, relative_tolerance=1e-12).displacement
    theirs = code.result["displacement"]
    assert theirs.shape == ours.shape
    scale = np.abs(ours).max()
    # Large: linear strain would be told apart at once.
    assert scale > 0.05 * np.ptp(problem.mesh.points, axis=0).max()
    return float(np.abs(theirs - ours).max() / scale)


CASES = ["bar", "beam", "kidney"]


def problem_of(name, box):
    return bent_and_twisted_bar(box) if name == "bar" else load_case(name).problem


@pytest.mark.skipif(importlib.util.find_spec("felupe") is None, reason="FElupe is not installed")
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("name", CASES)
def test_felupe_agrees_to_eight_digits(box, name, strain, monkeypatch):
    problem = problem_of(name, box)
    assert largest_difference(problem, strain, "felupe_svk", monkeypatch) < 1e-8


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("name", CASES)
def test_calculix_agrees_to_five_digits(box, name, strain, monkeypatch):
    problem = problem_of(name, box)
    # Its .dat file holds seven digits.
    assert largest_difference(problem, strain, "calculix", monkeypatch) < 1e-5
