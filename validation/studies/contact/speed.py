"""What contact with one tool costs: share of a step, and the largest body in real time."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import SAFETY
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Problem, TimeSpan
from palpate.meshes.rigid_tool import CapsuleShape, RigidTool, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Progress
from palpate.validation.studies.contact.scenes import ACROSS, TISSUE, lying_kidney

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
