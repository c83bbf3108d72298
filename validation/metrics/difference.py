"""Relative errors that never hold NaN, and states with their measures.

Python's max, min and comparisons pass a NaN over: nothing here does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.states import State, Trajectory

# Displacements [m] beyond this have no volume that a number can hold.
_LARGEST = 1e100
# Times are the same within this part of the span.
_SAME_TIME = 1e-9
# Fraction of the body's size.
_ROUNDING = float(np.finfo(np.float64).eps)


def largest(values: Iterable[float]) -> float:
    """The largest; infinity where one is NaN, 0 of none."""
    found = np.fromiter(values, dtype=np.float64)
    if not found.size:
        return 0.0
    return math.inf if np.isnan(found).any() else float(found.max())


def smallest(values: Iterable[float]) -> float:
    """The smallest; minus infinity where one is NaN, 0 of none."""
    return -largest(-float(value) for value in values)


def are_measurable(*arrays: NDArray[Any]) -> bool:
    """Whether all numbers are finite, and small enough to be squared and multiplied."""
    return all(bool((np.abs(array) < _LARGEST).all()) for array in arrays)


def measurable_rows(array: NDArray[Any]) -> NDArray[np.bool_]:
    """Which rows hold such numbers alone, (num_rows,)."""
    rows: NDArray[np.bool_] = (np.abs(array) < _LARGEST).all(axis=1)
    return rows


def is_still(mesh: TetMesh, state: State) -> bool:
    """Whether a state never moves by more than the rounding of the body's coordinates."""
    size = float(np.ptp(mesh.points, axis=0).max())
    return all(bool((np.abs(u) <= _ROUNDING * size).all()) for u in state.fields)


@dataclass(frozen=True)
class Difference:
    """A relative error with the scale it was divided by; it never holds NaN.

    Attributes:
        value: The error over the scale [-]; infinite where it, or the scale, is no number.
        scale: What the error was divided by, in the metric's unit.
        scale_name: Name of the scale, for people; "" is the metric's own.
        uncertainty: What the comparison itself may be off by, over the scale [-]: added to the
            reference's error bar. Above 0 where something has to be read between what was
            given, in space or in time; infinite where the comparison says nothing.
        remark: Why it is uncertain, for people; "" where that goes without saying.
    """

    value: float
    scale: float
    scale_name: str = ""
    uncertainty: float = 0.0
    remark: str = ""

    def __post_init__(self) -> None:
        # Checked where a number is made: a NaN would be passed over by max, min and "<".
        if not (math.isfinite(self.value) and math.isfinite(self.scale)):
            object.__setattr__(self, "value", math.inf)
        if not self.uncertainty >= 0.0:
            object.__setattr__(self, "uncertainty", math.inf)


def ratio(error: float, scale: float, name: str = "") -> Difference:
    """A reference that does not move at all gives no scale: then only zero error is zero."""
    if scale == 0.0:
        return Difference(0.0 if error == 0.0 else math.inf, scale, name)
    return Difference(error / scale, scale, name)


def measures_of(mesh: TetMesh, displacement: Points) -> dict[str, Any]:
    """What geometry alone says of a linear displacement field, by the names of `State`.

    What cannot be measured (NaN, or numbers too large for it) is infinite, det F minus infinity:
    no comparison with it passes.
    """
    found = dict.fromkeys(("volume", "surface_area", "max_displacement"), math.inf)
    found |= {"smallest_det_f": -math.inf}
    if are_measurable(displacement):
        with np.errstate(over="ignore", invalid="ignore"):
            moved = mesh.points + displacement
            volumes = signed_volumes(moved, mesh.cells)
            rest = signed_volumes(mesh.points, mesh.cells)
            found = {
                "volume": float(volumes.sum()),
                "surface_area": float(facet_areas(moved, mesh.boundary_facets).sum()),
                "smallest_det_f": float((volumes / rest).min()),
                "max_displacement": float(np.linalg.norm(displacement, axis=1).max()),
            }
    return {"displacement": displacement, **found}


def other_readings(
    mesh: TetMesh, candidate: State, reference: State
) -> Iterator[tuple[State, State]]:
    """Pairs of states that lie as far apart as reading motions between their times may be off.

    Of states at the same times on both sides the same is read by the same rule: what may be off is
    the reading of their difference.
    """
    ours, theirs = candidate.other_reading, reference.other_reading
    if ours is not None and theirs is not None and are_at_same_times(candidate, reference):
        assert candidate.given is not None
        assert reference.given is not None
        assert reference.trajectory is not None
        times, wanted = reference.given.times, reference.trajectory.times
        apart = candidate.given.displacements - reference.given.displacements
        read = read_at(times, apart, wanted, slack=_SAME_TIME * wanted[-1])
        motion = candidate.displacements + read.others - read.states
        moved = Trajectory(wanted, motion)
        yield candidate, replace(candidate, trajectory=moved, **measures_of(mesh, motion[-1]))
        return
    for state, other in ((candidate, ours), (reference, theirs)):
        if other is not None:
            yield state, other


def are_at_same_times(one: State, other: State) -> bool:
    """Whether two motions were given at the same times, to the rounding of the span."""
    if one.given is None or other.given is None:
        return one.given is other.given
    times, others = one.given.times, other.given.times
    return len(times) == len(others) and bool(
        np.allclose(times, others, rtol=0.0, atol=_SAME_TIME * others[-1])
    )


def make_state(
    mesh: TetMesh, displacement: Points, *, label: str, simulator: str, strain: Strain, **more: Any
) -> State:
    """A state with `measures_of` its displacement; the rest as in `State`."""
    about = {"degree": 1, "trajectory": None, "tool_forces": None, **more}
    return State(
        label=label, simulator=simulator, strain=strain, **measures_of(mesh, displacement), **about
    )
