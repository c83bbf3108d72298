"""Errors that say which input cannot be used, with the data that shows it.

Every class derives from InputError; the command line turns it into exit code 2.
"""

from __future__ import annotations

from collections.abc import Sequence


def first_of(items: Sequence[object], limit: int = 5) -> str:
    """The first few entries of a list, as text for a message."""
    shown = ", ".join(str(item) for item in items[:limit])
    return shown if len(items) <= limit else f"{shown} and {len(items) - limit} more"


def made_anew(kind: type[Exception], args: tuple[object, ...], fields: dict[str, object]) -> object:
    """An error from its pickle: not by what its class takes, which its message does not have."""
    error = kind.__new__(kind, *args)
    vars(error).update(fields)
    return error


class InputError(ValueError):
    """The input cannot be used; the message names the thing, the value and the remedy.

    >>> import palpate
    >>> try:
    ...     palpate.Material(youngs_modulus=10e3, poissons_ratio=0.5)
    ... except palpate.InputError as error:
    ...     print(str(error)[:20])
    poissons_ratio = 0.5
    """

    def __reduce__(self) -> tuple[object, ...]:
        return made_anew, (type(self), self.args, vars(self))


class FileFormatError(InputError):
    """A file is missing, unreadable, malformed or of an unknown kind; `.path` names it."""

    def __init__(self, path: object, reason: str) -> None:
        self.path = str(path)
        super().__init__(f"{path}: {reason}")


class DisagreeingSupportsError(InputError):
    """Supports prescribe different displacements of a point: `.points`, `.supports` (from 1).

    `.time` is the time of it [s]; None in statics.
    """

    def __init__(
        self,
        points: Sequence[int],
        supports: tuple[int, int],
        direction: str,
        wanted: tuple[float, float],
        time: float | None = None,
    ) -> None:
        self.points = [int(i) for i in points]
        self.supports = supports
        self.time = time
        when = "" if time is None else f" at {time:.4g} s"
        super().__init__(
            f"supports {supports[0]} and {supports[1]} disagree at {len(self.points)} point(s), "
            f"{first_of(self.points)}: along {direction}{when} one wants {wanted[0]:.6g} m and the "
            f"other {wanted[1]:.6g} m; separate their regions, or hold other components"
        )


class FacetNotOnBoundaryError(InputError):
    """A facet of a support, load or tool inside the body, or given twice; `.rows` says which."""

    def __init__(
        self, what: str, rows: Sequence[int], corners: Sequence[int], *, is_copy: bool = False
    ) -> None:
        self.rows = [int(i) for i in rows]
        fault = (
            "given twice; remove the copies"
            if is_copy
            else "not on the boundary of the mesh; choose boundary facets"
        )
        super().__init__(f"{what}: {len(self.rows)} facet(s), first {list(corners)}, {fault}")


class TooManyStepsError(InputError):
    """A motion of more time steps than anybody waits for; `.num_steps`, `.time_step` [s]."""

    MOST = 1_000_000_000

    def __init__(self, end_time: float, time_step: float) -> None:
        self.time_step = time_step
        self.num_steps = end_time / time_step if time_step > 0.0 else float("inf")
        super().__init__(
            f"{end_time:.4g} s in steps of {time_step:.3g} s are {self.num_steps:.3g} steps; at "
            f"most {self.MOST:.0e} are taken: check end_time, time_step, and what shortens a "
            "stable step (stiffness, density, damping, the size of the smallest cell)"
        )


class MeshError(InputError):
    """A mesh or surface that cannot be used."""


class ShapeError(MeshError):
    """An array has the wrong shape or kind of number."""


class NonFiniteError(MeshError):
    """A coordinate is NaN or infinite; `.points` holds the indices of the points."""

    def __init__(self, points: Sequence[int]) -> None:
        self.points = [int(i) for i in points]
        super().__init__(
            f"{len(self.points)} point(s) with a coordinate that is NaN or infinite: "
            f"{first_of(self.points)}; repair or drop them"
        )


class IndexRangeError(MeshError):
    """A cell or facet names a point that does not exist; `.rows` holds the guilty rows."""

    def __init__(self, what: str, rows: Sequence[int], num_points: int) -> None:
        self.rows = [int(i) for i in rows]
        super().__init__(
            f"{len(self.rows)} {what} name a point outside 0..{num_points - 1}: "
            f"{first_of(self.rows)}; the file is damaged or numbered from one"
        )


class InvertedCellError(MeshError):
    """Cells of zero or negative volume; `.cells` and `.signed_volumes` hold them."""

    def __init__(self, cells: Sequence[int], signed_volumes: Sequence[float]) -> None:
        self.cells = [int(i) for i in cells]
        self.signed_volumes = [float(v) for v in signed_volumes]
        worst = min(self.signed_volumes, default=0.0)
        super().__init__(
            f"{len(self.cells)} cell(s) inverted or flat: {first_of(self.cells)}; smallest signed "
            f"volume {worst:.3g} m3; re-mesh, or swap two points of each if all are mirrored"
        )
