"""FEBio's .feb, formats 2.5, 3.0 and 4.0: solids of tetrahedra at rest under loads.

By FEBio's user's manual (febio.org, "Free Format Input") and, where a sign or an energy matters,
its sources (github.com/febiosoftware/FEBio, version 4): "neo-Hookean" is mu/2 (I - 3) - mu ln J +
lmbda/2 (ln J)^2 (FENeoHookean.cpp), "isotropic elastic" is Saint-Venant-Kirchhoff
(FEIsotropicElastic.cpp: S = lmbda tr(E) I + 2 mu E), "Mooney-Rivlin" is ours where pressure_model
is Abaqus, U = k/2 (J - 1)^2 (FEUncoupledMaterial.h). A body force pushes the other way round:
- density times its value (FEElasticSolidDomain.cpp, BodyForce).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.material_law import Law
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.importing.febio_mesh import FebioMesh
from palpate.validation.importing.model import (
    Body,
    Face,
    FixedNodes,
    Model,
    Source,
    UnitSystem,
    added,
)
from palpate.validation.importing.understood import harmless, left_out
from palpate.validation.importing.xml_tree import Element, read_xml

VERSIONS = ("2.5", "3.0", "4.0")
_STEPS = ("Step", "StepData")
_KNOWN = (
    "Module", "Control", "Material", "Geometry", "Mesh", "MeshDomains", "Boundary", "Loads",
    "LoadData",
)  # fmt: skip
# "Module Section" of the user's manual; time is in seconds in each.
_UNITS = {
    "SI": UnitSystem.METRE_NEWTON,
    "mm-N-s": UnitSystem.MILLIMETRE_NEWTON,
    "mm-kg-s": UnitSystem.MILLIMETRE_MILLINEWTON,
}
# Of each law: ours, and the constants that have to be there with our names.
_LAWS = {
    "neo-Hookean": (Law.NEO_HOOKEAN, {"E": "youngs_modulus", "v": "poissons_ratio"}),
    "isotropic elastic": (
        Law.SAINT_VENANT_KIRCHHOFF, {"E": "youngs_modulus", "v": "poissons_ratio"},
    ),
    "Mooney-Rivlin": (
        Law.MOONEY_RIVLIN_LOG, {"c1": "c10", "c2": "c01", "k": "bulk_modulus"},
    ),
}  # fmt: skip
# Models of a law with a separate volume part: U = k/2 (ln J)^2, FEBio's own, or k/2 (J - 1)^2.
_PRESSURE_MODELS = {
    "0": Law.MOONEY_RIVLIN_LOG,
    "default": Law.MOONEY_RIVLIN_LOG,
    "2": Law.MOONEY_RIVLIN,
    "abaqus": Law.MOONEY_RIVLIN,
}
_AXES = {"x": 0, "y": 1, "z": 2}
_FIXED = ("fix", "zero displacement")
_PRESCRIBED = ("prescribe", "prescribed displacement")


def read_febio(path: Path) -> Model:
    """Read a .feb file.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
        FileFormatError: A file that cannot be opened.
    """
    root = read_xml(path)
    if root.tag != "febio_spec":
        raise root.refuse(f"<{root.tag}> is no FEBio model; that begins with <febio_spec>")
    root.mark()
    version = root.word("version")
    if version not in VERSIONS:
        raise root.refuse(f"format version {version[:20]!r}; known are {', '.join(VERSIONS)}")
    sections = _sections(root)
    for other in sections.get("Mesh" if version == "2.5" else "Geometry", []):
        raise other.refuse(f"<{other.tag}> is of another version than {version}")
    mesh = FebioMesh(sections, version)
    bodies, body_names = _materials(sections)
    model = Model(
        path,
        f"FEBio {version}",
        mesh.nodes,
        mesh.corners,
        mesh.middles,
        bodies,
        _bodies_of_cells(mesh.material_of, body_names),
        mesh.labels,
        notes=mesh.notes,
        units=_units(sections),
    )
    _Loads(model, mesh, _LoadCurves(sections)).put(sections)
    model.ignored += left_out([root], harmless("febio"))
    return model


def _sections(root: Element) -> dict[str, list[Element]]:
    """Sections by tag, those of the one step among them."""
    sections: dict[str, list[Element]] = {}
    steps: list[Element] = []
    for section in root.each(*_KNOWN, *_STEPS):
        if section.tag not in _STEPS:
            sections.setdefault(section.tag, []).append(section)
        else:
            steps += list(section.each("step")) or ([section] if section.children else [])
    if len(steps) > 1:
        raise steps[1].refuse("a second step; a case has one state of loads: split the model")
    for section in (section for step in steps for section in step.each(*_KNOWN)):
        sections.setdefault(section.tag, []).append(section)
    for section in (section for found in sections.values() for section in found):
        if section.get("from") is not None:
            raise section.refuse(f"<{section.tag} from=...> stands in another file; put it in here")
    return sections


def _units(sections: dict[str, list[Element]]) -> tuple[UnitSystem, Source] | None:
    """The units that <Module> states."""
    found = None
    for module in sections.get("Module", []):
        kind, units = module.word("type", "solid"), module.child("units")
        if kind != "solid":
            raise module.refuse(f'module type="{kind}"; a case is of "solid"')
        if units is not None:
            if units.text not in _UNITS:
                raise units.refuse(f"units {units.text[:40]!r}; known are {', '.join(_UNITS)}")
            found = _UNITS[units.text], units.source
    return found


def _materials(sections: dict[str, list[Element]]) -> tuple[list[Body], dict[str, int]]:
    """Materials, and the index of each by its id and by its name."""
    bodies: list[Body] = []
    names: dict[str, int] = {}
    for section in sections.get("Material", []):
        for material in section.each("material"):
            for name in {material.get("id"), material.get("name")} - {None}:
                if name in names:
                    raise material.refuse(f"material {name!r} is there twice")
                names[str(name)] = len(bodies)
            bodies.append(_body(material))
    return bodies, names


def _body(material: Element) -> Body:
    kind = material.require("type")
    if kind not in _LAWS:
        raise material.refuse(f"material {kind!r}; known here are {', '.join(_LAWS)}")
    law, names = _LAWS[kind]
    values: dict[str, float] = {}
    for name in (*names, "density"):
        found = material.child(name)
        if found is not None:
            if found.word("type", "const") != "const" or "lc" in found.values:
                raise found.refuse(f"<{name}> varies in space or time; a case has one number")
            values[name] = found.number()
        elif name in names:
            raise material.refuse(f"material {kind!r} needs <{name}>")
    is_split = kind == "Mooney-Rivlin"
    model = material.child("pressure_model") if is_split else None
    augmented = material.child("laugon") if is_split else None
    if model is not None:
        if model.text.lower() not in _PRESSURE_MODELS:
            raise model.refuse(
                "known here are default, U = k/2 (ln J)^2, and Abaqus, U = k/2 (J - 1)^2"
            )
        law = _PRESSURE_MODELS[model.text.lower()]
    if augmented is not None and augmented.text.lower() not in ("0", "off", "false"):
        raise augmented.refuse(
            "<laugon>: an augmented bulk modulus has no end; a case has a number"
        )
    constants = {ours: values[theirs] for theirs, ours in names.items()}
    return Body({"law": str(law), **constants}, values.get("density"), material.source)


def _bodies_of_cells(
    material_of: list[tuple[Element, str, int]], names: dict[str, int]
) -> NDArray[np.int64]:
    """Index of each cell's material, (num_cells,)."""
    rows = []
    for element, name, count in material_of:
        if name not in names:
            raise element.refuse(f"no material {name[:40]!r} (known: {', '.join(names) or 'none'})")
        rows.append(np.full(count, names[name], dtype=np.int64))
    return np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)


class _LoadCurves:
    """Curves by their number, read at the end of the one step: the state that a case asks for."""

    def __init__(self, sections: dict[str, list[Element]]) -> None:
        end_time = _end_time(sections.get("Control", []))
        self._factors: dict[str, float] = {}
        for section in sections.get("LoadData", []):
            for curve in section.each("loadcurve", "load_controller"):
                number = curve.require("id")
                if number in self._factors:
                    raise curve.refuse(f"load curve {number} is there twice")
                self._factors[number] = _value(curve, end_time)

    def factor(self, element: Element) -> float:
        """What an element's load curve multiplies it with at the end; 1 without one."""
        kind = element.word("type", "const")
        if kind not in ("const", "vector") or {"map", "node_data"} & element.values.keys():
            raise element.refuse(f"<{element.tag}> varies in space; a case has one number")
        number = element.word("lc", "0")
        if number != "0" and number not in self._factors:
            raise element.refuse(f"no load curve {number} in <LoadData>")
        return 1.0 if number == "0" else self._factors[number]

    def value(self, element: Element) -> float:
        """An element's number at the end."""
        return element.number() * self.factor(element)


def _value(curve: Element, end: float) -> float:
    """A curve at the end of the step."""
    is_old = curve.tag == "loadcurve"
    kind = curve.word("type", "linear" if is_old else "loadcurve")
    if not is_old and kind != "loadcurve":
        raise curve.refuse(f"load controller {kind!r} is no load curve")
    kind = kind if is_old else curve.said("interpolate", "linear").lower()
    extend = (curve.word if is_old else curve.said)("extend", "constant").lower()
    listed = curve.child("points") or curve
    rows = [point.numbers() for point in listed.each("point", "pt", "loadpoint")]
    if not rows or any(len(row) != 2 for row in rows):
        raise curve.refuse("a load curve needs points of two numbers each")
    times, values = np.array(rows).T
    if not (np.diff(times) > 0.0).all():
        raise curve.refuse("the times of a load curve have to increase")
    # These two go through their points; others jump there, or pass them by (PointCurve.cpp).
    if kind not in ("linear", "smooth"):
        raise curve.refuse(f"a {kind[:40]} curve; known are linear and smooth")
    near = int(np.abs(times - end).argmin())
    if abs(times[near] - end) <= 1e-9 * max(abs(end), 1.0):
        return float(values[near])
    if not times[0] <= end <= times[-1]:
        if extend != "constant":
            raise curve.refuse(f"the curve ends before the step does, at {end:g}; extend it")
    elif kind != "linear":
        raise curve.refuse(f"a {kind} curve between its points; give it a point at {end:g}")
    return float(np.interp(end, times, values))


def _end_time(controls: list[Element]) -> float:
    """time_steps times step_size; 1 where nothing is said: ten of 0.1 (FEAnalysis.cpp)."""
    if len(controls) > 1:
        raise controls[1].refuse("<Control> is there twice; a case has one step")
    for control in controls:
        analysis = control.child("analysis")
        if analysis is not None:
            # An attribute in 2.5, the text after that: the other is not looked at.
            for kind in {analysis.word("type").lower(), analysis.text.lower()} - {""}:
                if kind not in ("static", "0", "steady-state"):
                    raise analysis.refuse(
                        f"analysis {kind!r}: an import is of equilibrium (static)"
                    )
        steps, size = control.child("time_steps"), control.child("step_size")
        if (steps is None) != (size is None):
            raise control.refuse("<time_steps> and <step_size>: give both, or none of them")
        if steps is not None and size is not None:
            count, length = steps.number(), size.number()
            if count < 1.0 or count % 1.0 or not length > 0.0:
                raise steps.refuse(f"{count:g} steps of {length:g}: whole steps above 0 are needed")
            return count * length
    return 1.0


class _Loads:
    """Boundary conditions and loads, put into a model whose mesh is known."""

    def __init__(self, model: Model, mesh: FebioMesh, curves: _LoadCurves) -> None:
        self.model, self.mesh, self.curves = model, mesh, curves

    def put(self, sections: dict[str, list[Element]]) -> None:
        """Read them all.

        Raises:
            ImportRefusedError: What a case cannot say, with its line.
        """
        readers = {
            "nodal_load": self._nodal,
            "surface_load": self._surface,
            "body_load": self._body,
        }
        for section in sections.get("Boundary", []):
            for condition in section.each("bc", "fix", "prescribe"):
                self._support(condition)
        for section in sections.get("Loads", []):
            for load in section.each(*readers):
                readers[load.tag](load)

    def _support(self, condition: Element) -> None:
        kind = condition.word("type") if condition.tag == "bc" else condition.tag
        if kind in _FIXED:
            components = dict.fromkeys(_fixed_axes(condition, kind), 0.0)
        elif kind in _PRESCRIBED:
            if condition.flag("relative"):
                raise condition.refuse("<relative>: a case moves points from rest")
            axis = _axis(condition, is_old=condition.tag == "prescribe")
            components = {axis: self._product(condition, "scale", "value")}
        else:
            raise condition.refuse(
                f"boundary condition {kind[:40]!r}: a case knows no such condition"
            )
        if components:
            name = condition.get("name") or condition.values.get("node_set", "fixed")
            nodes = self.mesh.nodes_of(condition)
            self.model.supports.append(FixedNodes(name, nodes, components, condition.source))

    def _product(self, element: Element, *tags: str) -> float:
        """The product of these children with their curves; 1 for one that is not there."""
        found = [child for tag in tags if (child := element.child(tag)) is not None]
        if not found:
            raise element.refuse(f"<{element.tag}> needs <value> or <scale>")
        return float(np.prod([self.curves.value(child) for child in found]))

    def _vector(self, load: Element, tag: str) -> Points:
        """A child that has to be there, times its curve."""
        found = load.child(tag)
        if found is None:
            raise load.refuse(f"<{load.tag}> needs <{tag}>")
        return self.curves.factor(found) * np.array(found.vector())

    def _nodal(self, load: Element) -> None:
        kind = load.word("type", "nodal_load")
        self.model.pushed_at = self.model.pushed_at or load.source
        nodes = self.mesh.nodes_of(load)
        if kind == "nodal_force":
            _no_shell(load)
            self.model.forces[nodes] += self._vector(load, "value")
        elif kind == "nodal_load":
            if load.flag("relative"):
                raise load.refuse("<relative>: a case has the whole force")
            axis = _axis(load, is_old="type" not in load.values)
            self.model.forces[nodes, axis] += self._product(load, "scale", "value")
        else:
            raise load.refuse(f"nodal load {kind[:40]!r}: a case knows no such load")

    def _surface(self, load: Element) -> None:
        kind = load.require("type")
        facets = self.mesh.facets_of(load)
        name = load.get("name") or load.require("surface")
        is_dead = load.flag("linear")
        _no_shell(load)
        pressure, traction = None, None
        if kind == "pressure":
            if (load.child("pressure") is None) == (load.child("value") is None):
                raise load.refuse("a pressure load needs one <pressure>")
            size = self._product(load, "pressure", "value", "scale")
            if is_dead:
                traction = _dead_pressure(self.model, load, facets, size)
            else:
                pressure = size
        elif kind == "traction":
            if not is_dead:
                raise (load.child("linear") or load).refuse(
                    "a traction by deformed area, FEBio's default; a case's is by rest area: "
                    "<linear>1</linear>"
                )
            factor = 1.0 if load.child("scale") is None else self._product(load, "scale")
            traction = added(None, factor * self._vector(load, "traction"))
        else:
            raise load.refuse(f"surface load {kind[:40]!r}; known here are pressure and traction")
        self.model.faces.append(Face(name, facets, load.source, pressure, traction))

    def _body(self, load: Element) -> None:
        """Minus the value is the acceleration; of the whole body alone."""
        kind = load.require("type")
        if "elem_set" in load.values:
            raise load.refuse("a body load on a part; a case weighs the whole body")
        if kind == "const":
            parts = [load.child(name) for name in _AXES]
            value = np.array([0.0 if part is None else self.curves.value(part) for part in parts])
        elif kind == "body force":
            value = self._vector(load, "force")
        else:
            raise load.refuse(f"body load {kind[:40]!r}; known here are const and body force")
        self.model.acceleration = added(self.model.acceleration, -value)


def _no_shell(load: Element) -> None:
    if load.flag("shell_bottom"):
        raise load.refuse("<shell_bottom>: a case is of solids")


def _fixed_axes(condition: Element, kind: str) -> list[int]:
    """2.5: bc="x,y,z"; 3.0: <dofs>; 4.0: <x_dof>1</x_dof>."""
    if kind == "zero displacement":
        return [axis for name, axis in _AXES.items() if condition.flag(f"{name}_dof")]
    words = condition.word("bc") if condition.tag == "fix" else condition.said("dofs")
    return [_axis_named(condition, word) for word in words.replace(",", " ").split()]


def _axis(element: Element, *, is_old: bool) -> int:
    return _axis_named(element, element.word("bc") if is_old else element.said("dof"))


def _axis_named(element: Element, word: str) -> int:
    if word not in _AXES:
        raise element.refuse(f"degree of freedom {word[:20]!r}; solids of a case have x, y and z")
    return _AXES[word]


def _dead_pressure(
    model: Model, load: Element, facets: NDArray[np.int64], pressure: float
) -> tuple[float, float, float]:
    """The traction of a pressure by rest area on a flat face."""
    normals = area_vectors(model.nodes, facets)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    if not sizes.all():
        raise load.refuse("a facet of no area")
    normals /= sizes
    if np.abs(normals - normals[0]).max() > 1e-9:
        raise load.refuse(
            "<linear>: a pressure that stays by rest area on a face that is not flat; a case's "
            "pressure follows the body, and its traction is uniform or affine"
        )
    return added(None, -pressure * normals[0])
