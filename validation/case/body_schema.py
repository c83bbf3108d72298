"""The keys of a case file for the body: numbers, regions, geometry, mesh and materials."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from palpate.meshes.material_law import Law
from palpate.meshes.repair.choices import LARGEST_HOLE, LIMIT
from palpate.meshes.untrusted import is_a_float

# Largest number that a float64 and a machine word both represent without loss.
LARGEST_COUNT = 2**53


def plain_number(value: Any) -> Any:
    """A finite number, as it stands; anything else is refused."""
    if isinstance(value, bool):
        raise PydanticCustomError("number", "is a truth value; write a number")
    if isinstance(value, str):
        raise PydanticCustomError("number", "is text; write the number without quotes")
    if not isinstance(value, int | float):
        raise PydanticCustomError("number", "is no number")
    if not is_a_float(value):
        is_whole = isinstance(value, int)
        message = "is beyond the range of a float" if is_whole else "is not finite"
        raise PydanticCustomError("number", f"{message}; write a finite number")
    return value


def _plain_count(value: Any) -> Any:
    plain_number(value)
    if not isinstance(value, int):
        raise PydanticCustomError("number", "must be a whole number, without a point")
    if abs(value) > LARGEST_COUNT:
        raise PydanticCustomError("number", "is too large to count with")
    return value


def _truth_value(value: Any) -> Any:
    if not isinstance(value, bool):
        raise PydanticCustomError("truth_value", "must be true or false, without quotes")
    return value


Number = Annotated[float, BeforeValidator(plain_number)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Count = Annotated[int, BeforeValidator(_plain_count)]
Flag = Annotated[bool, BeforeValidator(_truth_value)]
Vector = tuple[Number, Number, Number]


def _usable(value: Any) -> Any:
    """Refuse what cannot be written out as JSON, with the path to it."""
    _require_usable(value, ())
    return value


def _require_usable(value: Any, location: tuple[str | int, ...]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _require_usable(item, (*location, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _require_usable(item, (*location, index))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        if not is_a_float(value):
            raise PydanticCustomError(
                "published", "is no finite number", {"path": location, "value": repr(value)}
            )
    elif not isinstance(value, str | bool):
        kind = type(value).__name__
        raise PydanticCustomError(
            "published", f"is a {kind}; write it as text, in quotes", {"path": location}
        )


# Text, truth values, finite numbers, and lists and tables of them.
PlainData = Annotated[dict[str, Any], AfterValidator(_usable)]


class Table(BaseModel):
    """Unknown keys, NaN and infinity are errors; the text below a key describes it to all."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        protected_namespaces=(),
        use_attribute_docstrings=True,
    )


class BoxRegion(Table):
    """Between two corners, in the case's length unit."""

    min: Vector
    """Lowest corner [units.length]."""
    max: Vector
    """Highest corner [units.length]."""


class BallRegion(Table):
    """Within a radius of a centre."""

    center: Vector
    """Centre [units.length]."""
    radius: Positive
    """Radius [units.length]."""


class HalfSpaceRegion(Table):
    """The side of a plane to which its normal points."""

    point: Vector
    """A point of the plane [units.length]."""
    normal: Vector
    """Points into the half that is meant; any length."""


class RegionSpec(Table):
    """Part of the boundary: where all the given conditions hold."""

    box: BoxRegion | None = None
    """Between two corners."""
    ball: BallRegion | None = None
    """Within a radius of a centre."""
    half_space: HalfSpaceRegion | None = None
    """One side of a plane."""
    group: str | None = None
    """A name in the mesh file: a group of facets; for some keys of cells or single points."""
    nearest: Vector | None = None
    """The one point of the boundary nearest to this position [units.length]; stands alone."""

    @model_validator(mode="after")
    def _says_something(self) -> RegionSpec:
        if not self.model_fields_set:
            raise ValueError("needs one of box, ball, half_space, group, nearest")
        if self.nearest is not None and len(self.model_fields_set) > 1:
            raise ValueError("nearest stands alone")
        return self


# Sizes of each built-in shape, in the order in which its maker takes them.
SHAPES: dict[str, tuple[str, ...]] = {
    "box": ("size",),
    "beam": ("length", "width", "height"),
    "cylinder": ("radius", "height"),
    "sphere": ("radius",),
    "kidney": (),
    "hollow_sphere": ("radius", "inner_radius"),
    "hollow_octant": ("radius", "inner_radius"),
    "tube": ("radius", "inner_radius", "height"),
}


if TYPE_CHECKING:
    ShapeName: TypeAlias = str
else:
    ShapeName = Literal[tuple(SHAPES)]
_REPAIR_KEYS = ("repair_distance", "repair_limit", "largest_hole", "smallest_shell")


class GeometrySpec(Table):
    """Exactly one of a built-in shape, a surface file or a mesh file."""

    shape: ShapeName | None = None
    """A built-in shape, instead of a file; an octant has x, y, z >= 0, for symmetry planes."""
    surface: str | None = None
    """A closed surface beside this file: .stl, .obj, .ply, .off, .msh, .vtk, .vtu, .vtp, .glb."""
    mesh: str | None = None
    """A mesh of tetrahedra beside this file, instead of a surface: .msh, .vtk, .vtu."""
    repair: Flag = False
    """Whether to repair the surface; the report says what was changed."""
    repair_distance: Positive | None = None
    """How far each of its parts may move [units.length]; half the part's mean edge if not said."""
    repair_limit: NotNegative = LIMIT
    """Largest change of a part's volume [%]; from 100 on parts may be lost or fused."""
    largest_hole: Annotated[Count, Field(ge=0)] = LARGEST_HOLE
    """Most edges of a hole that is closed; facet groups "cap 1", ... are what closes them."""
    smallest_shell: NotNegative = 0.0
    """Loose parts whose box is shorter are dropped [units.length]."""
    wrap: Positive | None = None
    """A new closed surface around it, or around what is repaired, this far away [units.length]."""
    size: Vector | None = None
    """Lengths of a box along x, y, z [units.length]."""
    length: Positive | None = None
    """Length of a beam, along x [units.length]."""
    width: Positive | None = None
    """Width of a beam, along y [units.length]."""
    height: Positive | None = None
    """Height of a beam, a cylinder or a tube, along z [units.length]."""
    radius: Positive | None = None
    """Radius of a cylinder or a sphere, the outer one of hollow shapes [units.length]."""
    inner_radius: Positive | None = None
    """Inner radius of hollow shapes, below the radius [units.length]."""
    edge_length: Positive | None = None
    """Edge length of a shape's facets [units.length]."""

    @model_validator(mode="after")
    def _is_one_thing(self) -> GeometrySpec:
        given = [k for k in ("shape", "surface", "mesh") if getattr(self, k) is not None]
        if len(given) != 1:
            raise ValueError("needs exactly one of shape, surface, mesh")
        parameters = {*SHAPES[self.shape], "edge_length"} if self.shape else set()
        extra = self.model_fields_set - parameters - {"shape", "surface", "mesh"}
        if self.surface is not None:
            extra -= {"wrap", "repair"}
            extra -= set(_REPAIR_KEYS if self.repair else ())
        what = f"shape {self.shape!r}" if self.shape else given[0]
        hint = "; cells are sized by edge_length" if extra == {"size"} else ""
        require_keys(what, missing=parameters - self.model_fields_set, extra=extra, hint=hint)
        return self


def require_keys(what: str, *, missing: set[str], extra: set[str], hint: str = "") -> None:
    """Raise ValueError for keys that something needs, or does not take."""
    wrongs = [f"takes no {', '.join(sorted(extra))}"] if extra else []
    wrongs += [f"needs {', '.join(sorted(missing))}"] if missing else []
    if wrongs:
        raise ValueError(f"{what} {' and '.join(wrongs)}{hint}")


class GradeSpec(Table):
    """Smaller cells towards a point, a ball or the whole boundary; sizes grow with distance."""

    point: Vector | None = None
    """The position of the smallest cells [units.length]."""
    ball: BallRegion | None = None
    """A ball whose cells are the smallest, instead of a point."""
    boundary: Flag = False
    """Whether the smallest cells are along the whole boundary, instead of at a point."""
    smallest: Positive
    """Edge length there [units.length]."""
    growth: Positive = 0.5
    """Edge length over the distance from there [-]."""

    @model_validator(mode="after")
    def _is_towards_one_thing(self) -> GradeSpec:
        if (self.point is not None) + (self.ball is not None) + self.boundary != 1:
            raise ValueError("needs exactly one of point, ball, boundary = true")
        return self


class MeshSpec(Table):
    """The program that fills a surface, and how finely it does so."""

    mesher: Literal["auto", "fastsim", "gmsh"] = "auto"
    """The program; auto is fastsim's mesher, and gmsh where that gives up."""
    edge_length: Positive | None = None
    """Wanted edge length inside [units.length]; the mean of the surface's where nothing is said."""
    interior: Literal["uniform", "graded"] = "uniform"
    """Or cells that grow from the surface inwards, to edge_length or eight of its mean edges."""
    boundary: Literal["kept", "free"] = "kept"
    """The given facets, or better ones within a distance of them."""
    boundary_distance: Positive | None = None
    """How far a free boundary may lie from the given one [units.length]."""
    grade: tuple[GradeSpec, ...] = ()
    """Cells are bisected until each is as small as every grade asks."""

    @model_validator(mode="after")
    def _free_says_how_far(self) -> MeshSpec:
        if (self.boundary == "free") != (self.boundary_distance is not None):
            raise ValueError('boundary = "free" and boundary_distance go together')
        return self


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
    """Density [units.density], above 0; matters for weight and motion."""
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    """For strain = "green"; under "linear" all are Hooke's law. Inclusions follow their body's."""
    c10: Number | None = None
    """mooney-rivlin takes this and the next two, not moduli; so does -log [units.stress]."""
    c01: Number | None = None
    """Second constant [units.stress]; 2 (c10 + c01) is the shear modulus."""
    bulk_modulus: Number | None = None
    """Bulk modulus [units.stress], above 0."""
    mu_1: Number | None = None
    """ogden takes bulk_modulus and one to three such pairs [units.stress]."""
    alpha_1: Number | None = None
    """Exponent of the first term [-]; half the sum of mu alpha is the shear modulus, above 0."""
    mu_2: Number | None = None
    """Modulus of the second term [units.stress]."""
    alpha_2: Number | None = None
    """Exponent of the second term [-]."""
    mu_3: Number | None = None
    """Modulus of the third term [units.stress]."""
    alpha_3: Number | None = None
    """Exponent of the third term [-]."""

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
                raise PydanticCustomError("missing", "needed", {"path": (key,)})
        for key in others:
            if getattr(self, key) is not None:
                raise ValueError(f"law = {self.law} takes {', '.join(needed)}, not {key}")
        return self


class InclusionSpec(Table):
    """Cells of another material: in a region, of a group, or within a surface of their own."""

    region: RegionSpec | None = None
    """A box, a ball or a half_space, for cells whose centroid lies in it; or a group of cells."""
    surface: str | None = None
    """A closed surface beside this file, instead of a region: its facets are in the mesh."""
    label: str | None = None
    """A name that `palpate mesh --label` gave to cells of the mesh file, instead of a region."""
    material: MaterialSpec
    """Material of those cells."""

    @model_validator(mode="after")
    def _chooses_cells(self) -> InclusionSpec:
        given = [x for x in (self.region, self.surface, self.label) if x is not None]
        if len(given) != 1:
            raise ValueError("an inclusion needs exactly one of region, surface, label")
        if self.region is not None and self.region.nearest is not None:
            raise ValueError("the region of an inclusion is a box, a ball, a half_space or a group")
        return self
