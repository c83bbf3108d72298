"""What a step on a device moves, counted from its arrays."""

from __future__ import annotations

import pytest

pytest.importorskip("warp", reason="the extra `gpu` is not installed")
pytestmark = pytest.mark.once


def test_what_a_step_moves_is_counted_from_its_arrays() -> None:
    import numpy as np

    from palpate.fastsim.explicit_body import ExplicitBody, Precision
    from palpate.meshes.bricks import brick_box
    from palpate.meshes.errors import InputError
    from palpate.meshes.problem import Element, Material, Problem
    from palpate.validation.peers.adapters.traffic import bytes_per_step, copy_bandwidth, paper_rate

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
