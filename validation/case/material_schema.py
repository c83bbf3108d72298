"""The keys of a case file for what the body is made of."""

from __future__ import annotations

from pydantic import ConfigDict, model_validator
from pydantic_core import PydanticCustomError

from palpate.meshes.material_law import Law
from palpate.validation.case.numbers import Number
from palpate.validation.case.region_schema import RegionSpec, Table

_MODULI = ("youngs_modulus", "poissons_ratio")
_OF_MOONEY_RIVLIN = ("c10", "c01", "bulk_modulus")
_OF_OGDEN = ("mu_1", "alpha_1", "bulk_modulus")
_MORE_OF_OGDEN = (("mu_2", "alpha_2"), ("mu_3", "alpha_3"))


class MaterialSpec(Table):
    """Isotropic solid; the ranges are checked where it is built."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [{"required": list(keys)} for keys in (_MODULI, _OF_MOONEY_RIVLIN, _OF_OGDEN)]
        }
    )

    youngs_modulus: Number | None = None
    """Young's modulus at rest [units.stress], above 0."""
    poissons_ratio: Number | None = None
    """Poisson's ratio at rest [-], between -1 and 0.5; linear cells lock near 0.5."""
    density: Number = 1000.0
    """[units.density], above 0; matters for weight and motion."""
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    """For strain = "green"; with "linear" all are Hooke's law. Inclusions follow their body's."""
    c10: Number | None = None
    """mooney-rivlin takes this and the next two, not moduli; so does -log [units.stress]."""
    c01: Number | None = None
    """[units.stress]; 2 (c10 + c01) is the shear modulus."""
    bulk_modulus: Number | None = None
    """[units.stress], above 0."""
    mu_1: Number | None = None
    """ogden takes bulk_modulus and one to three such pairs [units.stress]."""
    alpha_1: Number | None = None
    """Its exponent [-]; half the sum of mu alpha is the shear modulus, above 0."""
    mu_2: Number | None = None
    """Of the second term [units.stress]."""
    alpha_2: Number | None = None
    """Its exponent [-]."""
    mu_3: Number | None = None
    """Of the third term [units.stress]."""
    alpha_3: Number | None = None
    """Its exponent [-]."""

    @model_validator(mode="after")
    def _has_its_constants(self) -> MaterialSpec:
        needed: tuple[str, ...] = _MODULI
        if self.law.has_c01:
            needed = _OF_MOONEY_RIVLIN
        elif self.law is Law.OGDEN:
            needed = _OF_OGDEN
            for pair in _MORE_OF_OGDEN:
                if any(getattr(self, key) is not None for key in pair):
                    needed += pair
        known = (*_MODULI, *_OF_MOONEY_RIVLIN, *_OF_OGDEN, *sum(_MORE_OF_OGDEN, ()))
        others = [key for key in known if key not in needed]
        for key in needed:
            if getattr(self, key) is None:
                raise PydanticCustomError("missing", "needed", {"place": (key,)})
        for key in others:
            if getattr(self, key) is not None:
                raise ValueError(f"law = {self.law} takes {', '.join(needed)}, not {key}")
        return self


class InclusionSpec(Table):
    """Cells of another material: in a region, of a group, or within a surface of their own."""

    region: RegionSpec | None = None
    """A box, a ball or a half_space, for cells whose centroid lies in it; or a group of cells."""
    surface: str | None = None
    """A closed surface beside this file, in the place of a region: its facets are in the mesh."""
    material: MaterialSpec
    """Of those cells."""

    @model_validator(mode="after")
    def _chooses_cells(self) -> InclusionSpec:
        if (self.region is None) == (self.surface is None):
            raise ValueError("an inclusion needs either a region or a surface")
        if self.region is not None and self.region.nearest is not None:
            raise ValueError("the region of an inclusion is a box, a ball, a half_space or a group")
        return self
