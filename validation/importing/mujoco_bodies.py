"""A flex that MuJoCo wrote out: a body with three slides for each point, the world for pins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.validation.importing.xml_tree import Element

_AXES = {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)}


def written_out(
    flex: Element, bodies: list[Element]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], float]:
    """Points, which are pinned, and the mass of all, of a <flex> below <deformable>.

    A flex spreads its mass evenly, so that each free body has that of one point.

    Raises:
        ImportRefusedError: Bodies that do more than slide along x, y and z.
    """
    if "node" in flex.attributes:
        raise flex.refuse("<flex node=...>: points that move by those of a coarser grid")
    places: dict[str, tuple[float, float, float]] = {}
    masses: dict[str, float] = {}
    for body in bodies:
        body.only_attributes("name", "pos")
        name = body.require("name")
        places[name] = body.vector(body.attributes.get("pos", "0 0 0"))
        masses[name] = _mass_of_slider(body)
    names = flex.require("body").split()
    vertices = np.array(flex.numbers(flex.attributes.get("vertex", "")), dtype=np.float64)
    if not len(vertices):
        vertices = np.zeros(3 * len(names))
    if len(vertices) != 3 * len(names):
        raise flex.refuse(f"{len(names)} bodies and {len(vertices) / 3:g} vertices")
    points = vertices.reshape(-1, 3)
    is_pinned = np.array([name == "world" for name in names])
    for row, name in enumerate(names):
        if name == "world":
            continue
        if name not in places:
            raise flex.refuse(f"<flex body=...>: no body {name[:40]!r} in the world")
        points[row] += places[name]
    used = [name for name in names if name != "world"]
    if len(set(used)) < len(used):
        raise flex.refuse("<flex body=...>: two points of one body, which then is rigid between")
    others = set(places) - set(used)
    if others:
        raise flex.refuse(f"body {min(others)[:40]!r} is no part of the flex: it may touch it")
    if not used:
        raise flex.refuse("a flex that is pinned everywhere")
    own = np.array([masses[name] for name in used])
    # MuJoCo writes six digits.
    if np.ptp(own) > 1e-5 * own.max():
        raise flex.refuse("bodies of different mass; a case has one density")
    return points, is_pinned, float(own.mean()) * len(names)


def _mass_of_slider(body: Element) -> float:
    body.only("inertial", "joint")
    axes = set()
    for joint in body:
        if joint.tag != "joint":
            continue
        joint.only_attributes("name", "type", "axis", "damping", "pos")
        if joint.attributes.get("type") != "slide":
            raise joint.refuse("a joint that is no slide")
        axes.add(joint.vector(joint.attributes.get("axis", "0 0 1")))
    if axes != _AXES:
        raise body.refuse("a point of a flex slides along x, y and z")
    inertial = body.child("inertial")
    if inertial is None:
        raise body.refuse("<body> needs <inertial mass=...>")
    (mass,) = inertial.numbers(inertial.require("mass"))[:1] or (0.0,)
    return mass
