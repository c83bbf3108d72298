"""Explicit runs with contact: cubes that collide, a folded bar, and what a tool costs a step."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import overlap_depths
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import SAFETY, ExplicitBody, Precision
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_modes import connected_parts
from palpate.meshes.rigid_tool import CapsuleShape, RigidTool, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Progress
from palpate.validation.studies.contact.scenes import ACROSS, TISSUE, lying_kidney

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


# As in `palpate bench steps`.
MASS_DAMPING = 5.0
EDGE, CELLS = 5.15e-3, 20_724
# Part of the largest body in real time without tools that must still be so with one.
PART = 0.75
_TIMINGS = 10
_CELL_STEPS = 2e7


class Speed(NamedTuple):
    """One body on one core, single precision.

    `seconds` are the processor's per step: without contact, with a capsule under the constraint and
    the penalty, and without a tool but with self-collision.
    """

    cells: int
    time_step: float
    seconds: tuple[float, float, float, float]

    @property
    def shares(self) -> tuple[float, float, float]:
        """What is added to a step: constraint, penalty, self-collision [-]."""
        bare, constraint, penalty, itself = self.seconds
        return constraint / bare - 1.0, penalty / bare - 1.0, itself / bare - 1.0

    @property
    def real_time_factors(self) -> tuple[float, ...]:
        """Simulated over spent time [-], in the order of `seconds`."""
        return tuple(self.time_step / s for s in self.seconds)

    @property
    def real_time_cells(self) -> int:
        """Cells of this body in real time without a tool: cost grows as n, steps as n^(1/3)."""
        return int(self.cells * self.real_time_factors[0] ** 0.75)


def measure_speeds(progress: Progress) -> tuple[Speed, Speed]:
    """The kidney of the benchmark, then one of three quarters of what would be real time."""
    progress(f"steps of the kidney, about {CELLS} cells, with a capsule and without")
    first = measure_speed(mesh_surface(shape_kidney(edge_length=EDGE)))
    wanted = PART * first.real_time_cells
    progress(f"steps of the kidney, about {wanted:.0f} cells")
    edge = EDGE * (first.cells / wanted) ** (1.0 / 3.0)
    return first, measure_speed(mesh_surface(shape_kidney(edge_length=edge)))


def measure_speed(mesh: TetMesh) -> Speed:
    """Best of several timings, taken in turn while a capsule slides over the kidney."""
    step = SAFETY * Body(mesh, TISSUE).critical_time_step()
    bodies = [
        moving_capsule(mesh, step, law)
        for law in (None, ContactLaw(), ContactLaw(ContactForm.PENALTY))
    ]
    bodies.append(moving_capsule(mesh, step, None, touches_itself=True))
    # The capsule is down after 0.2 s.
    for body in bodies:
        body.step(int(0.25 / step))
    steps = max(50, int(_CELL_STEPS / mesh.num_cells))
    best = [np.inf] * len(bodies)
    for _ in range(_TIMINGS):
        for k, body in enumerate(bodies):
            start = time.process_time()
            body.step(steps)
            best[k] = min(best[k], (time.process_time() - start) / steps)
    return Speed(mesh.num_cells, step, (best[0], best[1], best[2], best[3]))


def moving_capsule(
    mesh: TetMesh, step: float, law: ContactLaw | None, *, touches_itself: bool = False
) -> ExplicitBody:
    """A kidney that lies on its side, a capsule pressed 5 mm into it that slides along it."""
    top = float(mesh.points[np.abs(mesh.points[:, 2]) < 0.03, 1].max())
    radius = 0.008
    heights = top + radius + np.array([0.0005, -0.005, -0.005])
    positions = np.stack([np.zeros(3), heights, np.array([-0.02, -0.02, 0.03])], axis=1)
    path = ToolPath(np.array([0.0, 0.2, 5.0]), positions, np.array([ACROSS] * 3))
    tools = () if law is None else (RigidTool(CapsuleShape(radius, 0.02), path),)
    span = TimeSpan(1.0, mass_damping=MASS_DAMPING)
    return ExplicitBody(
        Problem(mesh, TISSUE, (lying_kidney(mesh),), (), span, tools),
        time_step=step,
        precision=Precision.SINGLE,
        contact=law,
        body_contact=ContactLaw(ContactForm.PENALTY) if touches_itself else None,
    )
