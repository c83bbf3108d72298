"""What the adapters for CalculiX and FEBio write of a problem is imported as that problem."""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.bricks import side
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.importing import UnitSystem
from palpate.validation.peers import adapters

FOLDER = Path(adapters.__file__).parent


def written(problem, strain, monkeypatch, ending):
    """The adapter's input file; it is a program of its own, with files beside it."""
    monkeypatch.syspath_prepend(str(FOLDER))
    job = {**rest_arrays(problem), "strain": str(strain), "law": str(problem.material.law)}
    if ending == ".feb":
        return importlib.import_module("febio").model_file(job)
    return importlib.import_module("calculix")._input_file(job, "C3D4", "SPOOLES")


@pytest.mark.parametrize(
    ("ending", "material", "strain"),
    [
        (".inp", Material(1000.0, 0.3), Strain.LINEAR),
        (".inp", Material(1000.0, 0.3), Strain.GREEN),
        (".inp", Material(1000.0, 0.4, law=Law.NEO_HOOKEAN_ISOCHORIC), Strain.GREEN),
        (".inp", Material.mooney_rivlin(c10=150.0, c01=40.0, bulk_modulus=2e3), Strain.GREEN),
        (".feb", Material(1000.0, 0.3, 1200.0), Strain.GREEN),
        (".feb", Material(1000.0, 0.4, 1200.0, law=Law.NEO_HOOKEAN), Strain.GREEN),
    ],
)
def test_a_traction_a_weight_and_a_moved_support(
    bring, problem, monkeypatch, ending, material, strain
):
    mesh = problem.mesh
    (push,) = problem.loads
    assert isinstance(push, Traction)
    lifted = side(mesh, 2, 1.0)
    # Above the fixed end's row, which is fixed already.
    lifted = lifted[(mesh.points[lifted][:, :, 0] > 0.9).all(axis=1)]
    moved = Support(np.unique(lifted), lifted, (False, True, False), (0.0, 0.05, 0.0))
    posed = dataclasses.replace(
        problem,
        material=material,
        supports=(*problem.supports, moved),
        loads=(push, BodyForce((0.0, 0.0, -20.0))),
    )
    text = written(posed, strain, monkeypatch, ending)
    case, imported = bring(text, ending, UnitSystem.METRE_NEWTON)
    assert case.strain is strain
    if ending == ".feb":  # which has the density too; nodes keep their order in both
        assert case.problem.material == material
        assert np.array_equal(case.problem.mesh.points, posed.mesh.points)
    kinds = sorted(type(load).__name__ for load in case.problem.loads)
    assert kinds == ["BodyForce", "Traction"]
    ours = solve_static(posed, strain=strain).displacement
    theirs = solve_static(case.problem, strain=strain).displacement
    # CalculiX's file has thirteen digits.
    assert np.abs(ours - theirs).max() <= 1e-10 * np.abs(ours).max()
    assert any("uniform weight" in line for line in imported.notes)
    assert any("uniform traction on" in line for line in imported.notes)
