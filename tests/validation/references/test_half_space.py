"""A sphere or a flat round punch in round blocks: the truth reaches Hertz and the flat punch.

A round block of radius and height W carries the whole force F at the middle of its top. What its
sides and its bottom add to the half space's field there is, far from the tool, that of a force on
a point: the same k F / (E W) of settlement for any tool, exactly by scaling, and what is left over
the contact of radius a is of order (a / W)^2 of that (the field's curvature; its slope is zero by
symmetry). So with d the depth

    punch:  d / F       = 1 / (2 E* a)               - (k / E) / W
    sphere: d / F^(2/3) = (3 / (4 E* R^(1/2)))^(2/3)  - (k / E) F^(1/3) / W

both linear in the last factor x but for O(x^3) (the half space: K. L. Johnson, Contact Mechanics,
1985, sections 3.5 and 4.2). Two blocks give the half space, a third one what x^3 leaves, and k must
be the same for both tools.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

from palpate.meshes.arrays import Floats
from palpate.meshes.bricks import brick_box, rollers, side
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.references.adaptive_truth import TruthRequest, refine_truth
from palpate.validation.states import in_silence

TOOLS = ("punch", "sphere")
SETTLEMENT = 0.7
# Wider bars would show nothing.
WIDEST, WIDEST_SETTLEMENT = 0.015, 0.3
# The sphere is rounder than Hertz' paraboloid, the punch a polygon.
SHAPES = 2e-4
# The nodes' areas tell the contact to a part of a cell.
RADIUS_LIMIT = 0.03
CONTACT_RADIUS = 1e-3
MATERIAL = Material(5000.0, 0.3)
# Sphere over contact radius: the sphere's roundness counts for 0.8 depth / radius = 8e-5 at most.
FLATNESS = 100.0
# Of the block, over the contact radius; each four times the last.
SIZES = (4.0, 16.0, 64.0)
STEP = 4.0
# Over a quarter turn. At the same area a square has 2 % more force than a circle (its capacity is
# 0.3667 of its side, J. C. Maxwell's problem); 24 sides have 0.01 % more, if it goes as n^-3.
SEGMENTS = 6
BAR = 0.003
_GROWTH = 2.5
# Unknowns decide where a sequence ends, not the clock: a busy machine finds the same.
_MOST_UNKNOWNS, _SECONDS = 150_000, 7200.0
# How often the cells are halved towards the edge of the contact: at a punch's the pressure has no
# bound, at a sphere's it is nothing, and where that lies the block's size decides.
_HALVED = {"punch": 4, "sphere": 2}


class Block(NamedTuple):
    """The truth of one block; its size is over the contact radius."""

    size: float
    force: float  # on the whole tool [N]
    bar: float  # of the force [-]
    meshes: int
    touching: float  # radius of a circle with the area of the nodes that touch [m]


class HalfSpace(NamedTuple):
    """What a tool's blocks say of the half space; bars are from those of the truths [-]."""

    ratio: float  # of the force at the depth over the closed form's [-]
    bar: float
    remainder: float  # what x^3 leaves [-]
    settlement: float  # k [-]
    settlement_bar: float  # with what x^3 adds


def pressed_depth(tool: str) -> float:
    """How deep [m]: the sphere's contact has the contact radius on the half space."""
    return CONTACT_RADIUS / FLATNESS if tool == "sphere" else 1e-3 * CONTACT_RADIUS


def closed_force(tool: str) -> float:
    """Force at the depth on the half space [N]: Hertz, or a flat round punch without friction."""
    stiffness = MATERIAL.youngs_modulus / (1.0 - MATERIAL.poissons_ratio**2)
    depth = pressed_depth(tool)
    if tool == "punch":
        return 2.0 * stiffness * CONTACT_RADIUS * depth
    return 4.0 / 3.0 * stiffness * math.sqrt(FLATNESS * CONTACT_RADIUS) * math.pow(depth, 1.5)


def hertz_radius(force: float) -> float:
    """Contact radius of Hertz of a force on the sphere [m]."""
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio
    return math.cbrt(0.75 * force * FLATNESS * CONTACT_RADIUS * (1.0 - nu**2) / E)


def round_block(size: float, halved: int) -> TetMesh:
    """A quarter of a round block, graded towards the middle of its top, where z = 0.

    Args:
        size: Radius and height over the contact radius, > 2.
        halved: How often cells are halved towards the contact's edge, >= 1.
    """
    count = math.ceil(math.log(size) / math.log(_GROWTH))
    outer = np.geomspace(1.0, size, count + 1)
    to_edge = 0.5 ** np.arange(1, halved + 1)
    across = np.concatenate([[0.0], 1.0 - to_edge, [1.0], 1.0 + to_edge[::-1], outer[1:]])
    down = np.concatenate([[0.0], to_edge[::-1], outer])
    grid = brick_box((len(across) - 1, SEGMENTS, len(down) - 1), (1.0, 1.0, 1.0))
    i, j, k = np.rint(grid.points * [len(across) - 1, SEGMENTS, len(down) - 1]).astype(int).T
    angle = 0.5 * math.pi * j / SEGMENTS
    radius = CONTACT_RADIUS * _same_area() * across[i]
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    # The planes of symmetry to the last bit.
    x[j == SEGMENTS], y[j == 0] = 0.0, 0.0
    height = CONTACT_RADIUS * down[len(down) - 1 - k]
    first = np.where(i == 0, k, np.arange(len(i)) + len(down))
    kept, rows = np.unique(first, return_index=True)
    cells = np.searchsorted(kept, first)[grid.cells].astype(np.int32)
    points = np.column_stack([x, y, -height])[rows]
    # On the axis bricks are wedges.
    whole = [len(set(cell)) == 4 for cell in cells.tolist()]
    cells = cells[whole]
    flipped = signed_volumes(points, cells) < 0.0
    cells[flipped] = cells[flipped][:, [0, 1, 3, 2]]
    return TetMesh(points, cells)


def _same_area() -> float:
    """Radius of the corners of a polygon over that of the circle of its area."""
    sides = 4 * SEGMENTS
    return math.sqrt(2.0 * math.pi / (sides * math.sin(2.0 * math.pi / sides)))


def pressed_block(tool: str, size: float) -> Problem:
    """A punch or a sphere, pressed into a quarter of a round block.

    The planes of symmetry and the bottom slide in themselves; the round side is free.
    """
    mesh = round_block(size, _HALVED[tool])
    top = side(mesh, 2, 0.0)
    distance = np.linalg.norm(mesh.points[top][:, :, :2], axis=2)
    # The punch touches what lies below it, and the sphere no more than some contact radii.
    reach = _same_area() * CONTACT_RADIUS * (1.0 if tool == "punch" else _GROWTH) * (1.0 + 1e-9)
    near = top[(distance <= reach).all(axis=1)]
    depth = pressed_depth(tool)
    shape = PlaneShape() if tool == "punch" else SphereShape(FLATNESS * CONTACT_RADIUS)
    positions = np.zeros((2, 3))
    positions[:, 2] = 0.0 if tool == "punch" else FLATNESS * CONTACT_RADIUS
    positions[1, 2] -= depth
    # Half a turn about x: the plane's half space lies above.
    turned = np.tile([0.0, 1.0, 0.0, 0.0], (2, 1))
    path = ToolPath(np.arange(2.0), positions, turned)
    supports = rollers(mesh, ((0, 0.0), (1, 0.0), (2, float(mesh.points[:, 2].min()))))
    pressed = RigidTool(shape, path, contact_facets=near)
    return Problem(mesh, MATERIAL, supports, (), tools=(pressed,))


def solve_block(tool: str, size: float) -> Block:
    """The truth of the force on a tool, of the whole block."""
    problem = pressed_block(tool, size)
    goals = {Strain.LINEAR: ("tool_force",)}
    request = TruthRequest(BAR, _SECONDS, 8.0, goals, unknowns=_MOST_UNKNOWNS, has_others=False)
    found = refine_truth(problem, Strain.LINEAR, request, in_silence)
    (felt,) = found.tools
    touching = 2.0 * math.sqrt(felt.active_areas[-1] / math.pi)
    force = 4.0 * float(felt.forces[-1][2])
    return Block(size, force, found.bar("tool_force"), len(found.num_cells), touching)


def extrapolate(tool: str, blocks: Sequence[Block]) -> HalfSpace:
    """The half space from three blocks, smallest first, each `STEP` times the last."""
    depth = pressed_depth(tool)
    power = 1.0 if tool == "punch" else 2.0 / 3.0
    force = np.array([block.force for block in blocks])
    y = depth / force**power
    x = force ** (1.0 - power) / (CONTACT_RADIUS * np.array([block.size for block in blocks]))

    def half_space(values: Floats, first: int) -> float:
        a, b = first, first + 1
        return float(values[b] + (values[b] - values[a]) * x[b] / (x[a] - x[b]))

    def slope(values: Floats) -> float:
        return float((values[0] - values[1]) / (x[0] - x[1]))

    limit = half_space(y, 1)
    # Each truth may be off by its bar: all against the fit at once.
    each = np.diag(y * power * np.array([block.bar for block in blocks]))
    off = sum(abs(half_space(one, 1)) for one in each)
    apart = abs(limit - half_space(y, 0)) / (STEP**3 - 1.0)
    E = MATERIAL.youngs_modulus
    # The two smallest, between which it is large: O(x^3) beside x.
    settlement = -E * slope(y)
    curved = abs(settlement) / blocks[0].size ** 2
    return HalfSpace(
        (depth / limit) ** (1.0 / power) / closed_force(tool),
        off / limit / power,
        apart / limit / power,
        settlement,
        E * sum(abs(slope(one)) for one in each) + curved,
    )


def made_block(tool: str, size: float, factor: float) -> Block:
    """The force that settles a block by k F / (E W) and by a little of x^3 beside, and a factor."""
    depth, closed = pressed_depth(tool), closed_force(tool)

    def too_deep(force: float) -> float:
        left = SETTLEMENT * force / (MATERIAL.youngs_modulus * size * CONTACT_RADIUS)
        alone = depth * (force / closed) ** (1.0 if tool == "punch" else 2.0 / 3.0)
        return alone - left * (1.0 - 0.1 / size**2) - depth

    force = brentq(too_deep, 1e-3 * closed, 10.0 * closed, xtol=1e-15, rtol=1e-14) * factor
    return Block(size, force, BAR, 3, hertz_radius(force))


@pytest.mark.parametrize("size", [4.0, 64.0])
def test_a_block_is_the_quarter_of_a_cylinder(size: float) -> None:
    mesh = round_block(size, 2)
    assert mesh.volume == pytest.approx(0.25 * math.pi * (size * CONTACT_RADIUS) ** 3, rel=1e-12)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0.0
    edges = np.sort(mesh.boundary_facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_punch_touches_its_circle_and_no_more() -> None:
    problem = pressed_block("punch", 4.0)
    near = problem.tools[0].contact_facets
    corners = problem.mesh.points[near]
    edges = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    assert area == pytest.approx(0.25 * math.pi * CONTACT_RADIUS**2, rel=1e-9)


@pytest.mark.parametrize("tool", TOOLS)
def test_blocks_lead_to_the_half_space(tool: str) -> None:
    found, more = (
        extrapolate(tool, [made_block(tool, size, factor) for size in SIZES])
        for factor in (1.0, 1.01)
    )
    assert found.ratio == pytest.approx(1.0, abs=1e-4)
    assert abs(found.ratio - 1.0) <= 2.0 * found.remainder < 1e-4
    assert found.settlement == pytest.approx(SETTLEMENT, rel=0.02)
    # All forces 1 % off are that on the half space, and bars of 0.3 % leave 0.5 %.
    assert more.ratio == pytest.approx(1.01, abs=2e-3)
    assert found.bar == pytest.approx(BAR * 5.0 / 3.0, rel=0.3)


@pytest.mark.dolfinx
@pytest.mark.parametrize(("tool", "known"), [("punch", 1.181), ("sphere", 1.189)])
@pytest.mark.long
def test_the_first_mesh_is_near_the_truth(tool: str, known: float) -> None:
    """In a block of four contact radii, where the last mesh of the night has `known`."""
    from palpate.reference.statics import solve_static

    (felt,) = solve_static(pressed_block(tool, 4.0), strain=Strain.LINEAR, degree=2).tools
    assert 4.0 * felt.forces[-1][2] / closed_force(tool) == pytest.approx(known, rel=0.02)


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_the_truth_of_a_tool_reaches_hertz_and_the_flat_punch() -> None:
    blocks = {tool: [solve_block(tool, size) for size in SIZES] for tool in TOOLS}
    punch, sphere = (extrapolate(tool, blocks[tool]) for tool in TOOLS)
    for each in (punch, sphere):
        assert abs(each.ratio - 1.0) <= each.bar + each.remainder + SHAPES
        assert each.bar + each.remainder <= WIDEST
    # A block settles by the same k F / (E W) under either tool, within the bars.
    within = punch.settlement_bar + sphere.settlement_bar
    assert abs(punch.settlement - sphere.settlement) <= within
    assert within <= WIDEST_SETTLEMENT * abs(punch.settlement)
    for block in blocks["sphere"]:
        assert block.touching == pytest.approx(hertz_radius(block.force), rel=RADIUS_LIMIT)
        assert block.meshes >= 3
