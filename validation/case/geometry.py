"""From a case's geometry to a closed surface, with advice where it is none, and to a mesh."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.fastsim.mending.mend import mend_surface
from palpate.fastsim.mending.untangle import EntangledError
from palpate.fastsim.mending.wrap import WrapError, wrap_surface
from palpate.fastsim.mesher import BoundaryRecoveryError, DuplicatePointError, FlatCellError
from palpate.fastsim.nested_bodies import CrossingBodiesError
from palpate.meshes.arrays import Points
from palpate.meshes.errors import (
    DegenerateFacetError,
    DuplicateFacetError,
    FileFormatError,
    FinError,
    InputError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
    SelfIntersectionError,
    SurfaceError,
)
from palpate.meshes.files import read_mesh, read_surface
from palpate.meshes.hollow_shapes import shape_hollow_octant, shape_hollow_sphere, shape_tube
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_beam, shape_box, shape_cylinder, shape_sphere
from palpate.meshes.shells import turn_bodies
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case.body_schema import SHAPES, GeometrySpec, MeshSpec
from palpate.validation.case.meshing import (
    BODY,
    BuiltMesh,
    Filling,
    fill,
    fill_bodies,
    require_countable,
)
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.units import Units

_REPAIR = "--repair (repair = true in a case)"
_WRAP = "--wrap D (wrap = D) makes a new closed surface within D of it"
_OTHERS = (
    "--free D (boundary = 'free') may replace facets within D; --mesher gmsh tries another way"
)
# What mends each kind of trouble: of a surface as it is given, and after a repair.
REMEDIES: dict[type[InputError], tuple[str, str]] = {
    OpenSurfaceError: (
        f"{_REPAIR} closes holes, --largest-hole N (largest_hole) says how long ones",
        f"--largest-hole N (largest_hole) closes longer ones; {_WRAP}",
    ),
    FinError: (f"{_REPAIR} cuts fins off", _WRAP),
    NonManifoldError: (f"{_REPAIR} parts sheets that touch and removes walls within", _WRAP),
    OrientationError: (f"{_REPAIR} turns facets", _WRAP),
    DegenerateFacetError: (f"{_REPAIR} flips edges across flat facets or drops these", _WRAP),
    DuplicateFacetError: (f"{_REPAIR} drops copies", _WRAP),
    SelfIntersectionError: (f"{_REPAIR} mends what cuts itself", _WRAP),
    EntangledError: ("", f"--repair-distance D (repair_distance) allows more; {_WRAP}"),
    BoundaryRecoveryError: (_OTHERS, _OTHERS),
    DuplicatePointError: (f"{_REPAIR} merges points", _WRAP),
    FlatCellError: (f"{_REPAIR} merges points", _WRAP),
}
# Files whose facets are counted from 1; the others count from 0.
_FROM_ONE = (".obj", ".msh", ".stl")
_MOST_NAMED = 3


@contextmanager
def advised(
    path: Path, surface: TriSurface, *, is_as_given: bool, notes: Sequence[str] = ()
) -> Iterator[None]:
    """Say what is wrong with a surface by its file's numbers and places, and what would mend it.

    Args:
        path: Of the file.
        surface: As read or as mended [m].
        is_as_given: Whether its facets are the file's.
        notes: What was found or done before.
    """
    try:
        yield
    except InputError as error:
        known = next((kind for kind in type(error).__mro__ if kind in REMEDIES), None)
        if known is not None or isinstance(error, SurfaceError):
            error.args = (_message(error, path, surface, is_as_given, notes),)
        raise


def crossing_message(
    error: CrossingBodiesError, files: Mapping[str, Path | None], *, as_given: Sequence[str]
) -> str:
    """Which facets of which files cut or touch each other, and where.

    Args:
        error: With the surfaces' names.
        files: By name; None of a shape.
        as_given: Names of surfaces whose facets have their files' numbers.
    """
    said = []
    for pair, place in zip(error.pairs[:_MOST_NAMED], error.places, strict=False):
        numbers = [
            f"facet {row + _first_number(files[name])} of {_label(files[name], name)}"
            for name, row in zip(error.names, pair, strict=True)
            if name in as_given
        ]
        at = "({}) m".format(", ".join(f"{x + 0.0:.6g}" for x in place))
        said.append(f"{' and '.join(numbers)} at {at}" if numbers else f"at {at}")
    more = len(error.pairs) - len(said)
    names = " and ".join(_label(files[name], name) for name in dict.fromkeys(error.names))
    return (
        f"{names} {error.why}: {len(error.pairs)} pair(s) of facets, {', '.join(said)}"
        f"{f' and {more} more' if more > 0 else ''}; keep them apart, or give them these facets in "
        "common"
    )


def _label(path: Path | None, name: str) -> str:
    return name if path is None else path.name


def _first_number(path: Path | None) -> int:
    return 1 if path is not None and path.suffix.lower() in _FROM_ONE else 0


def _message(
    error: InputError, path: Path, surface: TriSurface, is_as_given: bool, notes: Sequence[str]
) -> str:
    kind = next((kind for kind in type(error).__mro__ if kind in REMEDIES), None)
    before, after = REMEDIES[kind] if kind is not None else ("", "")
    what, done, hint = str(error), list[str](), ""
    if isinstance(error, SurfaceError):
        what, done, hint = error.summary, error.done, error.hint
        surface = error.surface or surface
    where = _places(error, path, surface, is_as_given)
    parts = [*notes, *done, f"{what}{where}", hint, before if is_as_given else after]
    return f"{path.name}: " + "; ".join(part for part in parts if part)


def _places(error: InputError, path: Path, surface: TriSurface, is_as_given: bool) -> str:
    """The first facets with their centres [m]; numbers where they are the file's."""
    rows = [f for f in getattr(error, "facets", []) if 0 <= f < surface.num_facets]
    if not rows or isinstance(error, EntangledError):
        return ""
    start = _first_number(path)
    named = []
    for row in rows[:_MOST_NAMED]:
        centre = surface.points[surface.facets[row]].mean(axis=0)
        at = "({}) m".format(", ".join(f"{x + 0.0:.6g}" for x in centre))
        named.append(f"facet {row + start} at {at}" if is_as_given else f"at {at}")
    more = f" and {len(rows) - _MOST_NAMED} more" if len(rows) > _MOST_NAMED else ""
    first = f" (the file's first is {start})" if is_as_given else ""
    return f", {', '.join(named)}{more}{first}"


# Larger than the kidney of Table I along each axis [m].
_KIDNEY = (0.08, 0.07, 0.15)


def build_mesh(spec: CaseSpec, folder: Path) -> BuiltMesh:
    """Make or read the mesh of a case.

    Raises:
        InputError: A file that cannot be read, a surface that bounds no solid, or no mesher
            that manages.
    """
    geometry, units = spec.geometry, spec.units
    scale = units.metres(1.0)
    within = {
        f"inclusion {k}": one.surface
        for k, one in enumerate(spec.inclusion, 1)
        if one.surface is not None
    }
    if geometry.mesh is not None:
        if within:
            raise InputError(
                "an inclusion with a surface needs a body with one, or a shape: give a mesh file's "
                "inclusion by a group of its cells"
            )
        path = inside_folder(folder, geometry.mesh)
        return BuiltMesh(read_mesh(path, scale=scale), f"read from {path.name}")
    if geometry.surface is not None:
        path = inside_folder(folder, geometry.surface)
        wrap = None if geometry.wrap is None else units.metres(geometry.wrap)
        choices = _choices(geometry, units)
        loaded = load_surface(path, scale=scale, repair=choices, wrap=wrap)
    else:
        loaded = LoadedSurface(build_shape(geometry, units), [], {})
    others = {
        name: load_surface(inside_folder(folder, surface), scale=scale)
        for name, surface in within.items()
    }
    built = fill_loaded(loaded, spec.mesh, units, others)
    notes = [note for one in (loaded, *others.values()) for note in one.notes]
    return BuiltMesh(built.mesh, "; ".join([built.origin, *notes]))


def fill_loaded(
    loaded: LoadedSurface,
    spec: MeshSpec,
    units: Units,
    inclusions: Mapping[str, LoadedSurface] | None = None,
    how: Filling | None = None,
) -> BuiltMesh:
    """`fill`, with what is wrong said by the file's numbers; inclusions become groups of cells."""
    if inclusions:
        surfaces = {name: one.surface for name, one in inclusions.items()}
        bodies = {BODY: loaded, **inclusions}
        try:
            given = {BODY: loaded.surface, **surfaces}
            return fill_bodies(given, spec, units, loaded.groups, how)
        except CrossingBodiesError as error:
            files = {name: one.path for name, one in bodies.items()}
            as_given = [name for name, one in bodies.items() if one.is_as_given]
            error.args = (crossing_message(error, files, as_given=as_given),)
            raise
    if loaded.path is None:
        return fill(loaded.surface, spec, units, loaded.groups, how)
    # A free boundary has facets of its own.
    is_as_given = loaded.is_as_given and spec.boundary_distance is None
    with advised(loaded.path, loaded.surface, is_as_given=is_as_given):
        return fill(loaded.surface, spec, units, loaded.groups, how)


def _choices(geometry: GeometrySpec, units: Units) -> RepairChoices | None:
    if not geometry.repair:
        return None
    given = geometry.repair_distance
    return RepairChoices(
        distance=None if given is None else units.metres(given),
        largest_hole=geometry.largest_hole,
        smallest_shell=units.metres(geometry.smallest_shell),
    )


@dataclass(frozen=True, eq=False)
class LoadedSurface:
    """A surface that bounds a solid, lines on what was found or done, and groups of its facets.

    Attributes:
        surface: [m].
        notes: For people, lengths in metres.
        groups: Facets by their number: what closes holes is "cap 1", "cap 2", ...
        path: Of the file; None of a shape.
        is_as_given: Whether facets have the file's numbers.
        given: Coordinates as they stand in the file, shape (num_given, 3).
    """

    surface: TriSurface
    notes: list[str]
    groups: dict[str, list[int]]
    path: Path | None = None
    is_as_given: bool = True
    given: Points | None = None


def load_surface(
    path: Path,
    *,
    scale: float,
    repair: RepairChoices | None = None,
    wrap: float | None = None,
) -> LoadedSurface:
    """Read a surface that bounds a solid, mended first where that is asked for.

    Bodies that face inwards are turned round, and that is said, without being asked: nothing moves.

    Args:
        path: The surface file; named in every message.
        scale: Metres per unit of the file.
        repair: What may be done to it; None nothing.
        wrap: How far a new surface around it may lie [m], in the place of repair; None makes none.

    Raises:
        InputError: It cannot be read, or bounds no solid.
    """
    notes: list[str] = []
    groups: dict[str, list[int]] = {}
    given: list[Points] = []
    surface = read_surface(path, scale=scale, tell=notes.append, given=given.append)
    is_as_given = repair is None and wrap is None
    try:
        with advised(path, surface, is_as_given=False):
            if wrap is not None:
                surface, wrapped = wrap_surface(surface, distance=wrap)
                notes = [wrapped.line()]
            elif repair is not None:
                notes = [n for n in notes if "without a facet" in n]
                mended = mend_surface(surface, repair)
                surface, groups = mended.surface, mended.caps
                notes += mended.lines
    except WrapError as error:
        error.args = (f"{path.name}: {error}",)
        raise
    with advised(path, surface, is_as_given=is_as_given, notes=notes):
        try:
            shells = require_closed(surface)
        except OrientationError:
            surface, count = turn_bodies(surface)
            if not count:
                raise
            shells = require_closed(surface)
            notes.append(f"{count} facet(s) of bodies that faced inwards turned round")
    if len(shells) > 1:
        kinds = Counter(str(shell.kind) for shell in shells)
        notes.append(
            f"{len(shells)} shells: " + ", ".join(f"{n} {kind}" for kind, n in kinds.items())
        )
    return LoadedSurface(surface, notes, groups, path, is_as_given, given[0])


def build_shape(geometry: GeometrySpec, units: Units) -> TriSurface:
    """The surface of a built-in shape; the schema has checked that its parameters are there."""
    assert geometry.shape is not None
    assert geometry.edge_length is not None
    edge = units.metres(geometry.edge_length)
    given = [getattr(geometry, key) for key in SHAPES[geometry.shape]]
    sizes = [units.place(v) if isinstance(v, tuple) else units.metres(v) for v in given]
    require_countable(_extents(geometry.shape, sizes), edge)
    surface: TriSurface = _MAKERS[geometry.shape](*sizes, edge_length=edge)
    return surface


_MAKERS: dict[str, Any] = {
    "box": shape_box,
    "beam": shape_beam,
    "cylinder": shape_cylinder,
    "sphere": shape_sphere,
    "kidney": shape_kidney,
    "hollow_sphere": shape_hollow_sphere,
    "hollow_octant": shape_hollow_octant,
    "tube": shape_tube,
}


def _extents(shape: str, sizes: list[Any]) -> Sequence[float]:
    """Of a box around a built-in shape [m]."""
    match shape, sizes:
        case "box", [size]:
            extents: Sequence[float] = size
            return extents
        case "cylinder", [radius, height]:
            return 2.0 * radius, 2.0 * radius, height
        case "sphere", [radius]:
            return (2.0 * radius,) * 3
        case "hollow_sphere", [radius, _]:
            return (2.0 * radius,) * 3
        case "hollow_octant", [radius, _]:
            return (radius,) * 3
        case "tube", [radius, _, height]:
            return 2.0 * radius, 2.0 * radius, height
        case "kidney", []:
            return _KIDNEY
    return sizes


def inside_folder(folder: Path, name: str) -> Path:
    """A path of a case, which may not leave the case's folder.

    Raises:
        InputError: It does, links included.
    """
    try:
        path = (folder / name).resolve()
        is_there = path.is_file()
    # A loop of links, a NUL in the name, a name of a megabyte.
    except (OSError, RuntimeError, ValueError) as error:
        raise FileFormatError(repr(name), f"is no path that can be followed ({error})") from error
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{name!r} lies outside the case's folder; put the file beside the case")
    if not is_there:
        raise FileFormatError(name, f"no such file beside the case in {folder}")
    return path
