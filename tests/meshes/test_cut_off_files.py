"""A file that is cut off at any byte, or states counts it does not have, is read or refused soon.

Each kind is tried in a process of its own with little memory: reading past an end can hang there.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from limits import run_limited

from palpate.meshes.bricks import brick_box
from palpate.meshes.files import MESH_SUFFIXES, SURFACE_SUFFIXES, write_mesh, write_surface
from palpate.meshes.tri_surface import TriSurface

# No copy takes longer than this [s]; reading a small file takes a few milliseconds.
LONGEST = 5
READ = f"""
import re, signal
from pathlib import Path
from palpate.meshes.files import read_mesh, read_surface
file = Path(sys.argv[1])
whole, read = file.read_bytes(), {{"mesh": read_mesh, "surface": read_surface}}[sys.argv[2]]
path = file.with_name("copy" + file.suffix)
read(file)
COUNTS = b"-1", b"100000", b"30000000", b"100000000000", b"1" + 18 * b"0", 40 * b"9"
def copies():
    for end in range(len(whole)):
        yield end, whole[:end]
    for word in re.finditer(rb"(?<![\\w.+-])\\d+(?![\\w.])", whole):
        for count in COUNTS:
            yield (word.start(), count), whole[:word.start()] + count + whole[word.end():]
def late(*_):
    raise BaseException("hangs")
signal.signal(signal.SIGALRM, late)
tried = 0
for about, data in copies():
    path.write_bytes(data)
    signal.alarm({LONGEST})
    try:
        read(path)
    except InputError:
        tried += 1
    except BaseException as error:
        sys.exit(f"{{about}}: {{type(error).__name__}}: {{error}}")
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
        meshio.write(path, out, form, binary=False)
    else:
        meshio.write(path, meshio.Mesh(out.points, cells), binary=False)
    return path


KINDS = [
    *[("surface", suffix, "ours") for suffix in SURFACE_SUFFIXES],
    *[("mesh", suffix, "ours") for suffix in MESH_SUFFIXES],
    *[("surface", suffix, "text") for suffix in (".ply", ".stl", ".vtu")],
    *[("mesh", ".msh", version) for version in ("2.2", "4.0", "4.1")],
    *[("mesh", ".vtk", version) for version in ("vtk42", "vtk51")],
]


@pytest.mark.parametrize(("what", "suffix", "form"), KINDS)
def test_no_wound_makes_a_reader_hang(tmp_path: Path, what: str, suffix: str, form: str) -> None:
    path = written(tmp_path, suffix, form, what)
    done = run_limited(READ, path, what, seconds=500)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) > 10
