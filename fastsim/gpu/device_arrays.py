"""The arrays of a run on its device: the mesh's, and those of all bodies of a batch.

An array of bodies has a row for each; a vector of three numbers is one entry of Warp's. Parts
that no body of the batch has (pressure, moving supports, tools) have no arrays and no launches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.gpu.devices import UnsupportedOnDeviceError
from palpate.fastsim.gpu.kernels.tool_shapes import BOX, CAPSULE, HALF_SPACE, SPHERE
from palpate.fastsim.gpu.kernels.touching import CHUNK
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Strain
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, PlaneShape, SphereShape, ToolShape

# Corners of the six edges of a cell, as core/mechanics/smoothing_patches.hpp.
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_BITS = 10  # of the curve, along each axis


class Maker:
    """Makes arrays of one precision on one device."""

    def __init__(self, wp: Any, device: str, precision: str) -> None:
        self.wp, self.device = wp, device
        self.real = getattr(wp, precision)
        self.vec3 = wp.types.vector(3, self.real)
        self.vec6 = wp.types.vector(6, self.real)
        self.mat33 = wp.types.matrix((3, 3), self.real)

    def array(self, numbers: ArrayLike, dtype: Any) -> Any:
        """A copy on the device."""
        return self.wp.array(np.ascontiguousarray(numbers), dtype=dtype, device=self.device)

    def zeros(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """An array of zeros."""
        return self.wp.zeros(shape, dtype=dtype, device=self.device)

    def named_zeros(self, names: str, shape: int | tuple[int, ...], dtype: Any) -> dict[str, Any]:
        """Arrays of zeros by name."""
        return {name: self.zeros(shape, dtype) for name in names.split()}

    def groups(self, start: Indices, entries: NDArray[np.integer[Any]], **more: Any) -> Any:
        """Entries of numbered groups: those of group k from start[k] to start[k + 1]."""
        return SimpleNamespace(
            count=len(start) - 1,
            start=self.array(start, int),
            entries=self.array(entries.astype(np.int32), int),
            **more,
        )


def mesh_arrays(
    make: Maker, body: Body, kinds: Indices, num_bodies: int, *, is_atomic: bool
) -> Any:
    """Arrays for the forces of cells: the mesh at rest, and values passed between launches.

    Points keep the caller's numbers. Cells, each with its row of the moduli in `kinds`, are sorted
    along Morton's curve through their centres, so that neighbours in a launch share points in the
    cache.
    """
    mesh = body.mesh
    order = morton_order(mesh.points[mesh.cells].mean(axis=1))
    corners = np.ascontiguousarray(mesh.cells[order], dtype=np.int32)
    volumes, kinds = mesh.cell_volumes[order], kinds[order].astype(np.int32)
    found = SimpleNamespace(
        count=len(corners),
        corners=make.array(corners, make.wp.vec4i),
        gradients=make.array(body.shape_gradients[order, 1:], make.mat33),
        volumes=make.array(volumes, make.real),
        kinds=make.array(kinds, int),
        num_kinds=int(kinds.max()) + 1,
        gather=make.groups(*group(corners, mesh.num_points)),
        cell_forces=make.zeros((num_bodies, 0 if is_atomic else 4 * len(corners)), make.vec3),
        patches=None,
    )
    if body.element is Element.SMOOTHED:
        found.patches = patch_arrays(make, corners, volumes, kinds, num_bodies)
    return found


def patch_arrays(
    make: Maker, corners: Indices, volumes: Floats, kinds: Indices, num_bodies: int
) -> Any:
    """Patches of the smoothed element: cells of one kind around each edge and node.

    Weights are 1 / (36 V_e) for edges and 1 / (32 V_n) for nodes [1/m3]; times mu and the sum of
    2 V_c E_c, and times lmbda and the sum of the traces.
    """
    ends = np.sort(corners[:, _EDGES], axis=2).reshape(-1, 2).astype(np.int64)
    num_points, most = int(corners.max()) + 1, int(kinds.max()) + 1
    edge_keys = (ends[:, 0] * num_points + ends[:, 1]) * most + np.repeat(kinds, 6)
    node_keys = corners.reshape(-1).astype(np.int64) * most + np.repeat(kinds, 4)
    (edges, cell_edges), (nodes, cell_nodes) = (
        _patches(make, keys, width, factor, volumes, most)
        for keys, width, factor in ((edge_keys, 6, 36.0), (node_keys, 4, 32.0))
    )
    return SimpleNamespace(
        cell_edges=make.array(cell_edges, make.wp.types.vector(6, int)),
        cell_nodes=make.array(cell_nodes, make.wp.vec4i),
        edges=edges,
        nodes=nodes,
        strains=make.zeros((num_bodies, len(corners)), make.vec6),
        stresses=make.zeros((num_bodies, edges.count), make.vec6),
        pressures=make.zeros((num_bodies, nodes.count), make.real),
        **make.named_zeros("blends presses", (num_bodies, edges.count), make.real),
    )


def _patches(
    make: Maker, keys: NDArray[np.int64], width: int, factor: float, volumes: Floats, most: int
) -> tuple[Any, Indices]:
    """Cells, weights and kinds of the patches with these keys, and those of each cell."""
    names, numbers = np.unique(keys, return_inverse=True)
    numbers = numbers.reshape(-1, width).astype(np.int32)
    start, entries = group(numbers, len(names))
    of_patch = np.bincount(numbers.reshape(-1), np.repeat(volumes / width, width))
    weights = make.array(1.0 / (factor * of_patch), make.real)
    kinds = make.array((names % most).astype(np.int32), int)
    return make.groups(start, entries // width, weights=weights, kinds=kinds), numbers


def motion_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any:
    """State, loads, masses and counts of all bodies."""
    wp, real, vec3 = make.wp, make.real, make.vec3
    many, num_points = len(bodies), len(bodies[0].mass)
    shape = (many, num_points)
    chunks = max(1, min(1024, num_points // 32))
    return SimpleNamespace(
        is_free=make.array([b.is_free for b in bodies], vec3),
        mass=make.array([b.mass for b in bodies], wp.float64),
        given=make.zeros(shape, real),
        total_mass=make.array([b.mass.sum() for b in bodies], wp.float64),
        time_step=make.array([b.time_step for b in bodies], wp.float64),
        at_start=make.zeros(many, wp.float64),
        num_chunks=chunks,
        sums=make.zeros((many, chunks), wp.vec3d),
        **make.named_zeros("displacement increment force external pressure touch", shape, vec3),
        **make.named_zeros("counted good_displacement good_increment", shape, vec3),
        **make.named_zeros("go status row last_row since_good begun inverted", many, int),
        **make.named_zeros("outside unknown is_good open_sums", many, int),
    )


def scheme_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any:
    """Factors that change with the damping."""
    return SimpleNamespace(
        keep=make.array([b.keep for b in bodies], make.real),
        mobility=make.array([b.mobility for b in bodies], make.vec3),
        damping=make.array([b.mass_damping for b in bodies], make.wp.float64),
        # Factor from the wall's increment to energy over a mobility: half m (d / dt)^2.
        speed_share=make.array([0.5 / (1.0 + b.half_damping) for b in bodies], make.real),
    )


def load_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any:
    """Dead loads of the histories that have one in some body."""
    histories = sorted({h for b in bodies for h, force in b.dead.items() if force.any()})
    shape = (len(bodies), len(histories), len(bodies[0].mass), 3)
    dead = np.zeros(shape)
    for k, body in enumerate(bodies):
        for n, history in enumerate(histories):
            if history in body.dead:
                dead[k, n] = body.dead[history]
    return SimpleNamespace(
        numbers=histories,
        histories=make.array(np.array(histories, dtype=np.int32), int),
        dead=make.array(dead, make.vec3),
    )


def pressure_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any | None:
    """Facets of all bodies one after another; on those of others a body has zero pressure."""
    counts = [len(b.pressures) for b in bodies]
    if not any(counts):
        return None
    lists = [b.facets for b in bodies]
    if all(len(f) == len(lists[0]) and (f == lists[0]).all() for f in lists):
        facets, starts = lists[0], [0] * len(bodies)
    else:
        facets, starts = np.concatenate(lists), [0, *np.cumsum(counts)[:-1].tolist()]
    pressures = np.zeros((len(bodies), len(facets)))
    histories = np.full((len(bodies), len(facets)), -1, dtype=np.int32)
    for k, (body, start) in enumerate(zip(bodies, starts, strict=True)):
        pressures[k, start : start + counts[k]] = body.pressures
        histories[k, start : start + counts[k]] = body.pressure_histories
    pressed, numbers = np.unique(facets, return_inverse=True)
    begins, corners = group(numbers, len(pressed))
    return SimpleNamespace(
        on=pressed,
        count=len(facets),
        points=make.array(bodies[0].body.mesh.points, make.vec3),
        facets=make.array(facets, make.wp.vec3i),
        pressures=make.array(pressures, make.real),
        histories=make.array(histories, int),
        at=make.groups(begins, corners // 3, pressed=make.array(pressed, int)),
        corner_forces=make.zeros((len(bodies), len(facets)), make.vec3),
    )


def support_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any | None:
    """Points that some body's supports move; for a body that does not, the history is none."""
    num_points = len(bodies[0].mass)
    tables = []
    for body in bodies:
        values, histories = body.support_values, body.support_histories
        if values is None or histories is None:
            values, histories = np.zeros((num_points, 3)), np.full((num_points, 3), -1)
        tables.append((values.reshape(-1, num_points, 3), histories.reshape(-1, num_points, 3)))
    moves = np.any([(h >= 0).any(axis=(0, 2)) for _, h in tables], axis=0)
    moving = np.flatnonzero(moves).astype(np.int32)
    if not len(moving):
        return None
    terms = max(len(values) for values, _ in tables)
    of_values = np.zeros((len(bodies), len(moving), terms, 3))
    of_histories = np.full((len(bodies), len(moving), terms, 3), -1, dtype=np.int32)
    for k, (values, histories) in enumerate(tables):
        of_values[k, :, : len(values)] = values[:, moving].transpose(1, 0, 2)
        of_histories[k, :, : len(values)] = histories[:, moving].transpose(1, 0, 2)
    shape = (len(bodies), len(moving))
    flat = (len(bodies), len(moving) * terms, 3)
    return SimpleNamespace(
        count=len(moving),
        moving=make.array(moving, int),
        num_terms=terms,
        values=make.array(of_values.reshape(flat), make.vec3),
        histories=make.array(of_histories.reshape(flat), make.wp.vec3i),
        **make.named_zeros("last ahead inner", shape, make.vec3),
    )


def slide_arrays(make: Maker, bodies: Sequence[BodyData]) -> Any | None:
    """Points that slide in some body."""
    given = [b.slides for b in bodies]
    found = [g[0] for g in given if g is not None and len(g[0])]
    if not found:
        return None
    points = np.unique(np.concatenate(found)).astype(np.int32)
    many = len(bodies)
    directions = np.zeros((many, 2 * len(points), 3))
    values = np.zeros((many, 2 * len(points)))
    histories = np.full((many, 2 * len(points)), -1, dtype=np.int32)
    for k, slides in enumerate(given):
        if slides is None:
            continue
        rows = 2 * np.searchsorted(points, slides[0])[:, None] + np.arange(2)
        directions[k, rows] = slides[1].reshape(-1, 2, 3)
        values[k, rows], histories[k, rows] = slides[2], slides[3]
    return SimpleNamespace(
        count=len(points),
        points=make.array(points, int),
        directions=make.array(directions, make.vec3),
        values=make.array(values, make.real),
        histories=make.array(histories, int),
        **make.named_zeros("last ahead pull", (many, 2 * len(points)), make.real),
    )


def tool_arrays(make: Maker, bodies: Sequence[BodyData], Tool: Any) -> Any | None:
    """Tools, each with the vertices it may touch, the same in all bodies.

    Raises:
        InputError: Bodies of a batch with other tools, or tools on other vertices.
    """
    tools = bodies[0].tools
    same = all(
        len(b.tools) == len(tools)
        and all(np.array_equal(x.vertices, y.vertices) for x, y in zip(b.tools, tools, strict=True))
        for b in bodies
    )
    if not same:
        raise InputError("bodies of a batch need as many tools, each on the same vertices")
    if not tools:
        return None
    wp, f64 = make.wp, make.wp.float64
    rows = []
    for body in bodies:
        for tool in body.tools:
            row = Tool()
            row.shape, row.size = tool.shape, wp.vec3d(*tool.size)
            row.is_constraint, row.friction = int(tool.is_constraint), tool.friction
            row.reach, row.deepest, row.mass = tool.reach, tool.deepest, tool.mass
            row.direction = wp.vec3d(*tool.direction)
            rows.append(row)
    starts = np.concatenate([[0], np.cumsum([len(t.vertices) for t in tools])]).tolist()
    vertices = np.concatenate([t.vertices for t in tools])
    many, count, total = len(bodies), len(tools), len(vertices)
    stiffness = np.array([np.concatenate([t.stiffnesses for t in b.tools]) for b in bodies])
    most = max(1, -(-max(len(t.vertices) for t in tools) // CHUNK))
    return SimpleNamespace(
        count=count,
        starts=starts,
        on=np.unique(vertices),
        tools=wp.array(rows, dtype=Tool, device=make.device).reshape((many, count)),
        vertices=make.array(vertices, int),
        stiffness=make.array(stiffness, f64),
        rest=make.array(bodies[0].body.mesh.points, wp.vec3d),
        is_known=make.zeros((many, total), int),
        extremes=make.zeros((many, total), wp.vec2d),
        chunk_extremes=make.zeros((many, most), wp.vec2d),
        **make.named_zeros("begins acting vertex_moments", (many, total), wp.vec3d),
        **make.named_zeros("chunk_forces chunk_moments", (many, most), wp.vec3d),
        **make.named_zeros("forces moments impulses", (many, count), wp.vec3d),
        **make.named_zeros("gaps increments offsets", (many, count), f64),
    )


def group(
    numbers: NDArray[np.signedinteger[Any]], count: int
) -> tuple[Indices, NDArray[np.integer[Any]]]:
    """Positions in `numbers` grouped by the number there: where groups start, and members."""
    flat = numbers.reshape(-1)
    order = np.argsort(flat, kind="stable").astype(np.int32)
    return np.searchsorted(flat[order], np.arange(count + 1)).astype(np.int32), order


def morton_order(positions: Floats) -> NDArray[np.int64]:
    """Order of positions [m], shape (n, 3), along a curve that fills their box (Morton 1966)."""
    low, size = positions.min(axis=0), max(float(np.ptp(positions, axis=0).max()), 1e-300)
    at = ((positions - low) / size * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(positions), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((at[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


@dataclass(eq=False)
class BodyData:
    """A body, and its loads, supports and tools.

    Attributes:
        body: The body at rest.
        mass: Lumped [kg], shape (num_points,).
        is_free: 1 where free, 0 where fixed, shape (num_points, 3).
        time_step: [s].
        mass_damping: [1/s].
        displacement_limit: [m].
        dead: Forces by history [N], shape (num_points, 3) each.
        facets, pressures, pressure_histories: Follower pressures [Pa].
        support_values, support_histories: Terms below one another, (terms * num_points, 3).
        slides: Points, directions (n, 6), values (n, 2), histories (n, 2).
        tools: In their order: kind and lengths of the shape, what `DeviceRun.add_tool` is given.
    """

    body: Body
    mass: Floats
    is_free: Floats
    time_step: float
    mass_damping: float
    displacement_limit: float
    dead: dict[int, Floats] = field(default_factory=dict)
    facets: Indices = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int32))
    pressures: Floats = field(default_factory=lambda: np.zeros(0))
    pressure_histories: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    support_values: Floats | None = None
    support_histories: Indices | None = None
    slides: tuple[Indices, Floats, Floats, Indices] | None = None
    tools: list[SimpleNamespace] = field(default_factory=list)

    @property
    def half_damping(self) -> float:
        """C of eq. 12 [-]."""
        return 0.5 * self.mass_damping * self.time_step

    @property
    def keep(self) -> float:
        """Fraction of an increment that remains in a step without a force [-]."""
        return (1.0 - self.half_damping) / (1.0 + self.half_damping)

    @property
    def mobility(self) -> Floats:
        """Increment by a unit force [m/N], 0 where fixed, shape (num_points, 3)."""
        each = self.time_step**2 / (self.mass * (1.0 + self.half_damping))
        return np.where(self.is_free != 0, each[:, None], 0.0)


def require_supported(body: Body, device: str) -> None:
    """Raise for a law that only the core supports.

    Raises:
        UnsupportedOnDeviceError: A law other than Saint-Venant-Kirchhoff's.
    """
    if body.strain is Strain.GREEN and body.law is not Law.SAINT_VENANT_KIRCHHOFF:
        raise UnsupportedOnDeviceError(f"the law {body.law.value}", device)


def shape_numbers(shape: ToolShape, device: str) -> tuple[int, tuple[float, float, float]]:
    """A shape as the kernels represent it: its kind, and its lengths [m].

    Raises:
        UnsupportedOnDeviceError: A shape given by a surface.
    """
    match shape:
        case SphereShape():
            return SPHERE, (shape.radius, 0.0, 0.0)
        case CapsuleShape():
            return CAPSULE, (shape.radius, shape.half_length, 0.0)
        case BoxShape():
            return BOX, shape.half_widths
        case PlaneShape():
            return HALF_SPACE, (0.0, 0.0, 0.0)
        case _:
            raise UnsupportedOnDeviceError("a tool whose shape is a surface", device)
