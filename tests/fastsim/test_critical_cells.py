"""Which cells decide the time step, what the surface forces, and what a target does."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim import mesher
from palpate.fastsim.body import Body
from palpate.fastsim.critical_cells import (
    cell_steps,
    facet_altitudes,
    find_critical_cells,
    mesh_to_time_step,
    wave_speed,
)
from palpate.fastsim.mesher import Interior, MeshingReport, TimeLimitError, mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Element, Material
from palpate.meshes.quality import measure_quality
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

TISSUE = Material(1e4, 0.45, 1000.0)


def test_the_first_cell_decides_and_no_cell_beats_its_facet() -> None:
    mesh = mesh_surface(shape_sphere(0.05, edge_length=0.012))
    found = find_critical_cells(mesh, TISSUE)
    body = Body(mesh, TISSUE)
    steps = body.cell_time_steps()
    assert found.time_step == steps.min() == body.critical_time_step_bound()
    assert len(found.cells) == 10
    assert (np.diff(found.steps) >= 0.0).all()
    # Alone, the first cell has the same step.
    alone = TetMesh(mesh.points[mesh.cells[found.cells[0]]], np.array([[0, 1, 2, 3]]))
    assert Body(alone, TISSUE).critical_time_step_bound() == pytest.approx(found.time_step)
    # And so says the formula by blocks.
    np.testing.assert_allclose(cell_steps(mesh.points[mesh.cells], TISSUE), steps, rtol=1e-10)
    # Every cell with a facet on the surface keeps below that facet's altitude over c.
    owner = {tuple(sorted(f)): k for k, f in enumerate(mesh.boundary_facets.tolist())}
    altitudes = facet_altitudes(mesh.points[mesh.boundary_facets])
    seen = 0
    for cell, step in zip(mesh.cells.tolist(), steps, strict=True):
        for k in range(4):
            facet = owner.get(tuple(sorted(cell[:k] + cell[k + 1 :])))
            if facet is not None:
                assert step <= altitudes[facet] / wave_speed(TISSUE)
                seen += 1
    assert seen == len(altitudes)
    assert found.surface_step == pytest.approx(altitudes.min() / wave_speed(TISSUE))
    assert altitudes[found.surface_facet] == altitudes.min()


@pytest.mark.parametrize(
    "surface",
    [
        shape_kidney(edge_length=0.016),
        shape_sphere(0.05, edge_length=0.01),
        shape_box((0.1, 0.08, 0.06), edge_length=0.015),
    ],
    ids=["kidney", "sphere", "box"],
)
def test_the_worst_cell_is_no_worse_than_a_regular_one_on_the_thinnest_facet(
    surface: TriSurface,
) -> None:
    found = find_critical_cells(mesh_surface(surface, lengthens_step=True), TISSUE)
    regular = np.array([[[1.0, 1, 1], [-1.0, 1, -1], [1.0, -1, -1], [-1.0, -1, 1]]])
    altitude = facet_altitudes(regular[:, :3])[0]
    share = cell_steps(regular, TISSUE)[0] * wave_speed(TISSUE) / altitude
    assert share == pytest.approx(0.5, abs=0.01)
    assert found.time_step >= share * found.surface_step
    # Its price in angles stays above what counts as a sliver for the mesher.
    assert found.smallest_dihedral_deg > 26.9


@pytest.mark.parametrize("ratio", [-0.5, 0.0, 0.3, 0.45, 0.499])
def test_bounds_find_the_worst_of_many_blocks_of_cells(ratio: float) -> None:
    # 12 000 cells in six blocks, with dents: the worst ones lie anywhere.
    mesh = mesh_surface(shape_sphere(0.05, edge_length=0.006), improve=False)
    assert mesh.num_cells > 3 * 2048
    material = Material(1e4, ratio, 1000.0)
    steps = Body(mesh, material).cell_time_steps()
    found = find_critical_cells(mesh, material)
    assert found.cells.tolist() == np.argsort(steps, kind="stable")[:10].tolist()
    assert np.array_equal(found.steps, steps[found.cells])
    angle = measure_quality(mesh).smallest_dihedral_deg
    assert found.smallest_dihedral_deg == pytest.approx(angle, rel=1e-9)


def test_wave_speed_and_altitude_by_hand() -> None:
    # nu = 0.25: (lambda + 2 mu) = E 0.75 / (1.25 0.5) = 1.2 E.
    assert wave_speed(Material(1000.0, 0.25, 1.2)) == pytest.approx(1000.0**0.5)
    triangle = np.array([[[0.0, 0, 0], [3.0, 0, 0], [0.0, 4.0, 0]]])
    assert facet_altitudes(triangle) == pytest.approx([12.0 / 5.0])


def test_smoothed_cells_have_no_step_of_their_own() -> None:
    mesh = mesh_surface(shape_sphere(0.05, edge_length=0.03))
    with pytest.raises(InputError, match="smoothed"):
        Body(mesh, TISSUE, element=Element.SMOOTHED).cell_time_steps()


@pytest.mark.long
def test_a_target_lengthens_the_step_and_the_boundary_stays() -> None:
    surface = shape_kidney(edge_length=0.016)

    def make(altitude: float) -> TetMesh:
        return mesh_surface(surface, least_altitude=altitude)

    plain = find_critical_cells(make(0.0), TISSUE)
    reported: list[str] = []
    wanted = 1.1 * plain.time_step
    mesh = mesh_to_time_step(TISSUE, wanted, make, reported.append)
    longer = find_critical_cells(mesh, TISSUE)
    assert longer.time_step >= wanted
    assert 1 <= len(reported) <= 4
    np.testing.assert_array_equal(mesh.points[: len(surface.points)], surface.points)
    assert abs(mesh.volume / surface.volume - 1.0) < 1e-12
    # More than the thinnest facet allows is never reached, and the best mesh is returned.
    reported.clear()
    best = mesh_to_time_step(TISSUE, 2.0 * plain.surface_step, make, reported.append)
    reached = find_critical_cells(best, TISSUE)
    assert plain.time_step <= reached.time_step <= reached.surface_step
    assert len(reported) == 4


def test_no_time_is_an_error_that_says_where() -> None:
    surface = shape_sphere(0.05, edge_length=0.006)
    with pytest.raises(TimeLimitError, match="the time was up while") as caught:
        mesh_surface(surface, time_limit=1e-9)
    assert caught.value.time_limit == 1e-9
    with pytest.raises(TimeLimitError) as caught:
        mesh_surface(surface, edge_length=0.0008, time_limit=0.05)
    assert caught.value.stage
    with pytest.raises(InputError):
        mesh_surface(surface, time_limit=0.0)


def test_progress_names_the_stages_with_their_amounts() -> None:
    reported: list[str] = []
    mesh = mesh_surface(shape_sphere(0.05, edge_length=0.01), progress=reported.append)
    (expected,) = (line for line in reported if "expected" in line)
    assert float(expected.split("some ")[1].split()[0]) == pytest.approx(mesh.num_cells, rel=0.15)
    assert any(line.startswith("improving cells: ") for line in reported)


def test_work_on_slivers_is_bounded_only_where_the_interior_is_graded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Uniform meshes are those of cases, which stay what they are.
    surface = shape_kidney(edge_length=0.012)
    whole = mesh_surface(surface)
    monkeypatch.setattr(mesher, "_LEAST_WORK", 1)
    monkeypatch.setattr(mesher, "_WORK_PER_CELL", 0.0)
    reports: list[MeshingReport] = []
    again = mesh_surface(surface, report=reports.append)
    np.testing.assert_array_equal(again.points, whole.points)
    graded = mesh_surface(surface, interior=Interior.GRADED, report=reports.append)
    assert [report.is_cut_short for report in reports] == [False, True]
    assert graded.volume == pytest.approx(surface.volume, rel=1e-12)


def test_a_caller_may_end_the_work() -> None:
    def stop(line: str) -> None:
        if "improving" in line:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mesh_surface(shape_sphere(0.05, edge_length=0.02), progress=stop)
