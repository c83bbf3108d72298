"""The same problem in another form: rotated, mirrored, renumbered, in other units.

Each function returns the changed problem and the map of its solution back to the original. A
simulator whose two solutions differ is wrong, independently of any reference.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.problem import (
    Inclusion,
    InitialVelocity,
    Material,
    Problem,
    on_other_mesh,
    with_rows,
)
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

Back = Callable[[Points], Points]
Matrix = Floats
Triple = tuple[float, float, float]


def rotation(axis: Triple, angle_deg: float) -> Matrix:
    """Rotation matrix about an axis by Rodrigues' formula, (3, 3)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.deg2rad(angle_deg)
    turned: Matrix = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return turned


def turn(problem: Problem, matrix: Matrix) -> tuple[Problem, Back]:
    """Rotate mesh, supports, loads and tools; a matrix of determinant -1 mirrors.

    Where the matrix does not map axes to axes, a support of single components becomes one support
    along a normal for each component.
    """
    return _mapped(problem, matrix, 1.0), lambda solution: solution @ matrix


def change_units(problem: Problem, scale: float = 1000.0) -> tuple[Problem, Back]:
    """The same body with lengths in a unit of which a metre is `scale`; forces stay."""
    return _mapped(problem, np.eye(3), scale), lambda solution: solution / scale


def scale_loads(problem: Problem, factor: float) -> Problem:
    """The same body with all its loads multiplied; prescribed displacements stay."""
    loads = (_mapped_load(load, np.eye(3), 1.0, factor) for load in problem.loads)
    return dataclasses.replace(problem, loads=tuple(loads))


def renumber(problem: Problem, seed: int = 0) -> tuple[Problem, Back]:
    """Points and cells in a random order."""
    rng = np.random.default_rng(seed)
    mesh = problem.mesh
    order = rng.permutation(mesh.num_points)
    new = np.argsort(order).astype(np.int32)
    cell_order = rng.permutation(mesh.num_cells)
    new_cell = np.argsort(cell_order).astype(np.int32)
    changed = on_other_mesh(
        problem,
        TetMesh(mesh.points[order], new[mesh.cells][cell_order]),
        facets=lambda rows: new[rows],
        points=lambda rows: new[rows],
        cells=lambda rows: new_cell[rows],
    )
    return changed, lambda solution: solution[new]


def prescribe(mesh: TetMesh, material: Material, fixed: Indices, displacement: Points) -> Problem:
    """A body without loads whose `fixed` points have prescribed displacements, each its own."""
    supports = tuple(
        Support(np.array([p], dtype=np.int32), displacement=tuple(displacement[p].tolist()))
        for p in np.asarray(fixed)
    )
    return Problem(mesh, material, supports, ())


# Each quantity under x -> length * matrix @ x, `matrix` orthogonal and `length` the new unit's
# number in a metre. Forces keep their size; axial vectors change their sign under a mirror.


def _mapped(problem: Problem, matrix: Matrix, length: float) -> Problem:
    """The problem with its body, supports, loads, tools, springs and masses mapped."""
    # A mirrored facet or cell keeps its orientation by another order of its corners.
    order = [0, 2, 1] if np.linalg.det(matrix) < 0.0 else [0, 1, 2]

    def facets(rows: Indices) -> Indices:
        return np.ascontiguousarray(rows[:, order])

    cells = problem.mesh.cells[:, [0, *(1 + k for k in order)]]
    supports = (part for s in problem.supports for part in _mapped_support(s, matrix, length))
    loads = (_mapped_load(load, matrix, length) for load in problem.loads)
    tools = (_mapped_tool(tool, matrix, length) for tool in problem.tools)
    springs = (_mapped_spring(spring, matrix, length) for spring in problem.springs)
    start = problem.initial_velocity
    if start is not None:
        start = InitialVelocity(
            _vector(length * matrix, start.velocity),
            _vector(_axial(matrix), start.angular_velocity),
            _vector(length * matrix, start.center),
        )
    inclusions = (
        Inclusion(one.cells, _mapped_material(one.material, length)) for one in problem.inclusions
    )
    return dataclasses.replace(
        problem,
        mesh=TetMesh(length * (problem.mesh.points @ matrix.T), cells),
        material=_mapped_material(problem.material, length),
        supports=tuple(with_rows(item, facets=facets) for item in supports),
        loads=tuple(with_rows(item, facets=facets) for item in loads),
        tools=tuple(with_rows(item, facets=facets) for item in tools),
        springs=tuple(with_rows(item, facets=facets) for item in springs),
        masses=tuple(with_rows(item, facets=facets) for item in problem.masses),
        inclusions=tuple(inclusions),
        initial_velocity=start,
    )


def _vector(matrix: Matrix, values: Triple) -> Triple:
    x, y, z = (matrix @ np.array(values)).tolist()
    return x, y, z


def _axial(matrix: Matrix) -> Matrix:
    """The map of axial vectors: a mirror changes their sign as well."""
    return matrix if np.linalg.det(matrix) > 0.0 else -matrix


def _mapped_material(material: Material, length: float) -> Material:
    return dataclasses.replace(
        material,
        youngs_modulus=material.youngs_modulus / length**2,
        density=material.density / length**3,
        c01=material.c01 / length**2,
    )


def _mapped_support(support: Support, matrix: Matrix, length: float) -> list[Support]:
    """The support, or one along a normal for each component where axes do not map to axes."""
    rotation_ = support.rotation
    if rotation_ is not None:
        axis = _vector(_axial(matrix), rotation_.axis)
        rotation_ = Rotation(axis, _vector(length * matrix, rotation_.center), rotation_.angle)
    mapped = dataclasses.replace(
        support,
        components=(True, True, True),
        displacement=_vector(length * matrix, support.displacement),
        rotation=rotation_,
        normal=None if support.normal is None else _vector(matrix, support.normal),
    )
    if all(support.components):
        return [mapped]
    axes = np.abs(matrix)
    if np.allclose(axes, np.round(axes), atol=1e-12):
        x, y, z = (np.round(axes) @ np.array(support.components) > 0.5).tolist()
        return [dataclasses.replace(mapped, components=(x, y, z))]
    normals = (support.directions @ matrix.T).tolist()
    return [dataclasses.replace(mapped, normal=(a, b, c)) for a, b, c in normals]


def _mapped_load(load: Load, matrix: Matrix, length: float, force: float = 1.0) -> Load:
    """The load mapped, and multiplied by `force`."""
    R, per_area = matrix, force / length**2
    match load:
        case BodyForce():
            density = _vector(force / length**3 * R, load.force_density)
            return dataclasses.replace(load, force_density=density)
        case PointForce():
            return dataclasses.replace(load, forces=force * load.forces @ R.T)
        case Pressure():
            return dataclasses.replace(load, pressure=per_area * load.pressure)
        case Traction():
            G, C = load.gradient, load.curvature
            if G is not None:
                G = per_area / length * R @ G @ R.T
            if C is not None:
                C = per_area / length**2 * np.einsum("ai,bj,ck,ijk", R, R, R, C)
                C = 0.5 * (C + C.transpose(0, 2, 1))  # symmetric but for rounding
            traction = _vector(per_area * R, load.traction)
            return dataclasses.replace(load, traction=traction, gradient=G, curvature=C)


def _mapped_spring(spring: Spring, matrix: Matrix, length: float) -> Spring:
    moved = length * (spring.path.displacements @ matrix.T)
    return dataclasses.replace(
        spring,
        center=_vector(length * matrix, spring.center),
        radius=length * spring.radius,
        stiffness=spring.stiffness / length,
        path=dataclasses.replace(spring.path, displacements=moved),
    )


# Every shape but a surface is its own mirror image along x of its frame; a surface is mirrored.
_ALONG_X = np.diag([-1.0, 1.0, 1.0])


def _mapped_tool(tool: RigidTool, matrix: Matrix, length: float) -> RigidTool:
    """The tool with its shape, path and drive mapped.

    A mirrored pose is no rotation, so the tool's frame is mirrored along x as well: its rotation R
    becomes M R S.
    """
    from scipy.spatial.transform import Rotation as Turn

    path = tool.path
    mirror = _ALONG_X if np.linalg.det(matrix) < 0.0 else np.eye(3)
    # scipy's quaternions have the scalar last.
    given = Turn.from_quat(path.rotations[:, [1, 2, 3, 0]]).as_matrix()
    turns = Turn.from_matrix(matrix @ given @ mirror).as_quat()[:, [3, 0, 1, 2]]
    drive = tool.drive
    if drive is not None:
        drive = dataclasses.replace(drive, direction=_vector(matrix, drive.direction))
    return dataclasses.replace(
        tool,
        shape=_mapped_shape(tool.shape, mirror, length),
        path=ToolPath(path.times, length * (path.positions @ matrix.T), turns),
        drive=drive,
    )


def _mapped_shape(shape: ToolShape, mirror: Matrix, length: float) -> ToolShape:
    match shape:
        case SphereShape():
            return SphereShape(length * shape.radius)
        case CapsuleShape():
            return CapsuleShape(length * shape.radius, length * shape.half_length)
        case BoxShape():
            a, b, c = (length * width for width in shape.half_widths)
            return BoxShape((a, b, c))
        case PlaneShape():
            return shape
        case SurfaceShape():
            facets = shape.surface.facets
            if np.linalg.det(mirror) < 0.0:
                facets = facets[:, [0, 2, 1]]
            return SurfaceShape(TriSurface(length * (shape.surface.points @ mirror), facets))
