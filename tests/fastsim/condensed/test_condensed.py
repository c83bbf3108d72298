"""The condensed model beside the linear solve on the whole mesh."""

from __future__ import annotations

import dataclasses
import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import refusal, run_limited

from palpate.fastsim.condensed import (
    CompliancePrecision,
    CondensedModel,
    CondensedTooLargeError,
    NotCondensableError,
    condense,
    condense_once,
    condensed_size,
    load_condensed,
)
from palpate.fastsim.condensed.elimination import invert_in_place
from palpate.fastsim.condensed.model import content_hash
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.rigid_modes import UnsupportedBodyError
from palpate.meshes.spring import AnchorPath, Spring

EQUAL = 1e-10  # of the largest displacement


def body() -> Problem:
    """A block of two materials under its weight, a traction and a pressure, pulled and turned."""
    mesh = brick_box((5, 4, 3), (0.05, 0.04, 0.03))
    stiff = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.03).astype(np.int32)
    turn = Rotation((1.0, 0.0, 0.0), (0.05, 0.02, 0.015), 0.1)
    far = side(mesh, 0, 0.05)
    return Problem(
        mesh,
        Material(1e4, 0.45, 1000.0),
        (
            support_of(side(mesh, 0, 0.0)),
            Support(np.unique(far).astype(np.int32), far, (True,) * 3, (1e-3, 0, 0), None, turn),
        ),
        (
            BodyForce((0.0, 0.0, -9810.0)),
            Traction(side(mesh, 2, 0.03), (0.0, 40.0, 0.0)),
            Pressure(side(mesh, 1, 0.0), 30.0),
        ),
        inclusions=(Inclusion(stiff, Material(3e4, 0.3, 1200.0)),),
    )


def slanted() -> Problem:
    """A block on a plane that is not along an axis, which has been moved."""
    mesh = brick_box((4, 3, 3), (0.04, 0.03, 0.03))
    bottom = np.unique(side(mesh, 2, 0.0)).astype(np.int32)
    wall = Support(bottom, normal=(0.0, 0.6, 0.8), displacement=(0.0, 0.0, 1e-3))
    clamp = Support(np.unique(side(mesh, 0, 0.0)).astype(np.int32), components=(True, True, False))
    return Problem(mesh, Material(1e4, 0.3), (wall, clamp), (BodyForce((0.0, 0.0, 900.0)),))


def sprung() -> Problem:
    """The block of `slanted` with springs over two patches, one of them at the slanted plane."""
    problem = slanted()
    mesh = problem.mesh
    springs = (
        Spring.on(mesh, (0.04, 0.015, 0.03), 0.02, 20.0, AnchorPath([0.0], [[2e-3, 1e-3, 3e-3]])),
        Spring.on(mesh, (0.02, 0.015, 0.0), 0.015, 40.0, AnchorPath([0.0], [[0.0, 2e-3, 0.0]])),
    )
    return dataclasses.replace(problem, springs=springs)


def solve(problem: Problem, element: Element) -> Points:
    return solve_static(
        problem, strain=Strain.LINEAR, element=element, relative_tolerance=1e-13
    ).displacement


def difference(found: Points, expected: Points) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def with_forces(problem: Problem, points: Points, forces: Points) -> Problem:
    return dataclasses.replace(problem, loads=(*problem.loads, PointForce(points, forces)))


@pytest.mark.parametrize("element", Element)
@pytest.mark.parametrize("make", [body, slanted, sprung])
def test_loads_supports_and_forces_as_the_linear_solve_has_them(
    element: Element, make: Callable[[], Problem]
) -> None:
    problem = make()
    model = condense(problem, element=element, keep_inside=True)
    expected = solve(problem, element)
    assert difference(model.displacement(), expected[model.seen]) <= EQUAL
    forces = np.random.default_rng(1).standard_normal((len(model.touched), 3)) * 1e-2
    pushed = solve(with_forces(problem, model.touched, forces), element)
    assert np.abs(pushed - expected).max() > 0.1 * np.abs(expected).max()
    assert difference(model.displacement(forces), pushed[model.seen]) <= EQUAL
    assert difference(model.whole_displacement(forces), pushed) <= EQUAL


def test_supports_move_after_condensing() -> None:
    problem = body()
    model = condense(problem)
    clamp, turned = problem.supports
    assert turned.rotation is not None
    half = dataclasses.replace(turned.rotation, angle=0.5 * turned.rotation.angle)
    moved = dataclasses.replace(turned, displacement=(5e-4, 0.0, 0.0), rotation=half)
    expected = solve(dataclasses.replace(problem, supports=(clamp, moved)), Element.LINEAR)
    found = model.displacement(support_factors=(1.0, 0.5))
    assert difference(found, expected[model.seen]) <= EQUAL
    assert difference(model.displacement(), expected[model.seen]) > 0.1


def test_anchors_of_springs_move_after_condensing() -> None:
    problem = sprung()
    model = condense(problem, keep_inside=True)
    anchors = np.array([[-1e-3, 2e-3, 0.0], [0.0, 0.0, 1e-3]])
    springs = tuple(
        dataclasses.replace(spring, path=AnchorPath([0.0], [moved]))
        for spring, moved in zip(problem.springs, anchors, strict=True)
    )
    expected = solve(dataclasses.replace(problem, springs=springs), Element.LINEAR)
    assert difference(model.displacement(anchors=anchors), expected[model.seen]) <= EQUAL
    assert difference(model.whole_displacement(anchors=anchors), expected) <= EQUAL
    assert difference(model.displacement(), expected[model.seen]) > 0.1
    with pytest.raises(InputError, match="2 springs need"):
        model.displacement(anchors=anchors[:1])


def test_few_touched_points_and_others_that_are_only_seen() -> None:
    problem = body()
    everything = np.arange(problem.mesh.num_points)
    touched = np.unique(side(problem.mesh, 2, 0.03))
    touched = touched[(problem.mesh.points[touched, 0] % 0.05) > 1e-9]
    model = condense(problem, touched=touched, seen=everything)
    assert len(model.seen) == problem.mesh.num_points > len(model.touched)
    forces = np.random.default_rng(2).standard_normal((len(touched), 3)) * 1e-2
    expected = solve(with_forces(problem, model.touched, forces), Element.LINEAR)
    assert difference(model.displacement(forces), expected[model.seen]) <= EQUAL


def test_the_compliance_is_kept_once_for_each_pair_and_in_single_precision_where_asked() -> None:
    problem = body()
    double = condense(problem)
    single = condense(problem, precision=CompliancePrecision.SINGLE)
    n = len(double.touched)
    assert double.blocks.shape == (n * (n + 1) // 2, 9)
    assert single.blocks.nbytes == double.blocks.nbytes // 2
    forces = np.ones((n, 3)) * 1e-2
    error = difference(single.displacement(forces), double.displacement(forces))
    assert 1e-10 < error < 1e-5


def test_memory_is_reported_before_any_is_taken() -> None:
    problem = body()
    size = condensed_size(problem)
    lines: list[str] = []
    model = condense(problem, progress=lines.append)
    assert size.model_bytes == model.blocks.nbytes
    assert str(size) in lines[0]
    with pytest.raises(CondensedTooLargeError, match="fewer touched points") as refusal:
        condense(problem, most_bytes=size.peak_bytes - 1)
    assert refusal.value.needed_bytes == size.peak_bytes
    assert condensed_size(problem, keep_inside=True).peak_bytes > size.peak_bytes


def write_sealed(file: Path, fields: dict[str, Any]) -> None:
    """A file that says what it likes, with the right hash."""
    np.savez(file, **{**fields, "sha256": np.array(content_hash(fields))})


def test_a_saved_model_is_read_for_its_own_problem_alone(tmp_path: Path) -> None:
    problem, file = sprung(), tmp_path / "model.npz"
    model = condense(problem)
    model.save(file)
    read = load_condensed(file, problem)
    assert np.array_equal(read.displacement(), model.displacement())
    with pytest.raises(NotCondensableError, match="keep_inside"):
        read.whole_displacement()
    softer = dataclasses.replace(problem, material=Material(0.99e4, 0.3))
    with pytest.raises(FileFormatError, match="another problem"):
        load_condensed(file, softer)
    with pytest.raises(FileFormatError, match="another problem"):
        load_condensed(file, problem, element=Element.SMOOTHED)
    fields = dict(np.load(file))
    # Halved blocks are of the right shape, and would give half the displacement.
    np.savez(file, **{**fields, "blocks": 0.5 * fields["blocks"]})
    with pytest.raises(FileFormatError, match="its numbers do not have its hash"):
        load_condensed(file, problem)
    write_sealed(file, {**fields, "made_by": np.array("an older core")})
    with pytest.raises(FileFormatError, match="made by another palpate on 2"):
        load_condensed(file, problem)
    for name, wrong in (
        ("terms", np.array([[99, 0], [0, 0]])),
        ("terms", np.array([3])),
        ("terms", np.array(7)),
        ("version", np.array([2, 2])),
        ("has_inside", np.zeros((2, 2))),
        ("precision", np.array("half")),
    ):
        write_sealed(file, {**fields, name: wrong})
        with pytest.raises(FileFormatError, match="no condensed model"):
            load_condensed(file, problem)
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(FileFormatError, match="cannot be read as npz"):
        load_condensed(file, problem)


def test_a_model_that_claims_gigabytes_is_refused_before_they_are_taken(tmp_path: Path) -> None:
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (3 * 10**9,)}
    np.lib.format.write_array_header_1_0(header, shape)  # type: ignore[arg-type]
    file = tmp_path / "model.npz"
    condense(sprung(), keep_inside=True).save(file)
    with zipfile.ZipFile(file) as whole, zipfile.ZipFile(tmp_path / "huge.npz", "w") as huge:
        for name in whole.namelist():
            huge.writestr(name, whole.read(name))
        huge.writestr("more.npy", header.getvalue())
    read = f"""
sys.path[:0] = [{str(Path(__file__).parent)!r}, {str(Path(__file__).parents[2] / "bank")!r}]
from test_condensed import load_condensed, sprung
load_condensed(sys.argv[1], sprung())
print("read")
"""
    assert "24 GB when unpacked" in refusal(read, tmp_path / "huge.npz")
    assert run_limited(read, file).stdout == "read\n"


def test_a_model_is_made_once_and_found_again_with_its_inside(tmp_path: Path) -> None:
    problem, folder = sprung(), tmp_path / "kept"
    forces = np.ones((len(condense(problem).touched), 3)) * 1e-2

    def reported(**options: Any) -> tuple[CondensedModel, str]:
        lines: list[str] = []
        model = condense_once(folder, problem, progress=lines.append, **options)
        return model, " ".join(lines)

    first, said = reported(keep_inside=True)
    assert "stored for the next time" in said
    again, said = reported(keep_inside=True)
    assert f"condensed before, on {again.made}" in said
    assert again.made.startswith("2")
    assert "condensing" not in said
    assert np.array_equal(again.whole_displacement(forces), first.whole_displacement(forces))
    # Another key asks for another file; a corrupted file is made anew.
    reported(precision=CompliancePrecision.SINGLE)
    assert len(list(folder.iterdir())) == 2
    for file in folder.iterdir():
        fields = dict(np.load(file))
        np.savez(file, **{**fields, "blocks": 0.5 * fields["blocks"]})
    again, said = reported(keep_inside=True)
    assert "its numbers do not have its hash; made anew" in said
    assert again.made == ""
    assert np.array_equal(again.displacement(forces), first.displacement(forces))
    # A link leads to a file of somebody else, which is neither read nor replaced.
    for file in folder.iterdir():
        theirs = tmp_path / f"theirs-{file.name}"
        file.rename(theirs)
        file.symlink_to(theirs)
    before = {file: file.read_bytes() for file in tmp_path.glob("theirs-*")}
    again, said = reported(keep_inside=True)
    assert "is a link, which may lead anywhere; made anew" in said
    assert "not stored for the next time" in said
    assert {file: file.read_bytes() for file in before} == before
    (tmp_path / "file").write_text("")
    with pytest.raises(FileFormatError, match="is no folder for condensed models"):
        condense_once(tmp_path / "file", problem)
    # A stored model without its inside is not used where the inside is needed.
    reported(element=Element.SMOOTHED)
    model, said = reported(element=Element.SMOOTHED, keep_inside=True)
    assert "stored for the next time" in said
    assert model.inside is not None


def test_what_cannot_be_condensed_is_refused() -> None:
    problem = body()
    with pytest.raises(UnsupportedBodyError):
        condense(dataclasses.replace(problem, supports=()))
    with pytest.raises(NotCondensableError, match=r"touched point \d+ is held"):
        condense(problem, touched=problem.supports[0].points)
    model = condense(problem, touched=condense(problem).touched[:2])
    for forces in (np.zeros((3, 3)), np.full((2, 3), np.nan)):
        with pytest.raises(InputError, match="touched points need"):
            model.displacement(forces)
    with pytest.raises(InputError, match="support factors"):
        model.displacement(support_factors=(1.0, 1.0, 1.0))


@pytest.mark.parametrize("n", [1, 150, 401])
def test_inverse_in_place(n: int) -> None:
    rows = np.random.default_rng(n).standard_normal((n, n))
    matrix = rows @ rows.T + n * np.eye(n)
    inverse = matrix.copy()
    invert_in_place(inverse)
    assert np.abs(inverse @ matrix - np.eye(n)).max() <= 1e-12
