"""The study of meshing: inside or outside, what is measured, and verdicts both ways."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies import meshing, run_study

EPS = np.finfo(float).eps


def test_traditional_cells_of_a_convex_body_fill_it() -> None:
    ball = shape_sphere(edge_length=0.5)
    mesh = meshing.mesh_traditionally(ball)
    assert mesh.num_points == len(ball.points)
    measured = meshing.measure(ball, mesh)
    assert measured.facets_lost == 0
    assert measured.volume_error < mesh.num_cells * EPS


def test_lost_facets_and_slivers_are_counted() -> None:
    box = shape_box(edge_length=0.5)
    mesh = mesh_surface(box)
    whole = meshing.measure(box, mesh)
    assert (whole.facets_lost, whole.part_below_10_deg) == (0, 0.0)
    # Without a cell at the boundary its facets are missing, and its volume.
    boundary = {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()}
    outer = next(
        c
        for c, cell in enumerate(mesh.cells)
        if any(tuple(sorted(set(cell.tolist()) - {v})) in boundary for v in cell.tolist())
    )
    broken = TetMesh(mesh.points, np.delete(mesh.cells, outer, axis=0))
    measured = meshing.measure(box, broken)
    assert measured.facets_lost >= 1
    assert measured.volume_error > 1e-4
    # The whole mesh flattened to a hundredth: every cell is thin.
    flat = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
    thin = TetMesh(mesh.points * [1.0, 1.0, 0.01], mesh.cells)
    assert meshing.measure(flat, thin).part_below_10_deg == 1.0


def _made(**changed: dict[str, float]) -> meshing.Made:
    good = meshing.Measured(10, 20, 0, 1e-16, 29.0, 31.0, 0.0, 0.3, 3e-4)
    measured = {
        meshing.TRADITIONAL: good._replace(smallest_dihedral_deg=0.1, critical_time_step=1e-6),
        meshing.UNCLEANED: good._replace(smallest_dihedral_deg=1.0, critical_time_step=1e-5),
        meshing.PAPER: good._replace(smallest_dihedral_deg=25.0),
        meshing.OURS: good,
    }
    for name, values in changed.items():
        measured[name] = measured[name]._replace(**values)  # type: ignore[arg-type]
    return meshing.Made({}, measured)


def test_good_rows_pass() -> None:
    assert {f.verdict for f in meshing.judge(_made())} == {Verdict.PASSED}


@pytest.mark.parametrize(
    ("name", "changes", "failed"),
    [
        (meshing.OURS, {"facets_lost": 1}, 0),
        (meshing.PAPER, {"facets_lost": 2}, 0),
        (meshing.PAPER, {"smallest_dihedral_deg": 0.9}, 1),
        (meshing.OURS, {"smallest_dihedral_deg": 14.9}, 2),
        (meshing.OURS, {"first_percentile_dihedral_deg": 27.9}, 2),
        (meshing.OURS, {"critical_time_step": 2.9e-4}, 3),
        (meshing.UNCLEANED, {"critical_time_step": 4e-4}, 3),
    ],
)
def test_a_perturbed_row_fails_its_own_claim(
    name: str, changes: dict[str, float], failed: int
) -> None:
    verdicts = [f.verdict for f in meshing.judge(_made(**{name: changes}))]
    assert verdicts == [
        Verdict.FAILED if k == failed else Verdict.PASSED for k in range(len(verdicts))
    ]


def test_the_study_leaves_its_page_and_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(meshing, "EDGE_LENGTH", 14e-3)  # coarse: a fast run
    code = run_study("meshing", tmp_path, in_silence, Console(quiet=True))
    assert code in (0, 1)
    rows = json.loads((tmp_path / "results.json").read_text("utf-8"))["tables"]["quality"]
    assert [row["mesh"] for row in rows] == [
        meshing.TRADITIONAL, meshing.UNCLEANED, meshing.PAPER, meshing.OURS
    ]  # fmt: skip
    # The surface's volume, kept by all three that keep its facets.
    assert all(row["volume error"] < 1e-12 for row in rows[1:])
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("<svg") == 1
    assert "Fig. 1" in page
