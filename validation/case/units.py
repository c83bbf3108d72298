"""Units of a case, turned into SI once, at the door."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
STRESS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
DENSITY = {"kg/m3": 1.0, "g/cm3": 1e3}


class Units(BaseModel):
    """The units a case is written in; SI where nothing is said."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    length: Literal["m", "cm", "mm"] = "m"
    force: Literal["N", "mN", "kN"] = "N"
    stress: Literal["Pa", "kPa", "MPa"] = "Pa"
    density: Literal["kg/m3", "g/cm3"] = "kg/m3"

    def metres(self, value: float) -> float:
        """Turn a length into metres."""
        return value * LENGTH[self.length]

    def newtons(self, value: float) -> float:
        """Turn a force into newtons."""
        return value * FORCE[self.force]

    def pascals(self, value: float) -> float:
        """Turn a stress into pascals."""
        return value * STRESS[self.stress]

    def kilograms_per_cubic_metre(self, value: float) -> float:
        """Turn a density into kg/m3."""
        return value * DENSITY[self.density]
