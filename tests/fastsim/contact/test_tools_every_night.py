"""Section IV: tools that touch tissue. Every night: is the contact right, and what does it cost?

A rigid sphere on a block has a closed form where the strain is small and linear (Hertz): the
linear simulator must come to it as the mesh is refined, and Green strain must depart from it by the
same amount on every mesh. Beyond that, the same discrete problem is given to the reference: force,
displacement and change of volume must be the same on the same mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import overlap_depths
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.static_contact import ContactResult, solve_contact
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import refine_to_size
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_modes import parts_of_mesh
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    RigidTool,
    SphereShape,
    ToolPath,
)
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.studies.grading import (
    RADIUS,
    SPHERE_BODY,
    contact_radius,
    quarter_cube,
    sphere_into_block,
)

BLOCK_SIDE = 20.0  # radii
DEPTH = 0.01  # radii: the block is 200 contact radii wide
# Edges in a contact radius, and how fast they grow with distance: all edges shrink together.
LEVELS = ((4.0, 0.4), (4.0 * 2**0.5, 0.4 / 2**0.5), (8.0, 0.2), (8.0 * 2**0.5, 0.2 / 2**0.5))
# Depths of the indentation [radii]; the last is that of the comparison.
DEPTHS = (0.0, 0.01, 0.025, 0.05, 0.1, 0.15)
# Penalties in stiffnesses of a layer of cells, as the constraint's own is 100.
LAYERS = (3.0, 10.0, 30.0, 100.0)
TISSUE = Material(1e4, 0.45)
CUBES = Material(1e4, 0.3, 1000.0)
# About y, by which a capsule lies across the kidney.
ACROSS = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)


def hertz(depth: float) -> float:
    """F = 4/3 E / (1 - nu^2) sqrt(R) d^1.5 on the whole sphere at a depth in radii [N]."""
    stiffness = SPHERE_BODY.youngs_modulus / (1.0 - SPHERE_BODY.poissons_ratio**2)
    return 4.0 / 3.0 * stiffness * float(np.sqrt(RADIUS) * (depth * RADIUS) ** 1.5)


def quarter_block(
    finest: float, reach: float, *, growth: float = 0.3, width: float = BLOCK_SIDE * RADIUS
) -> TetMesh:
    """The block graded towards the origin.

    Args:
        finest: Edge within `reach` of the origin [m].
        reach: [m].
        growth: Of the edge with distance beyond [-].
        width: Of the quarter [m].
    """
    graded = GradedMesh(quarter_cube(width))

    def size(places: Points) -> Points:
        distance = np.linalg.norm(places, axis=1)
        wanted: Points = np.maximum(finest, growth * (distance - reach) + finest)
        return wanted

    refine_to_size(graded, size, max_cells=400_000)
    mesh = graded.mesh
    return TetMesh(np.array(mesh.points), np.array(mesh.cells))


def indentation(edges_per_radius: float = 6.0) -> Problem:
    """Sphere into a block 50 contact radii wide at the last depth."""
    finest = contact_radius(DEPTHS[-1] * RADIUS, RADIUS)
    return sphere_into_block(quarter_block(finest / edges_per_radius, 1.2 * finest), DEPTHS)


def over_hertz(edges_per_radius: float, growth: float) -> tuple[float, float]:
    """Force over Hertz' on one mesh of the family, linear and Green strain."""
    radius = contact_radius(DEPTH * RADIUS, RADIUS)
    mesh = quarter_block(radius / edges_per_radius, 1.5 * radius, growth=growth)
    problem = sphere_into_block(mesh, (0.0, DEPTH))
    linear, green = (
        4.0 * float(solve_contact(problem, strain=strain).forces[-1, 0, 2]) / hertz(DEPTH)
        for strain in (Strain.LINEAR, Strain.GREEN)
    )
    return linear, green


def test_a_coarse_level_is_stiffer_and_green_is_softer() -> None:
    linear, green = over_hertz(3.0, 0.5)
    assert 1.03 < linear < 1.15
    assert 0.93 < green / linear < 0.97


def test_over_facets_smoothed_cells_are_within_two_percent_of_hertz() -> None:
    radius = contact_radius(DEPTH * RADIUS, RADIUS)
    mesh = quarter_block(radius / 3.0, 1.5 * radius, growth=0.5)
    problem = sphere_into_block(mesh, (0.0, DEPTH))
    tool = replace(problem.tools[0], contact=ContactRule.FACETS)
    found = solve_contact(
        replace(problem, tools=(tool,)), strain=Strain.LINEAR, element=Element.SMOOTHED
    )
    assert 4.0 * found.forces[-1, 0, 2] / hertz(DEPTH) == pytest.approx(1.0, abs=0.02)


@pytest.mark.nightly
def test_linear_strain_comes_to_hertz_and_green_departs_alike_on_every_mesh() -> None:
    found = np.array([over_hertz(*level) for level in LEVELS])
    away = np.abs(found[:, 0] - 1.0)
    assert away[-1] <= 0.03
    assert (np.diff(away) < 0.0).all()
    ratios = found[:, 1] / found[:, 0]
    assert np.ptp(ratios) <= 0.002
    assert ratios.max() < 0.99


@pytest.mark.nightly
def test_penalties_lack_a_force_in_proportion_to_their_softness() -> None:
    problem = sphere_into_block(indentation(4.0).mesh, (0.0, 0.05))
    exact = solve_contact(problem)
    laws = [
        ContactLaw(ContactForm.PENALTY, exact.stiffnesses[0] * layers / 100.0) for layers in LAYERS
    ]
    forces = [float(solve_contact(problem, law=law).forces[-1, 0, 2]) for law in laws]
    lack = 1.0 - np.array(forces) / float(exact.forces[-1, 0, 2])
    rates = -np.diff(np.log(lack)) / np.diff(np.log(LAYERS))
    np.testing.assert_allclose(rates[1:], 1.0, rtol=0.0, atol=0.1)


def flat_punch() -> Problem:
    """Square punch, about 0.4 of the sphere's radius to either side, into the same block.

    Its edge runs midway between vertices, further from them than it sinks: nearer ones would be
    as near to its sides as to its bottom, and then which side pushes them is a matter of taste.
    """
    problem = indentation()
    points = problem.mesh.points
    near = np.abs(points[:, 2]) < 1e-12
    near &= (points[:, :2] < 0.6 * RADIUS).all(axis=1)
    line = np.unique(np.round(points[near, :2], 12))
    outer = int(np.searchsorted(line, 0.4 * RADIUS))
    half = float(0.5 * (line[outer - 1] + line[outer]))
    positions = np.zeros((3, 3))
    positions[:, 2] = half - 0.2 * (line[outer] - line[outer - 1]) * np.arange(3.0)
    # Wide in the planes of symmetry too: only the outer edges of the quarter are edges.
    punch = replace(
        problem.tools[0],
        shape=BoxShape((half, half, half)),
        path=ToolPath(np.arange(3.0), positions),
    )
    return replace(problem, tools=(punch,))


def lying(mesh: TetMesh) -> Support:
    """A kidney on its side, which is fixed."""
    return Support(np.flatnonzero(mesh.points[:, 1] < -0.02).astype(np.int32))


def on_kidney(name: str) -> Problem:
    """A sphere that slides over the kidney, or a capsule pressed into it."""
    mesh = mesh_surface(shape_kidney(edge_length=8e-3))
    top = float(mesh.points[np.abs(mesh.points[:, 2]) < 0.015, 1].max())
    if name == "slide":
        # Pressed 4 mm, then 30 mm along the kidney.
        down = np.array([0.0, 4.0, 4.0, 4.0, 4.0]) * 1e-3
        along = np.array([-15.0, -15.0, -5.0, 5.0, 15.0]) * 1e-3
        positions = np.stack([np.zeros(5), top + 0.015 - down, along], axis=1)
        tool = RigidTool(SphereShape(0.015), ToolPath(np.arange(5.0), positions))
    else:
        depth = 0.002 * np.arange(4.0)
        sinking = np.stack([0.0 * depth, top + 0.01 - depth, 0.0 * depth], axis=1)
        path = ToolPath(np.arange(4.0), sinking, np.array([ACROSS] * 4))
        tool = RigidTool(CapsuleShape(0.01, 0.02), path)
    return Problem(mesh, TISSUE, (lying(mesh),), (), tools=(tool,))


def solve_as_far(problem: Problem, strain: Strain) -> tuple[ContactResult, ContactLostError | None]:
    """As far as there is an equilibrium, and what ended it."""
    try:
        return solve_contact(problem, strain=strain), None
    except ContactLostError as error:
        if not isinstance(error.partial, ContactResult):
            raise
        return error.partial, error


def require_the_references(problem: Problem, strain: Strain, limit: float) -> None:
    """Force, displacement and change of volume, up to where both have an equilibrium."""
    from palpate.reference.statics import solve_static

    found, lost = solve_as_far(problem, strain)
    if lost is not None:
        tool = problem.tools[0]
        poses = np.array([tool.path.pose_at(float(t))[0] for t in found.times])
        shorter = replace(tool, path=ToolPath(found.times, poses))
        problem = replace(problem, tools=(shorter,))
    truth = solve_static(problem, strain=strain)
    forces = np.array(truth.tools[0].forces)
    assert np.abs(forces).max() > 0.0
    assert np.abs(found.forces[:, 0] - forces).max() <= limit * np.abs(forces).max()
    u, v = found.displacements[-1], truth.displacement
    assert np.linalg.norm(u - v) <= limit * np.linalg.norm(v)
    mesh = problem.mesh
    change = float(signed_volumes(mesh.points + u, mesh.cells).sum()) - mesh.volume
    assert change == pytest.approx(truth.volume - truth.rest_volume, rel=limit)


def coarse_block() -> TetMesh:
    """A quarter block with a seventh of the radius as its finest edge."""
    return quarter_block(0.15 * RADIUS, 0.3 * RADIUS, growth=0.4, width=2.0 * RADIUS)


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
def test_a_coarse_scene_is_the_references(strain: Strain) -> None:
    require_the_references(sphere_into_block(coarse_block(), (0.0, 0.05, 0.1)), strain, 1e-7)


@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("scene", ["sphere into block", "flat punch", "slide", "capsule"])
def test_every_scene_is_the_references(scene: str, strain: Strain) -> None:
    makers = {"sphere into block": indentation, "flat punch": flat_punch}
    problem = makers[scene]() if scene in makers else on_kidney(scene)
    require_the_references(problem, strain, 1e-6)


def test_a_quarter_is_a_quarter_of_the_whole() -> None:
    # The same cells turned about the axis: forces of the quarter's symmetry planes cancel.
    problem = sphere_into_block(coarse_block(), (0.0, 0.1))
    found = solve_contact(problem, strain=Strain.LINEAR)
    assert found.forces[-1, 0, 2] > 0.0
    # Diagonals of the mesh apart, x and y are alike.
    assert found.forces[-1, 0, 0] == pytest.approx(found.forces[-1, 0, 1], rel=1e-6)


@pytest.mark.nightly
def test_where_there_is_no_equilibrium_any_more_is_stated() -> None:
    depths = (0.0, DEPTHS[-1], 0.35)
    found, lost = solve_as_far(sphere_into_block(indentation().mesh, depths), Strain.GREEN)
    assert np.interp(found.times[-1], np.arange(3.0), depths) > DEPTHS[-1]
    assert lost is None or lost.reason


@pytest.mark.nightly
def test_two_cubes_that_collide_keep_momentum_and_energy() -> None:
    """Equal cubes of different meshes, 1 m/s, head on but for a few centimetres."""
    low = brick_box((6, 6, 6), (0.4, 0.4, 0.4))
    high = brick_box((7, 7, 7), (0.4, 0.4, 0.4))
    mesh = TetMesh(
        np.vstack([low.points, high.points + np.array([0.03, 0.05, 0.41])]),
        np.vstack([low.cells, high.cells + low.num_points]).astype(np.int32),
    )
    speed = np.zeros_like(mesh.points)
    speed[parts_of_mesh(mesh) != 0, 2] = -1.0
    problem = Problem(mesh, CUBES, (), (), TimeSpan(0.4, num_outputs=40))
    law = ContactLaw(ContactForm.PENALTY)
    run = simulate(problem, velocity=speed, body_contact=law, tracks_energy=True)
    assert run.energies is not None
    mass = Body(mesh, CUBES).lumped_mass[:, None]
    first, last = mass * speed, mass * run.velocity
    momentum, turn = first.sum(axis=0), np.cross(mesh.points, first).sum(axis=0)
    turned = np.cross(mesh.points + run.displacements[-1], last).sum(axis=0)
    assert np.linalg.norm(last.sum(axis=0) - momentum) <= 1e-12 * np.linalg.norm(momentum)
    assert np.linalg.norm(turned - turn) <= 1e-12 * np.linalg.norm(turn)
    assert np.ptp(run.energies.balance) <= 0.005 * run.energies.balance[0]


def folded_bar() -> TetMesh:
    """Two arms 0.6 m long and 0.2 m thick, 0.05 m apart, joined at one end."""
    block = brick_box((12, 4, 9), (0.6, 0.2, 0.45))
    middle = block.points[block.cells].mean(axis=1)
    slot = (middle[:, 0] > 0.15) & (middle[:, 2] > 0.2) & (middle[:, 2] < 0.25)
    cells = block.cells[~slot]
    used, numbered = np.unique(cells, return_inverse=True)
    return TetMesh(block.points[used], numbered.reshape(cells.shape).astype(np.int32))


@pytest.mark.nightly
def test_a_folded_bar_rests_on_itself_less_deep_the_stiffer_the_penalty() -> None:
    """The bar's arms are one edge apart; its weight, slowly raised, closes them."""
    mesh = folded_bar()
    span = TimeSpan(1.5, num_outputs=2, mass_damping=8.0)
    weight = BodyForce((0.0, 0.0, -1000.0))
    problem = Problem(mesh, CUBES, (support_of(side(mesh, 2, 0.0)),), (weight,), span)

    def deepest(law: ContactLaw | None) -> float:
        run = simulate(problem, body_contact=law, amplitude=smooth_ramp(0.8))
        return float(overlap_depths(mesh, run.displacements[-1])[1].max()) / 0.05

    free, soft, stiff = (
        deepest(law) for law in (None, *(ContactLaw(ContactForm.PENALTY, k) for k in (1e6, 4e6)))
    )
    assert free > 1.0
    assert soft > stiff
    assert stiff <= 0.1
