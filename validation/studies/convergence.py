"""Do the answers converge, and as fast as theory says?

In the cell size h (fastsim's linear tetrahedra), in the degree p (the reference), in the time step
dt (fastsim's explicit steps), each on a smooth problem whose answer is known, where theory gives
the order: p + 1 in the L2 norm, p in the energy norm, 2 in time. A code that solves other equations
than it says converges too, to something else: only the closed forms and the manufactured solution
see that.

Then on the kidney, where nothing is known beforehand: three meshes give the observed order,
Richardson's value and the grid convergence index (Roache 1994; Celik et al. 2008), held against the
stored reference, quadratic tetrahedra on the mesh cut in eight. The edge of the held surface is
singular, displacement there goes like the square root of the distance, so the order falls from 2
to about 1 on uniform meshes: an error falls by half, not by four, with each cut in eight. On meshes
of this size it is still a little below 1, and so Richardson's value may lie beyond the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.metrics.grid_convergence import GridConvergence
from palpate.validation.report.study_page import Finding, StudyTable
from palpate.validation.studies.convergence_figures import draw_families, draw_kidney
from palpate.validation.studies.convergence_space import (
    ColumnGrids,
    follow_column,
    follow_degrees,
    follow_manufactured,
)
from palpate.validation.studies.convergence_time import follow_block, follow_wave
from palpate.validation.studies.error_family import ErrorFamily
from palpate.validation.studies.kidney_convergence import (
    QUANTITIES,
    MeshFamily,
    StoredTruth,
    follow_meshes,
    stored_truth,
)
from palpate.validation.studies.study_folder import judged, leave_study

# Between the limit, 1, and the order of a smooth problem, 2: nearer the first.
LARGEST_SINGULAR_ORDER = 1.5


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Follow every family; leave report.html, two figures, three tables and results.json."""
    progress("manufactured solution, linear tetrahedra")
    families = follow_manufactured()
    grids = follow_column()
    about = (__doc__ or "").split("\n\n")[1:]
    if is_available():
        families += follow_degrees(progress)
    else:
        about.append("Degrees 1 to 3 of the reference are left out: FEniCSx is not here.")
    progress("explicit steps")
    families += [follow_wave(), follow_block()]
    case = load_case("kidney")
    meshes = follow_meshes(case.problem, progress)
    truth = stored_truth(case)
    findings = [*judge_families(families), *judge_column(grids), *judge_kidney(meshes, truth)]
    return leave_study(
        folder,
        console,
        name="convergence",
        title="Convergence in h, p and dt",
        about=about,
        findings=findings,
        figures={"orders": draw_families(families), "kidney": draw_kidney(meshes, truth)},
        tables={
            "families": family_table(families),
            "column": column_table(grids),
            "kidney_grids": kidney_table(meshes, truth),
        },
        numbers={
            "families": [{**asdict(f), "orders": f.orders} for f in families],
            "column": [asdict(g) for g in grids],
            "kidney": {
                **asdict(meshes),
                "assessed": {q: asdict(meshes.assess(q)) for q in QUANTITIES},
            },
            "kidney_truth": {q: asdict(t) for q, t in truth.items()},
        },
    )


def judge_families(families: Sequence[ErrorFamily]) -> list[Finding]:
    """Observed orders between the two finest runs against theory."""
    return [
        judged(
            f"{f.name}: order {f.expected_order:g} in {'dt' if f.what == 'dt' else 'h'}, "
            f"within {f.tolerance:g}",
            f"order {', '.join(f'{order:.3f}' for order in f.orders)}; error "
            f"{f.errors[0]:.2e} down to {f.errors[-1]:.2e}",
            f.is_as_expected,
        )
        for f in families
    ]


def judge_column(grids: Sequence[ColumnGrids]) -> list[Finding]:
    """Does the grid convergence index hold what it promises where the answer is known?"""
    return [
        judged(
            f"column, {g.quantity}, P1 (fastsim): order {g.expected_order:g} within 0.2, and the "
            "error bar of the grid convergence index holds the exact value",
            f"order {_order(g.assessed)}, {g.assessed.value:.6g} +- {_bar(g.assessed)}, "
            f"extrapolated {_extrapolated(g.assessed)}, exact {g.exact:.6g}",
            g.is_contained
            and g.assessed.order is not None
            and abs(g.assessed.order - g.expected_order) <= 0.2,
        )
        for g in grids
    ]


def judge_kidney(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> list[Finding]:
    """The kidney's orders and bars, and whether they agree with the stored reference."""
    findings = []
    for quantity, (_, unit, _) in QUANTITIES.items():
        found, known = meshes.assess(quantity), truth[quantity]
        bar = found.error_bar
        is_singular = found.order is not None and found.order <= LARGEST_SINGULAR_ORDER
        agrees = bar is not None and abs(found.value - known.value) <= bar + known.bar
        findings.append(
            judged(
                f"kidney, {quantity}: the clamp holds the order below {LARGEST_SINGULAR_ORDER:g}, "
                "and the finest value agrees with the stored P2 within both error bars",
                f"order {_order(found)}, {found.value:.5g} +- {_bar(found)} {unit} (GCI "
                f"{_percent(found.index_fine)}), extrapolated {_extrapolated(found)}; "
                f"stored {known.value:.5g} +- {known.bar:.3g}",
                is_singular and agrees,
            )
        )
    return findings


def family_table(families: Sequence[ErrorFamily]) -> StudyTable:
    """Every run with its error and order."""
    rows = []
    for f in families:
        for k, (note, error) in enumerate(zip(f.notes, f.errors, strict=True)):
            order = f"{f.orders[k - 1]:.3f}" if k else "-"
            rows.append([f.name, f.what, note, f"{error:.4e}", order, f"{f.expected_order:g}"])
    return StudyTable(
        "Errors and observed orders",
        ["family", "varied", "run", "relative error", "order", "theory"],
        rows,
    )


def column_table(grids: Sequence[ColumnGrids]) -> StudyTable:
    """GCI where the answer is known."""
    rows = [
        [g.quantity, f"{g.assessed.value:.8g}", _order(g.assessed), _extrapolated(g.assessed),
         _bar(g.assessed), _percent(g.assessed.index_fine), f"{g.exact:.8g}"]
        for g in grids
    ]  # fmt: skip
    return StudyTable(
        "Confined column, linear tetrahedra on three meshes (fastsim)",
        ["quantity", "finest", "order", "extrapolated", "error bar", "GCI", "exact"],
        rows,
    )


def kidney_table(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> StudyTable:
    """The kidney's numbers on three meshes, with order, Richardson's value and GCI."""
    rows = []
    for quantity, (name, unit, factor) in QUANTITIES.items():
        found = meshes.assess(quantity)
        values = [f"{factor * getattr(r, name):.6g}" for r in meshes.responses]
        known = truth[quantity]
        rows.append(
            [f"{quantity} [{unit}]", *values, _order(found), _extrapolated(found), _bar(found),
             _percent(found.index_fine), _percent(found.index_coarse), f"{known.value:.6g}",
             f"{known.bar:.3g}"]
        )  # fmt: skip
    return StudyTable(
        "Kidney, linear tetrahedra on its mesh and on that mesh cut in eight, twice (fastsim)",
        ["quantity", *(f"{n} cells" for n in meshes.cells), "order", "extrapolated", "error bar",
         "GCI fine", "GCI coarse", "stored P2", "its bar"],
        rows,
    )  # fmt: skip


def _order(found: GridConvergence) -> str:
    return str(found.behaviour) if found.order is None else f"{found.order:.2f}"


def _bar(found: GridConvergence) -> str:
    return "no bar" if found.error_bar is None else f"{found.error_bar:.3g}"


def _extrapolated(found: GridConvergence) -> str:
    return "-" if found.extrapolated is None else f"{found.extrapolated:.6g}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f} %"
