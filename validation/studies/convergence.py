"""Do the numbers of the kidney converge, and does their error bar hold?

Nothing is known of them beforehand: three meshes give the observed order, Richardson's value and
the grid convergence index (Roache 1994; Celik et al. 2008), compared with the stored reference,
quadratic tetrahedra on the mesh cut in eight. The edge of the fixed surface is singular,
displacement there goes like the square root of the distance, so the order falls from 2 to about 1
on uniform meshes: an error falls by half, not by four, with each cut in eight. On meshes of this
size it is still a little below 1, and so Richardson's value may lie beyond the truth.

The orders in cell size, degree and time step where the solution is known are tests
(tests/reference/test_manufactured.py, tests/validation/studies/test_study_convergence.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.case import Case, load_case
from palpate.validation.metrics.difference import make_state
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.references.stored import load_stored
from palpate.validation.report.plots import BLUE, GREEN, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress, State

TITLE = "Convergence of the kidney"

# Between the limit, 1, and the order of a smooth problem, 2: nearer the first.
LARGEST_SINGULAR_ORDER = 1.5


# All three meshes have the same faceted shape, so what converges is the discretisation alone. Where
# the fixed surface meets the free one, stress is singular: displacement behaves like the square
# root of the distance (a crack front, or a punch that sticks), so that linear functionals of
# P1 converge with order 1 on uniform meshes once that edge dominates, and with 2 before.

# Once the edge of the support dominates; before, up to 2.
EXPECTED_ORDER = 1.0
# fastsim's relative tolerance is 1e-10 of the forces.
_NOISE = 1e-8
# What is asked of a loaded body, its unit, and what one of SI's is in it. The probe is the point
# farthest from the support, the same on all meshes.
QUANTITIES = {
    "volume change": ("mm3", 1e9),
    "area change": ("mm2", 1e6),
    "largest displacement": ("mm", 1e3),
    "probe displacement": ("mm", 1e3),
}
# Each of these, in its unit.
Response = Mapping[str, float]


def measure_response(problem: Problem, displacement: Points) -> Response:
    """Measure a displacement by geometry alone."""
    state = make_state(problem.mesh, displacement, label="", simulator="", strain=Strain.GREEN)
    return _response(problem, state)


def _response(problem: Problem, state: State) -> Response:
    mesh = problem.mesh
    values = (
        state.volume - mesh.volume,
        state.surface_area - mesh.surface_area,
        state.max_displacement,
        float(np.linalg.norm(state.displacement[probe_of(problem)])),
    )
    named = zip(QUANTITIES.items(), values, strict=True)
    return {quantity: factor * value for (quantity, (_, factor)), value in named}


def probe_of(problem: Problem) -> int:
    """The point farthest from the middle of the fixed ones; refinement keeps its number."""
    fixed = np.unique(np.concatenate([s.points for s in problem.supports]))
    middle = problem.mesh.points[fixed].mean(axis=0)
    return int(np.linalg.norm(problem.mesh.points - middle, axis=1).argmax())


class MeshFamily(NamedTuple):
    """Responses on a mesh and its refinements, coarsest first."""

    cells: tuple[int, ...]
    responses: tuple[Response, ...]

    def assess(self, quantity: str) -> GridConvergence:
        """Order, Richardson's value and error bar of one quantity, in its unit."""
        values = [response[quantity] for response in self.responses[:-4:-1]]
        noise = _NOISE * abs(values[0])
        return assess_grid_convergence(
            values, [1.0, 2.0, 4.0], expected_order=EXPECTED_ORDER, noise=noise
        )


class StoredTruth(NamedTuple):
    """A stored reference's number and its error bar, in the quantity's unit."""

    value: float
    bar: float


def stored_truth(case: Case) -> dict[str, StoredTruth]:
    """What the stored P2 on the refined mesh says of each quantity.

    Raises:
        InputError: The stored reference is missing or belongs to another case.
    """
    stored = load_stored(case.name, case.problem)
    state = stored.truth(Strain.GREEN)
    assert state is not None, "a stored reference holds its truth"
    # Bars are relative to what is measured; the probe, near the largest, takes its bar.
    metrics = ("volume", "surface_area", "max_displacement", "max_displacement")
    named = zip(_response(case.problem, state).items(), metrics, strict=True)
    return {
        quantity: StoredTruth(value, abs(value) * stored.bars[metric, Strain.GREEN])
        for (quantity, value), metric in named
    }


def follow_meshes(problem: Problem, progress: Progress, *, refinements: int = 2) -> MeshFamily:
    """Solve on the mesh and its refinements by fastsim, Green strain, each from the one before."""
    cells, responses = [], []
    for level in range(refinements + 1):
        if level:
            problem = refine_problem(problem)
        progress(f"linear tetrahedra, {problem.mesh.num_cells} cells")
        cells.append(problem.mesh.num_cells)
        responses.append(measure_response(problem, solve_static(problem).displacement))
    return MeshFamily(tuple(cells), tuple(responses))


class Found(NamedTuple):
    """The kidney's numbers on its meshes, and what is stored of them."""

    meshes: MeshFamily
    truth: Mapping[str, StoredTruth]


def compute(progress: Progress) -> Found:
    """Solve on three meshes."""
    case = load_case("kidney")
    return Found(follow_meshes(case.problem, progress), stored_truth(case))


def judge(found: Found) -> list[Finding]:
    """The kidney's orders and bars, and whether they agree with the stored reference."""
    meshes, truth = found
    findings = []
    for quantity, (unit, _) in QUANTITIES.items():
        grids, known = meshes.assess(quantity), truth[quantity]
        bar, index, best = grids.error_bar, grids.index_fine, grids.extrapolated
        is_singular = grids.order is not None and grids.order <= LARGEST_SINGULAR_ORDER
        agrees = bar is not None and abs(grids.value - known.value) <= bar + known.bar
        findings.append(
            judged(
                f"kidney, {quantity}: the clamp holds the order below {LARGEST_SINGULAR_ORDER:g}, "
                "and the finest value agrees with the stored P2 within both error bars",
                f"order {_order(grids)}, {grids.value:.5g} +- "
                f"{'no bar' if bar is None else f'{bar:.3g}'} {unit} (GCI "
                f"{'-' if index is None else f'{100 * index:.2f} %'}), extrapolated "
                f"{'-' if best is None else f'{best:.6g}'}; stored {known.value:.5g} +- "
                f"{known.bar:.3g}",
                is_singular and agrees,
            )
        )
    return findings


def _order(found: GridConvergence) -> str:
    return str(found.behaviour) if found.order is None else f"{found.order:.2f}"


def present(found: Found) -> Page:
    """The kidney's numbers over cell size, and in a table."""
    return Page({"kidney": draw(*found)}, {"kidney_grids": kidney_table(*found)})


def kidney_table(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> Table:
    """The kidney's numbers on three meshes, with order, Richardson's value and GCI."""
    rows: list[Sequence[Any]] = []
    for quantity, (unit, _) in QUANTITIES.items():
        found, values = meshes.assess(quantity), [r[quantity] for r in meshes.responses]
        order = str(found.behaviour) if found.order is None else found.order
        indices = (
            None if index is None else 100.0 * index
            for index in (found.index_fine, found.index_coarse)
        )  # fmt: skip
        known = (order, found.extrapolated, found.error_bar, *indices, *truth[quantity])
        rows.append((f"{quantity} [{unit}]", *values, *known))
    return Table(
        "Kidney, linear tetrahedra on its mesh and on that mesh cut in eight, twice (fastsim)",
        {"quantity": "", **{f"{n} cells": ".6g" for n in meshes.cells}, "order": ".2f",
         "extrapolated": ".6g", "error bar": ".3g", "GCI [%]": ".2f", "GCI coarse [%]": ".2f",
         "stored P2": ".6g", "its bar": ".3g"},
        rows,
    )  # fmt: skip


def draw(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> Figure:
    """Each number over cell size, with Richardson's value and both error bars."""
    sizes = np.array([0.5**k for k in range(len(meshes.cells))])
    panels = []
    for quantity, (unit, _) in QUANTITIES.items():
        found, known = meshes.assess(quantity), truth[quantity]
        values = [r[quantity] for r in meshes.responses]
        lines = [
            Line((0.0, 1.0), (known.value,) * 2, style="-", colour=GREEN,
                 label="stored P2, its bar"),
            Line(sizes, values, colour=BLUE, label="P1 on three meshes"),
        ]  # fmt: skip
        if found.extrapolated is not None and found.order is not None:
            h = np.linspace(0.0, 1.0, 60)
            slope = (values[-1] - found.extrapolated) / sizes[-1] ** found.order
            power_law = found.extrapolated + slope * h**found.order
            lines += [
                Line(h, power_law, style=":", colour=BLUE),
                Line((0.0,), (found.extrapolated,), style="s", colour=RED, label="Richardson"),
            ]
        if found.error_bar is not None:
            ends = (found.value - found.error_bar, found.value + found.error_bar)
            lines.append(Line((sizes[-1],) * 2, ends, style="-_", colour=BLUE))
        panels.append(
            Panel(
                lines,
                band=(known.value - known.bar, known.value + known.bar),
                ticks={0.0: "0", 0.25: "1/4", 0.5: "1/2", 1.0: "1"},
                title=f"{quantity} [{unit}]\nobserved order {_order(found)}",
                x="cell size, first mesh = 1",
            )
        )
    return line_figure(
        [panels],
        f"The kidney on meshes of {', '.join(map(str, meshes.cells))} cells. The dotted line "
        "is the power law through the three; the bar at the finest is its grid convergence "
        "index.",
        shares_legend=True,
    )
