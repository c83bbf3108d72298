"""Files with something wrong in them end in a refusal or a verdict, never in an inner error.

Each is a whole, valid file in which bytes were turned, left out or doubled, or a word was put in
place of another; with a fixed seed, so that a failure comes back.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.files import read_mesh, read_surface, write_mesh, write_surface
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.case import load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.judging.run_comparison import compare_runs
from palpate.validation.states import CandidateFailedError

WORDS = (
    b"nan", b"-inf", b"1e308", b"-1e308", b"1e-320", b"0", b"-1", b"3", b"true", b"null", b'"x"',
    b"[]", b"{}", b"[[[[[[", b"1" + b"0" * 350, b"2147483648", b"1e400", b"\x00", b"\xff\xfe",
    b"\\u0000", b"=", b"2020-01-01", b'"\\ud800"', b"\n", b"..", b"/dev/zero",
)  # fmt: skip
_TOKEN = re.compile(rb"[\w.+-]+|[\[\]{}\"=,:<>/]")


def mutants(whole: bytes, count: int, seed: int) -> Iterator[bytes]:
    """So many damaged copies of a file, each with one to three wounds."""
    rng = np.random.default_rng(seed)
    tokens = [m.span() for m in _TOKEN.finditer(whole)]
    for _ in range(count):
        data = whole
        for _ in range(int(rng.integers(1, 4))):
            kind = rng.integers(5)
            start = int(rng.integers(max(len(data), 1)))
            stop = start + int(rng.integers(1, 40))
            if kind == 0:
                flipped = bytes(b ^ int(rng.integers(1, 256)) for b in data[start : start + 1])
                data = data[:start] + flipped + data[start + 1 :]
            elif kind == 1:
                data = data[:start] + data[stop:]
            elif kind == 2:
                data = data[:stop] + data[start:]
            else:
                first, last = tokens[int(rng.integers(len(tokens)))]
                data = data[:first] + WORDS[int(rng.integers(len(WORDS)))] + data[last:]
        yield data


@contextmanager
def only_refusals(data: bytes) -> Iterator[None]:
    """Numbers may overflow here; what comes of it may only be a refusal or a failed candidate."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (InputError, CandidateFailedError):
        return
    except Exception as error:
        raise AssertionError(f"{type(error).__name__}: {error}; input {data!r}"[:6000]) from error


# A case with most tables in it, whose mesh is a file of a few cells.
CASE = b"""
schema = 1
title = "A block"
strain = "green"

[units]
length = "mm"
stress = "kPa"

[geometry]
mesh = "block.vtu"

[material]
youngs_modulus = 10.0
poissons_ratio = 0.3
density = 900.0

[[inclusion]]
region = { ball = { center = [0.0, 0.0, 0.0], radius = 900.0 } }
material = { youngs_modulus = 20.0, poissons_ratio = 0.4 }

[[support]]
region = { half_space = { point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }
components = ["x", "y", "z"]
displacement = [0.0, 0.0, 0.0]
amplitude = { times = [0.0, 0.1], factors = [0.0, 1.0], smooth = true }

[[load]]
kind = "force"
force = [0.6, 0.2, -0.1]
region = { box = { min = [1999.0, -1.0, -1.0], max = [2001.0, 2000.0, 2000.0] } }

[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]

[tool]
shape = "capsule"
radius = 5.0
half_length = 20.0
pose = [
  { time = 0.0, position = [60.0, 0.0, 0.0], rotation = { axis = [1, 0, 0], angle_deg = 90.0 } },
  { time = 0.5, position = [52.0, 0.0, 0.0] },
]

[time]
end_time = 0.5
time_step = 1e-4
mass_damping = 4.0
num_outputs = 50

[[check]]
metric = "trajectory_l2"
against = "same_mesh"
limit = 1e-8
reason = "same equations"

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


def test_the_case_that_is_damaged_is_whole_itself(tmp_path: Path, problem: Problem) -> None:
    write_mesh(tmp_path / "block.vtu", scaled(problem))
    (tmp_path / "case.toml").write_bytes(CASE)
    assert load_case(tmp_path / "case.toml").problem.tools


def scaled(problem: Problem) -> TetMesh:
    """In millimetres, as the case is."""
    return TetMesh(1e3 * problem.mesh.points, problem.mesh.cells)


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_case_is_refused_or_makes_a_problem(
    tmp_path: Path, problem: Problem, seed: int
) -> None:
    write_mesh(tmp_path / "block.vtu", scaled(problem))
    path = tmp_path / "case.toml"
    for data in mutants(CASE, 250, seed):
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


def test_a_case_with_extreme_numbers_is_refused_or_makes_a_problem(
    tmp_path: Path, problem: Problem
) -> None:
    write_mesh(tmp_path / "block.vtu", scaled(problem))
    path, rng = tmp_path / "case.toml", np.random.default_rng(8)
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
def judged() -> CaseResult:
    return judge_case(load_case("block"))


@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_accepted_result_is_refused_or_compared(
    tmp_path: Path, judged: CaseResult, seed: int
) -> None:
    whole, path = outputs.results_json([judged], "1").encode(), tmp_path / "accepted.json"
    for data in mutants(whole, 250, seed):
        path.write_bytes(data)
        with only_refusals(data):
            compare_runs(path, path)


def packed_npz(folder: Path, problem: Problem, answer: NDArray[np.float64]) -> bytes:
    np.savez_compressed(
        folder / "whole.npz", displacement=answer, points=problem.mesh.points,
        cells=problem.mesh.cells, about='{"tool": "x", "tool_forces": [[0.0, 1.0, 2.0]]}',
    )  # fmt: skip
    return (folder / "whole.npz").read_bytes()


def plain_npz(folder: Path, _problem: Problem, answer: NDArray[np.float64]) -> bytes:
    order = np.arange(len(answer))
    np.savez(
        folder / "whole.npz", displacement=np.stack([0 * answer, answer]), original_id=order,
        times=[0.0, 1.0], length_unit="m",
    )  # fmt: skip
    return (folder / "whole.npz").read_bytes()


def packed_vtu(folder: Path, problem: Problem, answer: NDArray[np.float64]) -> bytes:
    write_mesh(folder / "whole.vtu", problem.mesh, point_data={"displacement": answer})
    return (folder / "whole.vtu").read_bytes()


def text_vtu(folder: Path, problem: Problem, answer: NDArray[np.float64]) -> bytes:
    import meshio

    mesh = problem.mesh
    out = meshio.Mesh(
        np.array(mesh.points), [("tetra", np.array(mesh.cells))], {"displacement": answer}
    )
    meshio.write(folder / "whole.vtu", out, binary=False)
    return (folder / "whole.vtu").read_bytes()


def table_csv(_folder: Path, _problem: Problem, answer: NDArray[np.float64]) -> bytes:
    rows = [",".join(f"{x:.17g}" for x in row) for row in answer]
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
    tmp_path: Path,
    problem: Problem,
    answer: NDArray[np.float64],
    suffix: str,
    write: Callable[[Path, Problem, NDArray[np.float64]], bytes],
    seed: int,
) -> None:
    whole = write(tmp_path, problem, answer)
    path = tmp_path / f"r.{suffix}"
    for data in [whole, *mutants(whole, 120, seed)]:
        path.write_bytes(data)
        with only_refusals(data[:200]):
            result_candidate(path).solve(problem, Strain.GREEN, lambda _line: None)


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "msh", "stl", "ply", "off", "obj"])
def test_a_damaged_mesh_or_surface_is_refused_or_read(
    tmp_path: Path, problem: Problem, suffix: str
) -> None:
    is_mesh = suffix in ("vtu", "vtk", "msh")
    path = tmp_path / f"whole.{suffix}"
    if is_mesh:
        write_mesh(path, problem.mesh)
    else:
        write_surface(path, problem.mesh.surface())
    whole = path.read_bytes()
    path = tmp_path / f"x.{suffix}"
    for data in mutants(whole, 150, 7):
        path.write_bytes(data)
        with only_refusals(data[:200]):
            (read_mesh if is_mesh else read_surface)(path)
