"""Small cells where the page's tool first touches: where, and that recordings have them."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.contact.explicit_tools import depth_at_start
from palpate.fastsim.grading.near_tools import PART_OF_CONTACT, first_touched
from palpate.fastsim.grading.size_fields import mean_edges
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element
from palpate.meshes.rigid_tool import ContactRule
from palpate.validation.case import Case, load_case
from palpate.validation.live.live_case import LiveCase, Touch, live_case
from palpate.validation.live.near_touch import near_touch
from palpate.validation.live.panes import Surface, make_panes
from palpate.validation.live.recording import write_pose, write_recording

BALL = Touch({"shape": "sphere", "radius": 20.0}, mass_damping=100.0)


def touched(case: Case, touch: Touch, edge: float | None = None) -> LiveCase:
    return live_case(*near_touch(case, touch, edge), (Element.LINEAR,))


def test_cells_are_small_where_the_ball_touches_first() -> None:
    live = touched(load_case("block"), BALL)
    mesh = live.problem.mesh
    # The block's end is at x = 40 mm, and the ball comes along -x; a fifth of its radius deep the
    # radius of contact is (20 mm * 4 mm)^(1/2) = 8.94 mm, and half of that an edge.
    away = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1) - [0.04, 0.0125, 0.01], axis=1)
    lengths = mean_edges(mesh.points, mesh.cells)
    assert lengths[away < 0.00894].max() <= PART_OF_CONTACT * 8.95e-3
    assert lengths.max() > 0.007
    assert live.problem.tools[0].contact is ContactRule.FACETS
    finer = touched(load_case("block"), BALL, 0.003).problem.mesh
    assert finer.num_cells > 2 * mesh.num_cells


def test_a_tool_of_the_case_begins_where_it_did_but_for_averages() -> None:
    case = load_case("press")
    vertices = case.spec.tool[0].model_copy(update={"contact": ContactRule.VERTICES})
    spec = case.spec.model_copy(update={"tool": (vertices,)})
    case = dataclasses.replace(case, spec=spec)
    live = touched(case, Touch())
    # At vertices it begins where the case says, at the slab; averages over small facets are a
    # fraction of their edges in it there.
    np.testing.assert_array_equal(
        live_case(case, Touch(), (Element.LINEAR,)).start, spec.tool[0].pose[0].position
    )
    assert np.linalg.norm(live.start - spec.tool[0].pose[0].position) < 0.2
    assert depth_at_start(live.problem) <= 0.0
    assert live.problem.tools[0].contact is ContactRule.FACETS
    assert live.problem.mesh.num_cells > case.problem.mesh.num_cells


def test_a_box_has_small_cells_and_contact_at_vertices() -> None:
    live = touched(load_case("block"), Touch({"shape": "box", "half_widths": [9.0, 30.0, 30.0]}))
    assert live.problem.tools[0].contact is ContactRule.VERTICES
    assert live.problem.mesh.num_cells > load_case("block").problem.mesh.num_cells


def test_what_is_recorded_and_judged_is_on_the_same_mesh(tmp_path: Path) -> None:
    live = touched(load_case("block"), BALL)
    panes = make_panes(live.problem, Surface(live.problem), (Element.LINEAR,))
    path = [live.start - np.array([x, 0.0, 0.0]) for x in np.linspace(0.0, 2.9, 11)]
    position = path[-1]
    for pane in panes:
        for there in path[1:]:
            pane.advance(live.metres(there), None, live.clock.steps)
    force = [np.array([1.0, 0.0, 0.0])] * len(panes)
    posed, _ = write_pose(live, position, panes, force, None, tmp_path, "pose")
    for file in (posed, write_recording(live, path, [], tmp_path, "motion")):
        again = load_case(file).problem
        np.testing.assert_array_equal(again.mesh.cells, live.problem.mesh.cells)
        np.testing.assert_array_equal(again.mesh.points, live.problem.mesh.points)
        assert again.tools[0].contact is ContactRule.FACETS


def test_a_ball_meets_the_nearest_facet_on_its_way_and_may_pass_the_body() -> None:
    live = live_case(load_case("block"), BALL, (Element.LINEAR,))
    found = first_touched(live.problem, [-1.0, 0.0, 0.0])
    np.testing.assert_allclose(found, [0.04, 0.0125, 0.01], atol=3e-3)
    # Coming down past the end, 12 mm from it, the ball meets its upper edge.
    (tool,) = live.problem.tools
    above = dataclasses.replace(tool.path, positions=np.array([[0.052, 0.0125, 0.06]]))
    problem = dataclasses.replace(live.problem, tools=(dataclasses.replace(tool, path=above),))
    x, _, z = first_touched(problem, [0.0, 0.0, -1.0])
    assert (x, z) == pytest.approx((0.04, 0.02), abs=1e-9)
    assert math.dist((x, z), (0.052, 0.036)) == pytest.approx(0.02, abs=1e-5)
    with pytest.raises(InputError, match="passes the body"):
        first_touched(live.problem, [1.0, 0.0, 0.0])
