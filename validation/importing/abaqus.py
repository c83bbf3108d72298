"""Abaqus' and CalculiX' .inp: solids of tetrahedra at rest under the loads of one step.

By the Abaqus Keywords Reference Guide and CalculiX CrunchiX USER'S MANUAL (2.20), which share the
cards read here. NEO HOOKE and MOONEY-RIVLIN have C10, C01 and D1: U = (J - 1)^2 / D1, so that
bulk_modulus = 2 / D1, and 2 (C10 + C01) is the shear modulus. *ELASTIC under NLGEOM is
Saint-Venant-Kirchhoff in CalculiX (its manual, "Linear elastic materials for large strains"); in
Abaqus it is a law of logarithmic strain, which agrees for small strains only.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.validation.importing.abaqus_mesh import AbaqusMesh, Card, name_of, number, read_cards
from palpate.validation.importing.model import (
    Body,
    Face,
    FixedNodes,
    ImportRefusedError,
    Model,
    Source,
    added,
    whole,
)
from palpate.validation.importing.understood import harmless, left_out

# Cards of a model of one part that is not moved in its assembly.
_FRAME = {"PART", "END PART", "ASSEMBLY", "END ASSEMBLY", "INSTANCE", "END INSTANCE"}
# Fields of a line of each kind of load, at least and at most.
_LOADS = {"BOUNDARY": (2, 4), "CLOAD": (3, 3), "DLOAD": (3, 6), "DSLOAD": (3, 3)}
_OF_MATERIALS = {"MATERIAL", "ELASTIC", "HYPERELASTIC", "DENSITY"}
# What is understood above *STEP, and what below.
_MODEL = {
    "HEADING", "NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SOLID SECTION", "AMPLITUDE",
    "BOUNDARY", *_FRAME, *_OF_MATERIALS,
}  # fmt: skip
_STEP = {"STEP", "STATIC", "END STEP", *_LOADS}
# What may be said of an amplitude; with one step, total time is the step's.
_CURVES = {
    "DEFINITION": ("TABULAR",), "VALUE": ("RELATIVE",), "TIME": ("STEP TIME", "TOTAL TIME"),
}  # fmt: skip
_HYPERELASTIC = ("NEO HOOKE", "MOONEY-RIVLIN")
# Components that Abaqus' named supports of solids fix, of x, y, z.
_NAMED = {
    "ENCASTRE": (0, 1, 2), "PINNED": (0, 1, 2), "XSYMM": (0,), "YSYMM": (1,), "ZSYMM": (2,),
    "XASYMM": (1, 2), "YASYMM": (0, 2), "ZASYMM": (0, 1),
}  # fmt: skip


def read_abaqus(path: Path) -> Model:
    """Read an .inp file.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
        FileFormatError: A file that cannot be opened.
    """
    cards = read_cards(path)
    _require_one_part(cards)
    is_green, end_time = _step(path, cards)
    mesh = AbaqusMesh(cards)
    materials = _materials(cards)
    sections = [card for card in cards if card.keyword == "SOLID SECTION"]
    bodies, body_of = _bodies(mesh, materials, sections)
    notes = mesh.notes()
    for body in bodies:
        if "law" in body.constants and not is_green:
            raise body.source.refuse(
                "*HYPERELASTIC in a step without NLGEOM: programs differ in what that is; say "
                "NLGEOM, or *ELASTIC"
            )
    if is_green and any("law" not in body.constants for body in bodies):
        notes.append(
            "*ELASTIC under NLGEOM is read as CalculiX has it, Saint-Venant-Kirchhoff; in Abaqus "
            "it is a law of logarithmic strain, which agrees for small strains only"
        )
        for body in bodies:
            body.constants.setdefault("law", str(Law.SAINT_VENANT_KIRCHHOFF))
    headings = [fields for c in cards if c.keyword == "HEADING" for _, fields in c.rows(1, 99)]
    model = Model(
        path,
        "Abaqus or CalculiX",
        *mesh.arrays(),
        bodies,
        body_of,
        np.array(list(mesh.nodes), dtype=np.int64),
        title=" ".join(", ".join(fields) for fields in headings)[:80].strip(),
        strain=Strain.GREEN if is_green else Strain.LINEAR,
        notes=notes,
    )
    factors = _amplitudes(cards, end_time)
    _Loads(model, mesh, factors).put([card for card in cards if card.keyword in _LOADS])
    model.ignored += left_out(cards, harmless("abaqus"))
    return model


def _require_one_part(cards: list[Card]) -> None:
    """Refuse several parts, one that its assembly moves or turns, and names of part and assembly.

    Nodes and sets of an assembly are others than those of the part with the same number or name.
    """
    seen: set[str] = set()
    scope, scope_of = "", dict[tuple[str, str], bool]()
    for card in cards:
        if card.keyword in _FRAME:
            scope = card.keyword
            if scope in seen:
                raise card.refuse(f"a second *{scope}; a case has one body")
            seen.add(scope)
            card.mark()
            if card.lines:
                raise card.lines[0][0].refuse(f"*{scope}: a part that is moved or turned")
        elif card.keyword in ("NODE", "ELEMENT") and scope in ("ASSEMBLY", "END INSTANCE"):
            raise card.refuse(f"*{card.keyword} of the assembly, beside those of its part")
        elif card.keyword in ("NODE", "ELEMENT", "NSET", "ELSET"):
            for kind in ("NSET", "ELSET"):
                name, is_of_part = name_of(card.values.get(kind, "")), scope in ("PART", "INSTANCE")
                if name and scope_of.setdefault((kind, name), is_of_part) != is_of_part:
                    raise card.refuse(f"set {name[:40]} of the part and of the assembly are two")


def _step(path: Path, cards: list[Card]) -> tuple[bool, float]:
    """Whether the one static step is of finite strain, and the time at its end.

    The model stands above it, its loads in it, and nothing below it.
    """
    step, static, is_ended = None, None, False
    for card in cards:
        word = card.keyword
        if word == "STEP" and step is not None:
            raise card.refuse("a second step; a case has one state of loads: split the model")
        if is_ended:
            raise card.refuse(f"*{word[:40]} below *END STEP, where a second step would begin")
        if word in _STEP and word not in _MODEL and word != "STEP" and step is None:
            raise card.refuse(f"*{word} stands in a *STEP")
        if word in _MODEL and word not in _STEP and step is not None:
            raise card.refuse(f"*{word} stands above *STEP")
        if word == "STATIC" and static is not None:
            raise card.refuse("a second *STATIC in the step")
        if word in _STEP:
            card.mark()
        step, static = (card if word == "STEP" else step), (card if word == "STATIC" else static)
        if word == "BOUNDARY" and step is None:
            _require_at_rest(card)
        is_ended = word == "END STEP"
    if step is None or static is None:
        unread = [card for card in cards if card.read is None and card.keyword not in _MODEL]
        left_out(unread, harmless("abaqus"))
        reason = "has no *STEP with *STATIC: an import is of equilibrium"
        raise ImportRefusedError(path, cards[-1].line if cards else None, reason)
    if not is_ended:
        raise step.refuse("the step has no *END STEP: the file may be cut off")
    step.require_usual("NLGEOM", "", "NO", "YES", reason="known is YES or NO")
    end_time = 1.0
    for source, fields in static.rows(1, 4):
        if source != static.lines[0][0]:
            raise source.refuse("*STATIC has one line")
        times = [number(text or "0", source, "*STATIC") for text in fields]
        if min(times) < 0.0:
            raise source.refuse("*STATIC: a time below 0")
        # None, and none above 0, is 1.
        end_time = (times[1] if len(times) > 1 else 0.0) or 1.0
    is_green = "NLGEOM" in step.values and step.word("NLGEOM").upper() != "NO"
    return is_green, end_time


def _require_at_rest(card: Card) -> None:
    """Above the step a support fixes; to move it, and by a curve, is the step's."""
    if "AMPLITUDE" in card.values:
        raise card.refuse("*BOUNDARY with an amplitude stands in a *STEP")
    for source, fields in card.lines:
        if len(fields) > 3 and fields[3] and number(fields[3], source, "*BOUNDARY") != 0.0:
            raise source.refuse("*BOUNDARY above *STEP fixes; what moves stands in the step")


def _amplitudes(cards: list[Card], end_time: float) -> dict[str, float]:
    """What each amplitude is at the end of the step, by name."""
    factors: dict[str, float] = {}
    for card in (card for card in cards if card.keyword == "AMPLITUDE"):
        name = card.label("NAME")
        if name in factors:
            raise card.refuse(
                f"amplitude {name[:40]} is there twice; programs differ in which counts"
            )
        for key, usual in _CURVES.items():
            card.require_usual(key, *usual, reason=f"known is {' or '.join(usual)}")
        # Four pairs are all that CalculiX reads of a line.
        values = [value for _, line in card.numbers(2, 8) for value in line]
        if any(len(line) % 2 for _, line in card.numbers(2, 8)) or not values:
            raise card.refuse("*AMPLITUDE needs pairs of time and factor")
        times, heights = np.array(values).reshape(-1, 2).T
        if not (np.diff(times) > 0.0).all():
            raise card.refuse("the times of an amplitude have to increase")
        factors[name] = float(np.interp(end_time, times, heights))
    return factors


def _materials(cards: list[Card]) -> dict[str, Body]:
    """Materials by name; those without a law have no constants."""
    materials: dict[str, Body] = {}
    name = None
    for card in cards:
        if card.keyword not in _OF_MATERIALS:
            # Behind another card they would be those of the last material, in CalculiX.
            name = None if card.keyword in _MODEL else name
        elif card.keyword == "MATERIAL":
            name = card.label("NAME")
            if name in materials:
                raise card.refuse(f"material {name} is there twice")
            materials[name] = Body({}, None, card.source)
        elif name is None:
            raise card.refuse(f"*{card.keyword} stands below a *MATERIAL")
        elif card.keyword == "DENSITY":
            if materials[name].density is not None:
                raise card.refuse(f"material {name} has two densities")
            materials[name] = replace(materials[name], density=_exactly(card, 1)[0])
        else:
            if materials[name].constants:
                raise card.refuse(f"material {name} has two laws")
            constants = _elastic(card) if card.keyword == "ELASTIC" else _hyperelastic(card)
            materials[name].constants.update(constants)
    return materials


def _bodies(
    mesh: AbaqusMesh, materials: dict[str, Body], sections: list[Card]
) -> tuple[list[Body], NDArray[np.int64]]:
    """Materials in use, and of each cell the index of its own."""
    names: list[str] = []
    body_of = np.full(len(mesh.tetrahedra), -1, dtype=np.int64)
    for section in sections:
        name = section.label("MATERIAL")
        if name not in materials or not materials[name].constants:
            raise section.refuse(f"no material {name} with *ELASTIC or *HYPERELASTIC")
        if name not in names:
            names.append(name)
        rows = mesh.rows_of(mesh.cells_of(section.require("ELSET"), section.source))
        other = body_of[rows]
        if ((other >= 0) & (other != names.index(name))).any():
            raise section.refuse("a cell in two sections of different materials")
        body_of[rows] = names.index(name)
    for cell in mesh.cells if (body_of < 0).any() else ():
        if (body_of[mesh.rows_of([cell])] < 0).any():
            card = next(card for card, labels in mesh.blocks if cell in labels)
            raise card.refuse(f"element {cell} is in no *SOLID SECTION")
    return [materials[name] for name in names], body_of


def _elastic(card: Card) -> dict[str, Any]:
    card.require_usual("TYPE", "ISO", "ISOTROPIC", reason="a case knows isotropic materials")
    modulus, ratio = _exactly(card, 2)
    return {"youngs_modulus": modulus, "poissons_ratio": ratio}


def _hyperelastic(card: Card) -> dict[str, Any]:
    names = [name for name in card.values if name != "MODULI"]
    kind = names[0] if names else "none"
    if len(names) != 1 or kind not in _HYPERELASTIC:
        raise card.refuse(f"*HYPERELASTIC, {kind[:30]}; known here are {', '.join(_HYPERELASTIC)}")
    card.require_usual(kind, "", reason="it has no value")
    c10, *c01, d1 = _exactly(card, 2 if kind == "NEO HOOKE" else 3)
    if not d1 > 0.0:
        raise card.refuse("D1 = 0 is a body that cannot change its volume; a case's has D1 > 0")
    bulk, shear = 2.0 / d1, 2.0 * c10
    if c01:
        return {"law": str(Law.MOONEY_RIVLIN), "c10": c10, "c01": c01[0], "bulk_modulus": bulk}
    if not shear > 0.0:
        raise card.refuse("C10 of a neo-Hookean body has to be above 0")
    return {
        "law": str(Law.NEO_HOOKEAN_ISOCHORIC),
        "youngs_modulus": 9.0 * bulk * shear / (3.0 * bulk + shear),
        "poissons_ratio": (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear)),
    }


def _exactly(card: Card, count: int) -> list[float]:
    """So many numbers in one line: more lines are other temperatures.

    A temperature behind them is taken where it stands alone.
    """
    if len(card.lines) > 1:
        raise card.lines[1][0].refuse(f"*{card.keyword} by temperature; a case has one")
    for _, numbers in card.numbers(count, count + 1):
        return numbers[:count]
    raise card.refuse(f"*{card.keyword} needs {count} number(s)")


class _Loads:
    """Boundary conditions and loads, put into a model whose mesh is known."""

    def __init__(self, model: Model, mesh: AbaqusMesh, factors: dict[str, float]) -> None:
        self.model, self.mesh, self.factors = model, mesh, factors
        self.weighed: set[str] = set()
        self.pushed: dict[tuple[int, int], Source] = {}
        # Faces by the name and size of their pressure, with the first line that names them.
        self.pressed: dict[tuple[str, float], tuple[Source, list[tuple[int, int]]]] = {}
        self.pressed_faces: set[tuple[int, int]] = set()
        # Nodes that are fixed one by one: by node and component the displacement, and its line.
        self.singles: dict[tuple[int, int], tuple[float, Source]] = {}

    def put(self, cards: list[Card]) -> None:
        """Read them all.

        Raises:
            ImportRefusedError: What a case cannot say, with its line.
        """
        readers = {
            "BOUNDARY": self._boundary,
            "CLOAD": self._cload,
            "DLOAD": self._dload,
            "DSLOAD": self._dsload,
        }
        seen: set[str] = set()
        for card in cards:
            what = f"*{card.keyword}"
            card.require_usual("OP", "MOD", "NEW", reason="known are MOD and NEW")
            if card.word("OP", "MOD").upper() != "MOD" and what in seen:
                raise card.refuse(f"{what}, OP=NEW takes back what stands above; leave that out")
            seen.add(what)
            if what == "*BOUNDARY":
                card.require_usual("TYPE", "DISPLACEMENT", reason="only displacements are known")
                if "FIXED" in card.values:
                    raise card.refuse(f"{what}, FIXED keeps points where an earlier step left them")
            factor = self._factor(card)
            for source, fields in card.rows(*_LOADS[card.keyword]):
                readers[card.keyword](fields, source, factor)
        # Nodes of one displacement are one support.
        alike: dict[tuple[int, float], list[int]] = {}
        for (row, axis), (value, _) in sorted(self.singles.items()):
            alike.setdefault((axis, value), []).append(row)
        by_nodes: dict[tuple[int, ...], dict[int, float]] = {}
        for (axis, value), rows in alike.items():
            by_nodes.setdefault(tuple(rows), {})[axis] = value
        for nodes, components in by_nodes.items():
            _, source = self.singles[nodes[0], next(iter(components))]
            fixed = np.array(nodes, dtype=np.int64)
            self.model.supports.append(FixedNodes("fixed", fixed, components, source))
        # Under NLGEOM a pressure follows the body, as a case's does; else both act at rest.
        for (name, pressure), (source, faces) in self.pressed.items():
            facets = self.mesh.facets(faces)
            self.model.faces.append(Face(name, facets, source, pressure=pressure))

    def _factor(self, card: Card) -> float:
        """Value of the card's amplitude at the end of the step."""
        if card.get("AMPLITUDE") is None:
            return 1.0
        name = card.label("AMPLITUDE")
        if name not in self.factors:
            raise card.refuse(f"no *AMPLITUDE {name[:40]}")
        return self.factors[name]

    def _boundary(self, fields: list[str], source: Source, factor: float) -> None:
        axes, value = _fixed(fields, source)
        value = factor * value + 0.0  # no minus zero
        if not axes:
            self.model.ignored.append(
                f"line {source.line} *BOUNDARY of rotations, which solids lack"
            )
            return
        nodes = self.mesh.nodes_of(fields[0], source)
        rows = sorted({self.mesh.row_of[node] for node in nodes})
        if len(nodes) == 1:
            for axis in axes:
                other, by = self.singles.setdefault((rows[0], axis), (value, source))
                if other != value:
                    raise source.refuse(
                        f"node {nodes[0]} is moved along {'xyz'[axis]} by {value:g} here and by "
                        f"{other:g} in line {by.line}; fix it once"
                    )
            return
        components = dict.fromkeys(axes, value)
        name, supports = fields[0].strip('" ').rpartition(".")[2], self.model.supports
        # Line after line of one set is one support.
        last = supports[-1] if supports else None
        is_same = last is not None and last.name == name and last.nodes.tolist() == rows
        if last is not None and is_same and not set(axes) & set(last.components):
            last.components.update(components)
        else:
            supports.append(FixedNodes(name, np.array(rows, dtype=np.int64), components, source))

    def _cload(self, fields: list[str], source: Source, factor: float) -> None:
        axis = whole(fields[1], source, "*CLOAD") - 1
        if axis not in (0, 1, 2):
            raise source.refuse(f"*CLOAD: degree of freedom {axis + 1}; solids have 1, 2 and 3")
        value = factor * number(fields[2], source, "*CLOAD")
        self.mesh.require_once("NSET", fields[0], source)
        self.model.pushed_at = self.model.pushed_at or source
        for node in self.mesh.nodes_of(fields[0], source):
            row = self.mesh.row_of[node]
            other = self.pushed.setdefault((row, axis), source)
            if other is not source:
                raise source.refuse(
                    f"*CLOAD: node {node} is pushed along {'xyz'[axis]} in line {other.line} too; "
                    "programs differ in whether they add: give the sum once"
                )
            self.model.forces[row, axis] += value

    def _dload(self, fields: list[str], source: Source, factor: float) -> None:
        model, kind = self.model, fields[1].strip().upper()
        value = factor * number(fields[2], source, "*DLOAD")
        is_face = len(kind) == 2 and kind[0] == "P"
        if not is_face and kind not in ("GRAV", "BX", "BY", "BZ"):
            raise source.refuse(
                f"*DLOAD of kind {kind[:20]!r}; known here are P1 to P6, GRAV, BX, BY, BZ"
            )
        if len(fields) > 3 and kind != "GRAV":
            raise source.refuse(f"*DLOAD, {kind}: {len(fields)} fields, needs 3")
        if is_face:
            self._press("pressed", self.mesh.faces_of(fields[0], kind, "P", source), source, value)
            return
        if kind in self.weighed:
            raise source.refuse(f"a second {kind}; programs differ in whether they add")
        self.weighed.add(kind)
        # A load by volume has to be of the whole body; an empty field is.
        part = self.mesh.cells_of(fields[0], source) if fields[0].strip() else self.mesh.cells
        if len(set(part)) < len(self.mesh.cells):
            raise source.refuse("*DLOAD: weight of a part; a case weighs the whole body")
        self.mesh.require_once("ELSET", fields[0], source)
        if kind == "GRAV":
            model.acceleration = added(model.acceleration, _gravity(fields, source, value))
        else:
            model.body_force = added(model.body_force, value * np.eye(3)["XYZ".index(kind[1])])

    def _dsload(self, fields: list[str], source: Source, factor: float) -> None:
        kind, name = fields[1].strip().upper(), name_of(fields[0]).rpartition(".")[2]
        if kind != "P":
            raise source.refuse(f"*DSLOAD of kind {kind[:20]!r}; known here is P, a pressure")
        value = factor * number(fields[2], source, "*DSLOAD")
        faces = self.mesh.named(self.mesh.surfaces, fields[0], source, "surface")
        self._press(name, faces, source, value)

    def _press(
        self, name: str, faces: list[tuple[int, int]], source: Source, pressure: float
    ) -> None:
        if not self.pressed_faces.isdisjoint(faces):
            raise source.refuse(
                "a face is pressed in two lines; programs differ in whether they add: give the sum "
                "once"
            )
        self.pressed_faces.update(faces)
        self.pressed.setdefault((name, pressure), (source, []))[1].extend(faces)


def _fixed(fields: list[str], source: Source) -> tuple[list[int], float]:
    """Components from 0, and how far they are moved; 4 to 6 are rotations, which solids lack."""
    word = fields[1].strip().upper()
    if word in _NAMED:
        if len(fields) > 2:
            raise source.refuse(f"*BOUNDARY, {word}: {len(fields)} fields, needs 2")
        return list(_NAMED[word]), 0.0
    first = whole(fields[1], source, "*BOUNDARY")
    last = whole(fields[2], source, "*BOUNDARY") if len(fields) > 2 and fields[2] else first
    if not 1 <= first <= last <= 6:
        raise source.refuse(f"*BOUNDARY: degrees of freedom {first} to {last}; solids have 1 to 3")
    value = number(fields[3], source, "*BOUNDARY") if len(fields) > 3 and fields[3] else 0.0
    return [axis - 1 for axis in range(first, last + 1) if axis <= 3], value


def _gravity(fields: list[str], source: Source, size: float) -> NDArray[np.float64]:
    if len(fields) != 6:
        raise source.refuse("*DLOAD, GRAV needs a size and a direction")
    direction = np.array([number(text, source, "*DLOAD") for text in fields[3:6]])
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise source.refuse("*DLOAD, GRAV: a direction of no length")
    return size * direction / length
