"""A file that is cut off at any byte, or states counts it does not have, is read or refused soon.

Each kind is tried in a process of its own with little memory: reading past an end can hang there.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from limits import run_limited

from palpate.meshes import files
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import FileFormatError
from palpate.meshes.files import (
    MESH_SUFFIXES,
    SURFACE_SUFFIXES,
    read_mesh,
    write_mesh,
    write_surface,
)
from palpate.meshes.tri_surface import TriSurface

# No copy takes longer than this [s]; reading a small file takes a few milliseconds.
LONGEST = 5
# The same where VTK tries what meshio refuses: a busy machine takes some seconds to start it, and
# 300 are given to it. So a .vtk is cut where a section begins and at every so many bytes.
LONGEST_OF_VTK, STEP_OF_VTK, STEP_AT_NIGHT = 60, 131, 3
READ = """
import re, signal
from pathlib import Path
from palpate.meshes.files import read_mesh, read_surface
file = Path(sys.argv[1])
whole, read = file.read_bytes(), {"mesh": read_mesh, "surface": read_surface}[sys.argv[2]]
path = file.with_name("copy" + file.suffix)
read(file)
COUNTS = b"-1", b"100000", b"30000000", b"100000000000", b"1" + 18 * b"0", 40 * b"9"
step, longest = int(sys.argv[3]), int(sys.argv[4])
starts = [found.end() for found in re.finditer(rb"\\n(?=[A-Z])", whole)]
def copies():
    for end in sorted({*range(0, len(whole), step), *starts} - {len(whole)}):
        yield end, whole[:end]
    for number, word in enumerate(re.finditer(rb"(?<![\\w.+-])\\d+(?![\\w.])", whole)):
        line = whole[:word.start()].rpartition(b"\\n")[2]
        if number % step and not line[:1].isalpha():
            continue
        for count in COUNTS:
            yield (word.start(), count), whole[:word.start()] + count + whole[word.end():]
def late(*_):
    raise BaseException("hangs")
signal.signal(signal.SIGALRM, late)
tried = 0
for about, data in copies():
    path.write_bytes(data)
    signal.alarm(longest)
    try:
        read(path)
    except InputError:
        tried += 1
    except BaseException as error:
        sys.exit(f"{about}: {type(error).__name__}: {error}")
    signal.alarm(0)
print(tried)
"""


def written(folder: Path, suffix: str, form: str, what: str) -> Path:
    """A small file of that kind as palpate writes it, or as text by meshio."""
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    path = folder / f"whole{suffix}"
    if form == "ours":
        if what == "mesh":
            write_mesh(path, mesh, point_data={"u": np.ones((mesh.num_points, 3))})
        else:
            write_surface(path, TriSurface(mesh.points, mesh.boundary_facets))
        return path
    cells = [("tetra", np.array(mesh.cells))]
    if what == "surface":
        cells = [("triangle", np.array(mesh.boundary_facets))]
    out = meshio.Mesh(np.array(mesh.points), cells, {"u": np.ones((mesh.num_points, 3))})
    if suffix == ".msh":
        meshio.gmsh.write(path, out, form, binary=False)
    elif suffix == ".vtk":
        meshio.vtk.write(path, out, form, binary=False)
    else:
        meshio.write(path, meshio.Mesh(out.points, cells), binary=False)
    return path


KINDS = [
    *[("surface", suffix, "ours") for suffix in SURFACE_SUFFIXES],
    *[("mesh", suffix, "ours") for suffix in MESH_SUFFIXES],
    *[("surface", suffix, "text") for suffix in (".ply", ".stl", ".vtu")],
    *[("mesh", ".msh", version) for version in ("2.2", "4.0", "4.1")],
    *[("mesh", ".vtk", version) for version in ("4.2", "5.1")],
]


AT_NIGHT = [
    pytest.param(*kind, STEP_AT_NIGHT, marks=pytest.mark.nightly)
    for kind in KINDS
    if ".vtk" in kind
]
BY_DAY = [(*kind, STEP_OF_VTK if ".vtk" in kind else 1) for kind in KINDS]


@pytest.mark.parametrize(("what", "suffix", "form", "step"), [*BY_DAY, *AT_NIGHT])
def test_no_wound_makes_a_reader_hang(
    tmp_path: Path, what: str, suffix: str, form: str, step: int
) -> None:
    path = written(tmp_path, suffix, form, what)
    longest, seconds = (LONGEST_OF_VTK, 2000) if suffix == ".vtk" else (LONGEST, 500)
    done = run_limited(READ, path, what, step, longest, seconds=seconds)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) > 10


def test_counts_that_a_file_has_no_room_for_are_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """VTK would read thirty million fields past the end of the file: five minutes."""
    monkeypatch.setattr(files, "made_by_vtk", lambda *_: pytest.fail("VTK is started"))
    path = written(tmp_path, ".vtk", "ours", "mesh")
    whole = path.read_bytes()
    assert whole.count(b"FIELD FieldData 1\n") == 1
    for count in ("30000000", 5000 * "9"):
        path.write_bytes(whole.replace(b"FieldData 1\n", f"FieldData {count}\n".encode()))
        with pytest.raises(FileFormatError, match=r"is damaged: 'FIELD FieldData [39]"):
            read_mesh(path)


def test_whole_numbers_of_a_field_are_no_counts(tmp_path: Path) -> None:
    """A row of four of them looks like the line that begins an array."""
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    path = tmp_path / "numbers.vtk"
    meshio.write(path, meshio.Mesh(np.array(mesh.points), [("tetra", np.array(mesh.cells))]))
    header, rows = "\nPOINT_DATA 8\nFIELD FieldData 1\nids 4 8 int\n", 8 * "5 20000000 30000000 3\n"
    meshio.write(path, meshio.read(path), "vtk42", binary=False)
    path.write_text(path.read_text("ascii") + header + rows, "ascii")
    assert read_mesh(path).num_points == mesh.num_points
