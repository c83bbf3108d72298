"""A solution as a grid of pyvista."""

from __future__ import annotations

import dataclasses
import itertools
import subprocess
import sys

import numpy as np
import pytest

import palpate

pytest.importorskip("pyvista")


def test_the_grid_is_the_deformed_body_with_its_fields() -> None:
    problem = palpate.load_case("block").problem
    state = palpate.solve(problem)
    grid = palpate.to_pyvista(problem, state)
    assert np.array_equal(grid.points, problem.mesh.points + state.displacement)
    assert np.array_equal(grid.cells_dict[10], problem.mesh.cells)
    assert np.array_equal(grid.point_data["displacement"], state.displacement)
    assert state.stresses is not None
    assert np.array_equal(grid.cell_data["von_mises"], state.stresses.von_mises)
    # VTK's own volumes, in the sum, are those of the state.
    sizes = grid.compute_cell_sizes(length=False, area=False, volume=True)
    assert sizes.cell_data["Volume"].sum() == pytest.approx(state.volume, rel=1e-12)


def test_of_a_motion_the_step_is_chosen_and_must_exist() -> None:
    problem = palpate.load_case("block-motion").problem
    state = palpate.solve(problem)
    assert state.trajectory is not None
    grid = palpate.to_pyvista(problem, state, step=3)
    moved = np.asarray(grid.points) - problem.mesh.points
    assert moved == pytest.approx(state.trajectory.displacements[3], abs=1e-15)
    with pytest.raises(palpate.InputError, match="step 99: there are 51 output times"):
        palpate.to_pyvista(problem, state, step=99)


def test_a_state_of_another_mesh_is_refused() -> None:
    block, beam = (palpate.load_case(name).problem for name in ("block", "beam"))
    with pytest.raises(palpate.InputError, match="points"):
        palpate.to_pyvista(beam, palpate.solve(block))


def test_a_state_is_shown_and_saved_in_one_line(tmp_path, monkeypatch) -> None:
    import pyvista

    problem = palpate.load_case("block").problem
    state = palpate.solve(problem)
    grid = pyvista.read(state.save(tmp_path / "x.vtu"))
    assert grid.points == pytest.approx(problem.mesh.points + state.displacement, abs=1e-15)
    assert list(tmp_path.iterdir()) == [tmp_path / "x.vtu"]
    asked = {}
    monkeypatch.setattr(pyvista.UnstructuredGrid, "plot", lambda _, **given: asked.update(given))
    state.plot(off_screen=True)
    assert (asked["scalars"], asked["off_screen"]) == ("displacement", True)
    # The scale has its unit, beside the body: below it its title would cross its numbers.
    bar = asked["scalar_bar_args"]
    assert (bar["title"], bar["vertical"]) == ("displacement [m]", True)
    state.plot(scalars="von_mises")
    assert "title" not in asked["scalar_bar_args"]
    with pytest.raises(palpate.InputError, match=r"saved as \.vtu"):
        state.save(tmp_path / "x.stl")
    with pytest.raises(palpate.InputError, match="does not know its problem"):
        dataclasses.replace(state, problem=None).plot()


ANIMATE = """
import sys
import palpate

problem = palpate.load_case("block").problem
span = palpate.TimeSpan(end_time=0.05, num_outputs=4)
palpate.simulate(problem, time=span).trajectory.animate(sys.argv[1], seconds=1.0)
"""


def test_a_motion_is_animated_in_one_line(tmp_path) -> None:
    from PIL import Image

    problem = palpate.load_case("block").problem
    span = palpate.TimeSpan(end_time=0.05, num_outputs=4)
    motion = palpate.simulate(problem, time=span).trajectory
    assert motion is not None
    # Drawn in a process of its own: VTK may abort one that has loaded much else.
    ended = subprocess.run(
        [sys.executable, "-c", ANIMATE, tmp_path / "x.gif"], capture_output=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    with Image.open(tmp_path / "x.gif") as shown:
        assert (shown.n_frames, shown.info["duration"]) == (5, 200)
        frames = []
        for k in range(5):
            shown.seek(k)
            frames.append(np.asarray(shown.convert("RGB"), dtype=float))
    # It moves from frame to frame, in pixels of the body.
    assert all(np.abs(a - b).mean() > 0.1 for a, b in itertools.pairwise(frames))
    assert list(tmp_path.iterdir()) == [tmp_path / "x.gif"]
    with pytest.raises(palpate.InputError, match=r"shown as \.gif"):
        motion.animate(tmp_path / "x.mp4")
    with pytest.raises(palpate.InputError, match="above 0"):
        motion.animate(tmp_path / "y.gif", seconds=0.0)
    with pytest.raises(palpate.InputError, match="does not know its problem"):
        dataclasses.replace(motion, problem=None).animate(tmp_path / "y.gif")
