"""Boundary conditions and loads of FEBio's <Boundary> and <Loads>, formats 2.5, 3.0 and 4.0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.validation.importing.febio_mesh import FebioMesh
from palpate.validation.importing.febio_time import LoadCurves
from palpate.validation.importing.model import Face, Hold, Model
from palpate.validation.importing.xml_tree import Element

_AXES = {"x": 0, "y": 1, "z": 2}
_FIXED = ("fix", "zero displacement")
_PRESCRIBED = ("prescribe", "prescribed displacement")
# Elements in a boundary condition or load that say nothing of mechanics.
_NAMES_OF_LOADS = ("name", "type", "node_set", "surface", "set", "bc", "elem_set")


def read_acting(
    model: Model, mesh: FebioMesh, sections: dict[str, list[Element]], curves: LoadCurves
) -> None:
    """Put what holds and pushes into a model.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
    """
    for section in sections.get("Boundary", []):
        for condition in section:
            _hold(model, mesh, condition, curves)
    for section in sections.get("Loads", []):
        for load in section:
            load.only_attributes(*_NAMES_OF_LOADS)
            match load.tag:
                case "nodal_load":
                    _nodal(model, mesh, load, curves)
                case "surface_load":
                    _surface(model, mesh, load, curves)
                case "body_load":
                    _body(model, load, curves)
                case _:
                    raise load.refuse(f"<{load.tag}> in <Loads>: a case knows no such load")


def _hold(model: Model, mesh: FebioMesh, condition: Element, curves: LoadCurves) -> None:
    if condition.tag not in ("bc", "fix", "prescribe"):
        raise condition.refuse(f"<{condition.tag}> in <Boundary>: a case knows no such condition")
    condition.only_attributes(*_NAMES_OF_LOADS)
    kind = condition.attributes.get("type", "") if condition.tag == "bc" else condition.tag
    if kind in _FIXED:
        condition.only("dofs", "x_dof", "y_dof", "z_dof")
        components = dict.fromkeys(_fixed_axes(condition), 0.0)
    elif kind in _PRESCRIBED:
        condition.only("dof", "scale", "value", "relative")
        relative = condition.child("relative")
        if relative is not None and relative.number() != 0.0:
            raise relative.refuse("<relative>: a case moves points from their rest place")
        components = {_axis(condition): _product(condition, curves)}
    else:
        raise condition.refuse(f"boundary condition {kind[:40]!r}: a case knows no such condition")
    if not components:
        return
    name = condition.attributes.get("name", condition.attributes.get("node_set", "held"))
    model.holds.append(Hold(name, mesh.nodes_of(condition), components, condition.place))


def _fixed_axes(condition: Element) -> list[int]:
    """2.5: bc="x,y,z"; 3.0: <dofs>; 4.0: <x_dof>1</x_dof>."""
    axes = []
    listed = condition.child("dofs")
    text = listed.text if listed is not None else condition.attributes.get("bc", "")
    for word in text.replace(",", " ").split():
        axes.append(_axis_named(condition, word))
    for name, axis in _AXES.items():
        flag = condition.child(f"{name}_dof")
        if flag is not None and flag.number() != 0.0:
            axes.append(axis)
    return axes


def _axis(element: Element) -> int:
    listed = element.child("dof")
    text = listed.text if listed is not None else element.attributes.get("bc", "")
    return _axis_named(element, text)


def _axis_named(element: Element, word: str) -> int:
    if word not in _AXES:
        raise element.refuse(f"degree of freedom {word[:20]!r}; solids of a case have x, y and z")
    return _AXES[word]


def _product(element: Element, curves: LoadCurves) -> float:
    """Its scale times its value, each with its curve; 1 for the one that is not there."""
    found = [child for tag in ("scale", "value") if (child := element.child(tag)) is not None]
    if not found:
        raise element.refuse(f"<{element.tag}> needs <value> or <scale>")
    return float(np.prod([curves.value(child) for child in found]))


def _nodal(model: Model, mesh: FebioMesh, load: Element, curves: LoadCurves) -> None:
    kind = load.attributes.get("type", "nodal_load")
    nodes = mesh.nodes_of(load)
    if kind == "nodal_force":
        load.only("value", "shell_bottom")
        _no_shell(load)
        value = load.child("value")
        if value is None:
            raise load.refuse("<nodal_load> needs <value>")
        model.forces[nodes] += curves.factor(value) * np.array(value.vector())
        return
    if kind != "nodal_load":
        raise load.refuse(f"nodal load {kind[:40]!r}: a case knows no such load")
    load.only("dof", "scale", "value", "relative")
    model.forces[nodes, _axis(load)] += _product(load, curves)


def _no_shell(load: Element) -> None:
    flag = load.child("shell_bottom")
    if flag is not None and flag.number() != 0.0:
        raise flag.refuse("<shell_bottom>: a case is of solids")


def _surface(model: Model, mesh: FebioMesh, load: Element, curves: LoadCurves) -> None:
    kind = load.require("type")
    facets = mesh.facets_of(load)
    name = load.attributes.get("name", load.attributes["surface"])
    linear = load.child("linear")
    is_dead = linear is not None and linear.number() != 0.0
    if kind == "pressure":
        load.only("pressure", "value", "scale", "linear", "symmetric_stiffness", "shell_bottom")
        _no_shell(load)
        given = [c for tag in ("pressure", "value") if (c := load.child(tag)) is not None]
        if len(given) != 1:
            raise load.refuse("a pressure load needs one <pressure>")
        scale = load.child("scale")
        pressure = curves.value(given[0]) * (1.0 if scale is None else curves.value(scale))
        if is_dead:
            traction = _dead_pressure(model, load, facets, pressure)
            model.faces.append(Face(name, facets, load.place, traction=traction))
        else:
            model.faces.append(Face(name, facets, load.place, pressure=pressure))
        return
    if kind != "traction":
        raise load.refuse(f"surface load {kind[:40]!r}; known here are pressure and traction")
    load.only("scale", "traction", "linear", "shell_bottom")
    _no_shell(load)
    if not is_dead:
        raise (linear or load).refuse(
            "a traction by deformed area, FEBio's default; a case's is by rest area: "
            "<linear>1</linear>"
        )
    given = [c for c in load if c.tag == "traction"]
    if len(given) != 1:
        raise load.refuse("a traction load needs one <traction>")
    scale = load.child("scale")
    factor = curves.factor(given[0]) * (1.0 if scale is None else curves.value(scale))
    x, y, z = (factor * t for t in given[0].vector())
    model.faces.append(Face(name, facets, load.place, traction=(x, y, z)))


def _dead_pressure(
    model: Model, load: Element, facets: NDArray[np.int64], pressure: float
) -> tuple[float, float, float]:
    """The traction of a pressure by rest area on a flat face."""
    a, b, c = (model.nodes[facets[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    if not sizes.all():
        raise load.refuse("a facet of no area")
    normals /= sizes
    if np.abs(normals - normals[0]).max() > 1e-9:
        raise load.refuse(
            "<linear>: a pressure that stays by rest area on a face that is not flat; a case's "
            "pressure follows the body, and its traction is uniform or affine"
        )
    x, y, z = (-pressure * n for n in normals[0].tolist())
    return x, y, z


def _body(model: Model, load: Element, curves: LoadCurves) -> None:
    """Minus the value is the acceleration; of the whole body alone."""
    kind = load.require("type")
    if "elem_set" in load.attributes:
        raise load.refuse("a body load on a part; a case weighs the whole body")
    if kind == "const":
        load.only("x", "y", "z")
        parts = [load.child(name) for name in _AXES]
        value = [0.0 if part is None else curves.value(part) for part in parts]
    elif kind == "body force":
        load.only("force")
        force = load.child("force")
        if force is None:
            raise load.refuse("a body force needs <force>")
        factor = curves.factor(force)
        value = [factor * f for f in force.vector()]
    else:
        raise load.refuse(f"body load {kind[:40]!r}; known here are const and body force")
    known = model.acceleration or (0.0, 0.0, 0.0)
    x, y, z = (a - v for a, v in zip(known, value, strict=True))
    model.acceleration = (x, y, z)
