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

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Strain
from palpate.validation.importing.abaqus_acting import AbaqusLoads
from palpate.validation.importing.abaqus_cards import Card, read_cards
from palpate.validation.importing.abaqus_material import AbaqusMaterials
from palpate.validation.importing.abaqus_mesh import AbaqusMesh
from palpate.validation.importing.model import ImportRefusedError, Model

# What is written where, and how the solver goes about it; by keyword.
_HARMLESS = {
    "NODE PRINT", "NODE FILE", "NODE OUTPUT", "EL PRINT", "EL FILE", "ELEMENT OUTPUT", "OUTPUT",
    "ENERGY OUTPUT", "ENERGY PRINT", "ENERGY FILE", "SECTION PRINT", "PREPRINT", "PRINT", "RESTART",
    "FILE FORMAT", "MONITOR", "CONTROLS", "SOLUTION TECHNIQUE", "NO OUTPUT",
}  # fmt: skip
# Of a model of one part that lies where it was drawn.
_FRAME = {"PART", "END PART", "ASSEMBLY", "END ASSEMBLY", "INSTANCE", "END INSTANCE"}


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
    """Card by card; loads are put together when all of the mesh is known."""

    def __init__(self, path: Path) -> None:
        self.path, self.title = path, ""
        self.mesh, self.materials, self.loads = AbaqusMesh(), AbaqusMaterials(), AbaqusLoads()
        self.ignored: list[str] = []
        self.frame: dict[str, Card] = {}
        self.step: Card | None = None
        self.is_ended = False
        self.has_static = False
        self.takers: tuple[Callable[[Card], bool], ...] = (
            self._frame, self._step, self.mesh.take, self.materials.take, self.loads.take
        )  # fmt: skip

    def take(self, card: Card) -> None:
        """Read a card.

        Raises:
            ImportRefusedError: A keyword that is not known, or what it says is not.
        """
        if self.is_ended and card.keyword == "STEP":
            raise card.refuse("a second step; a case has one state of loads: split the model")
        if card.keyword == "HEADING":
            self.title = " ".join(", ".join(fields) for _, fields in card.lines)[:80].strip()
            return
        if card.keyword in _HARMLESS:
            self.ignored.append(f"line {card.place.line} *{card.keyword}")
            return
        if not any(take(card) for take in self.takers):
            raise card.refuse(
                f"*{card.keyword[:40]} is not known here: it may change the mechanics, so nothing "
                "is imported; take it out if it does not matter"
            )

    def _frame(self, card: Card) -> bool:
        if card.keyword not in _FRAME:
            return False
        if not card.keyword.startswith("END"):
            if card.keyword in self.frame:
                raise card.refuse(f"a second *{card.keyword}; a case has one body")
            self.frame[card.keyword] = card
        if card.lines:
            # Data of *INSTANCE turn or move the part.
            raise card.lines[0][0].refuse(f"*{card.keyword}: a part that is moved or turned")
        return True

    def _step(self, card: Card) -> bool:
        match card.keyword:
            case "STEP":
                card.only(
                    "NLGEOM", "INC", "INCF", "NAME", "AMPLITUDE", "UNSYMM", "EXTRAPOLATION",
                    "SOLVER", "CONVERT SDI",
                )  # fmt: skip
                self.step = card
            case "STATIC":
                if self.step is None:
                    raise card.refuse("*STATIC stands in a *STEP")
                card.only("SOLVER", "DIRECT", "TIME RESET", "TOTAL TIME AT START")
                self.has_static = True
                numbers = card.numbers()
                self.loads.end_time = numbers[1] if len(numbers) > 1 else 1.0
            case "END STEP":
                self.is_ended = True
            case _:
                return False
        return True

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
        bodies, body_of = self.materials.finish(self.mesh, self.path)
        given = self.step.parameters.get("NLGEOM")
        is_green = given is not None and given.upper() != "NO"
        model = Model(
            self.path,
            "Abaqus or CalculiX",
            nodes,
            corners,
            middles,
            bodies,
            body_of,
            _labels(self.mesh),
            title=self.title,
            strain=Strain.GREEN if is_green else Strain.LINEAR,
            told=self.mesh.told(),
            ignored=self.ignored,
        )
        self.materials.explain(model)
        self.loads.put_into(model, self.mesh)
        return model


def _labels(mesh: AbaqusMesh) -> NDArray[np.int64]:
    return np.array(list(mesh.nodes), dtype=np.int64)
