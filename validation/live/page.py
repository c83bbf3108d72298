"""The live page: one HTML text with its style and script, which fetches nothing but its socket."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from markupsafe import Markup

from palpate.meshes.rigid_tool import rotation_matrix
from palpate.validation.case import Case
from palpate.validation.live.simulation import Simulation
from palpate.validation.report.html import (
    page_environment,
    policy_hash,
    script_of,
    template_text,
)
from palpate.validation.report.loads_and_tools import tool_surface
from palpate.validation.report.viewer import colour_table, packed

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
    tool = problem.tools[0]
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    own, facets = tool_surface(tool, size, fineness=0.2)
    turned = own @ rotation_matrix(tool.path.rotations[0]).T
    scene: dict[str, Any] = {
        "points": packed(points, np.float32),
        "facets": packed(surface.facets, np.uint32),
        "marks": packed(marks[surface.used], np.int8),
        "radius": 0.5 * float(np.linalg.norm(np.ptp(points, axis=0))),
        "axis": int(np.argmin(np.ptp(points, axis=0))),
        "colours": colour_table(),
        "tool": {
            "points": packed(turned * 1e3, np.float32),
            "facets": packed(facets, np.uint32),
        },
    }
    return json.dumps(scene, allow_nan=False).replace("<", "\\u003c")
