"""Units of a case, turned into SI once, where the case is read."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from palpate.validation.conversions import DENSITY, FORCE, LENGTH, MASS, STRESS, Conversions

__all__ = ["DENSITY", "FORCE", "LENGTH", "MASS", "STRESS", "Units"]


class Units(Conversions, BaseModel):
    """The units a case is written in; SI where nothing is said."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    length: Literal["m", "cm", "mm"] = "m"
    """Unit of every length, and of the surface or mesh file."""
    force: Literal["N", "mN", "kN"] = "N"
    """Unit of every force."""
    stress: Literal["Pa", "kPa", "MPa"] = "Pa"
    """Unit of moduli, tractions and pressures."""
    density: Literal["kg/m3", "g/cm3"] = "kg/m3"
    """Unit of densities."""
    mass: Literal["kg", "g"] = "kg"
    """Unit of a [[mass]]."""
