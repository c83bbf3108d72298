"""Small elastic bodies for the tests of the simulator, and what holds, moves and steps them."""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import side as facets_at  # noqa: F401  (one more of the bank)
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

SOFT = Material(1e4, 0.3, 1000.0)
EPS = float(np.finfo(float).eps)
FINITE_LAWS = [law for law in Law if not law.is_linear_in_strain]


def points_at(mesh: TetMesh, axis: int, value: float) -> np.ndarray:
    """Points in a plane across an axis."""
    return np.flatnonzero(np.abs(mesh.points[:, axis] - value) < 1e-9).astype(np.int32)


def clamped(mesh: TetMesh, axis: int = 0, value: float = 0.0) -> Support:
    """All points in a plane across an axis, fixed."""
    return Support(points_at(mesh, axis, value))


def shake(mesh: TetMesh, size: float, seed: int = 3) -> np.ndarray:
    """Random displacements."""
    return size * np.random.default_rng(seed).standard_normal(mesh.points.shape)


def rotation(angle: float) -> np.ndarray:
    """A rotation matrix about an axis across all coordinates."""
    axis = np.array([1.0, 2.0, -0.5])
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def body_of(
    mesh: TetMesh,
    law: Law = Law.SAINT_VENANT_KIRCHHOFF,
    element: Element = Element.LINEAR,
    strain: Strain = Strain.GREEN,
    *,
    mixed: bool = False,
) -> Body:
    """A body of a law, half of whose cells are of a stiffer material if it is mixed."""
    centres = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    half = np.flatnonzero(centres > np.median(centres)).astype(np.int32)
    inclusions = (Inclusion(half, example_material(law, 0.2, 8e4)),) if mixed else ()
    return Body(mesh, example_material(law, 0.4), strain, element=element, inclusions=inclusions)


def force_of_step(
    body: Body,
    u: np.ndarray,
    *,
    is_single: bool = False,
    num_threads: int = 1,
    at_most: _core.InstructionSet | None = None,
) -> np.ndarray:
    """R(u) as the explicit step computes it [N], the same twice."""
    run = _core.ExplicitRun.make(
        body.core,
        body.lumped_mass,
        np.ones(u.shape, np.uint8),
        time_step=1e-3,
        mass_damping=0.0,
        displacement_limit=1e3,
        num_threads=num_threads,
        at_most=at_most or _core.widest_instruction_set(),
        stiffness_damping=0.0,
        is_single=is_single,
        tracks_energy=False,
        classes=np.zeros(0, np.int32),
    )
    run.set_state(u, np.zeros_like(u), 0.0)
    first, second = np.empty_like(u), np.empty_like(u)
    run.internal_force(first)
    run.internal_force(second)
    np.testing.assert_array_equal(first, second)
    return first


def distance(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest number expected."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())
