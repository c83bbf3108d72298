"""Abaqus' and CalculiX' .inp: solids of tetrahedra at rest under the loads of one step.

By the Abaqus Keywords Reference Guide and CalculiX CrunchiX USER'S MANUAL (2.20), which share the
cards read here. NEO HOOKE and MOONEY-RIVLIN have C10, C01 and D1: U = (J - 1)^2 / D1, so that
bulk_modulus = 2 / D1, and 2 (C10 + C01) is the shear modulus. *ELASTIC under NLGEOM is
Saint-Venant-Kirchhoff in CalculiX (its manual, "Linear elastic materials for large strains"); in
Abaqus it is a law of logarithmic strain, which agrees for small strains only.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.validation.importing.abaqus_mesh import AbaqusMesh, Card, read_cards
from palpate.validation.importing.model import (
    Body,
    Face,
    FixedNodes,
    ImportRefusedError,
    Model,
    Source,
    finite,
    whole,
)

# What is written where, and how the solver goes about it; by keyword.
_HARMLESS = {
    "NODE PRINT", "NODE FILE", "NODE OUTPUT", "EL PRINT", "EL FILE", "ELEMENT OUTPUT", "OUTPUT",
    "ENERGY OUTPUT", "ENERGY PRINT", "ENERGY FILE", "SECTION PRINT", "PREPRINT", "PRINT", "RESTART",
    "FILE FORMAT", "MONITOR", "CONTROLS", "SOLUTION TECHNIQUE", "NO OUTPUT",
}  # fmt: skip
# Cards of a model of one part that is not moved in its assembly.
_FRAME = {"PART", "END PART", "ASSEMBLY", "END ASSEMBLY", "INSTANCE", "END INSTANCE"}
# Other cards below *MATERIAL that do not change an equilibrium at one temperature.
_HARMLESS_OF_MATERIALS = {"DAMPING", "CONDUCTIVITY", "SPECIFIC HEAT"}
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
    reader = _Reader(path)
    for card in read_cards(path):
        reader.take(card)
    return reader.model()


class _Reader:
    """Card by card; materials and loads are put together when all of the mesh is known."""

    def __init__(self, path: Path) -> None:
        self.path, self.title, self.mesh = path, "", AbaqusMesh()
        self.ignored: list[str] = []
        self.frame: set[str] = set()
        self.step: Card | None = None
        self.is_ended = self.has_static = False
        self.end_time = 1.0
        self.material: str | None = None
        self.materials: dict[str, Card] = {}
        self.constants: dict[str, dict[str, Any]] = {}
        self.densities: dict[str, float] = {}
        self.sections: list[Card] = []
        self.amplitudes: dict[str, Card] = {}
        self.loads: list[Card] = []
        self.takers: dict[str, Callable[[Card], object]] = {
            **self.mesh.takers,
            **dict.fromkeys(_FRAME, self._frame),
            **dict.fromkeys(("STEP", "STATIC", "END STEP"), self._step),
            **dict.fromkeys(("MATERIAL", "ELASTIC", "HYPERELASTIC", "DENSITY"), self._material),
            **dict.fromkeys(("BOUNDARY", "CLOAD", "DLOAD", "DSLOAD"), self.loads.append),
            "SOLID SECTION": self._section,
            "AMPLITUDE": self._amplitude,
        }

    def take(self, card: Card) -> None:
        """Read a card.

        Raises:
            ImportRefusedError: A keyword that is not known, or what it says is not.
        """
        if card.keyword == "HEADING":
            self.title = " ".join(", ".join(fields) for _, fields in card.lines)[:80].strip()
        elif card.keyword in self.takers:
            self.takers[card.keyword](card)
        elif card.keyword in _HARMLESS or (
            card.keyword in _HARMLESS_OF_MATERIALS and self.material is not None
        ):
            self.ignored.append(f"line {card.source.line} *{card.keyword}")
        else:
            raise card.refuse(
                f"*{card.keyword[:40]} is not known here: it may change the mechanics, so nothing "
                "is imported; take it out if it does not matter"
            )

    def _frame(self, card: Card) -> None:
        if not card.keyword.startswith("END"):
            if card.keyword in self.frame:
                raise card.refuse(f"a second *{card.keyword}; a case has one body")
            self.frame.add(card.keyword)
        if card.lines:
            # Data of *INSTANCE turn or move the part.
            raise card.lines[0][0].refuse(f"*{card.keyword}: a part that is moved or turned")

    def _step(self, card: Card) -> None:
        if card.keyword == "STEP":
            if self.is_ended:
                raise card.refuse("a second step; a case has one state of loads: split the model")
            card.only(
                "NLGEOM", "INC", "INCF", "NAME", "AMPLITUDE", "UNSYMM", "EXTRAPOLATION", "SOLVER",
                "CONVERT SDI",
            )  # fmt: skip
            self.step = card
        elif card.keyword == "STATIC":
            if self.step is None:
                raise card.refuse("*STATIC stands in a *STEP")
            card.only("SOLVER", "DIRECT", "TIME RESET", "TOTAL TIME AT START")
            self.has_static = True
            numbers = card.numbers()
            self.end_time = numbers[1] if len(numbers) > 1 else 1.0
        else:
            self.is_ended = True

    def _amplitude(self, card: Card) -> None:
        card.only("NAME", "TIME", "VALUE", "DEFINITION", "SMOOTH")
        self.amplitudes[card.require("NAME")] = card

    def _section(self, card: Card) -> None:
        card.only("ELSET", "MATERIAL", "CONTROLS")
        self.sections.append(card)

    def _material(self, card: Card) -> None:
        if card.keyword == "MATERIAL":
            card.only("NAME")
            self.material = card.require("NAME")
            if self.material in self.materials:
                raise card.refuse(f"material {self.material} is there twice")
            self.materials[self.material] = card
            return
        if self.material is None:
            raise card.refuse(f"*{card.keyword} stands below a *MATERIAL")
        if card.keyword == "DENSITY":
            card.only()
            self.densities[self.material] = _exactly(card, 1)[0]
            return
        constants = _elastic(card) if card.keyword == "ELASTIC" else _hyperelastic(card)
        if self.material in self.constants:
            raise card.refuse(f"material {self.material} has two laws")
        self.constants[self.material] = constants

    def model(self) -> Model:
        """All that was read.

        Raises:
            ImportRefusedError: Something is missing or contradicts.
        """
        if self.step is None or not self.has_static:
            raise ImportRefusedError(
                self.path, None, "has no *STEP with *STATIC: an import is of equilibrium"
            )
        self.mesh.finish()
        nodes, corners, middles = self.mesh.arrays()
        bodies, body_of = self._bodies()
        is_green = self.step.parameters.get("NLGEOM", "NO").upper() != "NO"
        model = Model(
            self.path,
            "Abaqus or CalculiX",
            nodes,
            corners,
            middles,
            bodies,
            body_of,
            np.array(list(self.mesh.nodes), dtype=np.int64),
            title=self.title,
            strain=Strain.GREEN if is_green else Strain.LINEAR,
            notes=self.mesh.notes(),
            ignored=self.ignored,
        )
        for body in bodies:
            if "law" in body.constants and not is_green:
                raise body.source.refuse(
                    "*HYPERELASTIC in a step without NLGEOM: programs differ in what that is; "
                    "say NLGEOM, or *ELASTIC"
                )
        if is_green and any("law" not in body.constants for body in bodies):
            model.notes.append(
                "*ELASTIC under NLGEOM is read as CalculiX has it, Saint-Venant-Kirchhoff; in "
                "Abaqus it is a law of logarithmic strain, which agrees for small strains only"
            )
            for body in bodies:
                body.constants.setdefault("law", str(Law.SAINT_VENANT_KIRCHHOFF))
        _Loads(model, self.mesh, self.amplitudes, self.end_time).put(self.loads)
        return model

    def _bodies(self) -> tuple[list[Body], NDArray[np.int64]]:
        """Materials, and of each cell the index of its own."""
        names: list[str] = []
        body_of = np.full(len(self.mesh.tetrahedra), -1, dtype=np.int64)
        for section in self.sections:
            name = section.require("MATERIAL")
            if name not in self.constants:
                raise section.refuse(f"no material {name} with *ELASTIC or *HYPERELASTIC")
            if name not in names:
                names.append(name)
            cells = self.mesh.cells_of(section.require("ELSET"), section.source)
            rows = self.mesh.rows_of(cells)
            other = body_of[rows]
            if ((other >= 0) & (other != names.index(name))).any():
                raise section.refuse("a cell in two sections of different materials")
            body_of[rows] = names.index(name)
        for cell in self.mesh.cells if (body_of < 0).any() else ():
            if (body_of[self.mesh.rows_of([cell])] < 0).any():
                raise ImportRefusedError(self.path, None, f"element {cell} is in no *SOLID SECTION")
        bodies = [
            Body(self.constants[name], self.densities.get(name), self.materials[name].source)
            for name in names
        ]
        return bodies, body_of


def _elastic(card: Card) -> dict[str, Any]:
    card.only("TYPE")
    if card.parameters.get("TYPE", "ISO").upper() not in ("ISO", "ISOTROPIC"):
        raise card.refuse("*ELASTIC, TYPE: a case knows isotropic materials")
    modulus, ratio = _exactly(card, 2)
    return {"youngs_modulus": modulus, "poissons_ratio": ratio}


def _hyperelastic(card: Card) -> dict[str, Any]:
    names = [name for name in card.parameters if name != "MODULI"]
    kind = names[0] if names else "none"
    if len(names) != 1 or kind not in _HYPERELASTIC:
        raise card.refuse(f"*HYPERELASTIC, {kind[:30]}; known here are {', '.join(_HYPERELASTIC)}")
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
    numbers = card.numbers()
    if len(numbers) not in (count, count + 1):
        raise card.refuse(f"*{card.keyword} needs {count} number(s), has {len(numbers)}")
    return numbers[:count]


class _Loads:
    """Boundary conditions and loads, put into a model whose mesh is known."""

    def __init__(
        self, model: Model, mesh: AbaqusMesh, amplitudes: dict[str, Card], end_time: float
    ) -> None:
        self.model, self.mesh, self.amplitudes, self.end_time = model, mesh, amplitudes, end_time
        self.pushed: dict[tuple[int, int], Source] = {}
        self.pressed: set[tuple[int, int]] = set()
        # Nodes that are fixed one by one, by component and displacement.
        self.singles: dict[tuple[int, float], set[int]] = {}

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
            if card.parameters.get("OP", "MOD").upper() != "MOD" and card.keyword in seen:
                raise card.refuse(
                    f"*{card.keyword}, OP=NEW takes back what stands above; leave that out"
                )
            seen.add(card.keyword)
            readers[card.keyword](card, self._factor(card))
        # Those of one displacement are one support.
        by_nodes: dict[tuple[int, ...], dict[int, float]] = {}
        for (axis, value), rows in self.singles.items():
            by_nodes.setdefault(tuple(sorted(rows)), {})[axis] = value
        for nodes, components in by_nodes.items():
            source = next(card.source for card in cards if card.keyword == "BOUNDARY")
            fixed = np.array(nodes, dtype=np.int64)
            self.model.holds.append(FixedNodes("held", fixed, components, source))

    def _factor(self, card: Card) -> float:
        """Value of the card's amplitude at the end of the step."""
        name = card.parameters.get("AMPLITUDE")
        if name is None:
            return 1.0
        curve = self.amplitudes.get(name.upper())
        if curve is None:
            raise card.refuse(f"no *AMPLITUDE {name[:40]}")
        for key, usual in (("DEFINITION", "TABULAR"), ("VALUE", "RELATIVE")):
            if curve.parameters.get(key, usual).upper() != usual:
                raise curve.refuse(f"*AMPLITUDE, {key}: only {usual} is known here")
        numbers = curve.numbers()
        if len(numbers) % 2 or not numbers:
            raise curve.refuse("*AMPLITUDE needs pairs of time and factor")
        times, factors = np.array(numbers).reshape(-1, 2).T
        if not (np.diff(times) > 0.0).all():
            raise curve.refuse("the times of an amplitude have to increase")
        return float(np.interp(self.end_time, times, factors))

    def _boundary(self, card: Card, factor: float) -> None:
        card.only("OP", "AMPLITUDE", "TYPE", "FIXED", "LOAD CASE")
        if card.parameters.get("TYPE", "DISPLACEMENT").upper() != "DISPLACEMENT":
            raise card.refuse("*BOUNDARY, TYPE: only displacements are known here")
        if "FIXED" in card.parameters:
            raise card.refuse("*BOUNDARY, FIXED holds points where an earlier step left them")
        holds = self.model.holds
        for source, fields in card.rows(2, 4):
            axes, value = _fixed(fields, source)
            value = factor * value + 0.0  # no minus zero
            if not axes:
                self.model.ignored.append(
                    f"line {source.line} *BOUNDARY of rotations, which solids lack"
                )
                continue
            nodes = self.mesh.nodes_of(fields[0], source)
            rows = sorted({self.mesh.row_of[node] for node in nodes})
            if len(nodes) == 1:
                for axis in axes:
                    self.singles.setdefault((axis, value), set()).update(rows)
                continue
            components = dict.fromkeys(axes, value)
            name = fields[0].strip('" ').rpartition(".")[2]
            # Line after line of one set is one support.
            if holds and holds[-1].name == name and not set(axes) & set(holds[-1].components):
                holds[-1].components.update(components)
            else:
                holds.append(FixedNodes(name, np.array(rows, dtype=np.int64), components, source))

    def _cload(self, card: Card, factor: float) -> None:
        card.only("OP", "AMPLITUDE", "LOAD CASE")
        for source, fields in card.rows(3, 3):
            axis = whole(fields[1], source, "*CLOAD") - 1
            if axis not in (0, 1, 2):
                raise source.refuse(f"*CLOAD: degree of freedom {axis + 1}; solids have 1, 2 and 3")
            value = factor * finite(fields[2], source, "*CLOAD")
            for node in self.mesh.nodes_of(fields[0], source):
                row = self.mesh.row_of[node]
                other = self.pushed.setdefault((row, axis), source)
                if other is not source:
                    raise source.refuse(
                        f"*CLOAD: node {node} is pushed along {'xyz'[axis]} in line {other.line} "
                        "too; programs differ in whether they add: give the sum once"
                    )
                self.model.forces[row, axis] += value

    def _dload(self, card: Card, factor: float) -> None:
        card.only("OP", "AMPLITUDE", "LOAD CASE")
        model, faces = self.model, dict[float, tuple[Source, list[tuple[int, int]]]]()
        for source, fields in card.rows(3, 6):
            kind = fields[1].strip().upper()
            value = factor * finite(fields[2], source, "*DLOAD")
            if kind == "GRAV":
                self._require_whole(fields[0], source)
                model.acceleration = _added(model.acceleration, _gravity(fields, source, value))
            elif kind in ("BX", "BY", "BZ"):
                self._require_whole(fields[0], source)
                model.body_force = _added(model.body_force, value * np.eye(3)["XYZ".index(kind[1])])
            elif len(kind) == 2 and kind[0] == "P":
                named = self.mesh.faces_of(fields[0], kind, "P", source)
                faces.setdefault(value, (source, []))[1].extend(named)
            else:
                raise source.refuse(
                    f"*DLOAD of kind {kind[:20]!r}; known here are P1 to P6, GRAV, BX, BY, BZ"
                )
        for pressure, (source, named) in faces.items():
            self._press("pressed", named, source, pressure)

    def _require_whole(self, text: str, source: Source) -> None:
        """A load by volume has to be of the whole body; an empty field is."""
        if text.strip() and len(set(self.mesh.cells_of(text, source))) < len(self.mesh.cells):
            raise source.refuse("*DLOAD: weight of a part; a case weighs the whole body")

    def _dsload(self, card: Card, factor: float) -> None:
        card.only("OP", "AMPLITUDE")
        for source, fields in card.rows(3, 3):
            kind, name = fields[1].strip().upper(), fields[0].strip('" ').upper().rpartition(".")[2]
            if kind != "P":
                raise source.refuse(f"*DSLOAD of kind {kind[:20]!r}; known here is P, a pressure")
            if name not in self.mesh.surfaces:
                raise source.refuse(f"no surface {name[:40]!r}")
            value = factor * finite(fields[2], source, "*DSLOAD")
            self._press(name, self.mesh.surfaces[name], source, value)

    def _press(
        self, name: str, faces: list[tuple[int, int]], source: Source, pressure: float
    ) -> None:
        """Under NLGEOM a pressure follows the body, as a case's does; else both act at rest."""
        if self.pressed & set(faces):
            raise source.refuse(
                "a face is pressed in two lines; programs differ in whether they add: give the sum "
                "once"
            )
        self.pressed.update(faces)
        self.model.faces.append(Face(name, self.mesh.facets(faces), source, pressure=pressure))


def _fixed(fields: list[str], source: Source) -> tuple[list[int], float]:
    """Components from 0, and how far they are moved; 4 to 6 are rotations, which solids lack."""
    word = fields[1].strip().upper()
    if word in _NAMED:
        return list(_NAMED[word]), 0.0
    first = whole(fields[1], source, "*BOUNDARY")
    last = whole(fields[2], source, "*BOUNDARY") if len(fields) > 2 and fields[2] else first
    if not 1 <= first <= last <= 6:
        raise source.refuse(f"*BOUNDARY: degrees of freedom {first} to {last}; solids have 1 to 3")
    value = finite(fields[3], source, "*BOUNDARY") if len(fields) > 3 and fields[3] else 0.0
    return [axis - 1 for axis in range(first, last + 1) if axis <= 3], value


def _gravity(fields: list[str], source: Source, size: float) -> NDArray[np.float64]:
    if len(fields) != 6:
        raise source.refuse("*DLOAD, GRAV needs a size and a direction")
    direction = np.array([finite(text, source, "*DLOAD") for text in fields[3:6]])
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise source.refuse("*DLOAD, GRAV: a direction of no length")
    return size * direction / length


def _added(
    known: tuple[float, float, float] | None, more: NDArray[np.float64]
) -> tuple[float, float, float]:
    x, y, z = (np.array(known or (0.0, 0.0, 0.0)) + more).tolist()
    return x, y, z
