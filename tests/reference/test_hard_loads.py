"""Loads up to where the material ends: what the reference calls converged has no inverted cell.

The kidney and the beam are bent, twisted, squeezed, pressed and pulled, each harder and harder, on
linear tetrahedra. A plain Newton iteration in equal load steps with full Newton steps loses some of
these and calls others converged that are not; the reference raises the load in steps that adapt,
lets no cell invert, takes stable equilibria only, and says why where there is none.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import prescribe, rotation
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.validation.case import load_case

# Which way each body lies.
BODIES = {"kidney": 2, "beam": 0}


def hard_loads() -> Iterator[tuple[str, str, float, Problem]]:
    """Body, kind, strength and problem of every trial."""
    for body, axis in BODIES.items():
        case = load_case(body).problem
        mesh, stiffness = case.mesh, case.material.youngs_modulus
        along = mesh.points[:, axis]
        low, length = along.min(), float(np.ptp(along))
        foot, head = (
            np.flatnonzero(is_end).astype(np.int32)
            for is_end in (along < low + 0.12 * length, along > along.max() - 0.12 * length)
        )
        facets = mesh.boundary_facets
        top = facets[np.isin(facets, head).all(axis=1)]
        skin = facets[~np.isin(facets, foot).any(axis=1)]
        arms = mesh.points - mesh.points[head].mean(axis=0)
        up, beside = np.eye(3)[axis], np.roll(np.eye(3), 1, axis=0)[axis]
        width = float(np.ptp(mesh.points @ beside))
        # The stress of bending is about the force times the length over the width.
        bending = stiffness * width / length**2 * beside
        foothold = _hold(mesh, foot)

        def loaded(load: Load, case: Problem = case, foot: Support = foothold) -> Problem:
            return Problem(case.mesh, case.material, (foot,), (load,))

        def moved(*supports: Support, case: Problem = case, foot: Support = foothold) -> Problem:
            return Problem(case.mesh, case.material, (foot, *supports), ())

        for part in (0.02, 0.1, 0.3, 1.0, 3.0):
            yield body, "bend", part, loaded(BodyForce(_triple(part * bending)))
        for degrees in (30.0, 60.0, 90.0, 120.0, 150.0):
            turned = arms @ rotation(_triple(up), degrees).T - arms
            heads = prescribe(mesh, case.material, head, turned).supports
            yield body, "twist", degrees, moved(*heads)
        for part in (0.05, 0.1, 0.2, 0.3, 0.5):
            yield body, "squeeze", part, moved(_hold(mesh, head, -part * length * up))
        for part in (0.05, 0.15, 0.3, 0.6, 1.2):
            yield body, "press", part, loaded(Pressure(skin, part * stiffness))
        for part in (0.05, 0.1, 0.2, 0.5, 2.0):
            for kind, sign in (("push", -1.0), ("pull", 1.0)):
                load = Traction(top, _triple(sign * part * stiffness * up))
                yield body, kind, part, loaded(load)


def _has_inverted(mesh: TetMesh, displacement: Points) -> bool:
    return bool((signed_volumes(mesh.points + displacement, mesh.cells) <= 0.0).any())


def _triple(vector: Points) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z


def _hold(mesh: TetMesh, points: Indices, displacement: Points | None = None) -> Support:
    """Points, with the facets between them."""
    facets = mesh.boundary_facets
    between = facets[np.isin(facets, points).all(axis=1)]
    moved = _triple(np.zeros(3) if displacement is None else displacement)
    return Support(points, between, displacement=moved)


def require_honest(problem: Problem) -> float:
    """The part of the load that has an equilibrium: 1, or less with the reason; NaN without."""
    from palpate.reference.statics import solve_static

    try:
        found = solve_static(problem, relative_tolerance=1e-10)
    except ReferenceNotConvergedError as error:
        return error.load_factor if error.reason and error.smallest_stretch > 0.0 else np.nan
    assert not _has_inverted(problem.mesh, found.displacement)
    return 1.0


@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.slow
def test_a_mild_load_converges_and_a_hard_one_ends_honestly() -> None:
    loads = {(b, k, s): p for b, k, s, p in hard_loads()}
    assert len(loads) == 60
    reached = {key: require_honest(problem) for key, problem in loads.items()}
    assert np.isfinite(list(reached.values())).all()
    assert reached["beam", "bend", 0.02] == 1.0
    assert 0.2 <= reached["beam", "squeeze", 0.5] < 0.3
