"""Text files read at once are read as word by word, and say their per cent."""

from __future__ import annotations

import itertools
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.meshes import percent, ply_files, surface_files, text_tables
from palpate.meshes.errors import FileFormatError
from palpate.meshes.files import read_surface, write_surface
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.text_tables import polygons_by_corners, table

OBJ = """# a wedge: two triangles, three quadrilaterals
o wedge
v 0 0 0
v 1e0 0 0 0.5 0.5 0.5
v 0 1 0 # a corner
v 0 0 0.1
v 1 0 0.1
v 0 1 0.1
vt 0 0
vn 0 0 1
f 1/1/1 3/1/1 2/1/1
f 4//1 5//1 6//1
f 1 2 5 4
f 2 3 6 5
f 3 1 4 6
"""
OFF = """OFF
# a wedge
6 5 0
0 0 0
1e0 0 0
0 1 0 1.0 0.5
0 0 0.1
1 0 0.1
0 1 0.1

3 0 2 1
3 3 4 5
4 0 1 4 3 255 0 0
4 1 2 5 4
4 2 0 3 5
"""
PLY = """ply
format ascii 1.0
element vertex 6
property double x
property double y
property double z
property uchar red
element face 5
property list uchar int vertex_indices
end_header
0 0 0 1
1e0 0 0 1
0 1 0 1
0 0 0.1 1
1 0 0.1 1
0 1 0.1 1
3 0 2 1
3 3 4 5
4 0 1 4 3
4 1 2 5 4
4 2 0 3 5
"""
TEXTS = {".obj": OBJ, ".off": OFF, ".ply": PLY}
PLAIN = [
    (surface_files, "_plain_obj"),
    (surface_files, "_plain_off"),
    (surface_files, "_plain_stl"),
]


def text_of(suffix: str, folder: Path) -> Path:
    path = folder / f"wedge{suffix}"
    if suffix == ".stl":
        ball = shape_sphere(1.0, edge_length=0.5)
        meshio.write(path, meshio.Mesh(ball.points, [("triangle", ball.facets)]), binary=False)
    else:
        path.write_text(TEXTS[suffix], encoding="ascii")
    return path


@pytest.mark.parametrize("suffix", [*TEXTS, ".stl"])
def test_at_once_and_word_by_word_are_the_same(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = text_of(suffix, tmp_path)
    taken: list[str] = []
    for module, name in PLAIN:
        whole = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda *words, whole=whole: taken.append(suffix) or whole(*words)
        )
    monkeypatch.setattr(surface_files, "_numbers", None)  # what reads word by word
    at_once = read_surface(path)
    assert bool(taken) == (suffix != ".ply")
    monkeypatch.undo()
    for module, name in PLAIN:
        monkeypatch.setattr(module, name, lambda *_: None)
    monkeypatch.setattr(ply_files, "table", lambda *_: None)
    monkeypatch.setattr(ply_files, "polygons_by_corners", lambda *_: None)
    by_words = read_surface(path)
    np.testing.assert_array_equal(at_once.points, by_words.points)
    np.testing.assert_array_equal(at_once.facets, by_words.facets)
    assert at_once.num_facets == (
        8 if suffix in TEXTS else shape_sphere(1.0, edge_length=0.5).num_facets
    )


@pytest.mark.parametrize("suffix", [".obj", ".off"])
def test_what_is_written_is_read_bit_for_bit(suffix: str, tmp_path: Path) -> None:
    ball = shape_sphere(1e-3 / 3.0, edge_length=2e-4)
    write_surface(tmp_path / f"ball{suffix}", ball)
    read = read_surface(tmp_path / f"ball{suffix}")
    np.testing.assert_array_equal(read.points, ball.points)
    np.testing.assert_array_equal(read.facets, ball.facets)


@pytest.mark.parametrize(
    ("suffix", "old", "new", "message"),
    [
        (".obj", "f 1 2 5 4", "f 1 2 5 x", "line 13: a facet needs three or more"),
        (".obj", "f 1 2 5 4", "f 1 2.5 5 4", "line 13: a facet needs three or more"),
        (".obj", "f 1 2 5 4", "f 1 0 5 4", "line 13: a facet needs three or more"),
        (".obj", "f 1 2 5 4", "f 1 2 99999999999999999999 4", "beyond 2\\^63"),
        (".obj", "v 1 0 0.1", "v 1 0", "point 4 .from 0. is '1 0', not three numbers"),
        (".obj", "vn 0 0 1", "curv 0 0 1", "line 10: 'curv' is no polygon"),
        (".off", "4 1 2 5 4", "5 1 2 5 4", "a facet of 5 corners in '5 1 2 5 4'"),
        (".off", "1 0 0.1", "1 0 a", "point 4 .from 0. is '1 0 a', not three numbers"),
        (".off", "6 5 0", "6 6 0", "11 lines of 6 points, 6 facets"),
        (".ply", "4 1 2 5 4", "5 1 2 5 4", "a face ends early"),
        (".ply", "1 0 0.1 1", "1 0 a 1", "could not convert"),
    ],
)
def test_damage_is_named_as_before(
    suffix: str, old: str, new: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / f"damaged{suffix}"
    assert old in TEXTS[suffix]
    path.write_text(TEXTS[suffix].replace(old, new), encoding="ascii")
    with pytest.raises(FileFormatError, match=message):
        read_surface(path)


def test_indices_below_zero_count_back(tmp_path: Path) -> None:
    path = tmp_path / "back.obj"
    path.write_text(OBJ.replace("f 4//1 5//1 6//1", "f -3//1 -2//1 -1//1"), encoding="ascii")
    np.testing.assert_array_equal(
        read_surface(path).facets, read_surface(text_of(".obj", tmp_path)).facets
    )


@pytest.mark.parametrize("lines", [[b"1 2 3", b"1 2"], [b"1 2 3", b""], [b"1 2 x"], []])
def test_a_table_that_is_none_is_refused(lines: list[bytes]) -> None:
    assert table(lines, range(3), np.float64) is None


def test_blocks_of_other_widths_are_no_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_tables, "_BLOCK", 2)
    lines = [b"1 2 3"] * 4
    found = table(lines, None, np.int64)
    assert found is not None
    assert found.shape == (4, 3)
    assert table([*lines, b"1 2"], None, np.int64) is None
    assert polygons_by_corners([b"3 0 1 2", b"03 0 1 2"]) is None


@pytest.mark.parametrize("suffix", [*TEXTS, ".stl"])
def test_a_long_read_says_its_per_cent(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = text_of(suffix, tmp_path)
    monkeypatch.setattr(text_tables, "_BLOCK", 1)
    seconds = itertools.count(step=1.0)
    monkeypatch.setattr(percent.time, "monotonic", lambda: next(seconds))
    lines: list[str] = []
    read_surface(path, progress=lines.append)
    assert lines
    shares = [int(line.removeprefix(f"reading {path.name}: ").removesuffix(" %")) for line in lines]
    assert shares == sorted(shares)
    assert shares[-1] > 30
