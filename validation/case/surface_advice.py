"""What is wrong with a surface file, for people: where, by its numbers, and what mends it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from palpate.fastsim.mending.untangle import EntangledError
from palpate.fastsim.mesher import BoundaryRecoveryError, DuplicatePointError, FlatCellError
from palpate.fastsim.nested_bodies import CrossingBodiesError
from palpate.meshes.errors import (
    DegenerateFacetError,
    DuplicateFacetError,
    FinError,
    InputError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
    SelfIntersectionError,
    SurfaceError,
)
from palpate.meshes.tri_surface import TriSurface

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
