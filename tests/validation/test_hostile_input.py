"""Files with something wrong in them end in a refusal or a verdict, never in an inner error.

Each is a whole, valid file that was damaged.
"""

import re

import numpy as np
import pytest
from case_texts import BLOCK, BOX, changed, moving
from damage import damaged_copies, only_refusals

from palpate.meshes.files import read_mesh, read_surface, write_mesh, write_surface
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.case import load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.run_comparison import compare_runs
from palpate.validation.states import in_silence

MESH = 'mesh = "block.vtu"'
MORE = """
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]

[[check]]
metric = "published_displacement"
against = "candidate"
at = [2000.0, 0.0, 0.0]
component = "x"
expected = 1.5
limit = 0.1
reason = "a book"

[published]
volume = 1.5
source = { who = "me", rows = [1, 2.5] }

[evidence]
question = "why"
"""
# A case with most tables in it, whose mesh is a file of a few cells.
CASE = changed(
    BLOCK,
    *moving(),
    (BOX.replace("2.0, 1.0, 1.0", "2000.0, 1000.0, 1000.0").replace("0.5", "500.0"), MESH),
    ('"displacement_l2"', '"trajectory_l2"'),
    ("[[support]]", "[[support]]\ndisplacement = [0.0, 0.0, 0.0]"),
    ("[[load]]", MORE + "\n[[load]]"),
).encode()


@pytest.fixture
def path(tmp_path, problem):
    """The whole case, with its mesh in millimetres beside it."""
    mesh = TetMesh(1e3 * problem.mesh.points, problem.mesh.cells)
    write_mesh(tmp_path / "block.vtu", mesh)
    (tmp_path / "case.toml").write_bytes(CASE)
    assert load_case(tmp_path / "case.toml").problem.tools
    return tmp_path / "case.toml"


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_case_is_refused_or_makes_a_problem(path, seed):
    for data in damaged_copies(CASE, 250, seed):
        path.write_bytes(data)
        with only_refusals(data):
            case = load_case(path)
            # Meshing is another matter: a size of 1e-300 asks for cells without end.
            if case.spec.geometry.shape is None:
                _ = case.problem


NUMBER = re.compile(rb"-?\d[\d.e-]*")
EXTREMES = (
    b"1e308", b"-1e308", b"1.7e308", b"1e160", b"1e20", b"0", b"-1", b"1e-30", b"1e-160", b"1e-320",
    b"5e-324", b"0.49999999999999999",
)  # fmt: skip


@pytest.mark.long
def test_a_case_with_extreme_numbers_is_refused_or_makes_a_problem(path):
    rng = np.random.default_rng(8)
    spans = [m.span() for m in NUMBER.finditer(CASE)]
    for first, last in spans:
        for word in EXTREMES:
            # Another number too: two that are each possible may not be together.
            other = int(rng.integers(len(spans)))
            data = CASE[:first] + word + CASE[last:]
            if spans[other][1] < first:
                start, stop = spans[other]
                data = data[:start] + EXTREMES[int(rng.integers(len(EXTREMES)))] + data[stop:]
            path.write_bytes(data)
            with only_refusals(data):
                _ = load_case(path).problem


@pytest.fixture(scope="module")
def judged():
    return judge_case(load_case("block"))


@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_accepted_result_is_refused_or_compared(tmp_path, judged, seed):
    whole, path = outputs.results_json([judged], "1").encode(), tmp_path / "accepted.json"
    for data in damaged_copies(whole, 250, seed):
        path.write_bytes(data)
        with only_refusals(data):
            compare_runs(path, path)


def packed_npz(folder, problem, solution):
    np.savez_compressed(
        folder / "whole.npz", displacement=solution, points=problem.mesh.points,
        cells=problem.mesh.cells, about='{"tool": "x", "tool_forces": [[0.0, 1.0, 2.0]]}',
    )  # fmt: skip
    return (folder / "whole.npz").read_bytes()


def plain_npz(folder, _problem, solution):
    order = np.arange(len(solution))
    np.savez(
        folder / "whole.npz", displacement=np.stack([0 * solution, solution]), original_id=order,
        times=[0.0, 1.0], length_unit="m",
    )  # fmt: skip
    return (folder / "whole.npz").read_bytes()


def packed_vtu(folder, problem, solution):
    write_mesh(folder / "whole.vtu", problem.mesh, point_data={"displacement": solution})
    return (folder / "whole.vtu").read_bytes()


def text_vtu(folder, problem, solution):
    import meshio

    mesh = problem.mesh
    out = meshio.Mesh(
        np.array(mesh.points), [("tetra", np.array(mesh.cells))], {"displacement": solution}
    )
    meshio.write(folder / "whole.vtu", out, binary=False)
    return (folder / "whole.vtu").read_bytes()


def table_csv(_folder, _problem, solution):
    rows = [",".join(f"{x:.17g}" for x in row) for row in solution]
    return "\n".join(["ux,uy,uz", *rows]).encode()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        ("npz", packed_npz), ("npz", plain_npz), ("vtu", packed_vtu), ("vtu", text_vtu),
        ("csv", table_csv),
    ],
)  # fmt: skip
def test_a_damaged_result_is_refused_failed_or_a_state(
    tmp_path, problem, solution, suffix, write, seed
):
    whole = write(tmp_path, problem, solution)
    path = tmp_path / f"r.{suffix}"
    for data in [whole, *damaged_copies(whole, 120, seed)]:
        path.write_bytes(data)
        with only_refusals(data[:200]):
            result_candidate(path).solve(problem, Strain.GREEN, in_silence)


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "msh", "stl", "ply", "off", "obj"])
def test_a_damaged_mesh_or_surface_is_refused_or_read(tmp_path, problem, suffix):
    is_mesh = suffix in ("vtu", "vtk", "msh")
    path = tmp_path / f"whole.{suffix}"
    if is_mesh:
        write_mesh(path, problem.mesh)
    else:
        write_surface(path, problem.mesh.surface())
    whole = path.read_bytes()
    path = tmp_path / f"x.{suffix}"
    # VTK starts anew for each copy that meshio refuses.
    for data in damaged_copies(whole, 8 if suffix == "vtk" else 150, 7):
        path.write_bytes(data)
        with only_refusals(data[:200]):
            (read_mesh if is_mesh else read_surface)(path)
