"""`palpate bench static`: equilibria of a beam and a kidney, ours beside other solvers.

A timing is a whole static solve to a relative residual of 1e-8, with assembly. dolfinx has its mesh
and compiled forms before the clock starts, ours only the arrays; CalculiX reads its input file;
FElupe factors directly. Rows have body, strain, tip_displacement [m] (z, of the same point in every
tool), peak_memory_mb of the process, solver, iterations, linear_iterations, and times_linear:
seconds with Green strain over those with linear.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool, tools_for
from palpate.validation.peers.timing import Child, Schedule
from palpate.validation.states import Progress

# Degrees of freedom -> bricks of the beam.
BEAMS = {22_143: (60, 10, 10), 115_881: (106, 18, 18)}
KIDNEY = 3_246  # the kidney of Table I
TOLERANCE = 1e-8
SCHEDULE = Schedule(turns=4, long=5.0, turns_if_long=2)
TOOLS = (Tool(OURS, "ours"), *tools_for("static"))


def beam_problem(size: int) -> Problem:
    """A beam of 1 x 0.1 x 0.1 m, bent by about 4 % of its length."""
    mesh = brick_box(BEAMS[size], (1.0, 0.1, 0.1))
    fixed = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    return Problem(
        mesh, Material(1e6, 0.3, 1000.0), (Support(fixed),), (BodyForce((0.0, 0.0, -300.0)),)
    )


def make_scenes(size: int, _progress: Progress) -> Iterator[Scene]:
    """Both strain measures, linear first."""
    problem = load_case("kidney").problem if size == KIDNEY else beam_problem(size)
    # The farthest point along x, then z: it moves much, and is the same for all tools.
    x, _, z = problem.mesh.points.T
    tip = int(np.lexsort((z, x))[-1])

    def finish(rows: list[Row], children: list[Child], earlier: list[Row]) -> None:
        linear = {(row["tool"], row["version"]): row for row in earlier if row["size"] == size}
        for row, child in zip(rows, children, strict=True):
            row["tip_displacement"] = float(child.result["displacement"][tip, 2])
            row["iterations"], row["solver"] = row.pop("newton_iterations"), row.pop("method")
            row.setdefault("linear_iterations", None)
            if row["strain"] == "green" and (partner := linear.get((row["tool"], row["version"]))):
                row["times_linear"] = row["seconds"] / partner["seconds"]

    for strain in (Strain.LINEAR, Strain.GREEN):
        yield Scene(
            3 * problem.mesh.num_points,
            rest_arrays(problem) | {"strain": strain.value, "relative_tolerance": TOLERANCE},
            {"body": "kidney" if size == KIDNEY else "beam", "strain": strain.value},
            finish,
        )


def remark(ours: list[Row], rivals: list[Row]) -> list[str]:
    """Memory and tip beside the quickest rival's, and the cost of Green strain."""
    row, parts = ours[0], []
    if rivals:
        tip = rivals[0]["tip_displacement"]
        parts = [
            f"{row['peak_memory_mb'] / rivals[0]['peak_memory_mb']:.2f} of the quickest's memory",
            f"tips {abs(row['tip_displacement'] - tip) / abs(tip):.1g} apart",
        ]
    if "times_linear" in row:
        parts.append(f"Green {row['times_linear']:.1f} times linear")
    return parts


BENCHMARK = Benchmark(
    task="Static",
    sizes=(*BEAMS, KIDNEY),
    tools=TOOLS,
    schedule=SCHEDULE,
    make_scenes=make_scenes,
    measure_work=lambda row: row["size"],
    rate_unit="degrees of freedom per second",
    same=("body", "strain"),
    table=("body", "strain", "tip_displacement", "peak_memory_mb", "iterations",
           "linear_iterations", "times_linear"),
    remark=remark,
)  # fmt: skip
