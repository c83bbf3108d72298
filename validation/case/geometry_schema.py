"""The keys of a case file for the body: its geometry, and how it is filled."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from palpate.meshes.repair.choices import LARGEST_HOLE
from palpate.validation.case.numbers import Count, Flag, NotNegative, Positive, Vector
from palpate.validation.case.region_schema import BallRegion, Table

# Of each built-in shape its sizes, in the order in which its maker takes them.
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


_REPAIR_KEYS = ("repair_distance", "largest_hole", "smallest_shell")


class GeometrySpec(Table):
    """Exactly one of a built-in shape, a surface file or a mesh file."""

    shape: (
        Literal[
            "box",
            "beam",
            "cylinder",
            "sphere",
            "kidney",
            "hollow_sphere",
            "hollow_octant",
            "tube",
        ]
        | None
    ) = None
    """A built-in shape, in place of a file; an octant has x, y, z >= 0, for symmetry planes."""
    surface: str | None = None
    """A closed surface beside this file: .stl, .obj, .ply, .off, .msh, .vtk, .vtu."""
    mesh: str | None = None
    """A mesh of tetrahedra beside this file, in place of a surface: .msh, .vtk, .vtu."""
    repair: Flag = False
    """Mend the surface; what was done stands in the report."""
    repair_distance: Positive | None = None
    """How far it may move where it cuts itself [units.length]; two mean edges where not said."""
    largest_hole: Annotated[Count, Field(ge=0)] = LARGEST_HOLE
    """Most edges of a hole that is closed; facet groups "cap 1", ... are what closes them."""
    smallest_shell: NotNegative = 0.0
    """Loose parts whose box is shorter are dropped [units.length]."""
    wrap: Positive | None = None
    """A new closed surface around it, at most this far away, in place of repair [units.length]."""
    size: Vector | None = None
    """Of a box along x, y, z [units.length]."""
    length: Positive | None = None
    """Of a beam, along x [units.length]."""
    width: Positive | None = None
    """Of a beam, along y [units.length]."""
    height: Positive | None = None
    """Of a beam, a cylinder or a tube, along z [units.length]."""
    radius: Positive | None = None
    """Of a cylinder or a sphere, outside of what is hollow [units.length]."""
    inner_radius: Positive | None = None
    """Of what is hollow, below the radius [units.length]."""
    edge_length: Positive | None = None
    """Of a shape's facets [units.length]."""

    @model_validator(mode="after")
    def _is_one_thing(self) -> GeometrySpec:
        given = [k for k in ("shape", "surface", "mesh") if getattr(self, k) is not None]
        if len(given) != 1:
            raise ValueError("needs exactly one of shape, surface, mesh")
        parameters = {*SHAPES[self.shape], "edge_length"} if self.shape else set()
        extra = self.model_fields_set - parameters - {"shape", "surface", "mesh"}
        if self.surface is not None:
            extra -= {"wrap"} if self.wrap is not None else {"repair"}
            extra -= set(_REPAIR_KEYS if self.repair else ())
        missing = parameters - self.model_fields_set
        what = f"shape {self.shape!r}" if self.shape else given[0]
        wrongs = [f"takes no {', '.join(sorted(extra))}"] if extra else []
        wrongs += [f"needs {', '.join(sorted(missing))}"] if missing else []
        if wrongs:
            hint = "; cells are sized by edge_length" if extra == {"size"} else ""
            raise ValueError(f"{what} {' and '.join(wrongs)}{hint}")
        return self


class GradeSpec(Table):
    """Smaller cells towards a point, a ball or the whole boundary; sizes grow with distance."""

    point: Vector | None = None
    """The place with the smallest cells [units.length]."""
    ball: BallRegion | None = None
    """Or all of a ball."""
    boundary: Flag = False
    """Or all of the boundary."""
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
    """Who fills a surface, and how finely."""

    mesher: Literal["auto", "fastsim", "gmsh"] = "auto"
    """Who fills the surface; auto is fastsim's mesher, and gmsh where that gives up."""
    edge_length: Positive | None = None
    """Wanted inside [units.length]; the mean of the surface's where nothing is said."""
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
