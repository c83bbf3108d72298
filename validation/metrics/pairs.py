"""How far apart two solutions are: each metric with its scale, and never a comparison with NaN."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.field_norms import SMALLEST_CHANGE, l2_norm, size_of_change
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.metrics.finite import are_measurable
from palpate.validation.states import State, Trajectory


@dataclass(frozen=True)
class Difference:
    """A relative error with the scale it was divided by; it never holds NaN.

    Attributes:
        value: The error over the scale [-]; infinite where it, or the scale, is no number.
        scale: In the metric's unit.
        scale_name: For people.
        uncertainty: What the comparison itself may be off by, over the scale [-]: added to the
            reference's error bar. Above 0 where something has to be read between what was
            given, in space or in time; infinite where the comparison tells nothing.
        remark: Why it is uncertain, for people; "" where that goes without saying.
    """

    value: float
    scale: float
    scale_name: str
    uncertainty: float = 0.0
    remark: str = ""

    def __post_init__(self) -> None:
        # Checked where a number is made: a NaN would be passed over by max, min and "<".
        if not (math.isfinite(self.value) and math.isfinite(self.scale)):
            object.__setattr__(self, "value", math.inf)
        if not self.uncertainty >= 0.0:
            object.__setattr__(self, "uncertainty", math.inf)


def displacement_l2(mesh: TetMesh, candidate: State, reference: State) -> Difference:
    """Relative L2 error of displacement, weighted by volume."""
    scale = l2_norm(mesh, reference.displacement)
    error = l2_norm(mesh, candidate.displacement - reference.displacement)
    return ratio(error, scale, "L2 norm of the reference's displacement")


def displacement_max(mesh: TetMesh, candidate: State, reference: State) -> Difference:
    """Largest error of a point over the largest displacement of the reference."""
    del mesh
    error = float(np.linalg.norm(candidate.displacement - reference.displacement, axis=1).max())
    return ratio(error, reference.max_displacement, "the reference's largest displacement")


def max_displacement(mesh: TetMesh, candidate: State, reference: State) -> Difference:
    """Error of the largest displacement, over the reference's."""
    del mesh
    error = abs(candidate.max_displacement - reference.max_displacement)
    return ratio(error, reference.max_displacement, "the reference's largest displacement")


def volume(mesh: TetMesh, candidate: State, reference: State) -> Difference:
    """Error of the deformed volume over the reference's change of volume.

    One per cent of the rest volume would pass almost anything.
    """
    scale = size_of_change(reference.volume, mesh.volume)
    is_small = scale == SMALLEST_CHANGE * mesh.volume
    name = "0.1 % of the rest volume" if is_small else "the reference's change of volume"
    return ratio(abs(candidate.volume - reference.volume), scale, name)


def surface_area(mesh: TetMesh, candidate: State, reference: State) -> Difference:
    """Error of the deformed area over the reference's change of area."""
    scale = size_of_change(reference.surface_area, mesh.surface_area)
    is_small = scale == SMALLEST_CHANGE * mesh.surface_area
    name = "0.1 % of the rest area" if is_small else "the reference's change of area"
    return ratio(abs(candidate.surface_area - reference.surface_area), scale, name)


COMPARISONS = {
    "displacement_l2": displacement_l2,
    "displacement_max": displacement_max,
    "max_displacement": max_displacement,
    "volume": volume,
    "surface_area": surface_area,
}


def ratio(error: float, scale: float, name: str) -> Difference:
    """A reference that does not move at all gives no scale: then only zero error is zero."""
    if scale == 0.0:
        return Difference(0.0 if error == 0.0 else math.inf, scale, name)
    return Difference(error / scale, scale, name)


class Measures(TypedDict):
    """What geometry alone says of a displacement; see `State`."""

    displacement: Points
    volume: float
    surface_area: float
    smallest_det_f: float
    max_displacement: float


def measures_of(mesh: TetMesh, displacement: Points) -> Measures:
    """Measure a linear displacement field.

    What cannot be measured (NaN, or numbers too large for it) is infinite, det F minus infinity:
    no comparison with it passes.
    """
    inf = math.inf
    if not are_measurable(displacement):
        return Measures(
            displacement=displacement,
            volume=inf,
            surface_area=inf,
            smallest_det_f=-inf,
            max_displacement=inf,
        )
    with np.errstate(over="ignore", invalid="ignore"):
        moved = mesh.points + displacement
        volumes = signed_volumes(moved, mesh.cells)
        rest = signed_volumes(mesh.points, mesh.cells)
        return Measures(
            displacement=displacement,
            volume=float(volumes.sum()),
            surface_area=float(facet_areas(moved, mesh.boundary_facets).sum()),
            smallest_det_f=float((volumes / rest).min()),
            max_displacement=float(np.linalg.norm(displacement, axis=1).max()),
        )


def make_state(
    mesh: TetMesh,
    displacement: Points,
    *,
    label: str,
    simulator: str,
    strain: Strain,
    trajectory: Trajectory | None = None,
    tool_forces: NDArray[np.float64] | None = None,
    **more: Any,
) -> State:
    """A state with `measures_of` its displacement; the rest as in `State`."""
    return State(
        label=label,
        simulator=simulator,
        strain=strain,
        degree=more.pop("degree", 1),
        trajectory=trajectory,
        tool_forces=tool_forces,
        **measures_of(mesh, displacement),
        **more,
    )
