"""Problems travel between processes unchanged; floating bodies are recognised."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.problem_files import load_problem, problem_arrays, save_problem
from palpate.meshes.rigid_modes import (
    UnsupportedBodyError,
    free_rigid_modes,
    parts_of_mesh,
    require_supported,
)
from palpate.meshes.rigid_tool import (
    CapsuleShape,
    ForceDrive,
    RigidTool,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.temporaries import atomic_path, write_text_atomically
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

POINTS = np.vstack([np.zeros(3), np.eye(3)])
MESH = TetMesh(POINTS, [[0, 1, 2, 3]], {"base": [[0, 2, 1]]}, {"tip": [3]})
BASE = np.array([[0, 2, 1]], dtype=np.int32)
PROBLEM = Problem(
    MESH,
    Material(1e4, 0.3, 1050.0),
    (Support(np.array([0, 1, 2], dtype=np.int32), BASE, (True, False, True), (0.0, 0.0, 1e-3)),),
    (
        Traction(BASE, (1.0, 2.0, 1.0 / 3.0)),
        Pressure(BASE, 4.0),
        PointForce(np.array([3], dtype=np.int32), np.array([[0.1, 0.2, 0.3]])),
        BodyForce((0.0, 0.0, -9810.0), TabularAmplitude((0.0, 0.5), (0.0, 1.0), is_smooth=True)),
    ),
    TimeSpan(1.0, None, 2.0, 7),
    (
        RigidTool(
            SurfaceShape(TriSurface(POINTS, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])),
            ToolPath([0.0, 1.0], [[0.0, 0.0, 2.0], [0.0, 0.0, 1.5]]),
            friction_coefficient=0.2,
            contact_facets=BASE,
        ),
        RigidTool(
            CapsuleShape(0.1, 0.3),
            ToolPath([0.0], [[0.0, 0.0, 2.0]], [[0.0, 1.0, 0.0, 0.0]]),
            drive=ForceDrive((0.0, 0.0, -1.0), 3.0, TabularAmplitude((0.0,), (1.0,)), 0.01),
        ),
    ),
    (Inclusion(np.array([0], dtype=np.int32), Material(2e4, 0.2)),),
)


def test_a_problem_comes_back_bit_for_bit(tmp_path: Path) -> None:
    save_problem(tmp_path / "p.npz", PROBLEM)
    back = load_problem(tmp_path / "p.npz")
    ours, theirs = problem_arrays(PROBLEM), problem_arrays(back)
    assert ours.keys() == theirs.keys()
    for name, array in ours.items():
        assert array.dtype == theirs[name].dtype
        assert array.tobytes() == theirs[name].tobytes()
    assert back.material == PROBLEM.material
    assert back.time == PROBLEM.time
    assert back.loads[-1] == PROBLEM.loads[-1]
    assert back.tools[1].shape == PROBLEM.tools[1].shape
    assert back.tools[1].drive == PROBLEM.tools[1].drive
    assert back.inclusions[0].material == PROBLEM.inclusions[0].material


# Of version 0.1.
IDENTITY_OF_0_1 = "884539c97c17ffb1e26ea131c5626a757a28e53fdcd9900741d105eff697ed8a"


def identity(problem: Problem) -> str:
    digest = hashlib.sha256()
    for name, array in sorted(problem_arrays(problem).items()):
        digest.update(f"|{name}|{array.dtype.str}|{array.shape}|".encode() + array.tobytes())
    return digest.hexdigest()


def with_later_fields(item: Any, **later: Any) -> Any:
    """The item as a class of the same name in a later version, which has more optional fields."""
    fields = [
        (name, type(default), dataclasses.field(default_factory=lambda d=default: d))
        for name, (default, _) in later.items()
    ]
    kind = dataclasses.make_dataclass(
        type(item).__name__, fields, bases=(type(item),), frozen=True, eq=False
    )
    values = {f.name: getattr(item, f.name) for f in dataclasses.fields(item)}
    return kind(**values, **{name: value for name, (_, value) in later.items()})


def test_every_kind_of_thing_has_the_arrays_that_version_0_1_gave_it() -> None:
    """A literal of 0.1: supports, all loads, amplitudes, tools, inclusions, time, groups."""
    assert identity(PROBLEM) == IDENTITY_OF_0_1


@pytest.mark.parametrize(
    ("default", "other"),
    [
        (0.0, 0.1),
        (None, 3.0),
        ("svk", "neo-hookean"),
        (np.zeros((0, 3)), np.ones((1, 3))),
        ((), (1,)),
    ],
)
def test_an_optional_field_of_a_later_version_counts_only_where_it_is_used(
    default: Any, other: Any
) -> None:
    parts = ("material", "time", "supports", "loads", "tools", "inclusions")

    def later(part: str, value: Any) -> Problem:
        item = getattr(PROBLEM, part)
        if isinstance(item, tuple):
            changed: Any = (with_later_fields(item[0], extra=(default, value)), *item[1:])
        else:
            changed = with_later_fields(item, extra=(default, value))
        return dataclasses.replace(PROBLEM, **{part: changed})

    for part in parts:
        assert identity(later(part, default)) == identity(PROBLEM), part
        if not (isinstance(other, np.ndarray) and part in ("material", "time")):
            assert identity(later(part, other)) != identity(PROBLEM), part
    # The problem itself, too.
    if not isinstance(other, np.ndarray | tuple):
        assert identity(with_later_fields(PROBLEM, extra=(default, default))) == identity(PROBLEM)
        assert identity(with_later_fields(PROBLEM, extra=(default, other))) != identity(PROBLEM)


def test_a_cell_has_one_material() -> None:
    twice = Inclusion(np.array([0], dtype=np.int32), Material(2e4, 0.2))
    with pytest.raises(InputError, match="named twice"):
        Problem(MESH, PROBLEM.material, (), (), inclusions=(twice, twice))
    outside = Inclusion(np.array([1], dtype=np.int32), Material(2e4, 0.2))
    with pytest.raises(InputError, match="inclusion 1"):
        Problem(MESH, PROBLEM.material, (), (), inclusions=(outside,))


def test_a_tool_beside_a_support_along_a_slanted_normal_is_refused() -> None:
    slanted = Support(np.array([0, 1, 2], dtype=np.int32), BASE, normal=(0.0, 0.6, 0.8))
    with pytest.raises(InputError, match=r"slanted normal do not go together; turn the body"):
        dataclasses.replace(PROBLEM, supports=(*PROBLEM.supports, slanted))
    # Each alone is fine.
    dataclasses.replace(PROBLEM, supports=(slanted,), tools=())


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"no zip at all"])
def test_a_damaged_problem_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "p.npz"
    path.write_bytes(content)
    with pytest.raises(FileFormatError):
        load_problem(path)


def _hold(points: list[int], components: tuple[bool, bool, bool] = (True, True, True)) -> Support:
    return Support(np.array(points, dtype=np.int32), components=components)


@pytest.mark.parametrize(
    ("supports", "free"),
    [
        ([], 6),
        ([_hold([0])], 3),  # turns about a point
        ([_hold([0, 1])], 1),  # turns about a line
        ([_hold([0, 1, 2])], 0),
        ([_hold([0, 1, 2], (True, True, False))], 3),  # up, and two tilts
        ([_hold([0]), _hold([1], (False, True, True)), _hold([2], (False, False, True))], 0),
    ],
)
def test_free_rigid_motions_are_counted(supports: list[Support], free: int) -> None:
    for scale in (1e-6, 1.0, 1e6):
        mesh = TetMesh(POINTS * scale + 1e3 * scale, MESH.cells)
        assert free_rigid_modes(mesh, supports) == [free]


def test_a_floating_part_is_found_beside_a_held_one() -> None:
    mesh = TetMesh(np.vstack([POINTS, POINTS + 5.0]), [[0, 1, 2, 3], [4, 5, 6, 7]])
    assert parts_of_mesh(mesh).tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    with pytest.raises(UnsupportedBodyError, match="part 1 of 2") as caught:
        require_supported(Problem(mesh, PROBLEM.material, (_hold([0, 1, 2]),), ()))
    assert caught.value.num_free_modes == 6
    assert caught.value.part == 1


@pytest.mark.parametrize(
    ("E", "nu", "rho", "word"),
    [
        (0.0, 0.3, 1.0, "youngs_modulus"),
        (float("nan"), 0.3, 1.0, "youngs_modulus"),
        (1.0, 0.5, 1.0, "poissons_ratio"),
        (1.0, -1.0, 1.0, "poissons_ratio"),
        (1.0, float("nan"), 1.0, "poissons_ratio"),
        (1.0, 0.3, -5.0, "density"),
    ],
)
def test_senseless_materials_are_refused(E: float, nu: float, rho: float, word: str) -> None:
    with pytest.raises(InputError, match=word):
        Material(E, nu, rho)


def test_an_interrupted_write_leaves_the_old_text(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text_atomically(path, "old")

    def interrupted() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
