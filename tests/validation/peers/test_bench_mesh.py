"""`palpate bench mesh`: what is measured of a mesh, and that a spoiled mesh is seen."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.peers import bench_mesh as bench
from palpate.validation.peers.bench import time_all
from palpate.validation.peers.bench_mesh import make_surface
from palpate.validation.peers.registry import Tool
from palpate.validation.peers.timing import ChildFailedError

BALL = shape_sphere(edge_length=0.4)


def test_a_boundary_is_kept_whatever_the_numbering() -> None:
    filled = mesh_surface(BALL)
    turn = np.random.default_rng(0).permutation(filled.num_points)
    points = np.empty_like(filled.points)
    points[turn] = filled.points
    other = TetMesh(points, turn[filled.cells].astype(np.int32))
    assert bench.is_boundary_kept(BALL, other)


def test_a_boundary_moved_by_one_rounding_is_not_kept() -> None:
    filled = mesh_surface(BALL)
    points = filled.points.copy()
    points[3] *= 1.0 + 2.0**-50
    assert not bench.is_boundary_kept(BALL, TetMesh(points, filled.cells))
    assert not bench.is_boundary_kept(shape_box((1.0, 1.0, 1.0), edge_length=0.5), filled)


def test_an_inverted_cell_is_counted_and_nothing_else_is_claimed() -> None:
    filled = mesh_surface(BALL)
    cells = filled.cells.copy()
    cells[5, [0, 1]] = cells[5, [1, 0]]
    measured = bench.measure(BALL, {"points": filled.points, "cells": cells})
    assert measured["inverted"] == 1
    assert measured["relative_volume_error"] > 1e-6
    assert "min_dihedral_deg" not in measured


def test_rows_of_palpate_have_every_column(monkeypatch: pytest.MonkeyPatch) -> None:
    def ball(kind: str, size: int) -> TriSurface:
        if kind == "decimated":
            raise ChildFailedError("no decimator")
        assert size == 10_000
        return BALL

    monkeypatch.setattr(bench, "make_surface", ball)
    tools = (bench.TOOLS[0], Tool("other", "numpy_dense"))
    benchmark = dataclasses.replace(bench.BENCHMARK, tools=tools)
    said: list[str] = []
    rows = time_all(benchmark, (10_000,), said.append)
    assert [row["surface"] for row in rows] == ["gmsh", "marching cubes"]
    row = rows[0]
    assert (row["tool"], row["size"], row["inverted"]) == ("palpate", BALL.num_facets, 0)
    assert row["boundary_kept"] is True
    # One rounding for each cell of a sum of like terms.
    assert row["relative_volume_error"] < row["cells"] * np.finfo(float).eps
    assert row["rate"] == row["cells"] / row["seconds"]
    assert 0.0 < row["min_dihedral_deg"] <= row["p1_dihedral_deg"] < 70.53
    assert row["critical_time_step_us"] > 0.0
    assert any("no decimator" in line for line in said)
    assert any(line.startswith("other: ") for line in said)


def test_surfaces_of_other_makers_are_closed() -> None:
    pytest.importorskip("pyvista")
    surface = make_surface("marching cubes", 1000)
    assert 800 < surface.num_facets < 1200
    # 332 889 mm3 as given; edges of h = 8 mm on a body of radius R = 30 mm cut off about
    # 3 h^2 / (8 R^2) = 3 % of it.
    assert surface.volume == pytest.approx(332889e-9, rel=0.03)
