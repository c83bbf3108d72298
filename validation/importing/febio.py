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
from palpate.validation.importing.model import Body, Face, FixedNodes, Model, added
from palpate.validation.importing.xml_tree import Element, read_xml

VERSIONS = ("2.5", "3.0", "4.0")
# Sections without mechanics, and those that may be there if they are empty.
_HARMLESS = ("Output", "Globals")
_IF_EMPTY = (
    "Constraints", "Contact", "Initial", "Discrete", "Rigid", "MeshData", "MeshAdaptor",
    "Modifiers",
)  # fmt: skip
_STEPS = ("Step", "StepData")
_KNOWN = (
    "Module", "Control", "Material", "Geometry", "Mesh", "MeshDomains", "Boundary", "Loads",
    "LoadData",
)  # fmt: skip
# Of each law: ours, the constants that have to be there with our names, and what else may be.
_LAWS = {
    "neo-Hookean": (Law.NEO_HOOKEAN, {"E": "youngs_modulus", "v": "poissons_ratio"}, ()),
    "isotropic elastic": (
        Law.SAINT_VENANT_KIRCHHOFF, {"E": "youngs_modulus", "v": "poissons_ratio"}, (),
    ),
    "Mooney-Rivlin": (
        Law.MOONEY_RIVLIN_LOG, {"c1": "c10", "c2": "c01", "k": "bulk_modulus"},
        ("pressure_model", "laugon"),
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
# Attributes of a boundary condition or load that say nothing of mechanics.
_NAMES_OF_LOADS = ("name", "type", "node_set", "surface", "set", "bc", "elem_set")


def read_febio(path: Path) -> Model:
    """Read a .feb file.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
        FileFormatError: A file that cannot be opened.
    """
    root = read_xml(path)
    if root.tag != "febio_spec":
        raise root.refuse(f"<{root.tag}> is no FEBio model; that begins with <febio_spec>")
    version = root.attributes.get("version", "")
    if version not in VERSIONS:
        raise root.refuse(f"format version {version[:20]!r}; known are {', '.join(VERSIONS)}")
    sections, ignored = _sections(root)
    for module in sections.get("Module", []):
        kind = module.attributes.get("type", "solid")
        if kind != "solid":
            raise module.refuse(f'module type="{kind}"; a case is of "solid"')
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
        ignored=ignored,
    )
    _Loads(model, mesh, _LoadCurves(sections)).put(sections)
    return model


def _sections(root: Element) -> tuple[dict[str, list[Element]], list[str]]:
    """Sections by tag, those of the one step among them, and what is left out."""
    sections: dict[str, list[Element]] = {}
    ignored: list[str] = []
    steps: list[Element] = []

    def file(section: Element) -> None:
        if "from" in section.attributes:
            raise section.refuse(f"<{section.tag} from=...> stands in another file; put it in here")
        if section.tag in _STEPS:
            inner = section.children
            if section.tag == "Step" and inner and all(child.tag == "step" for child in inner):
                steps.extend(inner)
            elif inner:
                steps.append(section)
        elif section.tag in _HARMLESS:
            ignored.append(f"line {section.line} <{section.tag}>")
        elif section.tag in _IF_EMPTY:
            if section.children:
                raise section.children[0].refuse(
                    f"<{section.children[0].tag}> in <{section.tag}>: a case knows no such thing"
                )
        elif section.tag in _KNOWN:
            sections.setdefault(section.tag, []).append(section)
        else:
            raise section.refuse(f"section <{section.tag}> is not known here")

    for section in root:
        file(section)
    if len(steps) > 1:
        raise steps[1].refuse("a second step; a case has one state of loads: split the model")
    for step in steps:
        for section in step:
            file(section)
    return sections, ignored


def _materials(sections: dict[str, list[Element]]) -> tuple[list[Body], dict[str, int]]:
    """Materials, and the index of each by its id and by its name."""
    bodies: list[Body] = []
    names: dict[str, int] = {}
    for section in sections.get("Material", []):
        section.only("material")
        for material in section:
            for name in {material.attributes.get("id"), material.attributes.get("name")} - {None}:
                if name in names:
                    raise material.refuse(f"material {name!r} is there twice")
                names[str(name)] = len(bodies)
            bodies.append(_body(material))
    return bodies, names


def _body(material: Element) -> Body:
    kind = material.require("type")
    if kind not in _LAWS:
        raise material.refuse(f"material {kind!r}; known here are {', '.join(_LAWS)}")
    law, names, others = _LAWS[kind]
    material.only(*names, "density", *others)
    values: dict[str, float] = {}
    for name in (*names, "density"):
        found = material.child(name)
        if found is not None:
            if found.attributes.get("type", "const") != "const" or "lc" in found.attributes:
                raise found.refuse(f"<{name}> varies in space or time; a case has one number")
            values[name] = found.number()
        elif name in names:
            raise material.refuse(f"material {kind!r} needs <{name}>")
    model, augmented = material.child("pressure_model"), material.child("laugon")
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
        self.end_time = _end_time(sections.get("Control", []))
        self._curves: dict[str, Element] = {}
        for section in sections.get("LoadData", []):
            section.only("loadcurve", "load_controller")
            for curve in section:
                number = curve.require("id")
                if number in self._curves:
                    raise curve.refuse(f"load curve {number} is there twice")
                self._curves[number] = curve

    def factor(self, element: Element) -> float:
        """What an element's load curve multiplies it with at the end; 1 without one."""
        kind = element.attributes.get("type", "const")
        if kind not in ("const", "vector") or {"map", "node_data"} & element.attributes.keys():
            raise element.refuse(f"<{element.tag}> varies in space; a case has one number")
        number = element.attributes.get("lc")
        if number is None or number == "0":
            return 1.0
        if number not in self._curves:
            raise element.refuse(f"no load curve {number} in <LoadData>")
        return self._value(self._curves[number])

    def value(self, element: Element) -> float:
        """An element's number at the end."""
        return element.number() * self.factor(element)

    def _value(self, curve: Element) -> float:
        kind = curve.attributes.get("type", "loadcurve")
        if kind not in ("loadcurve", "linear", "step", "smooth"):
            raise curve.refuse(f"load controller {kind!r} is no load curve")
        listed = curve.child("points") or curve
        rows = [point.numbers() for point in listed if point.tag in ("point", "pt", "loadpoint")]
        if not rows or any(len(row) != 2 for row in rows):
            raise curve.refuse("a load curve needs points of two numbers each")
        times, values = np.array(rows).T
        if not (np.diff(times) > 0.0).all():
            raise curve.refuse("the times of a load curve have to increase")
        end = self.end_time
        near = int(np.abs(times - end).argmin())
        if abs(times[near] - end) <= 1e-9 * max(abs(end), 1.0):
            return float(values[near])
        if end > times[-1] or end < times[0]:
            if curve.word("extend", "extend", "constant").lower() != "constant":
                raise curve.refuse(f"the curve ends before the step does, at {end:g}; extend it")
            return float(values[-1] if end > times[-1] else values[0])
        usual = curve.attributes.get("type", "linear")
        kind = curve.word("interpolate", "interpolate", usual).lower()
        if kind not in ("linear", "loadcurve"):
            raise curve.refuse(f"a {kind} curve between its points; give it a point at {end:g}")
        return float(np.interp(end, times, values))


def _end_time(controls: list[Element]) -> float:
    """time_steps times step_size; 1 where nothing is said."""
    if len(controls) > 1:
        raise controls[1].refuse("<Control> is there twice; a case has one step")
    for control in controls:
        analysis = control.child("analysis")
        if analysis is not None:
            kind = analysis.attributes.get("type", analysis.text).lower()
            if kind not in ("static", "0", "steady-state"):
                raise analysis.refuse(f"analysis {kind!r}: an import is of equilibrium (static)")
        steps, size = control.child("time_steps"), control.child("step_size")
        if steps is not None and size is not None:
            return steps.number() * size.number()
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
        for condition in (c for section in sections.get("Boundary", []) for c in section):
            self._support(condition)
        for load in (c for section in sections.get("Loads", []) for c in section):
            load.only_attributes(*_NAMES_OF_LOADS)
            if load.tag not in readers:
                raise load.refuse(f"<{load.tag}> in <Loads>: a case knows no such load")
            readers[load.tag](load)

    def _support(self, condition: Element) -> None:
        if condition.tag not in ("bc", "fix", "prescribe"):
            raise condition.refuse(
                f"<{condition.tag}> in <Boundary>: a case knows no such condition"
            )
        condition.only_attributes(*_NAMES_OF_LOADS)
        kind = condition.attributes.get("type", "") if condition.tag == "bc" else condition.tag
        if kind in _FIXED:
            condition.only("dofs", "x_dof", "y_dof", "z_dof")
            components = dict.fromkeys(_fixed_axes(condition), 0.0)
        elif kind in _PRESCRIBED:
            condition.only("dof", "scale", "value", "relative")
            if condition.flag("relative"):
                raise condition.refuse("<relative>: a case moves points from rest")
            components = {_axis(condition): self._product(condition, "scale", "value")}
        else:
            raise condition.refuse(
                f"boundary condition {kind[:40]!r}: a case knows no such condition"
            )
        if components:
            name = condition.attributes.get("name", condition.attributes.get("node_set", "fixed"))
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
        kind = load.attributes.get("type", "nodal_load")
        nodes = self.mesh.nodes_of(load)
        if kind == "nodal_force":
            load.only("value", "shell_bottom")
            _no_shell(load)
            self.model.forces[nodes] += self._vector(load, "value")
        elif kind == "nodal_load":
            load.only("dof", "scale", "value", "relative")
            self.model.forces[nodes, _axis(load)] += self._product(load, "scale", "value")
        else:
            raise load.refuse(f"nodal load {kind[:40]!r}: a case knows no such load")

    def _surface(self, load: Element) -> None:
        kind = load.require("type")
        facets = self.mesh.facets_of(load)
        name = load.attributes.get("name", load.attributes["surface"])
        is_dead = load.flag("linear")
        _no_shell(load)
        pressure, traction = None, None
        if kind == "pressure":
            load.only("pressure", "value", "scale", "linear", "symmetric_stiffness", "shell_bottom")
            if (load.child("pressure") is None) == (load.child("value") is None):
                raise load.refuse("a pressure load needs one <pressure>")
            size = self._product(load, "pressure", "value", "scale")
            if is_dead:
                traction = _dead_pressure(self.model, load, facets, size)
            else:
                pressure = size
        elif kind == "traction":
            load.only("scale", "traction", "linear", "shell_bottom")
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
        if "elem_set" in load.attributes:
            raise load.refuse("a body load on a part; a case weighs the whole body")
        if kind == "const":
            load.only("x", "y", "z")
            parts = [load.child(name) for name in _AXES]
            value = np.array([0.0 if part is None else self.curves.value(part) for part in parts])
        elif kind == "body force":
            load.only("force")
            value = self._vector(load, "force")
        else:
            raise load.refuse(f"body load {kind[:40]!r}; known here are const and body force")
        self.model.acceleration = added(self.model.acceleration, -value)


def _no_shell(load: Element) -> None:
    if load.flag("shell_bottom"):
        raise load.refuse("<shell_bottom>: a case is of solids")


def _fixed_axes(condition: Element) -> list[int]:
    """2.5: bc="x,y,z"; 3.0: <dofs>; 4.0: <x_dof>1</x_dof>."""
    words = condition.word("dofs", "bc").replace(",", " ").split()
    flagged = [axis for name, axis in _AXES.items() if condition.flag(f"{name}_dof")]
    return [_axis_named(condition, word) for word in words] + flagged


def _axis(element: Element) -> int:
    return _axis_named(element, element.word("dof", "bc"))


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
