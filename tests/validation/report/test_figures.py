"""Figures that a reader can read: names, colours, tools and arrows that hide nothing."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from judged import case_of
from matplotlib import pyplot

from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
)
from palpate.meshes.shapes import shape_box
from palpate.validation.case import load_case
from palpate.validation.case.units import Units
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.case_plots import checks_figure, motion_figure
from palpate.validation.report.drawing import Surface, _faces, _ribbons, in_front
from palpate.validation.report.loads_and_tools import depth_of, load_arrows, tools_in_words
from palpate.validation.report.pictures import first_view
from palpate.validation.report.plots import COLUMN, PAGE, plot_style
from palpate.validation.states import Precision

BOX = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
EYE = np.array([1.0, -1.3, 0.7]) / np.linalg.norm([1.0, -1.3, 0.7])


@pytest.mark.parametrize("medium", [PAGE, COLUMN], ids=["page", "column"])
@pytest.mark.parametrize("count", [1, 2, 3, 12])
def test_names_of_checks_do_not_overprint(kidney: CaseResult, medium, count: int) -> None:
    named = [c for c in kidney.checks if c.against != "candidate" and c.value is not None]
    checks = tuple(itertools.islice(itertools.cycle(named), count))
    with plot_style(medium):
        figure = checks_figure(dataclasses.replace(kidney, checks=checks), medium)
        assert figure is not None
        figure.canvas.draw()
        renderer = figure.canvas.get_renderer()
        labels = figure.axes[0].get_yticklabels()
        boxes = [label.get_window_extent(renderer) for label in labels]
        below = figure.axes[0].xaxis.label.get_window_extent(renderer)
        pyplot.close(figure)
    assert len(boxes) == count
    for lower, upper in itertools.pairwise(boxes):
        assert lower.y1 <= upper.y0
    assert below.y0 >= 0.0


@pytest.mark.parametrize("medium", [PAGE, COLUMN], ids=["page", "column"])
def test_what_is_written_below_checks_and_about_a_motion_is_within_the_picture(
    kidney: CaseResult, medium
) -> None:
    """Long names leave little room for the axis, whose words then stood half outside."""
    motion = judge_case(load_case("block-motion"), diagnoses=False)
    long = tuple(dataclasses.replace(c, precision=Precision.SINGLE) for c in kidney.checks)
    path = ToolPath(np.zeros(1), np.array([[0.0, 0.0, 0.1]]))
    tooled = dataclasses.replace(motion.problem, tools=(RigidTool(SphereShape(0.02), path),))
    states = tuple(
        dataclasses.replace(s, tool_forces=np.ones((1, len(s.trajectory.times), 3)))
        for s in motion.states
        if s.trajectory is not None
    )
    moved = dataclasses.replace(motion, problem=tooled, states=states)
    with plot_style(medium):
        for figure in (
            checks_figure(dataclasses.replace(kidney, checks=long), medium),
            motion_figure(moved, medium),
        ):
            assert figure is not None
            figure.canvas.draw()
            renderer = figure.canvas.get_renderer()
            whole = figure.bbox
            written = [axes.xaxis.label for axes in figure.axes]
            written += [axes.get_legend() for axes in figure.axes if axes.get_legend()]
            boxes = [one.get_window_extent(renderer) for one in written]
            pyplot.close(figure)
            assert min(box.x0 for box in boxes) >= whole.x0
            assert max(box.x1 for box in boxes) <= whole.x1


def test_a_line_runs_along_rim_contour_and_creases_alone() -> None:
    """Of a box seen from a corner 9 of 12 edges, two pieces each, none of the diagonals."""
    ribbons = _ribbons(Surface(BOX.points, BOX.facets, is_outline=True), EYE, 1.0)
    assert len(ribbons) == 2 * 9 * 2
    # They lie before the surface by an edge's length at most.
    assert (ribbons.reshape(-1, 3) @ EYE).max() <= (BOX.points @ EYE).max() + 0.75


def test_edges_of_coloured_facets_have_nearly_their_colour() -> None:
    values = np.linspace(0.0, 1.0, len(BOX.points))
    _, paint, edges = _faces(Surface(BOX.points, BOX.facets, values=values), EYE, 1.0)
    assert np.abs(paint - edges).max() < 0.15


def test_what_a_body_hides_of_a_tool_is_not_drawn() -> None:
    body = Surface(BOX.points, BOX.facets)
    for way, shown in ((1.0, len(BOX.facets)), (-1.0, 0)):
        tool = Surface(0.2 * BOX.points + 0.4 + 3.0 * way * EYE, BOX.facets, is_beside=True)
        assert len(in_front(tool, [body], EYE).facets) == shown
    pale = dataclasses.replace(body, opacity=0.3)
    assert len(in_front(tool, [pale], EYE).facets) == len(BOX.facets)


@pytest.mark.parametrize(
    ("shape", "height", "depth"),
    [
        (SphereShape(0.01), 0.028, 0.002),
        (CapsuleShape(0.01, 0.02), 0.048, 0.002),
        (BoxShape((0.004, 0.004, 0.01)), 0.028, 0.002),
        (PlaneShape(), 0.018, None),
        (SphereShape(0.01), 0.05, 0.0),
    ],
    ids=lambda given: type(given).__name__,
)
def test_the_depth_of_a_tool_by_hand(shape, height: float, depth: float | None) -> None:
    """Above the block of 40 x 25 x 20 mm; a plane with its body below reaches through all of it."""
    problem: Problem = case_of("block").problem
    place = [0.02, 0.0125, height]
    tool = RigidTool(shape, ToolPath([0.0, 1.0], [[0.0, 0.0, 0.1], place]))
    expected = height if depth is None else depth
    # Between the samples of a facet, a tenth of an edge of 12.5 mm: 0.06^2 / 2 r.
    assert depth_of(tool, problem) == pytest.approx(expected, abs=1e-4)


def test_the_depth_stands_with_the_first_picture() -> None:
    problem = case_of("press").problem
    (words,) = tools_in_words(problem, Units(length="mm"))
    assert words.startswith("sphere, 2 mm deep")


def test_the_first_picture_says_that_its_scale_is_no_verdict(block: CaseResult) -> None:
    found = first_view(block)
    assert found is not None
    assert "not a limit" in found[1]


def test_a_weight_s_arrow_ends_on_the_body() -> None:
    problem = case_of("phantom").problem
    ((start, arrow),) = load_arrows(problem, 1e-3)
    points = 1e3 * problem.mesh.points[np.unique(problem.mesh.boundary_facets)]
    tip = start + arrow
    assert np.linalg.norm(points - tip, axis=1).min() < 6.0  # an edge of its mesh is 5 mm
    above = points[np.linalg.norm((points - tip)[:, :2], axis=1) < 3.0]
    assert tip[2] >= above[:, 2].max() - 3.0
