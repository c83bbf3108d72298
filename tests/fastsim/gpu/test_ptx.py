"""The kernels compile for GPUs on a machine without one, and compute with no double by accident."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.fastsim.gpu.kernels.kit import IN_DOUBLE, TOPICS

pytest.importorskip("warp", reason="the extra `gpu` is not installed")
pytestmark = pytest.mark.once
KERNELS = {
    "elasticity": {"force_cells"},
    "smoothing": {"strain_cells", "smooth_edges", "smooth_nodes", "force_smoothed_cells"},
    "gathering": {"gather_forces"},
    "stepping": {"move_points", "finish_step"},
}


@pytest.mark.parametrize("architecture", [80, 90, 100])
@pytest.mark.parametrize("topic", TOPICS)
def test_single_precision_computes_in_single_precision(
    topic: str, architecture: int, tmp_path: Path
) -> None:
    from palpate.fastsim.gpu.ptx import compile_topic, read_ptx

    path = compile_topic(topic, "float32", architecture, tmp_path)
    assert f".target sm_{architecture}" in path.read_text("utf-8", errors="replace")
    kernels = read_ptx(path)
    assert {kernel.name for kernel in kernels} >= KERNELS.get(topic, set())
    doubles = {kernel.name: kernel.doubles[:3] for kernel in kernels if kernel.doubles}
    if topic in IN_DOUBLE:
        assert doubles  # the search finds what there is
    else:
        assert doubles == {}
        assert all("f64" not in kernel.virtual_registers for kernel in kernels)


@pytest.mark.parametrize("topic", ["elasticity", "gathering", "stepping"])
def test_double_precision_compiles_and_the_search_sees_it(topic: str, tmp_path: Path) -> None:
    from palpate.fastsim.gpu.ptx import compile_topic, read_ptx

    kernels = read_ptx(compile_topic(topic, "float64", 90, tmp_path))
    moving = [kernel for kernel in kernels if kernel.name != "finish_step"]
    assert all(kernel.doubles for kernel in moving)


@pytest.mark.parametrize(("precision", "stated"), [("float32", 56), ("float64", 90)])
def test_registers_of_machine_code_are_about_those_stated(
    precision: str, stated: int, tmp_path: Path
) -> None:
    from palpate.fastsim.gpu.ptx import compile_topic, registers

    found = registers(compile_topic("elasticity", precision, 90, tmp_path, is_ptx=False))
    assert found.keys() == {"force_cells"}
    # Another release of the compiler may do a little otherwise; 255 is where memory takes over.
    assert abs(found["force_cells"] - stated) <= 24


def test_what_a_step_moves_is_counted_from_its_arrays() -> None:
    import numpy as np

    from palpate.fastsim.explicit_body import ExplicitBody, Precision
    from palpate.fastsim.gpu.traffic import bytes_per_step, copy_bandwidth, paper_rate
    from palpate.meshes.bricks import brick_box
    from palpate.meshes.errors import InputError
    from palpate.meshes.problem import Element, Material, Problem

    mesh = brick_box((4, 3, 3), size=(4.0, 3.0, 3.0))
    problem = Problem(mesh, Material(1e4, 0.3, 1e3), (), ())
    counted = {}
    for precision, word in ((Precision.SINGLE, 4), (Precision.DOUBLE, 8)):
        body = ExplicitBody(problem, precision=precision, device="warp:cpu")
        counted[precision] = bytes_per_step(body)
        # A cell: 4 corners, 9 + 1 numbers, 12 written and 12 read, 4 entries. A point: the start of
        # its entries; 3 numbers read, summed; 7 times 3 as it moves; a look in sixteen steps.
        of_cells = mesh.num_cells * (16 + 10 * word + 24 * word + 16)
        of_points = mesh.num_points * (4 + 27 * word) + 4
        of_look = mesh.num_points * (8 + 12 * word + 20 * word) / 16
        assert counted[precision] == pytest.approx(of_cells + of_points + of_look, rel=1e-3)
    fast = ExplicitBody(problem, device="warp:cpu", is_repeatable=False)
    assert bytes_per_step(fast) < counted[Precision.DOUBLE]
    smoothed = ExplicitBody(problem, device="warp:cpu", element=Element.SMOOTHED)
    assert bytes_per_step(smoothed) > counted[Precision.DOUBLE]
    assert copy_bandwidth(fast, megabytes=8) > 1e6
    assert paper_rate(100.0, 1e12) == pytest.approx(1e10)
    with pytest.raises(InputError, match="device"):
        bytes_per_step(ExplicitBody(problem))
    assert np.isfinite(fast.time_step)
