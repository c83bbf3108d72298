"""Small cells where the page's tool first touches the body, and contact over facets.

They are a grade of the case's mesh: what is recorded or judged has it in its file.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from pydantic import ValidationError

from palpate.fastsim.contact.contact_law import half_thickness
from palpate.fastsim.grading.near_tools import PART_OF_CONTACT, first_touched
from palpate.meshes.problem import Element
from palpate.meshes.rigid_tool import ContactRule
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.load import CaseError, explain
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.writing import case_text
from palpate.validation.live.live_case import Touch, live_case

# How deep a tool is expected to go, as a part of its radius.
_DEEP = 0.2


def near_touch(case: Case, touch: Touch, edge: float | None = None) -> tuple[Case, Touch]:
    """The case with small cells where the tool, moved straight in from its start, first touches.

    Args:
        case: As it was read.
        touch: How it is touched.
        edge: Length of edges there [m]; where None, half of the radius of contact of a tool that
            is pressed in by a fifth of its radius.

    Returns:
        The case, its mesh graded to that length in a ball of the radius of contact, and the touch,
        with contact over facets, which a box, whose edges no averages follow, has at vertices.

    Raises:
        InputError: The case cannot be touched, or has a mesh that is not graded.
    """
    plain = live_case(case, touch, (Element.LINEAR,))
    (tool,) = plain.problem.tools
    of_contact = math.sqrt(_DEEP) * half_thickness(tool.shape)
    position = first_touched(plain.problem, -plain.outwards)
    grade = {
        "ball": {
            "center": (position / plain.unit).round(6).tolist(),
            "radius": float(f"{of_contact / plain.unit:.4g}"),
        },
        "smallest": float(f"{(edge or PART_OF_CONTACT * of_contact) / plain.unit:.4g}"),
    }
    data: dict[str, Any] = parse_toml(case.text)
    mesh = data.setdefault("mesh", {})
    mesh["grade"] = [*mesh.get("grade", []), grade]
    table = {k: v for k, v in plain.data["tool"][0].items() if k != "pose"}
    if table["shape"] != "box":
        table["contact"] = ContactRule.FACETS.value
    if touch.tool is not None or not case.spec.tool:
        touch = dataclasses.replace(touch, tool=table)
    else:
        own = data["tool"]
        (own[0] if isinstance(own, list) else own)["contact"] = table.get("contact", "vertices")
    try:
        spec = CaseSpec.model_validate(data)
    except ValidationError as error:
        raise CaseError(explain(case.path, case.text, data, error)) from error
    return dataclasses.replace(case, spec=spec, text=case_text(data)), touch
