"""Bodies that touch: two cubes that collide, a folded bar that comes to rest on itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import overlap_depths
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_modes import connected_parts
from palpate.meshes.tet_mesh import TetMesh

MATERIAL = Material(1e4, 0.3, 1000.0)
# Penalties of the bar [Pa/m], after the one that the time step bears by itself.
STIFFER = (1e6, 4e6)


class Collision(NamedTuple):
    """Two cubes, one of which flies at the other.

    Errors are changes of the sum over its size [-], of the balance of energy over the energy at the
    start; `speeds` are those of both along the flight, after over before.
    """

    momentum_error: float
    moment_error: float
    energy_error: float
    speeds: tuple[float, float]


class Fold(NamedTuple):
    """Deepest vertex of a folded bar in itself under its weight [edges of its cells].

    `free`: without contact, the arms pass through each other; `depths`: with each penalty [Pa/m].
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
    first, last = mass * speed, mass * run.velocity
    turn = np.cross(mesh.points, first).sum(axis=0)
    turned = np.cross(mesh.points + run.displacements[-1], last).sum(axis=0)
    momentum = first.sum(axis=0)
    return Collision(
        float(np.linalg.norm(last.sum(axis=0) - momentum) / np.linalg.norm(momentum)),
        float(np.linalg.norm(turned - turn) / np.linalg.norm(turn)),
        float(np.ptp(run.energies.balance) / run.energies.balance[0]),
        (
            float(-last[~flying, 2].sum() / mass[~flying].sum()),
            float(-last[flying, 2].sum() / mass[flying].sum()),
        ),
    )


def fold() -> Fold:
    """The bar's arms are one edge apart; its weight, slowly raised, closes them."""
    mesh = folded_bar()
    span = TimeSpan(1.5, num_outputs=2, mass_damping=8.0)
    weight = BodyForce((0.0, 0.0, -1000.0))
    problem = Problem(mesh, MATERIAL, (held(side(mesh, 2, 0.0)),), (weight,), span)

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
