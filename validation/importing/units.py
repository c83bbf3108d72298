"""Systems of units that other simulators' models are written in: their files have none.

Length, force and stress; time is in seconds, so that mass follows: tonnes for mm and N.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from palpate.validation.case.units import FORCE, LENGTH


class UnitSystem(StrEnum):
    """Length, force and stress of a model, which fit together; time in seconds."""

    METRE_NEWTON = "m-N-Pa"
    MILLIMETRE_NEWTON = "mm-N-MPa"
    MILLIMETRE_MILLINEWTON = "mm-mN-kPa"
    METRE_KILONEWTON = "m-kN-kPa"


@dataclass(frozen=True)
class ModelUnits:
    """What turns a model's numbers into those of a case."""

    length: str
    force: str
    stress: str

    @classmethod
    def of(cls, system: UnitSystem) -> ModelUnits:
        """By the system's name."""
        return cls(*system.value.split("-"))

    @property
    def table(self) -> dict[str, str]:
        """The table [units] of a case: lengths, forces and stresses stay as they are."""
        return {
            "length": self.length,
            "force": self.force,
            "stress": self.stress,
            "density": "kg/m3",
        }

    def kilograms_per_cubic_metre(self, density: float) -> float:
        """Of a density in force time^2 / length^4; to 15 digits, so that 1e-9 t/mm3 is 1000."""
        return float(f"{density * FORCE[self.force] / LENGTH[self.length] ** 4:.15g}")

    def metres_per_second_squared(self, acceleration: float) -> float:
        """Of an acceleration in length / s2."""
        return acceleration * LENGTH[self.length]
