"""How long may an explicit step be? dt = 2 / omega_max of K x = omega^2 M x (paper, sec. III)."""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.forces import STRAIN_MEASURE, lame_parameters, lumped_mass
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import TetMesh


def critical_time_step(mesh: TetMesh, material: Material) -> float:
    """Largest stable step of central differences about the rest state [s], a safe bound.

    omega^2 is bounded by the largest eigenvalue of any single cell's stiffness over its own
    lumped mass (Fried 1972, "Bounds on the extremal eigenvalues of the finite element stiffness
    and mass matrices"); for one cell that is 4 / rho times the largest eigenvalue of B^T D B,
    found from its 6 x 6 twin.

    Args:
        mesh: Rest mesh [m].
        material: Isotropic solid with a density.

    Note:
        Stretched Green-strain cells are stiffer than at rest: keep a margin.
    """
    lmbda, mu = lame_parameters(material)
    # Square root of D in Voigt order (xx, yy, zz, xy, yz, zx).
    elasticity = np.diag([2.0 * mu] * 3 + [mu] * 3)
    elasticity[:3, :3] += lmbda
    values, vectors = np.linalg.eigh(elasticity)
    root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    largest = 0.0
    gradients = _shape_gradients(mesh)
    for part in np.array_split(gradients, max(1, mesh.num_cells // 20000)):
        strain = np.zeros((len(part), 6, 12))
        for a in range(4):
            gx, gy, gz = part[:, a].T
            strain[:, 0, 3 * a], strain[:, 1, 3 * a + 1], strain[:, 2, 3 * a + 2] = gx, gy, gz
            strain[:, 3, 3 * a], strain[:, 3, 3 * a + 1] = gy, gx
            strain[:, 4, 3 * a + 1], strain[:, 4, 3 * a + 2] = gz, gy
            strain[:, 5, 3 * a], strain[:, 5, 3 * a + 2] = gz, gx
        half = root @ strain
        values = np.linalg.eigvalsh(half @ half.transpose(0, 2, 1))[:, -1]
        largest = max(largest, float(values.max()))
    return float(2.0 / np.sqrt(4.0 * largest / material.density))


def sharp_critical_time_step(
    mesh: TetMesh,
    material: Material,
    *,
    displacement: Points | None = None,
    strain: Strain = Strain.GREEN,
    mass: Points | None = None,
    relative_tolerance: float = 1e-4,
    max_iterations: int = 2000,
) -> float:
    """Critical step from the largest eigenvalue itself, by Lanczos iterations [s].

    Approached from above: the answer is too long by at most about the tolerance, so multiply it
    by a safety factor. Never below `critical_time_step`, which bounds it.

    Args:
        mesh: Rest mesh [m].
        material: Isotropic solid with a density.
        displacement: State about which the body moves [m], shape (num_points, 3); None is rest.
        strain: Engineering or Green strain.
        mass: Lumped mass [kg], shape (num_points,); None is the material's.
        relative_tolerance: Change of the eigenvalue over ten iterations at which to stop.
        max_iterations: Matrix products at most.
    """
    solid = _core.Solid.make(mesh.points, mesh.cells)
    at = np.zeros_like(mesh.points) if displacement is None else displacement
    solid.assemble_tangent(
        np.ascontiguousarray(at, dtype=np.float64),
        *lame_parameters(material),
        STRAIN_MEASURE[strain],
    )
    lumped = lumped_mass(mesh, material.density) if mass is None else mass
    scale = 1.0 / np.sqrt(lumped)[:, None]
    q = np.random.default_rng(0).standard_normal(mesh.points.shape)
    q /= np.linalg.norm(q)
    before = np.zeros_like(q)
    product = np.empty_like(q)
    diagonal: list[float] = []
    beside: list[float] = []
    known = 0.0
    for iteration in range(1, min(max_iterations, mesh.points.size) + 1):
        solid.multiply_tangent(scale * q, product)
        w = scale * product - (beside[-1] * before if beside else 0.0)
        diagonal.append(float(np.sum(w * q)))
        w -= diagonal[-1] * q
        beside.append(float(np.linalg.norm(w)))
        is_exhausted = beside[-1] <= 1e-12 * abs(diagonal[0])
        if iteration % 10 == 0 or is_exhausted:
            off = beside[: len(diagonal) - 1]
            ritz = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
            largest = float(np.linalg.eigvalsh(ritz)[-1])
            if is_exhausted or largest - known <= relative_tolerance * largest:
                known = largest
                break
            known = largest
        before, q = q, w / beside[-1]
    return float(2.0 / np.sqrt(known))


def _shape_gradients(mesh: TetMesh) -> Points:
    """Gradients of the four shape functions [1/m], shape (num_cells, 4, 3)."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    rest = inverse.transpose(0, 2, 1)
    gradients: Points = np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)
    return gradients
