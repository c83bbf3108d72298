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

from palpate.meshes.material_law import Law
from palpate.validation.importing.febio_acting import read_acting
from palpate.validation.importing.febio_mesh import read_mesh_sections
from palpate.validation.importing.febio_time import LoadCurves
from palpate.validation.importing.model import Body, Model
from palpate.validation.importing.xml_tree import Element, read_xml

VERSIONS = ("2.5", "3.0", "4.0")
# Sections without mechanics, and those that may be there if they are empty.
_HARMLESS = ("Output", "Globals")
_IF_EMPTY = (
    "Constraints", "Contact", "Initial", "Discrete", "Rigid", "MeshData", "MeshAdaptor",
    "Modifiers",
)  # fmt: skip
_STEPS = ("Step", "StepData")


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
    _require_solid(sections)
    mesh = read_mesh_sections(sections, version)
    bodies, body_names = _materials(sections)
    curves = LoadCurves(sections)
    model = Model(
        path,
        f"FEBio {version}",
        mesh.nodes,
        mesh.corners,
        mesh.middles,
        bodies,
        _bodies_of_cells(mesh.material_of, body_names),
        mesh.labels,
        told=mesh.told,
        ignored=ignored,
    )
    read_acting(model, mesh, sections, curves)
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


_KNOWN = (
    "Module", "Control", "Material", "Geometry", "Mesh", "MeshDomains", "Boundary", "Loads",
    "LoadData",
)  # fmt: skip


def _require_solid(sections: dict[str, list[Element]]) -> None:
    for module in sections.get("Module", []):
        kind = module.attributes.get("type", "solid")
        if kind != "solid":
            raise module.refuse(f'module type="{kind}"; a case is of "solid"')


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


# Parameters of each law, those that have to be there first.
_PARAMETERS = {
    "neo-Hookean": (("E", "v"), ("density",)),
    "isotropic elastic": (("E", "v"), ("density",)),
    "Mooney-Rivlin": (("c1", "c2", "k"), ("density", "pressure_model", "laugon")),
}
_LAWS = {
    "neo-Hookean": Law.NEO_HOOKEAN,
    "isotropic elastic": Law.SAINT_VENANT_KIRCHHOFF,
}
# Of a law whose volume stands apart: U = k/2 (ln J)^2, which is FEBio's own, or k/2 (J - 1)^2.
_PRESSURE_MODELS = {
    "0": Law.MOONEY_RIVLIN_LOG,
    "default": Law.MOONEY_RIVLIN_LOG,
    "2": Law.MOONEY_RIVLIN,
    "abaqus": Law.MOONEY_RIVLIN,
}


def _body(material: Element) -> Body:
    kind = material.require("type")
    if kind not in _PARAMETERS:
        raise material.refuse(f"material {kind!r}; known here are {', '.join(_PARAMETERS)}")
    needed, others = _PARAMETERS[kind]
    material.only(*needed, *others)
    values: dict[str, float] = {}
    for name in (*needed, "density"):
        found = material.child(name)
        if found is None:
            if name in needed:
                raise material.refuse(f"material {kind!r} needs <{name}>")
            continue
        if found.attributes.get("type", "const") != "const" or "lc" in found.attributes:
            raise found.refuse(f"<{name}> varies in place or time; a case has one number for it")
        values[name] = found.number()
    density = values.get("density")
    if kind != "Mooney-Rivlin":
        constants = {"youngs_modulus": values["E"], "poissons_ratio": values["v"]}
        return Body({"law": str(_LAWS[kind]), **constants}, density, material.place)
    model = material.child("pressure_model")
    law = Law.MOONEY_RIVLIN_LOG
    if model is not None:
        known = _PRESSURE_MODELS.get(model.text.lower())
        if known is None:
            raise model.refuse(
                "known here are default, U = k/2 (ln J)^2, and Abaqus, U = k/2 (J - 1)^2"
            )
        law = known
    augmented = material.child("laugon")
    if augmented is not None and augmented.text.lower() not in ("0", "off", "false"):
        raise augmented.refuse(
            "<laugon>: an augmented bulk modulus has no end; a case has a number"
        )
    constants = {"c10": values["c1"], "c01": values["c2"], "bulk_modulus": values["k"]}
    return Body({"law": str(law), **constants}, density, material.place)


def _bodies_of_cells(
    material_of: list[tuple[Element, str, int]], names: dict[str, int]
) -> NDArray[np.int64]:
    """Of each cell the index of its material."""
    rows = []
    for element, name, count in material_of:
        if name not in names:
            raise element.refuse(f"no material {name[:40]!r} (known: {', '.join(names) or 'none'})")
        rows.append(np.full(count, names[name], dtype=np.int64))
    return np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
