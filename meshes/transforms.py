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
from palpate.meshes.problem import Inclusion, InitialVelocity, Material, Problem
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


def rotation(axis: tuple[float, float, float], angle_deg: float) -> Matrix:
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
    # Where axes map to axes, fixed components map with them.
    axes = np.abs(matrix)
    is_of_axes = bool(np.allclose(axes, np.round(axes), atol=1e-12))
    is_mirror = bool(np.linalg.det(matrix) < 0.0)
    order = [0, 2, 1] if is_mirror else [0, 1, 2]

    def facets(rows: Indices) -> Indices:
        return np.ascontiguousarray(rows[:, order])

    def vector(values: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (matrix @ np.array(values)).tolist()
        return x, y, z

    cells = problem.mesh.cells[:, [0, *(1 + k for k in order)]]
    supports = []
    for support in problem.supports:
        x, y, z = (np.round(axes) @ np.array(support.components) > 0.5).tolist()
        turned = dataclasses.replace(
            support,
            facets=facets(support.facets),
            components=(x, y, z) if is_of_axes else (True, True, True),
            displacement=vector(support.displacement),
            rotation=_turned_rotation(support.rotation, matrix),
            normal=None if support.normal is None else vector(support.normal),
        )
        if is_of_axes or all(support.components):
            supports.append(turned)
        else:
            for a, b, c in (support.directions @ matrix.T).tolist():
                supports.append(dataclasses.replace(turned, normal=(a, b, c)))
    changed = dataclasses.replace(
        problem,
        mesh=TetMesh(problem.mesh.points @ matrix.T, cells),
        supports=tuple(supports),
        loads=tuple(_turned(load, matrix, facets) for load in problem.loads),
        initial_velocity=_turned_velocity(problem.initial_velocity, matrix),
        tools=tuple(
            dataclasses.replace(
                turned_tool(tool, matrix), contact_facets=facets(tool.contact_facets)
            )
            for tool in problem.tools
        ),
        springs=tuple(
            dataclasses.replace(
                spring,
                facets=facets(spring.facets),
                center=vector(spring.center),
                path=dataclasses.replace(
                    spring.path, displacements=spring.path.displacements @ matrix.T
                ),
            )
            for spring in problem.springs
        ),
    )
    return changed, lambda solution: solution @ matrix


def _turned_rotation(given: Rotation | None, matrix: Matrix) -> Rotation | None:
    """The rotation with its axis mapped as an axial vector: a mirror changes its sign as well."""
    if given is None:
        return None
    sign = 1.0 if np.linalg.det(matrix) > 0.0 else -1.0
    x, y, z = (sign * matrix @ np.array(given.axis)).tolist()
    a, b, c = (matrix @ np.array(given.center)).tolist()
    return Rotation((x, y, z), (a, b, c), given.angle)


def _turned_velocity(given: InitialVelocity | None, matrix: Matrix) -> InitialVelocity | None:
    if given is None:
        return None
    sign = 1.0 if np.linalg.det(matrix) > 0.0 else -1.0
    rows = np.array([given.velocity, given.angular_velocity, given.center]) @ matrix.T
    (a, b, c), (p, q, r), (x, y, z) = (rows * [[1.0], [sign], [1.0]]).tolist()
    return InitialVelocity((a, b, c), (p, q, r), (x, y, z))


def _turned(load: Load, matrix: Matrix, facets: Callable[[Indices], Indices]) -> Load:
    def vector(values: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (matrix @ np.array(values)).tolist()
        return (x, y, z)

    match load:
        case BodyForce():
            return dataclasses.replace(load, force_density=vector(load.force_density))
        case Traction():
            R, G, C = matrix, load.gradient, load.curvature
            return dataclasses.replace(
                load,
                facets=facets(load.facets),
                traction=vector(load.traction),
                gradient=None if G is None else R @ G @ R.T,
                curvature=None if C is None else _symmetric(np.einsum("ai,bj,ck,ijk", R, R, R, C)),
            )
        case PointForce():
            return dataclasses.replace(load, forces=load.forces @ matrix.T)
        case Pressure():
            return dataclasses.replace(load, facets=facets(load.facets))


def _symmetric(curvature: Floats) -> Floats:
    return 0.5 * (curvature + curvature.transpose(0, 2, 1))


def _times(load: Traction, factor: float, per_length: float = 1.0) -> Traction:
    """A traction times a factor, with lengths in another unit: t0, dt/dX and d2t/dX2."""
    x, y, z = (factor * t for t in load.traction)
    G, C = load.gradient, load.curvature
    return dataclasses.replace(
        load,
        traction=(x, y, z),
        gradient=None if G is None else factor / per_length * G,
        curvature=None if C is None else factor / per_length**2 * C,
    )


def renumber(problem: Problem, seed: int = 0) -> tuple[Problem, Back]:
    """Points and cells in a random order."""
    rng = np.random.default_rng(seed)
    mesh = problem.mesh
    order = rng.permutation(mesh.num_points)
    new = np.empty(mesh.num_points, dtype=np.int32)
    new[order] = np.arange(mesh.num_points)
    cell_order = rng.permutation(mesh.num_cells)
    new_cell = np.empty(mesh.num_cells, dtype=np.int32)
    new_cell[cell_order] = np.arange(mesh.num_cells)

    def load_of(load: Load) -> Load:
        match load:
            case Traction() | Pressure():
                return dataclasses.replace(load, facets=new[load.facets])
            case PointForce():
                return dataclasses.replace(load, points=new[load.points])
            case BodyForce():
                return load

    changed = dataclasses.replace(
        problem,
        mesh=TetMesh(mesh.points[order], new[mesh.cells][cell_order]),
        supports=tuple(
            dataclasses.replace(s, points=new[s.points], facets=new[s.facets])
            for s in problem.supports
        ),
        loads=tuple(map(load_of, problem.loads)),
        inclusions=tuple(Inclusion(new_cell[i.cells], i.material) for i in problem.inclusions),
        tools=tuple(
            dataclasses.replace(tool, contact_facets=new[tool.contact_facets])
            for tool in problem.tools
        ),
        springs=tuple(dataclasses.replace(s, facets=new[s.facets]) for s in problem.springs),
    )
    return changed, lambda solution: solution[new]


def change_units(problem: Problem, scale: float = 1000.0) -> tuple[Problem, Back]:
    """The same body with lengths in a unit of which a metre is `scale`; forces stay."""

    def material(of: Material) -> Material:
        return dataclasses.replace(
            of,
            youngs_modulus=of.youngs_modulus / scale**2,
            density=of.density / scale**3,
            c01=of.c01 / scale**2,
        )

    def load_of(load: Load) -> Load:
        match load:
            case BodyForce():
                x, y, z = (f / scale**3 for f in load.force_density)
                return dataclasses.replace(load, force_density=(x, y, z))
            case Traction():
                return _times(load, 1.0 / scale**2, scale)
            case Pressure():
                return dataclasses.replace(load, pressure=load.pressure / scale**2)
            case PointForce():
                return load

    def support_of(support: Support) -> Support:
        x, y, z = (scale * d for d in support.displacement)
        turned = support.rotation
        if turned is not None:
            a, b, c = (scale * x for x in turned.center)
            turned = dataclasses.replace(turned, center=(a, b, c))
        return dataclasses.replace(support, displacement=(x, y, z), rotation=turned)

    def spring_of(spring: Spring) -> Spring:
        x, y, z = (scale * c for c in spring.center)
        return dataclasses.replace(
            spring,
            center=(x, y, z),
            radius=scale * spring.radius,
            stiffness=spring.stiffness / scale,
            path=dataclasses.replace(spring.path, displacements=scale * spring.path.displacements),
        )

    start = problem.initial_velocity
    if start is not None:
        (a, b, c), (x, y, z) = (
            [scale * number for number in numbers] for numbers in (start.velocity, start.center)
        )
        start = dataclasses.replace(start, velocity=(a, b, c), center=(x, y, z))
    changed = dataclasses.replace(
        problem,
        initial_velocity=start,
        mesh=TetMesh(scale * problem.mesh.points, problem.mesh.cells),
        material=material(problem.material),
        supports=tuple(map(support_of, problem.supports)),
        loads=tuple(map(load_of, problem.loads)),
        inclusions=tuple(Inclusion(i.cells, material(i.material)) for i in problem.inclusions),
        tools=tuple(scaled_tool(tool, scale) for tool in problem.tools),
        springs=tuple(map(spring_of, problem.springs)),
    )
    return changed, lambda solution: solution / scale


def scale_loads(problem: Problem, factor: float) -> Problem:
    """The same body with all its loads multiplied; prescribed displacements stay."""

    def load_of(load: Load) -> Load:
        match load:
            case BodyForce():
                x, y, z = (factor * f for f in load.force_density)
                return dataclasses.replace(load, force_density=(x, y, z))
            case Traction():
                return _times(load, factor)
            case Pressure():
                return dataclasses.replace(load, pressure=factor * load.pressure)
            case PointForce():
                return dataclasses.replace(load, forces=factor * load.forces)

    return dataclasses.replace(problem, loads=tuple(map(load_of, problem.loads)))


def prescribe(mesh: TetMesh, material: Material, held: Indices, displacement: Points) -> Problem:
    """A body without loads whose points `held` have prescribed displacements, each its own."""
    supports = tuple(
        Support(np.array([p], dtype=np.int32), displacement=tuple(displacement[p].tolist()))
        for p in np.asarray(held)
    )
    return Problem(mesh, material, supports, ())


# Every shape but a surface is its own mirror image along x of its frame; a surface is mirrored.
_ALONG_X = np.diag([-1.0, 1.0, 1.0])


def turned_tool(tool: RigidTool, matrix: Matrix) -> RigidTool:
    """A tool with its path and drive rotated about the origin; its contact facets stay.

    Args:
        tool: Any tool.
        matrix: Orthogonal, shape (3, 3); of determinant -1 it mirrors. A mirrored pose is no
            rotation, so the tool's frame is mirrored along x as well: R becomes M R S.
    """
    path, rotations, shape = tool.path, tool.path.rotations, tool.shape
    if np.linalg.det(matrix) < 0.0:
        # M R S = (M S) (S R S), and S R S turns about the axis -S a by the same angle.
        matrix_of_frame, rotations = matrix @ _ALONG_X, rotations * [1.0, 1.0, -1.0, -1.0]
        shape = _mirrored(shape)
    else:
        matrix_of_frame = matrix
    drive = tool.drive
    if drive is not None:
        x, y, z = (matrix @ np.array(drive.direction)).tolist()
        drive = dataclasses.replace(drive, direction=(x, y, z))
    return dataclasses.replace(
        tool,
        shape=shape,
        path=ToolPath(
            path.times,
            path.positions @ matrix.T,
            _product(_quaternion(matrix_of_frame), rotations),
        ),
        drive=drive,
    )


def scaled_tool(tool: RigidTool, scale: float) -> RigidTool:
    """A tool with its lengths in a unit of which a metre is `scale`; forces stay."""
    path = tool.path
    return dataclasses.replace(
        tool,
        shape=_scaled(tool.shape, scale),
        path=ToolPath(path.times, scale * path.positions, path.rotations),
    )


def _scaled(shape: ToolShape, scale: float) -> ToolShape:
    match shape:
        case SphereShape():
            return SphereShape(scale * shape.radius)
        case CapsuleShape():
            return CapsuleShape(scale * shape.radius, scale * shape.half_length)
        case BoxShape():
            a, b, c = (scale * width for width in shape.half_widths)
            return BoxShape((a, b, c))
        case PlaneShape():
            return shape
        case SurfaceShape():
            return SurfaceShape(TriSurface(scale * shape.surface.points, shape.surface.facets))


def _mirrored(shape: ToolShape) -> ToolShape:
    if not isinstance(shape, SurfaceShape):
        return shape
    surface = shape.surface
    return SurfaceShape(TriSurface(surface.points @ _ALONG_X, surface.facets[:, [0, 2, 1]]))


def _quaternion(rotation: Matrix) -> Floats:
    """Unit quaternion (w, x, y, z) of a rotation matrix.

    The largest eigenvector of a symmetric matrix (I. Y. Bar-Itzhack, J. Guidance 23, 2000), which
    no angle makes inaccurate.
    """
    R = rotation
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0.0, 0.0, 0.0],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], 0.0, 0.0],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], 0.0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    vector = np.linalg.eigh(K)[1][:, -1]
    found: Floats = vector[[3, 0, 1, 2]]
    return found


def _product(first: Floats, rows: Floats) -> Floats:
    """Hamilton's product of one quaternion with many: rotate by `rows`, then by `first`."""
    w, v = first[0], first[1:]
    scalar = w * rows[:, 0] - rows[:, 1:] @ v
    vector = w * rows[:, 1:] + rows[:, :1] * v + np.cross(v, rows[:, 1:])
    return np.column_stack([scalar, vector])
