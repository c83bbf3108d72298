"""Loads up to where the material ends: who finds the equilibrium, and who says why not.

The kidney and the beam are bent, twisted, squeezed, pressed and pulled, each harder and harder, on
linear tetrahedra. The reference raises the load in steps that adapt, lets no cell invert, and takes
stable equilibria only. Beside it a plain Newton iteration raises the load in one step and in ten
equal ones, with full Newton steps, and calls converged whatever leaves no residual. A converged
answer is checked afterwards by the volumes of its cells, as they are.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.validation.case import load_case
from palpate.validation.quoting import csv_text
from palpate.validation.run_folder import RESULTS

BODIES = ("kidney", "beam")
PLAIN_STEPS = (1, 10)
_PLAIN_ITERATIONS = 25
_TOLERANCE = 1e-10


@dataclass(frozen=True)
class Trial:
    """One load on one body.

    Attributes:
        body: Built-in case whose mesh and material it is.
        kind: What is done to it.
        strength: How hard: degrees, part of the length, or stress over Young's modulus.
        reference: "converged", or up to which part of the load there is equilibrium.
        diagnosis: What ended it; empty where it converged.
        reference_seconds: [s].
        plain: "converged", "false success" (a cell inverted, or not stable) or "lost", for each
            of `PLAIN_STEPS`.
        is_wrong: The reference called converged what has an inverted cell.
    """

    body: str
    kind: str
    strength: float
    reference: str
    diagnosis: str
    reference_seconds: float
    plain: tuple[str, ...]
    is_wrong: bool


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Try every load; leave hard-loads.csv and results.json."""
    trials = []
    for body, kind, strength, problem in hard_loads():
        progress(f"{body}: {kind} {strength:g}")
        trials.append(attempt(body, kind, strength, problem))
    columns = ("body", "kind", "strength", "reference", "plain", "reference_seconds", "diagnosis")
    table = csv_text(columns, ([asdict(t)[c] for c in columns] for t in trials))
    (folder / "hard-loads.csv").write_text(table, encoding="utf-8")
    summary = summarise(trials)
    text = json.dumps(
        {"study": "hard-loads", "summary": summary, "trials": [asdict(t) for t in trials]}, indent=1
    )
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    for t in trials:
        plain = " ".join(f"{p:14}" for p in t.plain)
        line = f"{t.body:7} {t.kind:9} {t.strength:6g}  {t.reference:10} {plain} {t.diagnosis}"
        console.print(line, markup=False, soft_wrap=True)
    for name, value in summary.items():
        console.print(f"{name.replace('_', ' ')}: {value}", markup=False)
    return 1 if summary["false_successes"] else 0


def summarise(trials: list[Trial]) -> dict[str, float]:
    """Count who converged, and what a plain iteration loses or gets wrong."""
    converged = [t for t in trials if t.reference == "converged"]
    counts: dict[str, float] = {
        "trials": len(trials),
        "converged": len(converged),
        "honest_ends": sum(t.reference != "converged" and bool(t.diagnosis) for t in trials),
        "false_successes": sum(t.is_wrong for t in trials),
        "longest_seconds": round(max(t.reference_seconds for t in trials), 1),
    }
    for k, steps in enumerate(PLAIN_STEPS):
        name = f"plain_in_{steps}"
        counts[f"{name}_misses"] = sum(t.plain[k] != "converged" for t in converged)
        counts[f"{name}_falsely_succeeds"] = sum(t.plain[k] == "false success" for t in trials)
    return counts


def hard_loads() -> Iterator[tuple[str, str, float, Problem]]:
    """Body, kind, strength and problem of every trial."""
    for body in BODIES:
        case = load_case(body).problem
        mesh, stiffness = case.mesh, case.material.youngs_modulus
        # The kidney stands along z, the beam lies along x.
        axis = {"kidney": 2, "beam": 0}[body]
        along = mesh.points[:, axis]
        low, high = along.min(), along.max()
        length = float(high - low)
        foot = _hold(mesh, np.flatnonzero(along < low + 0.12 * length))
        head = np.flatnonzero(along > high - 0.12 * length)
        side = np.roll(np.eye(3), 1, axis=0)[axis]
        width = float(np.ptp(mesh.points @ side))
        top = _facets_within(mesh, head)
        skin = _facets_outside(mesh, foot.points)

        def problem(
            load: Load | None = None,
            moved: tuple[Support, ...] = (),
            case: Problem = case,
            foot: Support = foot,
        ) -> Problem:
            return Problem(case.mesh, case.material, (foot, *moved), (load,) if load else ())

        for part in (0.02, 0.1, 0.3, 1.0, 3.0):
            # The stress of bending is about the force times the length over the width.
            density = part * stiffness * width / length**2
            yield body, "bend", part, problem(BodyForce(_triple(density * side)))
        for degrees in (30.0, 60.0, 90.0, 120.0, 150.0):
            turned = _turned(mesh, head, axis, degrees)
            yield body, "twist", degrees, problem(None, turned)
        for part in (0.05, 0.1, 0.2, 0.3, 0.5):
            down = _triple(-part * length * np.eye(3)[axis])
            squeezed = _hold(mesh, head, down)
            yield body, "squeeze", part, problem(None, (squeezed,))
        for part in (0.05, 0.15, 0.3, 0.6, 1.2):
            yield body, "press", part, problem(Pressure(skin, part * stiffness))
        for part in (0.05, 0.1, 0.2, 0.5, 2.0):
            push = _triple(-part * stiffness * np.eye(3)[axis])
            yield body, "push", part, problem(Traction(top, push))
            yield body, "pull", part, problem(Traction(top, _triple(-np.asarray(push))))


def attempt(body: str, kind: str, strength: float, problem: Problem) -> Trial:
    """Let the reference and a plain iteration try."""
    from palpate.reference.statics import solve_static

    start = time.perf_counter()
    is_wrong, diagnosis = False, ""
    try:
        found = solve_static(problem, relative_tolerance=_TOLERANCE)
    except ReferenceNotConvergedError as error:
        reference = f"to {error.load_factor:.3f}"
        x, y, z = 1e3 * error.place
        diagnosis = (
            f"{error.reason}; smallest stretch {error.smallest_stretch:.3f} "
            f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm"
        )
    else:
        reference = "converged"
        is_wrong = _has_inverted(problem.mesh, found.displacement)
    seconds = time.perf_counter() - start
    plain = tuple(_iterate_plainly(problem, steps) for steps in PLAIN_STEPS)
    return Trial(body, kind, strength, reference, diagnosis, seconds, plain, is_wrong)


def _iterate_plainly(problem: Problem, num_steps: int) -> str:
    """Equal steps of full Newton steps, as a textbook has it."""
    from palpate.reference.deformed_state import DetFSampler
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.linear_solver import LinearSolveError, LinearSolver
    from palpate.reference.newton import Newton

    eq = DiscreteProblem(problem, strain=Strain.GREEN, degree=1)
    linear = LinearSolver(
        eq.space.coordinates, is_symmetric=not eq.has_followers, is_always_direct=True
    )
    u = np.zeros(eq.num_dofs)
    for step in range(1, num_steps + 1):
        t = step / num_steps
        for _ in range(_PLAIN_ITERATIONS):
            internal, external = eq.internal_force(u), t * eq.external_force(u)
            residual = internal - external
            gap = t * eq.held.values - u[eq.held.dofs]
            scale = max(np.linalg.norm(internal), np.linalg.norm(external))
            if not np.isfinite(scale):
                return "lost"
            small = np.linalg.norm(residual[eq.free]) <= 1e-8 * scale
            if small and not gap.any() and scale > 0.0:
                break
            try:
                u = u + linear.solve(
                    eq.tangent(u, t), -residual, eq.held.dofs, gap, tolerance=1e-10
                )
            except LinearSolveError:
                return "lost"
            u[eq.held.dofs] = t * eq.held.values
        else:
            return "lost"
    if _has_inverted(problem.mesh, eq.space.at_points(u)):
        return "false success"
    newton = Newton(eq, DetFSampler(eq), relative_tolerance=1e-8)
    return "converged" if newton.is_stable(u, 1.0) else "false success"


def _has_inverted(mesh: TetMesh, displacement: Points) -> bool:
    return bool((signed_volumes(mesh.points + displacement, mesh.cells) <= 0.0).any())


def _triple(vector: Points) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z


def _hold(
    mesh: TetMesh, points: Indices, displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Support:
    facets = _facets_within(mesh, points)
    return Support(points.astype(np.int32), facets, displacement=displacement)


def _facets_within(mesh: TetMesh, points: Indices) -> Indices:
    facets = mesh.boundary_facets
    found: Indices = facets[np.isin(facets, points).all(axis=1)]
    return found


def _facets_outside(mesh: TetMesh, points: Indices) -> Indices:
    facets = mesh.boundary_facets
    found: Indices = facets[~np.isin(facets, points).any(axis=1)]
    return found


def _turned(mesh: TetMesh, points: Indices, axis: int, degrees: float) -> tuple[Support, ...]:
    """Points held where a turn about the axis through their middle takes them."""
    a = np.radians(degrees)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    arms = mesh.points[points] - mesh.points[points].mean(axis=0)
    moved = np.zeros_like(arms)
    moved[:, i] = np.cos(a) * arms[:, i] - np.sin(a) * arms[:, j] - arms[:, i]
    moved[:, j] = np.sin(a) * arms[:, i] + np.cos(a) * arms[:, j] - arms[:, j]
    return tuple(
        Support(np.array([p], dtype=np.int32), displacement=_triple(u))
        for p, u in zip(points, moved, strict=True)
    )
