"""Nodal forces, energy and mass of linear tetrahedra: eq. 1-8 of the paper.

f_a = sum over cells of V P grad N_a; engineering strain (eq. 3-4) gives R(a) = K a (eq. 5),
Green strain (eq. 6-7) gives R(a) = (K + P(a)) a (eq. 8), the Saint-Venant-Kirchhoff solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim import _core
from palpate.fastsim.errors import SeveralMaterialsError
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

STRAIN_MEASURE = {
    Strain.LINEAR: _core.StrainMeasure.linear,
    Strain.GREEN: _core.StrainMeasure.green,
}


def lame_parameters(material: Material) -> tuple[float, float]:
    """First Lamé parameter and shear modulus [Pa] of an isotropic solid."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def only_material(problem: Problem) -> Material:
    """The material of a body that has one.

    Raises:
        SeveralMaterialsError: It has inclusions: this simulator takes one material.
    """
    if problem.inclusions:
        raise SeveralMaterialsError(
            len(problem.inclusions), sum(len(one.cells) for one in problem.inclusions)
        )
    return problem.material


def assemble_internal_force(
    mesh: TetMesh, displacement: ArrayLike, *, material: Material, strain: Strain = Strain.GREEN
) -> Points:
    """Internal force R(a) at the points (eq. 1).

    Args:
        mesh: Rest mesh [m].
        displacement: [m], shape (num_points, 3), finite.
        material: Isotropic solid.
        strain: Engineering or Green strain.

    Returns:
        Force [N], shape (num_points, 3); its sum over the points is zero.

    Raises:
        InputError: Wrong shape or a value that is not finite.

    Note:
        Green strain softens under compression, from a stretch of 1/sqrt(3) = 0.577 downwards.
    """
    u = checked_displacement(mesh, displacement)
    lmbda, mu = lame_parameters(material)
    force = np.zeros_like(u)
    _core.Solid.make(mesh.points, mesh.cells).internal_force(
        u, lmbda, mu, STRAIN_MEASURE[strain], force
    )
    return force


def strain_energy(
    mesh: TetMesh, displacement: ArrayLike, *, material: Material, strain: Strain = Strain.GREEN
) -> float:
    """Strain energy [J]: integral of lmbda/2 tr(E)^2 + mu tr(E^2) over the rest volume."""
    u = checked_displacement(mesh, displacement)
    lmbda, mu = lame_parameters(material)
    solid = _core.Solid.make(mesh.points, mesh.cells)
    return float(solid.strain_energy(u, lmbda, mu, STRAIN_MEASURE[strain]))


def det_f(mesh: TetMesh, displacement: ArrayLike) -> Points:
    """Volume over rest volume of each cell [-], shape (num_cells,); <= 0 if inverted."""
    u = checked_displacement(mesh, displacement)
    out = np.empty(mesh.num_cells)
    _core.Solid.make(mesh.points, mesh.cells).det_f(u, out)
    return out


def external_force(problem: Problem, displacement: Points | None = None) -> Points:
    """Consistent nodal forces of all loads [N], shape (num_points, 3).

    A traction gives a third of its facet's force to each corner, a body force a quarter of its
    cell's. Pressure acts on the facets as displaced, so it needs the displacement.

    Args:
        problem: Mesh and loads.
        displacement: Where the pressure acts [m]; None is the rest state.

    Raises:
        InputError: A load that is not finite.
    """
    mesh = problem.mesh
    force = np.zeros_like(mesh.points)
    for number, load in enumerate(problem.loads, start=1):
        match load:
            case Traction():
                share = _area_vectors(mesh.points, load.facets)
                areas = np.linalg.norm(share, axis=1)
                corner = areas[:, None] * np.asarray(load.traction) / 3.0
                for k in range(3):
                    np.add.at(force, load.facets[:, k], corner)
            case Pressure():
                points = mesh.points if displacement is None else mesh.points + displacement
                corner = -load.pressure * _area_vectors(points, load.facets) / 3.0
                for k in range(3):
                    np.add.at(force, load.facets[:, k], corner)
            case PointForce():
                np.add.at(force, load.points, load.forces)
            case BodyForce():
                share = signed_volumes(mesh.points, mesh.cells)[:, None] / 4.0
                corner = share * np.asarray(load.force_density)
                for k in range(4):
                    np.add.at(force, mesh.cells[:, k], corner)
        if not np.isfinite(force).all():
            raise InputError(f"load {number} ({type(load).__name__}) is NaN or infinite")
    return force


def lumped_mass(mesh: TetMesh, density: float) -> Points:
    """Diagonal mass matrix: a quarter of each cell's mass to its corners [kg], (num_points,)."""
    mass = np.zeros(mesh.num_points)
    share = density * signed_volumes(mesh.points, mesh.cells) / 4.0
    for k in range(4):
        np.add.at(mass, mesh.cells[:, k], share)
    return mass


def lumped_areas(mesh: TetMesh, facets: np.ndarray[tuple[int, ...], np.dtype[np.int32]]) -> Points:
    """A third of the rest area of each of these facets to its corners [m2], (num_points,)."""
    areas = np.zeros(mesh.num_points)
    share = np.linalg.norm(_area_vectors(mesh.points, facets), axis=1) / 3.0
    for k in range(3):
        np.add.at(areas, facets[:, k], share)
    return areas


def constraints(problem: Problem) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint8]], Points]:
    """Which components are free (1) or held (0), and the held values [m]; (num_points, 3) each.

    Raises:
        InputError: Two supports hold the same component of a point at different places.
    """
    is_free = np.ones((problem.mesh.num_points, 3), dtype=np.uint8)
    held = np.zeros((problem.mesh.num_points, 3))
    for number, support in enumerate(problem.supports, start=1):
        points = np.union1d(support.points, support.facets)
        for axis in range(3):
            if not support.components[axis]:
                continue
            value = support.displacement[axis]
            if not np.isfinite(value):
                raise InputError(f"support {number}: its displacement is NaN or infinite")
            clash = points[(is_free[points, axis] == 0) & (held[points, axis] != value)]
            if clash.size:
                raise InputError(
                    f"point {int(clash[0])} is held at two displacements along {'xyz'[axis]}: "
                    f"{held[clash[0], axis]:g} m and {value:g} m; separate the supports"
                )
            is_free[points, axis] = 0
            held[points, axis] = value
    return is_free, held


def checked_displacement(mesh: TetMesh, displacement: ArrayLike) -> Points:
    """Return a displacement as a C-ordered float64 array of the mesh's shape, finite."""
    u = np.ascontiguousarray(displacement, dtype=np.float64)
    if u.shape != mesh.points.shape:
        raise InputError(
            f"displacement has shape {u.shape}, the mesh has points {mesh.points.shape}"
        )
    if not np.isfinite(u).all():
        bad = int(np.flatnonzero(~np.isfinite(u).all(axis=1))[0])
        raise InputError(f"displacement of point {bad} is NaN or infinite")
    return u


def _area_vectors(
    points: Points, facets: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
) -> Points:
    a, b, c = (points[facets[:, k]] for k in range(3))
    vectors: Points = 0.5 * np.cross(b - a, c - a)
    return vectors
