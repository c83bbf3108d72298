"""Inclusions in 3-D: seen through the body, moved with it, and named, in the report and live."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest

from palpate.meshes.problem import Element
from palpate.validation.case import Case
from palpate.validation.judging.results import CaseResult
from palpate.validation.live.frames import FrameMaker, unpack_frame
from palpate.validation.live.live_case import Touch, live_case
from palpate.validation.live.panes import Surface, make_panes
from palpate.validation.report.loads_and_tools import inclusion_names, inclusions_inside
from palpate.validation.report.viewer import viewer_json


def unpack(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, 3)


def volume(points: np.ndarray, facets: np.ndarray) -> float:
    """Volume within a closed surface, by cones from the origin."""
    return float(np.linalg.det(points[facets].astype(np.float64)).sum() / 6.0)


def test_surfaces_of_inclusions_move_with_the_body(lump: Case, lump_result: CaseResult) -> None:
    scene = json.loads(viewer_json(lump_result))
    points = unpack(scene["points"], "<f4")
    assert len(points) > len(np.unique(lump.problem.mesh.boundary_facets))  # some lie inside
    (drawn,) = scene["solutions"]
    moved = points + drawn["step"] * unpack(drawn["displacement"], "<i2")
    displacement = lump_result.states[0].displacement
    assert len(scene["inclusions"]) == 2
    for shown, one in zip(scene["inclusions"], lump.problem.inclusions, strict=True):
        facets = unpack(shown["facets"], "<u4")
        for drawn_at, at in ((points, 0.0), (moved, displacement)):
            corners = 1e3 * (lump.problem.mesh.points + at)[lump.problem.mesh.cells[one.cells]]
            edges = corners[:, 1:] - corners[:, :1]
            expected = np.linalg.det(edges).sum() / 6.0
            assert volume(drawn_at, facets) == pytest.approx(expected, rel=1e-4)
        corners = 1e3 * lump.problem.mesh.points[lump.problem.mesh.cells[one.cells]]
        at_rest = np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6.0
        assert f"{at_rest:.4g} mm3" in shown["says"]
    says = [shown["says"] for shown in scene["inclusions"]]
    assert says[0].startswith("inclusion 1: E = 40 kPa, ")
    assert says[1].startswith("inclusion 2: E = 5 kPa, ")


def test_inclusions_have_the_names_of_the_case(lump: Case) -> None:
    tables: dict[str, Any] = {"inclusion": [{"label": "tumour"}, {"region": {"group": "vessel"}}]}
    assert inclusion_names(lump.problem, tables) == ["inclusion tumour", "inclusion vessel"]
    tables = {"inclusion": [{"surface": "cyst.off"}, {"region": {}}]}
    assert inclusion_names(lump.problem, tables) == ["inclusion cyst.off", "inclusion 2"]
    assert inclusion_names(lump.problem, {}) == ["inclusion 1", "inclusion 2"]


def test_frames_of_the_live_page_hold_the_points_inside(lump: Case) -> None:
    live = live_case(lump, Touch(), (Element.LINEAR,))
    mesh = live.problem.mesh
    used = np.unique(mesh.boundary_facets)
    inner, _ = inclusions_inside(live.problem, used, lump.spec.units, live.data)
    assert len(inner) > 0
    surface = Surface(live.problem, inner)
    panes = make_panes(live.problem, surface, (Element.LINEAR,), is_condensed=True)
    frames = FrameMaker(1e3 * mesh.points[used], 1e4)
    for depth in (0.0, 0.5, 1.0, 1.5, 2.0):  # into the body, by 2 mm at last
        for pane in panes:
            pane.advance(live.metres(live.start - (depth + 3.6) * live.outwards), None, 40)
    _, numbers, _ = unpack_frame(frames.frame(panes, {}), len(used) + len(inner))
    for pane, sent in zip(panes, numbers, strict=True):
        places = frames.box.origin + frames.box.step * sent[len(used) :]
        expected = 1e3 * (mesh.points + pane.displacement)[inner]
        assert np.abs(places - expected).max() < 2.0 * frames.box.step
        # The condensed body's are its own, not those at rest.
        assert np.abs(pane.displacement[inner]).max() > 1e-5, pane.name
