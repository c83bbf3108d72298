"""Bodies that touch: two cubes that collide, a folded bar that comes to rest on itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import overlap_depths
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_modes import connected_parts
from palpate.meshes.tet_mesh import TetMesh

MATERIAL = Material(1e4, 0.3, 1000.0)
# Penalties of the bar [Pa/m], after the one that the time step bears by itself.
STIFFER = (1e6, 4e6)


@dataclass(frozen=True)
class Collision:
    """Two cubes, one of which flies at the other.

    Attributes:
        momentum_error: Change of the sum over its size [-].
        moment_error: The same of the moment of momentum.
        energy_error: Largest change of the balance over the energy at the start [-].
        speeds: Of both along the flight, after over before [-].
    """

    momentum_error: float
    moment_error: float
    energy_error: float
    speeds: tuple[float, float]


@dataclass(frozen=True)
class Fold:
    """Deepest vertex of a folded bar in itself under its weight [edges of its cells].

    Attributes:
        free: Without contact: the arms pass through each other.
        stiffnesses: Penalties [Pa/m].
        depths: With each.
    """

    free: float
    stiffnesses: tuple[float, ...]
    depths: tuple[float, ...]


def collide() -> Collision:
    """Equal cubes of different meshes, 1 m/s, head on but for a few centimetres."""
    low = brick_box((6, 6, 6), (0.4, 0.4, 0.4))
    high = brick_box((7, 7, 7), (0.4, 0.4, 0.4))
    mesh = TetMesh(
        np.vstack([low.points, high.points + np.array([0.03, 0.05, 0.41])]),
        np.vstack([low.cells, high.cells + low.num_points]).astype(np.int32),
    )
    flying = connected_parts(mesh) != 0
    speed = np.zeros_like(mesh.points)
    speed[flying, 2] = -1.0
    problem = Problem(mesh, MATERIAL, (), (), TimeSpan(0.4, num_outputs=40))
    law = ContactLaw(ContactForm.PENALTY)
    run = simulate(problem, velocity=speed, body_contact=law, tracks_energy=True)
    assert run.energies is not None
    mass = Body(mesh, MATERIAL).lumped_mass[:, None]
    places = mesh.points + run.displacements[-1]
    before, after = (mass * speed).sum(axis=0), (mass * run.velocity).sum(axis=0)
    turn = np.cross(mesh.points, mass * speed).sum(axis=0)
    turned = np.cross(places, mass * run.velocity).sum(axis=0)
    ends = [
        float(-(mass * run.velocity)[part, 2].sum() / mass[part].sum())
        for part in (~flying, flying)
    ]
    return Collision(
        float(np.linalg.norm(after - before) / np.linalg.norm(before)),
        float(np.linalg.norm(turned - turn) / np.linalg.norm(turn)),
        float(np.ptp(run.energies.balance) / run.energies.balance[0]),
        (ends[0], ends[1]),
    )


def fold() -> Fold:
    """The bar's arms are one edge apart; its weight, slowly raised, closes them."""
    mesh = folded_bar()
    held = Support(np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32))
    span = TimeSpan(1.5, num_outputs=2, mass_damping=8.0)
    problem = Problem(mesh, MATERIAL, (held,), (BodyForce((0.0, 0.0, -1000.0)),), span)

    def deepest(law: ContactLaw | None) -> float:
        run = simulate(problem, body_contact=law, amplitude=smooth_ramp(0.8))
        return float(overlap_depths(mesh, run.displacements[-1])[1].max()) / 0.05

    laws = [ContactLaw(ContactForm.PENALTY, k) for k in STIFFER]
    return Fold(deepest(None), STIFFER, tuple(deepest(law) for law in laws))


def folded_bar() -> TetMesh:
    """Two arms 0.6 m long and 0.2 m thick, 0.05 m apart, joined at one end."""
    block = brick_box((12, 4, 9), (0.6, 0.2, 0.45))
    middle = block.points[block.cells].mean(axis=1)
    slot = (middle[:, 0] > 0.15) & (middle[:, 2] > 0.2) & (middle[:, 2] < 0.25)
    cells = block.cells[~slot]
    used, numbered = np.unique(cells, return_inverse=True)
    return TetMesh(block.points[used], numbered.reshape(cells.shape).astype(np.int32))
