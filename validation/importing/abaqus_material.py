"""Materials and sections of Abaqus and CalculiX input files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.validation.importing.abaqus_cards import Card
from palpate.validation.importing.abaqus_mesh import AbaqusMesh
from palpate.validation.importing.model import Body, ImportRefusedError, Model

_HYPERELASTIC = ("NEO HOOKE", "MOONEY-RIVLIN")
# What else may stand below *MATERIAL without a say in an equilibrium at one temperature.
_HARMLESS = ("DAMPING", "CONDUCTIVITY", "SPECIFIC HEAT")


class AbaqusMaterials:
    """Card by card: materials by their names, and which cells are of which."""

    def __init__(self) -> None:
        self._constants: dict[str, dict[str, Any]] = {}
        self._densities: dict[str, float] = {}
        self._cards: dict[str, Card] = {}
        self._sections: list[Card] = []
        self._left_out: list[str] = []
        self._name: str | None = None

    def take(self, card: Card) -> bool:
        """Read a card of a material or a section; False where it is none."""
        match card.keyword:
            case "MATERIAL":
                card.only("NAME")
                self._name = card.require("NAME")
                if self._name in self._cards:
                    raise card.refuse(f"material {self._name} is there twice")
                self._cards[self._name] = card
            case "ELASTIC":
                self._set(card, _elastic(card))
            case "HYPERELASTIC":
                self._set(card, _hyperelastic(card))
            case "DENSITY":
                card.only()
                self._densities[self._of(card)] = _exactly(card, 1)[0]
            case "SOLID SECTION":
                card.only("ELSET", "MATERIAL", "CONTROLS")
                self._sections.append(card)
            case keyword if keyword in _HARMLESS and self._name is not None:
                self._left_out.append(f"line {card.place.line} *{card.keyword}")
            case _:
                return False
        return True

    def finish(self, mesh: AbaqusMesh, path: Path) -> tuple[list[Body], NDArray[np.int64]]:
        """Materials, and of each cell the index of its own."""
        names: list[str] = []
        body_of = np.full(len(mesh.tetrahedra), -1, dtype=np.int64)
        for section in self._sections:
            name = section.require("MATERIAL")
            if name not in self._constants:
                raise section.refuse(f"no material {name} with *ELASTIC or *HYPERELASTIC")
            if name not in names:
                names.append(name)
            cells = mesh.cells_of(section.require("ELSET"), section.place)
            rows = mesh.rows_of(cells)
            other = body_of[rows]
            if ((other >= 0) & (other != names.index(name))).any():
                raise section.refuse("a cell in two sections of different materials")
            body_of[rows] = names.index(name)
        if (body_of < 0).any():
            row = int(np.argmin(body_of))
            label = next(cell for cell in mesh.cells if row in mesh.rows_of([cell]))
            raise ImportRefusedError(path, None, f"element {label} is in no *SOLID SECTION")
        bodies = [
            Body(self._constants[name], self._densities.get(name), self._cards[name].place)
            for name in names
        ]
        return bodies, body_of

    def explain(self, model: Model) -> None:
        """Say what the cards mean as a law of a case.

        Raises:
            ImportRefusedError: A hyperelastic law without NLGEOM.
        """
        model.ignored += self._left_out
        is_green = model.strain is Strain.GREEN
        for body in model.bodies:
            if "law" in body.constants and not is_green:
                raise body.place.refuse(
                    "*HYPERELASTIC in a step without NLGEOM: programs differ in what that is; "
                    "say NLGEOM, or *ELASTIC"
                )
        if is_green and any("law" not in body.constants for body in model.bodies):
            model.told.append(
                "*ELASTIC under NLGEOM is read as CalculiX has it, Saint-Venant-Kirchhoff; in "
                "Abaqus it is a law of logarithmic strain, which agrees for small strains only"
            )
            for body in model.bodies:
                body.constants.setdefault("law", str(Law.SAINT_VENANT_KIRCHHOFF))

    def _of(self, card: Card) -> str:
        if self._name is None:
            raise card.refuse(f"*{card.keyword} stands below a *MATERIAL")
        return self._name

    def _set(self, card: Card, constants: dict[str, Any]) -> None:
        name = self._of(card)
        if name in self._constants:
            raise card.refuse(f"material {name} has two laws")
        self._constants[name] = constants


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
    if kind == "NEO HOOKE":
        c10, d1 = _exactly(card, 2)
    else:
        c10, c01, d1 = _exactly(card, 3)
    if not d1 > 0.0:
        raise card.refuse("D1 = 0 is a body that cannot change its volume; a case's has D1 > 0")
    bulk, shear = 2.0 / d1, 2.0 * c10
    if kind == "MOONEY-RIVLIN":
        return {"law": str(Law.MOONEY_RIVLIN), "c10": c10, "c01": c01, "bulk_modulus": bulk}
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
