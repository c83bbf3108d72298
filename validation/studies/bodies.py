"""What several studies ask of a body, and the inputs of a problem changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from palpate.fastsim.statics import StaticResult
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import scale_loads

# fastsim's statics, or what is put to the test in its place.
Solve = Callable[..., StaticResult]


def volume_change(mesh: TetMesh, displacement: Points) -> float:
    """Over the rest volume [-]."""
    return float(signed_volumes(mesh.points + displacement, mesh.cells).sum()) / mesh.volume - 1.0


def changed(problem: Problem, name: str, factor: float) -> Problem:
    """The problem with one input multiplied: "load", "Young's modulus" or "Poisson's ratio"."""
    if name == "load":
        return scale_loads(problem, factor)
    field = {"Young's modulus": "youngs_modulus", "Poisson's ratio": "poissons_ratio"}[name]
    value = factor * getattr(problem.material, field)
    material = dataclasses.replace(problem.material, **{field: value})
    return dataclasses.replace(problem, material=material)
