"""From a case's geometry to a surface that bounds a solid, with advice where it bounds none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.fastsim.exact_repair.part_changes import ChangedPartError, table
from palpate.fastsim.exact_repair.solid_repair import EntangledError, repair_to_solid
from palpate.fastsim.exact_repair.wrap import WrapError, wrap_surface
from palpate.fastsim.mesher import BoundaryRecoveryError, DuplicatePointError, FlatCellError
from palpate.fastsim.nested_bodies import CrossingBodiesError
from palpate.fastsim.surface_remesher import require_solid
from palpate.meshes.arrays import Points
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.files import read_surface
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import (
    shape_beam,
    shape_box,
    shape_cylinder,
    shape_hollow_octant,
    shape_hollow_sphere,
    shape_sphere,
    shape_tube,
)
from palpate.meshes.shells import turn_bodies
from palpate.meshes.tri_surface import (
    DegenerateFacetError,
    DuplicateFacetError,
    FinError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
    SelfIntersectionError,
    SurfaceError,
    TriSurface,
)
from palpate.validation.conversions import LENGTH, Conversions

if TYPE_CHECKING:
    from palpate.validation.case.body_schema import GeometrySpec

MOST_CELLS = 2_000_000
# Limits for a box around the body, which may be mostly empty.
_MOST_CELLS_OF_BOX, _MOST_FACETS_OF_BOX = 10 * MOST_CELLS, MOST_CELLS
# Regular tetrahedra of edge h fill 6 sqrt(2) to h^3, regular triangles 4 / sqrt(3) to h^2.
_CELLS_PER_CUBE, _FACETS_PER_SQUARE = 8.49, 2.31
# Larger than the kidney of Table I along each axis [m].
_KIDNEY = (0.08, 0.07, 0.15)
_REPAIR = "--repair (repair = true in a case)"
_WRAP = "--wrap D (wrap = D) makes a new closed surface within D of it"
_OTHERS = (
    "--free D (boundary = 'free') may replace facets within D; --mesher gmsh tries another way"
)
# Repairs for each kind of trouble: of a surface as it is given, and after a repair.
REMEDIES: dict[type[InputError], tuple[str, str]] = {
    OpenSurfaceError: (
        f"{_REPAIR} closes holes, --largest-hole N (largest_hole) says how long ones",
        f"--largest-hole N (largest_hole) closes longer ones; {_WRAP}",
    ),
    FinError: (f"{_REPAIR} cuts thin fins off", _WRAP),
    NonManifoldError: (f"{_REPAIR} parts sheets that touch and removes walls within", _WRAP),
    OrientationError: (f"{_REPAIR} turns facets", _WRAP),
    DegenerateFacetError: (f"{_REPAIR} flips edges across flat facets or drops these", _WRAP),
    DuplicateFacetError: (f"{_REPAIR} drops copies", _WRAP),
    SelfIntersectionError: (f"{_REPAIR} repairs what cuts itself", _WRAP),
    EntangledError: ("", _WRAP),
    ChangedPartError: (
        "",
        "--repair-limit P and --repair-distance D (repair_limit, repair_distance) say how much; "
        f"{_WRAP}",
    ),
    BoundaryRecoveryError: (_OTHERS, _OTHERS),
    DuplicatePointError: (f"{_REPAIR} merges points", _WRAP),
    FlatCellError: (f"{_OTHERS}; {_REPAIR} merges points", f"{_OTHERS}; {_WRAP}"),
}
# Files whose facets are counted from 1; the others count from 0.
_FROM_ONE = (".obj", ".msh", ".stl")
_MOST_NAMED = 3


@dataclass(frozen=True, eq=False)
class LoadedSurface:
    """A surface that bounds a solid [m], notes on what was found or done, and groups of its facets.

    What closes holes is group "cap 1", "cap 2", ... `path` is None for a built-in shape; with
    `is_as_given` facets have the file's numbers; `given` are coordinates as in the file,
    (num_given, 3).
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
    time_limit: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> LoadedSurface:
    """Read a surface that bounds a solid, repaired first where that is asked for.

    Bodies that face inwards are turned round, and that is said, without being asked: nothing moves.
    `scale` is metres per unit of the file; `wrap` how far a new surface around it may lie [m], of
    what a repair left where both are asked for. `time_limit` is for the wrap; `progress` is called
    with lines on what takes more than two seconds.

    Raises:
        InputError: It cannot be read, or bounds no solid.
    """
    notes: list[str] = []
    groups: dict[str, list[int]] = {}
    given: list[Points] = []
    surface = read_surface(
        path, scale=scale, tell=notes.append, given=given.append, progress=progress
    )
    is_as_given = repair is None and wrap is None
    try:
        with advised(path, surface, is_as_given=False):
            if repair is not None:
                notes = [n for n in notes if "without a facet" in n]
                try:
                    repaired = repair_to_solid(surface, repair, progress)
                except SurfaceError as error:
                    if wrap is None:
                        raise
                    notes.append(f"wrapped as given, since no repair succeeded: {error.summary}")
                else:
                    surface, groups = repaired.surface, repaired.caps
                    notes += [*repaired.lines, *table(repaired.changes, *_unit_of(scale))]
            if wrap is not None:
                surface, wrapped = wrap_surface(
                    surface, distance=wrap, time_limit=time_limit, progress=progress
                )
                groups = {}
                notes.append(wrapped.line())
    except WrapError as error:
        error.args = (f"{path.name}: {error}",)
        raise
    with advised(path, surface, is_as_given=is_as_given, notes=notes):
        try:
            shells = require_solid(surface)
        except OrientationError:
            surface, count = turn_bodies(surface)
            if not count:
                raise
            shells = require_solid(surface)
            notes.append(f"{count} facet(s) of bodies that faced inwards turned round")
    if len(shells) > 1:
        kinds = Counter(str(shell.kind) for shell in shells)
        notes.append(
            f"{len(shells)} shells: " + ", ".join(f"{n} {kind}" for kind, n in kinds.items())
        )
    return LoadedSurface(surface, notes, groups, path, is_as_given, given[0])


def _unit_of(scale: float) -> tuple[str, float]:
    """A file's unit of length by its size, and this; metres where it has no name."""
    return next(((name, size) for name, size in LENGTH.items() if size == scale), ("m", 1.0))


def _at(point: Iterable[float]) -> str:
    return "at ({}) m".format(", ".join(f"{x + 0.0:.6g}" for x in point))


def _first_number(path: Path | None) -> int:
    return 1 if path is not None and path.suffix.lower() in _FROM_ONE else 0


@contextmanager
def advised(
    path: Path | None, surface: TriSurface, *, is_as_given: bool, notes: Sequence[str] = ()
) -> Iterator[None]:
    """Say what is wrong with a surface by its file's numbers and positions, and what repairs it.

    Numbers where its facets are as given; after `notes` of what was found or done before. Nothing
    is added where there is no file.
    """
    try:
        yield
    except InputError as error:
        kind = next((kind for kind in type(error).__mro__ if kind in REMEDIES), None)
        if path is None or not (kind or isinstance(error, SurfaceError)):
            raise
        what, done, hint = str(error), list[str](), ""
        if isinstance(error, SurfaceError):
            what, done, hint = error.summary, error.done, error.hint
            surface = error.surface or surface
        what += _where(error, path, surface, is_as_given)
        before, after = REMEDIES[kind] if kind is not None else ("", "")
        parts = [*notes, *done, what, hint, before if is_as_given else after]
        error.args = (f"{path.name}: " + "; ".join(part for part in parts if part),)
        raise


def _where(error: InputError, path: Path, surface: TriSurface, is_as_given: bool) -> str:
    """The first facets with their centres [m]; numbers where they are the file's."""
    rows = [f for f in getattr(error, "facets", []) if 0 <= f < surface.num_facets]
    if not rows or isinstance(error, EntangledError):
        return ""
    start = _first_number(path)
    named = []
    for row in rows[:_MOST_NAMED]:
        at = _at(surface.points[surface.facets[row]].mean(axis=0))
        named.append(f"facet {row + start} {at}" if is_as_given else at)
    more = f" and {len(rows) - _MOST_NAMED} more" if len(rows) > _MOST_NAMED else ""
    first = f" (the file's first is {start})" if is_as_given else ""
    return f", {', '.join(named)}{more}{first}"


def crossing_message(error: CrossingBodiesError, bodies: Mapping[str, LoadedSurface]) -> str:
    """Which facets of which files cut or touch each other, and where; bodies by name."""
    labels = {name: name if b.path is None else b.path.name for name, b in bodies.items()}
    found = []
    for pair, position in zip(error.pairs[:_MOST_NAMED], error.positions, strict=False):
        numbers = [
            f"facet {row + _first_number(bodies[name].path)} of {labels[name]}"
            for name, row in zip(error.names, pair, strict=True)
            if bodies[name].is_as_given
        ]
        at = _at(position)
        found.append(f"{' and '.join(numbers)} {at}" if numbers else at)
    more = len(error.pairs) - len(found)
    names = " and ".join(labels[name] for name in dict.fromkeys(error.names))
    return (
        f"{names} {error.why}: {len(error.pairs)} pair(s) of facets, {', '.join(found)}"
        f"{f' and {more} more' if more > 0 else ''}; keep them apart, or give them these facets in "
        "common"
    )


def require_countable(extents: Sequence[float], edge_length: float) -> None:
    """Refuse an edge length [m] that fills a box of these lengths [m] with too much, beforehand.

    Raises:
        InputError: More than 20 million cells, or 2 million facets.
    """
    a, b, c = (max(x / edge_length, 1.0) for x in extents)
    cells, facets = _CELLS_PER_CUBE * a * b * c, 2.0 * _FACETS_PER_SQUARE * (a * b + b * c + c * a)
    if not (cells <= _MOST_CELLS_OF_BOX and facets <= _MOST_FACETS_OF_BOX):
        raise InputError(
            f"edge_length = {edge_length:g} m asks for some {cells:.0e} cells and {facets:.0e} "
            f"facets in a box of {max(extents):g} m; take a larger one"
        )


def build_shape(geometry: GeometrySpec, units: Conversions) -> TriSurface:
    """The surface of a built-in shape; the schema has checked that its parameters are there."""
    from palpate.validation.case.body_schema import SHAPES

    assert geometry.shape is not None
    assert geometry.edge_length is not None
    edge = units.metres(geometry.edge_length)
    sizes = units.sizes(getattr(geometry, key) for key in SHAPES[geometry.shape])
    make, extents = _SHAPES[geometry.shape]
    require_countable(extents(*sizes), edge)
    surface: TriSurface = make(*sizes, edge_length=edge)
    return surface


# What makes each built-in shape, and the lengths of a box around it [m], of its sizes.
_SHAPES: dict[str, tuple[Callable[..., TriSurface], Callable[..., Sequence[float]]]] = {
    "box": (shape_box, lambda size: size),
    "beam": (shape_beam, lambda *sizes: sizes),
    "cylinder": (shape_cylinder, lambda radius, height: (2.0 * radius, 2.0 * radius, height)),
    "sphere": (shape_sphere, lambda radius: (2.0 * radius,) * 3),
    "kidney": (shape_kidney, lambda: _KIDNEY),
    "hollow_sphere": (shape_hollow_sphere, lambda radius, _inner: (2.0 * radius,) * 3),
    "hollow_octant": (shape_hollow_octant, lambda radius, _inner: (radius,) * 3),
    "tube": (shape_tube, lambda radius, _inner, height: (2.0 * radius, 2.0 * radius, height)),
}


def inside_folder(folder: Path, name: str) -> Path:
    """A path of a case; raises InputError where it leaves the case's folder, links included."""
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
