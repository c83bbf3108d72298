"""Round trips through every format, and refusals of what the readers let through."""

from __future__ import annotations

import base64
import re
import zlib
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.meshes.errors import FileFormatError, InputError, InvertedCellError
from palpate.meshes.files import (
    MESH_SUFFIXES,
    SURFACE_SUFFIXES,
    read_mesh,
    read_result_arrays,
    read_surface,
    write_mesh,
    write_surface,
)
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

ONE_CELL = TetMesh(np.vstack([np.zeros(3), np.eye(3)]) / 3.0, [[0, 1, 2, 3]])
BANK = {"one cell": ONE_CELL, "eight cells": refine_uniformly(ONE_CELL)}


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
@pytest.mark.parametrize("name", BANK)
def test_meshes_come_back_exactly(tmp_path: Path, suffix: str, name: str) -> None:
    mesh = BANK[name]
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, mesh)
    back = read_mesh(path)
    assert np.array_equal(back.points, mesh.points)
    assert np.array_equal(back.cells, mesh.cells)


def test_a_vtu_file_is_compressed_at_zlibs_first_level_and_meshio_is_left_as_it_was(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mesh.vtu"
    write_mesh(path, ONE_CELL)
    text = re.search(rb"<DataArray[^>]*binary[^>]*>\s*([^<\s]+)", path.read_bytes())
    assert text is not None
    # One block: its header is 4 numbers of 4 bytes, in base64 by itself.
    block = base64.b64decode(text[1][24:])
    # RFC 1950: method 8, window 7, level 0 of 0 to 3.
    assert block[:2] == bytes([0x78, 0x01])
    assert zlib.decompress(block) == ONE_CELL.points.tobytes()
    assert meshio.vtu._vtu.zlib is zlib


@pytest.mark.parametrize("suffix", SURFACE_SUFFIXES)
def test_surfaces_come_back(tmp_path: Path, suffix: str) -> None:
    surface = shape_sphere(1.0, edge_length=0.5)
    path = tmp_path / f"surface{suffix}"
    write_surface(path, surface)
    back = read_surface(path)
    assert len(back.points) == len(surface.points)
    # STL keeps single precision: 24 bits.
    digits = 2.0**-23 if suffix == ".stl" else 0.0
    np.testing.assert_allclose(
        back.points[back.facets], surface.points[surface.facets], rtol=0, atol=digits
    )


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_groups_of_facets_come_back_with_their_names(tmp_path: Path, suffix: str) -> None:
    boundary = ONE_CELL.boundary_facets
    groups = {"cap 1": boundary[:2], "cap 2": boundary[1:3], "50 % of it": boundary[:2]}
    mesh = TetMesh(ONE_CELL.points, ONE_CELL.cells, groups)
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, mesh, groups=True)
    back = read_mesh(path)
    assert np.array_equal(back.cells, mesh.cells)
    assert set(back.facet_groups) == set(groups)
    for name, rows in groups.items():
        assert np.array_equal(back.facet_groups[name], rows)
    write_mesh(path, mesh)
    assert not read_mesh(path).facet_groups


def test_fields_come_back(tmp_path: Path) -> None:
    field = np.arange(12.0).reshape(4, 3)
    write_mesh(tmp_path / "m.vtu", ONE_CELL, point_data={"displacement": field})
    _, _, fields, _ = read_result_arrays(tmp_path / "m.vtu")
    assert np.array_equal(fields["displacement"], field)


@pytest.mark.parametrize("version", ["2.2", "4.0", "4.1"])
@pytest.mark.parametrize("spelled", ["{}", "np.float64({})", "np.float32({})"])
def test_fields_of_a_text_msh_are_read_as_any_meshio_spells_them(
    tmp_path: Path, version: str, spelled: str
) -> None:
    path = tmp_path / "mesh.msh"
    cells = [("tetra", np.array(ONE_CELL.cells))]
    meshio.gmsh.write(path, meshio.Mesh(np.array(ONE_CELL.points), cells), version, binary=False)
    rows = "".join(f"{k} {spelled.format(k / 8)}\n" for k in range(1, 5))
    field = f'$NodeData\n1\n"u"\n1\n0.0\n3\n0\n1\n4\n{rows}$EndNodeData\n'
    path.write_text(path.read_text() + field)
    _, _, fields, _ = read_result_arrays(path)
    assert fields["u"].tolist() == [1 / 8, 2 / 8, 3 / 8, 4 / 8]
    assert read_mesh(path).num_points == 4


def test_scale_turns_file_units_into_metres(tmp_path: Path) -> None:
    write_mesh(tmp_path / "m.vtu", ONE_CELL)
    assert read_mesh(tmp_path / "m.vtu", scale=1e-3).volume == pytest.approx(
        1e-9 * ONE_CELL.volume, rel=1e-14
    )


@pytest.mark.parametrize("suffix", SURFACE_SUFFIXES)
@pytest.mark.parametrize("keep", [0.0, 0.3, 0.8])
def test_a_cut_off_file_is_refused_or_read_whole(tmp_path: Path, suffix: str, keep: float) -> None:
    surface = shape_sphere(1.0, edge_length=0.5)
    path = tmp_path / f"cut{suffix}"
    write_surface(path, surface)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    with pytest.raises(InputError) as caught:
        read_surface(path)
    assert "cut" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("huge.msh", b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1000000000000\n1 0 0 0\n"),
        ("bomb.vtu", b"<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><VTKFile>&b;</VTKFile>"),
        ("text.stl", b"this is no surface"),
        ("far.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("nan.off", b"OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n"),
        ("crossed.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 2 4\n"),
        ("curved.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\ncstype bezier\n"),
        ("short.off", b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("many.off", b"OFF\n99999999999999 2 0\n0 0 0\n"),
        ("unknown.xyz", b"1 2 3"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_surface(path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_surface_given_as_a_mesh(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_mesh(tmp_path / "nothing.vtu")
    write_surface(tmp_path / "s.vtu", shape_sphere(1.0, edge_length=0.5))
    with pytest.raises(FileFormatError, match="mesh it first"):
        read_mesh(tmp_path / "s.vtu")


def test_an_inverted_cell_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.vtu"
    cells = BANK["eight cells"].cells.copy()
    cells[3] = cells[3][[1, 0, 2, 3]]
    meshio.write(path, meshio.Mesh(BANK["eight cells"].points, [("tetra", cells)]))
    with pytest.raises(InvertedCellError, match=r"bad\.vtu") as caught:
        read_mesh(path)
    assert caught.value.cells == [3]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "m.vtu"
    write_mesh(path, ONE_CELL)
    before = path.read_bytes()

    def full(*_args: object, **_kwargs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("meshio.write", full)
    with pytest.raises(OSError, match="No space"):
        write_mesh(path, BANK["eight cells"])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.vtu"]


def test_a_surface_object_needs_three_columns() -> None:
    with pytest.raises(InputError, match="shape"):
        TriSurface(np.zeros((3, 2)), np.array([[0, 1, 2]]))
