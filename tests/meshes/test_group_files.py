"""Groups of facets, points and cells go into mesh files and come back."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import IndexRangeError, InputError
from palpate.meshes.files import read_mesh, write_mesh
from palpate.meshes.tet_mesh import TetMesh


def grouped() -> TetMesh:
    """Two sides, one of them in two groups, points, and parts."""
    mesh = brick_box((3, 2, 2), (3.0, 1.0, 1.0 / 3.0), ragged=0.2)
    fixed = side(mesh, 0, 0.0)
    return TetMesh(
        mesh.points,
        mesh.cells,
        {"held": fixed, "half": fixed[::2], "end": side(mesh, 0, 3.0)},
        {"corner": [0], "some points": [3, 7, 5]},
        {"first": [0, 1, 2, 5], "second": [9]},
    )


@pytest.mark.parametrize("suffix", ["msh", "vtu", "vtk"])
def test_groups_come_back(tmp_path: Path, suffix: str) -> None:
    mesh, path = grouped(), tmp_path / f"body.{suffix}"
    write_mesh(path, mesh, groups=True)
    found = read_mesh(path)
    assert np.array_equal(found.points, mesh.points)
    assert np.array_equal(found.cells, mesh.cells)
    for kind in ("facet_groups", "point_groups", "cell_groups"):
        ours, theirs = getattr(mesh, kind), getattr(found, kind)
        assert set(ours) == set(theirs)
        for name, rows in ours.items():
            assert np.array_equal(np.asarray(rows), theirs[name])


def test_only_points_or_only_cells(tmp_path: Path) -> None:
    mesh = grouped()
    for groups in (({}, {"corner": [0]}, {}), ({}, {}, {"first": [3]})):
        write_mesh(tmp_path / "x.msh", TetMesh(mesh.points, mesh.cells, *groups), groups=True)
        found = read_mesh(tmp_path / "x.msh")
        assert [found.facet_groups, *found.point_groups, *found.cell_groups] == [
            {}, *groups[1], *groups[2]
        ]  # fmt: skip


def test_gmsh_reads_what_was_written(tmp_path: Path) -> None:
    gmsh = pytest.importorskip("gmsh")
    mesh = grouped()
    write_mesh(tmp_path / "body.msh", mesh, groups=True)
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "body.msh"))
        found = {
            gmsh.model.getPhysicalName(dim, tag): dim for dim, tag in gmsh.model.getPhysicalGroups()
        }
    finally:
        gmsh.finalize()
    assert found == {
        "corner": 0, "some points": 0, "held": 2, "half": 2, "end": 2, "first": 3, "second": 3
    }  # fmt: skip


def test_groups_travel_to_other_processes() -> None:
    there = pickle.loads(pickle.dumps(grouped()))
    assert there.cell_groups["first"].tolist() == [0, 1, 2, 5]


def test_what_readers_would_not_tell_apart_is_refused(tmp_path: Path) -> None:
    mesh = grouped()
    twice = TetMesh(mesh.points, mesh.cells, {"one": side(mesh, 0, 0.0)}, {"one": [0]})
    both = TetMesh(mesh.points, mesh.cells, cell_groups={"one": [0, 1], "two": [1]})
    with pytest.raises(InputError, match="'one' is there twice"):
        write_mesh(tmp_path / "x.vtu", twice, groups=True)
    with pytest.raises(InputError, match="'two' has cells of another group"):
        write_mesh(tmp_path / "x.msh", both, groups=True)
    assert not list(tmp_path.iterdir())
    write_mesh(tmp_path / "x.vtu", both, groups=True)
    assert read_mesh(tmp_path / "x.vtu").cell_groups["two"].tolist() == [1]
    with pytest.raises(IndexRangeError, match="cells of 'far'"):
        TetMesh(mesh.points, mesh.cells, cell_groups={"far": [mesh.num_cells]})
