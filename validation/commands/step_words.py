"""What `palpate mesh` says of the time step that its mesh allows."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.fastsim.critical_cells import CriticalCells
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Material

# Of which the step is a length over the speed of pressure waves, where no material is stated.
TISSUE = Material(1e4, 0.45, 1000.0)


def step_lines(
    critical: CriticalCells, *, is_stated: bool, scale: float, unit: str
) -> Iterator[str]:
    """The step, and the cells that decide it.

    Args:
        critical: Of the mesh.
        is_stated: Whether the material is the user's; otherwise steps are lengths over c.
        scale: Metres per unit of the file.
        unit: Its name.
    """

    def told(step: float) -> str:
        if is_stated:
            return f"{step:.4g} s"
        return f"{step * critical.wave_speed / scale:.4g} {unit} / c"

    which = "" if is_stated else " (c: speed of pressure waves, Poisson's ratio 0.45)"
    yield f"critical time step {told(critical.time_step)}{which}, decided by"
    for cell, step, place in zip(critical.cells, critical.steps, critical.places, strict=True):
        yield f"  cell {cell} at {_place(place, scale)}: {told(step)}"
    yield (
        f"  the thinnest facet, at {_place(critical.surface_place, scale)}, allows at most "
        f"{told(critical.surface_step)}"
    )


def verdict_line(critical: CriticalCells, target: float, scale: float, unit: str) -> str:
    """Whether a step was reached [s], and if not, why."""
    if critical.time_step >= target:
        return f"target step {target:g} s reached"
    if critical.surface_step < target:
        why = (
            f"the facet at {_place(critical.surface_place, scale)} {unit} forces at most "
            f"{critical.surface_step:.4g} s on any cell behind it: use --free, or a coarser surface"
        )
    else:
        why = (
            "no facet by itself forbids it, but moved, flipped and inserted inner points came no "
            f"further near {_place(critical.places[0], scale)} {unit}: use --free, or longer edges"
        )
    return f"target step {target:g} s not reached ({critical.time_step:.4g} s): {why}"


def _place(place: Points, scale: float) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*(float(x) / scale for x in place))
