"""`palpate check`: sizes, areas, forces and cost by hand; what looks wrong is told; a picture."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Problem
from palpate.validation.case import load_case
from palpate.validation.preview.acting import acting
from palpate.validation.preview.costs import expected_costs
from palpate.validation.preview.look import look_at
from palpate.validation.preview.picture import draw_case
from palpate.validation.preview.thickness import measure_thickness

PNG = b"\x89PNG\r\n\x1a\n"


def palpate(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "palpate.validation.cli", *map(str, arguments)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def size_of(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data.startswith(PNG)
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_a_slab_is_as_thick_as_it_was_made() -> None:
    # 2 layers of bricks of side 1, each cut into tetrahedra with edges from 1 to sqrt(3).
    found = measure_thickness(brick_box((12, 12, 2), (12.0, 12.0, 2.0)))
    assert found.length == pytest.approx(2.0, rel=1e-9)
    assert 2.0 / np.sqrt(3.0) < found.num_edges < 2.0
    finer = measure_thickness(brick_box((12, 12, 6), (12.0, 12.0, 2.0)))
    assert finer.length == pytest.approx(2.0, rel=1e-9)
    assert finer.num_edges > found.num_edges


def test_forces_and_areas_are_those_of_the_loads(problem: Problem) -> None:
    pulled = next(load for load in problem.loads if isinstance(load, Traction))
    # The end of a box 2 x 1 x 1 m has 1 m2.
    found = acting(problem, pulled)
    assert found.area == pytest.approx(1.0)
    assert found.force == pytest.approx([60.0, 20.0, -10.0])
    assert found.center[0] == pytest.approx(2.0)
    pressed = acting(problem, Pressure(pulled.facets, 7.0))
    assert pressed.force == pytest.approx([-7.0, 0.0, 0.0], abs=1e-12)
    weight = acting(problem, BodyForce((0.0, 0.0, -3.0)))
    assert weight.force == pytest.approx([0.0, 0.0, -3.0 * problem.mesh.volume])
    both = acting(problem, PointForce(np.array([0, 1]), np.array([[1.0, 0, 0], [2.0, 0, 0]])))
    assert both.force.tolist() == [3.0, 0.0, 0.0]


def test_unknowns_and_steps_are_counted() -> None:
    problem = load_case("block-motion").problem
    assert problem.time is not None
    assert problem.time.time_step is not None
    costs = expected_costs(problem)
    ends = problem.mesh.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    num_edges = len({tuple(sorted(pair)) for pair in ends.tolist()})
    assert costs.num_quadratic_unknowns == 3 * (problem.mesh.num_points + num_edges)
    steps = problem.time.end_time / problem.time.time_step
    assert costs.num_steps == pytest.approx(steps, abs=1.0)
    assert costs.linear is None


def test_a_case_that_looks_right_has_its_numbers_and_no_warning(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    assert palpate("init", "-o", path).returncode == 0
    done = palpate("check", path)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stdout
    for wanted in ("60 x 20 x 20 mm", "[0.2, 0, 0] N", "critical time step", "unknowns", "GB"):
        assert wanted in done.stdout


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("force = [60.0, 20.0, -10.0]", "force = [0.0, 0.0, 0.0]", "nothing moves"),
        ("force = [60.0, 20.0, -10.0]", "force = [300.0, 0.0, 0.0]", "of its size"),
        ("force = [60.0, 20.0, -10.0]", "force = [-4000.0, 0.0, 0.0]", "inside out"),
        ("edge_length = 0.5", "edge_length = 1.0", "through the thickness"),
        ("poissons_ratio = 0.3", "poissons_ratio = 0.49", "lock"),
        ("point = [1.999, 0.0, 0.0]", "point = [-0.1, 0.0, 0.0]", "held; that part is lost"),
        ("[geometry]", '[units]\nlength = "mm"\n[geometry]', "is its file really in mm"),
        ("[material]", "[time]\nend_time = 1.0\ntime_step = 0.9\n[material]", "will blow up"),
    ],
)
def test_what_looks_wrong_is_told(
    write_case: Callable[..., Path], old: str, new: str, told: str
) -> None:
    look = look_at(load_case(write_case((old, new))))
    assert any(told in warning for warning in look.warnings), look.warnings


def test_a_case_in_which_nothing_acts_or_is_checked_is_told() -> None:
    case = load_case("block")
    bare = dataclasses.replace(case, spec=case.spec.model_copy(update={"load": (), "check": ()}))
    warnings = " ".join(look_at(bare).warnings)
    assert "nothing pushes or moves the body" in warnings
    assert "no [[check]]" in warnings


def test_bad_input_is_two_and_nothing_is_written(
    tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    bad = write_case(("poissons_ratio = 0.3", "poissons_ratio = 0.7"))
    done = palpate("check", bad, "--picture", tmp_path / "case.png")
    assert done.returncode == 2
    assert "poissons_ratio = 0.7" in done.stderr
    assert not (tmp_path / "case.png").exists()
    assert palpate("check", "block", "--picture", tmp_path / "case.pdf").returncode == 2
    assert palpate("check", bad, "--picture", bad).returncode == 2


@pytest.mark.parametrize("by", ["pyvista", "matplotlib"])
@pytest.mark.parametrize("name", ["block", "slide"])
def test_a_picture_shows_what_is_held_and_pushed_and_the_tools(
    tmp_path: Path, name: str, by: str
) -> None:
    if by == "pyvista":
        pytest.importorskip("pyvista")
    from matplotlib import image

    path = tmp_path / "case.png"
    draw_case(load_case(name), path, by=(by,))
    width, height = size_of(path)
    assert width >= 1000
    assert height >= 600
    red, green, blue = (image.imread(path)[:, :, k] for k in range(3))
    # Blue is held, red pushed, amber a tool: each is some thousandth of the picture at least.
    is_held = (blue > 1.5 * red) & (blue > 1.3 * green)
    is_pushed = (red > 2.0 * green) & (red > 2.0 * blue)
    is_tool = (red > 1.15 * green) & (green > 2.0 * blue)
    assert is_held.mean() > 1e-3
    assert (is_pushed.mean() > 1e-3) == (name == "block")
    assert (is_tool.mean() > 1e-3) == (name == "slide")


def test_matplotlib_draws_where_pyvista_cannot(tmp_path: Path) -> None:
    path = tmp_path / "case.png"
    draw_case(load_case("block"), path, by=("nobody", "matplotlib"))
    assert size_of(path)[0] >= 1000
