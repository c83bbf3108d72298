"""Boundary conditions and loads of Abaqus and CalculiX input files."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.importing.abaqus_cards import Card
from palpate.validation.importing.abaqus_mesh import AbaqusMesh
from palpate.validation.importing.model import Face, Hold, Model, Place, finite, whole

# Of Abaqus, for solids: which of x, y, z are held.
_NAMED = {
    "ENCASTRE": (0, 1, 2), "PINNED": (0, 1, 2), "XSYMM": (0,), "YSYMM": (1,), "ZSYMM": (2,),
    "XASYMM": (1, 2), "YASYMM": (0, 2), "ZASYMM": (0, 1),
}  # fmt: skip
_ROTATIONS = (4, 5, 6)


@dataclass(eq=False)
class AbaqusLoads:
    """Cards as they come; `put_into` reads them when the mesh is known."""

    end_time: float = 1.0
    _amplitudes: dict[str, Card] = field(default_factory=dict)
    _cards: list[Card] = field(default_factory=list)

    def take(self, card: Card) -> bool:
        """Keep a card of a load, a support or an amplitude; False where it is none."""
        if card.keyword == "AMPLITUDE":
            card.only("NAME", "TIME", "VALUE", "DEFINITION", "SMOOTH")
            self._amplitudes[card.require("NAME")] = card
            return True
        if card.keyword in ("BOUNDARY", "CLOAD", "DLOAD", "DSLOAD"):
            self._cards.append(card)
            return True
        return False

    def put_into(self, model: Model, mesh: AbaqusMesh) -> None:
        """Read them all.

        Raises:
            ImportRefusedError: What a case cannot say, with its line.
        """
        seen: set[str] = set()
        pushed: dict[tuple[int, int], Place] = {}
        singles: dict[tuple[int, float], list[int]] = {}
        pressed: list[list[tuple[int, int]]] = []
        for card in self._cards:
            if card.parameters.get("OP", "MOD").upper() != "MOD" and card.keyword in seen:
                raise card.refuse(
                    f"*{card.keyword}, OP=NEW takes back what stands above; leave that out"
                )
            seen.add(card.keyword)
            factor = self._factor(card)
            match card.keyword:
                case "BOUNDARY":
                    _boundary(model, mesh, card, factor, singles)
                case "CLOAD":
                    _cload(model, mesh, card, factor, pushed)
                case "DLOAD":
                    _dload(model, mesh, card, factor, pressed)
                case _:
                    _dsload(model, mesh, card, factor, pressed)
        _put_singles(model, singles, self._cards)

    def _factor(self, card: Card) -> float:
        """What the card's amplitude is worth at the end of the step."""
        name = card.parameters.get("AMPLITUDE")
        if name is None:
            return 1.0
        curve = self._amplitudes.get(name.upper())
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


def _boundary(
    model: Model,
    mesh: AbaqusMesh,
    card: Card,
    factor: float,
    singles: dict[tuple[int, float], list[int]],
) -> None:
    card.only("OP", "AMPLITUDE", "TYPE", "FIXED", "LOAD CASE")
    if card.parameters.get("TYPE", "DISPLACEMENT").upper() != "DISPLACEMENT":
        raise card.refuse("*BOUNDARY, TYPE: only displacements are known here")
    if "FIXED" in card.parameters:
        raise card.refuse("*BOUNDARY, FIXED holds points where an earlier step left them")
    for place, fields in card.rows(2, 4):
        axes, value = _held(fields, place)
        value = factor * value + 0.0  # no minus zero
        if not axes:
            model.ignored.append(f"line {place.line} *BOUNDARY of rotations, which solids lack")
            continue
        nodes = mesh.nodes_of(fields[0], place)
        rows = np.array(sorted({mesh.row_of[node] for node in nodes}), dtype=np.int64)
        if len(nodes) == 1:
            for axis in axes:
                singles.setdefault((axis, value), []).extend(rows.tolist())
            continue
        components = dict.fromkeys(axes, value)
        name = fields[0].strip('" ').rpartition(".")[2]
        earlier = model.holds[-1] if model.holds else None
        # Line after line of one set is one support.
        if earlier is not None and earlier.name == name and not set(axes) & set(earlier.components):
            earlier.components.update(components)
        else:
            model.holds.append(Hold(name, rows, components, place))


def _held(fields: list[str], place: Place) -> tuple[list[int], float]:
    """Components from 0, and how far they are moved."""
    word = fields[1].strip().upper()
    if word in _NAMED:
        return list(_NAMED[word]), 0.0
    first = whole(fields[1], place, "*BOUNDARY")
    last = whole(fields[2], place, "*BOUNDARY") if len(fields) > 2 and fields[2] else first
    if not 1 <= first <= last <= 6:
        raise place.refuse(f"*BOUNDARY: degrees of freedom {first} to {last}; solids have 1 to 3")
    value = finite(fields[3], place, "*BOUNDARY") if len(fields) > 3 and fields[3] else 0.0
    axes = [axis - 1 for axis in range(first, last + 1) if axis not in _ROTATIONS]
    return axes, value


def _put_singles(
    model: Model, singles: dict[tuple[int, float], list[int]], cards: list[Card]
) -> None:
    """Nodes that were held one by one: those of one component and place are one support."""
    place = next((card.place for card in cards if card.keyword == "BOUNDARY"), None)
    by_nodes: dict[tuple[int, ...], dict[int, float]] = {}
    for (axis, value), rows in singles.items():
        by_nodes.setdefault(tuple(sorted(set(rows))), {})[axis] = value
    for nodes, components in by_nodes.items():
        assert place is not None
        model.holds.append(Hold("held", np.array(nodes, dtype=np.int64), components, place))


def _cload(
    model: Model,
    mesh: AbaqusMesh,
    card: Card,
    factor: float,
    pushed: dict[tuple[int, int], Place],
) -> None:
    card.only("OP", "AMPLITUDE", "LOAD CASE")
    for place, fields in card.rows(3, 3):
        axis = whole(fields[1], place, "*CLOAD") - 1
        if axis not in (0, 1, 2):
            raise place.refuse(f"*CLOAD: degree of freedom {axis + 1}; solids have 1, 2 and 3")
        value = factor * finite(fields[2], place, "*CLOAD")
        for node in mesh.nodes_of(fields[0], place):
            row = mesh.row_of[node]
            other = pushed.setdefault((row, axis), place)
            if other is not place:
                raise place.refuse(
                    f"*CLOAD: node {node} is pushed along {'xyz'[axis]} in line {other.line} too; "
                    "programs differ in whether they add: give the sum once"
                )
            model.forces[row, axis] += value


def _dload(
    model: Model, mesh: AbaqusMesh, card: Card, factor: float, pressed: list[list[tuple[int, int]]]
) -> None:
    card.only("OP", "AMPLITUDE", "LOAD CASE")
    faces: dict[float, tuple[Place, list[tuple[int, int]]]] = {}
    for place, fields in card.rows(3, 6):
        kind = fields[1].strip().upper()
        value = factor * finite(fields[2], place, "*DLOAD")
        if kind == "GRAV":
            _require_whole(mesh, fields[0], place)
            _gravity(model, place, fields, value)
        elif kind in ("BX", "BY", "BZ"):
            _require_whole(mesh, fields[0], place)
            force = np.array(model.body_force or (0.0, 0.0, 0.0))
            force["XYZ".index(kind[1])] += value
            model.body_force = (float(force[0]), float(force[1]), float(force[2]))
        else:
            if not (len(kind) == 2 and kind[0] == "P"):
                raise place.refuse(
                    f"*DLOAD of kind {kind[:20]!r}; known here are P1 to P6, GRAV, BX, BY, BZ"
                )
            named = mesh.faces_of(fields[0], kind, "P", place)
            faces.setdefault(value, (place, []))[1].extend(named)
    for pressure, (place, named) in faces.items():
        model.faces.append(_pressed("pressed", mesh, named, place, pressure, pressed))


def _require_whole(mesh: AbaqusMesh, text: str, place: Place) -> None:
    """A load by volume has to be of the whole body; an empty field is."""
    if text.strip() and len(set(mesh.cells_of(text, place))) < len(mesh.cells):
        raise place.refuse("*DLOAD: weight of a part; a case weighs the whole body")


def _gravity(model: Model, place: Place, fields: list[str], size: float) -> None:
    if len(fields) != 6:
        raise place.refuse("*DLOAD, GRAV needs a size and a direction")
    direction: Points = np.array([finite(text, place, "*DLOAD") for text in fields[3:6]])
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise place.refuse("*DLOAD, GRAV: a direction of no length")
    known = np.array(model.acceleration or (0.0, 0.0, 0.0)) + size * direction / length
    model.acceleration = (float(known[0]), float(known[1]), float(known[2]))


def _dsload(
    model: Model, mesh: AbaqusMesh, card: Card, factor: float, pressed: list[list[tuple[int, int]]]
) -> None:
    card.only("OP", "AMPLITUDE")
    for place, fields in card.rows(3, 3):
        kind, name = fields[1].strip().upper(), fields[0].strip('" ').upper().rpartition(".")[2]
        if kind != "P":
            raise place.refuse(f"*DSLOAD of kind {kind[:20]!r}; known here is P, a pressure")
        if name not in mesh.surfaces:
            raise place.refuse(f"no surface {name[:40]!r}")
        value = factor * finite(fields[2], place, "*DSLOAD")
        model.faces.append(_pressed(name, mesh, mesh.surfaces[name], place, value, pressed))


def _pressed(
    name: str,
    mesh: AbaqusMesh,
    faces: list[tuple[int, int]],
    place: Place,
    pressure: float,
    pressed: list[list[tuple[int, int]]],
) -> Face:
    """Under NLGEOM a pressure follows the body, as a case's does; else both act at rest."""
    earlier = {face for known in pressed for face in known}
    if earlier & set(faces):
        raise place.refuse(
            "a face is pressed in two lines; programs differ in whether they add: give the sum once"
        )
    pressed.append(faces)
    return Face(name, mesh.facets(faces), place, pressure=pressure)
