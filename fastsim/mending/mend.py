"""A surface as it comes made to bound a solid: all repairs in their order, each said."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.fastsim.mending.patch_attempts import is_clean
from palpate.fastsim.mending.untangle import untangle
from palpate.fastsim.surface_arrays import mean_edge_length
from palpate.meshes.errors import OpenSurfaceError, SurfaceError
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.repair.surface_repair import RepairReport, repair_surface
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface

# How far the surface may move where nothing is said, of its mean edge: the detail that it resolves.
_EDGES = 2.0


@dataclass(frozen=True, eq=False)
class MendedSurface:
    """A surface, what was done to it, and the facets of its caps.

    Attributes:
        surface: [m].
        lines: What was done, for people.
        caps: Facets, by their number in the surface, of "cap 1" (on the longest loop), "cap 2", ...
    """

    surface: TriSurface
    lines: list[str] = field(default_factory=list)
    caps: dict[str, list[int]] = field(default_factory=dict)


def mend_surface(surface: TriSurface, choices: RepairChoices | None = None) -> MendedSurface:
    """Make a surface bound a solid without crossings, as far as that can be done.

    Args:
        surface: Any [m].
        choices: What may be done.

    Raises:
        SurfaceError: What cannot be mended, with the guilty facets.
    """
    choices = choices or RepairChoices()
    repaired, report = repair_surface(
        surface,
        largest_hole=choices.largest_hole,
        smallest_shell=choices.smallest_shell,
        fits=is_clean,
    )
    _require_mended(repaired, report)
    distance = choices.distance
    if distance is None:
        distance = _EDGES * mean_edge_length(repaired.points, repaired.facets)
    mended, done, number = untangle(repaired, distance=distance)
    lines = report.lines()
    if done.num_pairs:
        lines.append(done.line())
    caps = {}
    for count, rows in enumerate(report.caps, start=1):
        left = np.flatnonzero(np.isin(number, rows))
        if len(left):
            caps[f"cap {count}"] = left.tolist()
    if caps:
        names = "cap 1" if len(caps) == 1 else f"cap 1 to cap {len(report.caps)}"
        lines.append(f"facet group(s) {names}: what closes holes, on the longest loop first")
    return MendedSurface(mended, lines, caps)


def _require_mended(surface: TriSurface, report: RepairReport) -> None:
    """Refuse what is still open or wrong, and say what was done and what might help."""
    try:
        require_closed(surface)
    except SurfaceError as error:
        said = "; ".join(report.lines())
        hint = ""
        if isinstance(error, OpenSurfaceError) and report.open_holes:
            longest = max(map(len, report.open_holes))
            hint = f"allow holes of {longest} edges if these are to be closed"
        error.done, error.hint = report.lines(), hint
        text = f"{error}; {hint}" if hint else str(error)
        error.args = (f"{said}; {text}" if said else text,)
        raise
