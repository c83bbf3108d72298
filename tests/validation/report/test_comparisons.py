"""Two candidates beside one another in a report: pairs, pictures, and lines told apart."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
from judged import judge

from palpate.meshes.problem import Element, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.case_plots import motion_svg
from palpate.validation.report.comparisons import colours_of, comparisons_of, way_to_eye
from palpate.validation.report.drawing import BLUE as SUPPORT
from palpate.validation.report.drawing import Surface, View, extent
from palpate.validation.report.loads_and_tools import arrows_around
from palpate.validation.report.pictures import result_views
from palpate.validation.report.plots import BLUE, OCHRE, RED
from palpate.validation.report.viewer import viewer_json

BOTH = [fastsim_candidate(element=element) for element in Element]


@pytest.fixture(scope="module")
def motion() -> CaseResult:
    return judge(load_case("block-motion"), candidate=BOTH)


def test_each_candidate_has_its_own_same_mesh_and_all_share_the_truth(both: CaseResult) -> None:
    for look in comparisons_of(both):
        candidates = [both.states[one] for one, _ in look.pairs]
        references = [both.states[other] for _, other in look.pairs]
        assert [s.element for s in candidates] == [Element.LINEAR, Element.SMOOTHED]
        assert {s.strain for s in (*candidates, *references)} == {look.strain}
        if look.is_truth:
            assert len(look.references) == 1
            assert references[0].degree == 2
        else:
            assert [s.element for s in references] == [s.element for s in candidates]
    # The finest truth comes first, linear strain last.
    first, *_, last = comparisons_of(both)
    assert both.states[first.references[0]].label == "reference P2, refined"
    assert (first.strain, last.strain) == (Strain.GREEN, Strain.LINEAR)


def test_pictures_show_both_and_the_reference_on_one_scale(both: CaseResult) -> None:
    pictures = result_views(both)
    titles = [panel.title for panel in pictures["states"]]
    assert titles[1:] == [
        f"{name} (green line: at rest)"
        for name in ("fastsim", "fastsim (smoothed)", "reference P2, refined")
    ]
    assert len({panel.surfaces[0].largest for panel in pictures["states"][1:]}) == 1
    errors = pictures["errors"]
    assert [panel.title for panel in errors] == [
        "fastsim: error against reference P1",
        "fastsim (smoothed): error against reference smoothed",
        "fastsim: error against reference P2, refined",
        "fastsim (smoothed): error against reference P2, refined",
    ]
    plain, smoothed = (panel.surfaces[0] for panel in errors[2:])
    assert plain.largest == smoothed.largest
    assert plain.values is not None
    assert smoothed.values is not None
    assert plain.values.max() == pytest.approx(plain.largest)
    assert smoothed.values.max() < 0.5 * plain.largest


def lines_of(svg: str) -> set[str]:
    """Colours of the lines."""
    return set(re.findall(r"fill: none; (?:stroke-dasharray[^;]*;[^;]*; )?stroke: (#\w{6})", svg))


def test_lines_of_two_candidates_have_colours_of_their_own(motion: CaseResult) -> None:
    assert colours_of(motion) == {"fastsim": RED, "fastsim (smoothed)": BLUE}
    svg = motion_svg(motion)
    assert {RED, BLUE} <= lines_of(svg)
    assert OCHRE not in lines_of(svg)
    for words in ("fastsim, Green strain", "fastsim (smoothed), Green strain",
                  "fastsim (smoothed) to reference P2, refined"):  # fmt: skip
        assert words in svg


def test_a_candidate_alone_looks_as_ever() -> None:
    alone = judge(load_case("block-motion"))
    assert colours_of(alone) == {"fastsim": BLUE}
    svg = motion_svg(alone)
    assert {BLUE, OCHRE} <= lines_of(svg)
    assert "to reference P1" in svg
    assert [panel.title for panel in result_views(alone)["states"]][1:] == [
        "linear strain (green line: at rest)", "Green strain (green line: at rest)",
    ]  # fmt: skip


def test_pictures_stand_as_the_3d_view_begins_with_tools_supports_and_loads(
    both: CaseResult,
) -> None:
    path = ToolPath([0.0, 1.0], [[0.0, 0.0, 0.03], [0.01, 0.0, 0.03]])
    tool = RigidTool(SphereShape(0.004), path)
    problem = dataclasses.replace(both.problem, tools=(tool,))
    result = dataclasses.replace(both, problem=problem)
    yaw, pitch = json.loads(viewer_json(result))["eye"]
    pictures = result_views(result)
    assert {panel.side for panels in pictures.values() for panel in panels} == {
        tuple(map(float, way_to_eye(yaw, pitch)))
    }
    arrows = arrows_around(problem, np.zeros(3), 1e-3)
    for panel in (*pictures["states"], *pictures["errors"]):
        (ball,) = (part for part in panel.surfaces if part.is_beside)
        # Where it starts beside the original, where it ends beside the others; millimetres.
        x = 0.0 if panel is pictures["states"][0] else 10.0
        assert ball.points.mean(axis=0) == pytest.approx((x, 0.0, 30.0), abs=0.2)
        assert np.array_equal(panel.marks[0].vectors, arrows[:, 1])
        fixed = [part.colour == SUPPORT for part in panel.surfaces]
        assert any(fixed), panel.title


def test_a_tool_widens_a_picture_by_a_part_of_the_body_at_most() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
    facets = np.array([[0, 1, 2]], dtype=np.int32)
    body = Surface(corners, facets)
    plane = Surface(100.0 * (corners - 0.5), facets, is_beside=True)
    near = Surface(corners + 0.1, facets, is_beside=True)
    low, high = extent([View("", [body, plane], (1.0, 0.0, 0.0))])
    assert (low, high) == (pytest.approx([-0.6] * 3), pytest.approx((1.6, 1.6, 2.6)))
    # A ball that is about as large as the body is whole.
    ball = Surface(1.4 * (corners - [0.5, 0.5, 1.0]) + [0.5, 0.5, 3.0], facets, is_beside=True)
    low, high = extent([View("", [body, ball], (1.0, 0.0, 0.0))])
    assert (low, high) == (pytest.approx([-0.2, -0.2, 0.0]), pytest.approx((1.2, 1.2, 4.0)))
    low, high = extent([View("", [body, near], (1.0, 0.0, 0.0))])
    assert (low, high) == (pytest.approx([0.0] * 3), pytest.approx((1.1, 1.1, 2.1)))
