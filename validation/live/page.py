"""The live page: one HTML text with its style and script, which fetches nothing but its socket."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    rotation_matrix,
)
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case import Case
from palpate.validation.live.simulation import Simulation
from palpate.validation.report.environment import (
    page_environment,
    policy_hash,
    script_of,
    template_text,
)
from palpate.validation.report.viewer_data import colour_table, packed

_SCRIPTS = ("drawing.js", "touch.js")
_STYLE = "touch.css"


def page_text(case: Case, simulation: Simulation) -> str:
    """The page of a case; every text in it is escaped."""
    script, _ = script_of(*_SCRIPTS)
    return (
        page_environment()
        .get_template("touch.html.j2")
        .render(
            case=case,
            panes=[pane.name for pane in simulation.panes],
            loads=len(case.spec.load),
            scene=Markup(_scene(simulation)),
            style=Markup(template_text(_STYLE)),
            script=script,
        )
    )


def page_policy(socket: str) -> str:
    """Content-Security-Policy: our script, our style, our socket, and nothing else."""
    _, script = script_of(*_SCRIPTS)
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src '{script}'",
            f"style-src '{policy_hash(template_text(_STYLE))}'",
            f"connect-src {socket}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


def _scene(simulation: Simulation) -> str:
    """The body at rest and the tool, lengths in mm, as JSON that is safe in a <script> element."""
    problem, surface = simulation.live.problem, simulation.surface
    points = problem.mesh.points[surface.used] * 1e3
    marks = np.zeros(problem.mesh.num_points, dtype=np.int8)
    for support in problem.supports:
        marks[support.points] = 1
    shape = tool_surface(problem.tools[0], float(np.ptp(points, axis=0).max()) * 1e-3)
    scene: dict[str, Any] = {
        "points": packed(points, np.float32),
        "facets": packed(surface.facets, np.uint32),
        "marks": packed(marks[surface.used], np.int8),
        "radius": 0.5 * float(np.linalg.norm(np.ptp(points, axis=0))),
        "axis": int(np.argmin(np.ptp(points, axis=0))),
        "colours": colour_table(),
        "tool": {
            "points": packed(shape.points * 1e3, np.float32),
            "facets": packed(shape.facets, np.uint32),
        },
    }
    return json.dumps(scene, allow_nan=False).replace("<", "\\u003c")


def tool_surface(tool: RigidTool, size: float) -> TriSurface:
    """A tool as it is drawn [m], turned as its path begins; a plane as a flat box of a size."""
    shape = tool.shape
    match shape:
        case SphereShape():
            drawn = shape_sphere(shape.radius, edge_length=0.2 * shape.radius)
        case CapsuleShape():
            drawn = shape_sphere(shape.radius, edge_length=0.2 * shape.radius)
            places = drawn.points.copy()
            places[:, 2] += np.where(places[:, 2] > 0.0, 1.0, -1.0) * shape.half_length
            drawn = TriSurface(places, drawn.facets)
        case BoxShape():
            a, b, c = (2.0 * width for width in shape.half_widths)
            drawn = _centred(shape_box((a, b, c), edge_length=max(a, b, c)), (0.5, 0.5, 0.5))
        case PlaneShape():
            flat = (size, size, 0.05 * size)
            drawn = _centred(shape_box(flat, edge_length=size), (0.5, 0.5, 1.0))
        case _:
            drawn = shape.surface
    turned: NDArray[np.float64] = drawn.points @ rotation_matrix(tool.path.rotations[0]).T
    return TriSurface(turned, drawn.facets)


def _centred(surface: TriSurface, parts: tuple[float, float, float]) -> TriSurface:
    """With a part of its extent below the origin along each axis."""
    low, extent = surface.points.min(axis=0), np.ptp(surface.points, axis=0)
    return TriSurface(surface.points - low - extent * np.array(parts), surface.facets)
