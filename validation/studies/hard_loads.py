"""Loads up to where the material ends: who finds the equilibrium, and who says why not.

The kidney and the beam are bent, twisted, squeezed, pressed and pulled, each harder and harder, on
linear tetrahedra. The reference raises the load in steps that adapt, lets no cell invert, and takes
stable equilibria only. Beside it a plain Newton iteration raises the load in one step and in ten
equal ones, with full Newton steps, and calls converged whatever leaves no residual. A converged
answer is checked afterwards by the volumes of its cells, as they are.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import prescribe, rotation
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.validation.case import load_case
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.study import Study

# Which way each body lies.
BODIES = {"kidney": 2, "beam": 0}
PLAIN_STEPS = (1, 10)
_PLAIN_ITERATIONS = 25
_TOLERANCE = 1e-10


class Trial(NamedTuple):
    """One load on one body; `strength` is degrees, part of the length, or stress over E.

    `reference` is "converged", or up to which part of the load there is equilibrium, and
    `diagnosis` then says why. `plain` is "converged", "false success" (a cell inverted, or not
    stable) or "lost", for each of `PLAIN_STEPS`. `is_wrong`: the reference called converged what
    has an inverted cell.
    """

    body: str
    kind: str
    strength: float
    reference: str
    plain: tuple[str, ...]
    reference_seconds: float
    diagnosis: str
    is_wrong: bool


def compute(progress: Progress) -> list[Trial]:
    """Try every load."""
    trials = []
    for body, kind, strength, problem in hard_loads():
        progress(f"{body}: {kind} {strength:g}")
        trials.append(attempt(body, kind, strength, problem))
    return trials


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


def judge(trials: list[Trial]) -> list[Finding]:
    """The reference calls nothing converged that is not."""
    counts = summarise(trials)
    words = ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in counts.items())
    claim = "what the reference calls converged has no inverted cell"
    return [judged(claim, words, counts["false_successes"] == 0)]


def present(trials: list[Trial]) -> Page:
    """Every trial."""
    columns = {"body": "", "kind": "", "strength": "g", "reference": ""}
    columns |= {f"plain, {n} steps" if n > 1 else "plain, 1 step": "" for n in PLAIN_STEPS}
    columns |= {"reference [s]": ".1f", "diagnosis": ""}
    rows = [(*t[:4], *t.plain, t.reference_seconds, t.diagnosis) for t in trials]
    table = Table("Every load", columns, rows)
    return Page(tables={"hard-loads": table}, numbers={"summary": summarise(trials)})


def hard_loads() -> Iterator[tuple[str, str, float, Problem]]:
    """Body, kind, strength and problem of every trial."""
    for body, axis in BODIES.items():
        case = load_case(body).problem
        mesh, stiffness = case.mesh, case.material.youngs_modulus
        along = mesh.points[:, axis]
        low, length = along.min(), float(np.ptp(along))
        foot, head = (
            np.flatnonzero(is_end).astype(np.int32)
            for is_end in (along < low + 0.12 * length, along > along.max() - 0.12 * length)
        )
        facets = mesh.boundary_facets
        top = facets[np.isin(facets, head).all(axis=1)]
        skin = facets[~np.isin(facets, foot).any(axis=1)]
        arms = mesh.points - mesh.points[head].mean(axis=0)
        up, beside = np.eye(3)[axis], np.roll(np.eye(3), 1, axis=0)[axis]
        width = float(np.ptp(mesh.points @ beside))
        # The stress of bending is about the force times the length over the width.
        bending = stiffness * width / length**2 * beside
        foothold = _hold(mesh, foot)

        def loaded(load: Load, case: Problem = case, foot: Support = foothold) -> Problem:
            return Problem(case.mesh, case.material, (foot,), (load,))

        def moved(*supports: Support, case: Problem = case, foot: Support = foothold) -> Problem:
            return Problem(case.mesh, case.material, (foot, *supports), ())

        for part in (0.02, 0.1, 0.3, 1.0, 3.0):
            yield body, "bend", part, loaded(BodyForce(_triple(part * bending)))
        for degrees in (30.0, 60.0, 90.0, 120.0, 150.0):
            turned = arms @ rotation(_triple(up), degrees).T - arms
            heads = prescribe(mesh, case.material, head, turned).supports
            yield body, "twist", degrees, moved(*heads)
        for part in (0.05, 0.1, 0.2, 0.3, 0.5):
            yield body, "squeeze", part, moved(_hold(mesh, head, -part * length * up))
        for part in (0.05, 0.15, 0.3, 0.6, 1.2):
            yield body, "press", part, loaded(Pressure(skin, part * stiffness))
        for part in (0.05, 0.1, 0.2, 0.5, 2.0):
            for kind, sign in (("push", -1.0), ("pull", 1.0)):
                load = Traction(top, _triple(sign * part * stiffness * up))
                yield body, kind, part, loaded(load)


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
    return Trial(body, kind, strength, reference, plain, seconds, diagnosis, is_wrong)


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


def _hold(mesh: TetMesh, points: Indices, displacement: Points | None = None) -> Support:
    """Points, with the facets between them."""
    facets = mesh.boundary_facets
    between = facets[np.isin(facets, points).all(axis=1)]
    moved = _triple(np.zeros(3) if displacement is None else displacement)
    return Support(points, between, displacement=moved)


STUDY = Study("Loads up to where the material ends", __doc__, compute, judge, present)
