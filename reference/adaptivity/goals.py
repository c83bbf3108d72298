"""What the truth is asked for, how far two meshes are apart in it, and the error bar; no FEniCSx.

The bar of a quantity on the last of a sequence of meshes. Let d_k be its relative difference
between mesh k - 1 and mesh k, and e_k the dual-weighted estimate of its error on mesh k. What is
left is at most a geometric series that goes on as slowly as either of them says:

    ratio = max(e_n / e_(n-1), d_n / d_(n-1), LEAST_RATIO or LEAST_RATIO_OF_NUMBERS)
    bar = SAFETY max(d_n, ratio d_(n-1)) ratio / (1 - ratio)

d_(n-1) stands beside d_n because a signed number may pass by chance through the value of the mesh
before, and the worst point may lie where no cell was cut; the norm of a difference does neither,
and goes without. For the same reason (d_n / d_(n-2))^(1/2) takes the place of d_n / d_(n-1) where
d_n is above d_(n-1), if there is a d_(n-2). The largest displacement is no farther off than the
displacement at its worst point: where both are asked for, its bar is no larger than that one's.

The area of flat faces changes by what its edges do: its derivative is a line load along each edge,
whose dual goes as log r. Edges pull both ways, so that differences cancel by chance; and where the
displacement goes as r^a, at a re-entrant edge, what is left falls as h^a alone, more slowly than
what went before. The estimates add cells without sign. So the bar of an area is AREA_WIDER times
what the formula says, or AREA_OF_ESTIMATE e_n where that is less, and never less than it says.
Where its differences do not settle and its estimates do, it is AREA_OF_ESTIMATE e_n, if that is no
less than d_n.

LEAST_RATIO is that of smooth displacements, whose gradient, quadratic, is four times better where
cells are halved; at clamped edges, where it goes as the square root of the distance and the error
halves, both ratios say so: e_k is by a dual of the quantity's own, or, of the energy and of forces
through parts, by that of the displacement in L2 (`duals`). All these factors are held against known
answers by `palpate study calibration`.

Numbers with a dual of their own converge, where all is smooth, as the product of two errors of a
gradient does: h^4, so that on meshes with some 3.3 times as many cells each, as these are,
3.3^(-4/3) of the error is left: LEAST_RATIO_OF_NUMBERS. They may pass by chance through the values
of two meshes in a row, and then both differences say too little: their bar is at least
PART_OF_ESTIMATE e_n.

Where the ratio is above LARGEST_RATIO nothing can be concluded, and the bar is infinite. Where the
last two differences are at most NOISE, the bar is SAFETY NOISE.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norm, size_of_change
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.adaptivity.parts import Part, force_apart, stress_apart
from palpate.reference.result import ReferenceResult

LEAST_RATIO = 0.25
LEAST_RATIO_OF_NUMBERS = 0.2
LARGEST_RATIO = 0.9
SAFETY = 1.75
# On the calibration's problems that are not set apart, areas of clamped and re-entrant bodies are
# off by 0.36 of their estimate at most, and by 1.25 times what differences say. Three is Roache's
# factor (below) for grids that tell no rate.
AREA_OF_ESTIMATE = 0.5
AREA_WIDER = 3.0
# There one number had two small differences in a row; it is off by 0.05 of its estimate.
PART_OF_ESTIMATE = 0.1
# Of two meshes, whose differences tell no rate: that of clamped edges, and Roache's factor for two
# grids (ASME J. Fluids Eng. 116, 1994).
LEAST_RATIO_OF_TWO = 0.5
SAFETY_OF_TWO = 3.0
# Relative to the largest force.
_NO_FORCE = 1e-6
# Relative: what solves to 1e-10 of the forces may leave in a number.
NOISE = 1e-8


class Quantity(StrEnum):
    """What of a state has an error bar, relative to its own size or change.

    TOOL_FORCE is the forces on all tools at the end of their paths, over the largest. The last two
    are of a part of the body: the L2 norm of Cauchy's stress in it, and the force through it, over
    the largest of a support.

    >>> Quantity("volume")
    <Quantity.VOLUME: 'volume'>
    """

    DISPLACEMENT_L2 = "displacement_l2"
    DISPLACEMENT_MAX = "displacement_max"
    MAX_DISPLACEMENT = "max_displacement"
    VOLUME = "volume"
    SURFACE_AREA = "surface_area"
    STRAIN_ENERGY = "strain_energy"
    TOOL_FORCE = "tool_force"
    STRESS_L2 = "stress_l2"
    TRACTION_RESULTANT = "traction_resultant"

    @property
    def is_norm(self) -> bool:
        """Whether its difference is a norm over a volume, which is not small by chance."""
        return self in (Quantity.DISPLACEMENT_L2, Quantity.STRESS_L2)

    @property
    def has_own_dual(self) -> bool:
        """Whether it is a number, or of single points, whose estimates are by a dual of its own."""
        return self in (
            Quantity.DISPLACEMENT_MAX,
            Quantity.MAX_DISPLACEMENT,
            Quantity.VOLUME,
            Quantity.SURFACE_AREA,
        )

    @property
    def bounded_by(self) -> Quantity | None:
        """What is never less far off, if anything is."""
        return Quantity.DISPLACEMENT_MAX if self is Quantity.MAX_DISPLACEMENT else None

    def bar(self, differences: Sequence[float], estimates: Sequence[float]) -> float:
        """Its error bar on the last mesh of a sequence; see `error_bar`, and what stands above it.

        Args:
            differences: Between each mesh and the one before, shape (n,), >= 0.
            estimates: Of the error on each mesh, the first one too, shape (n + 1,), >= 0.
        """
        if not self.has_own_dual:
            return error_bar(differences, estimates, is_norm=self.is_norm)
        bar = error_bar(differences, estimates, least_ratio=LEAST_RATIO_OF_NUMBERS)
        estimate = estimates[-1]
        if self is Quantity.SURFACE_AREA:
            edges = AREA_OF_ESTIMATE * estimate
            if math.isfinite(bar):
                bar = max(bar, min(AREA_WIDER * bar, edges))
            elif _estimates_settle(differences, estimates) and differences[-1] <= edges:
                bar = edges
        return max(bar, PART_OF_ESTIMATE * estimate)


OF_PART = frozenset({Quantity.STRESS_L2, Quantity.TRACTION_RESULTANT})


@dataclass(frozen=True)
class Goal:
    """A quantity and the error bar it is to have.

    Args:
        quantity: What.
        tolerance: Largest bar that is small enough [-], > 0; infinite where any is.
        part: Of the case's mesh, where the quantity is of one; else None.
        name: What it is called in the result: the quantity, and where it is of a part "@" and more;
            the quantity's own name where empty.

    Raises:
        InputError: A tolerance that is not above 0, a part too many or too few, or a name that does
            not begin with the quantity.
    """

    quantity: Quantity
    tolerance: float
    part: Part | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if not self.tolerance > 0.0:
            raise InputError(f"{self.quantity}: bar = {self.tolerance:g}: needs a value above 0")
        if (self.part is not None) != (self.quantity in OF_PART):
            needs = "needs a part of the body" if self.part is None else "is of the whole body"
            raise InputError(f"{self.quantity} {needs}")
        if self.called.partition("@")[0] != self.quantity:
            raise InputError(f"{self.quantity} called {self.name!r}: needs {self.quantity}@...")

    @property
    def called(self) -> str:
        """Its name in the result."""
        return self.name or str(self.quantity)


@dataclass(frozen=True)
class Budget:
    """What may be spent.

    Args:
        seconds: No mesh is begun that would take the whole past this [s], > 0.
        memory: Nor one that would need more than this [GB], > 0.
        unknowns: Nor one with more than this, > 0; the same on every machine.

    Raises:
        InputError: A value that is not above 0.
    """

    seconds: float = 1800.0
    memory: float = 8.0
    unknowns: float = math.inf

    def __post_init__(self) -> None:
        if not (self.seconds > 0.0 and self.memory > 0.0 and self.unknowns > 0.0):
            raise InputError(
                f"a budget of {self.seconds:g} s, {self.memory:g} GB and {self.unknowns:g} "
                "unknowns; all need to be above 0"
            )


def has_limit(quantity: Quantity, strain: Strain, *, has_point_forces: bool) -> bool:
    """Whether a quantity tends to anything as the mesh is refined.

    Under a force on a point the displacement grows as 1 / r (Kelvin), and its gradient's square
    cannot be integrated: with Green strain no solution is known, and in the linear one the place
    of the force goes to infinity, and the change of volume and area, both nonlinear, with it.

    Args:
        quantity: What.
        strain: Strain measure.
        has_point_forces: Loads on single points, or supports of single points that carry force.
    """
    return not has_point_forces or (
        strain is Strain.LINEAR and quantity in (Quantity.DISPLACEMENT_L2, Quantity.TOOL_FORCE)
    )


def has_point_forces(problem: Problem, state: ReferenceResult) -> bool:
    """Whether forces act on single points: loads, or supports without facets that carry any."""
    if any(isinstance(load, PointForce) for load in problem.loads):
        return True
    sizes = np.linalg.norm(state.support_forces, axis=1)
    single = np.array([len(support.facets) == 0 for support in problem.supports], dtype=bool)
    # What holds a body that balances itself is left with the rounding of a solve.
    scale = max(
        float(sizes.max(initial=0.0)), state.strain_energy / problem.mesh.volume ** (1.0 / 3.0)
    )
    return bool((sizes[single] > _NO_FORCE * scale).any())


def _largest(displacement: Points) -> float:
    return float(np.linalg.norm(displacement, axis=1).max(initial=0.0))


def _l2(mesh: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    apart = fine.displacement - coarse.displacement
    return l2_norm(mesh, apart), l2_norm(mesh, fine.displacement)


def _worst(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    return _largest(fine.displacement - coarse.displacement), _largest(fine.displacement)


def _size(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    sizes = [_largest(state.displacement) for state in (fine, coarse)]
    return abs(sizes[0] - sizes[1]), sizes[0]


def _volume(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    return abs(fine.volume - coarse.volume), size_of_change(fine.volume, fine.rest_volume)


def _area(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    return (
        abs(fine.surface_area - coarse.surface_area),
        size_of_change(fine.surface_area, fine.rest_surface_area),
    )


def _energy(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    return abs(fine.strain_energy - coarse.strain_energy), fine.strain_energy


def _tools(_: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> tuple[float, float]:
    own, other = (np.array([tool.forces[-1] for tool in s.tools]) for s in (fine, coarse))
    return (
        float(np.linalg.norm(own - other, axis=1).max(initial=0.0)),
        float(np.linalg.norm(own, axis=1).max(initial=0.0)),
    )


_OF_WHOLE: dict[
    Quantity, Callable[[TetMesh, ReferenceResult, ReferenceResult], tuple[float, float]]
] = {
    Quantity.DISPLACEMENT_L2: _l2,
    Quantity.DISPLACEMENT_MAX: _worst,
    Quantity.MAX_DISPLACEMENT: _size,
    Quantity.VOLUME: _volume,
    Quantity.SURFACE_AREA: _area,
    Quantity.STRAIN_ENERGY: _energy,
    Quantity.TOOL_FORCE: _tools,
}


_OF_PART: dict[
    Quantity, Callable[[TetMesh, ReferenceResult, ReferenceResult, Part], tuple[float, float]]
] = {
    Quantity.STRESS_L2: stress_apart,
    Quantity.TRACTION_RESULTANT: force_apart,
}


def difference(goal: Goal, mesh: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> float:
    """How far two states at the points of one mesh are apart, over the size of the finer's [-].

    Args:
        goal: In what.
        mesh: At whose points both displacements are.
        fine: The better one.
        coarse: The other.

    Returns:
        At least 0; 0 where both are nothing, infinite where the better one alone is.
    """
    if goal.part is None:
        apart, scale = _OF_WHOLE[goal.quantity](mesh, fine, coarse)
    else:
        apart, scale = _OF_PART[goal.quantity](mesh, fine, coarse, goal.part)
    if scale == 0.0:
        return 0.0 if apart == 0.0 else math.inf
    return apart / scale


def error_bars(
    sequences: Mapping[str, tuple[Sequence[float], Sequence[float]]],
) -> dict[str, float]:
    """Error bars of the quantities of one sequence of meshes; the formulas stand above.

    Args:
        sequences: Differences and estimates by what each is called: a quantity, and where it is of
            a part of the body "@" and more; see `error_bar`.

    Raises:
        ValueError: A name that begins with no quantity.
    """
    kinds = {name: Quantity(name.partition("@")[0]) for name in sequences}
    found = {
        name: kinds[name].bar(differences, estimates)
        for name, (differences, estimates) in sequences.items()
    }
    return {
        name: min(bar, found.get(str(kinds[name].bounded_by), math.inf))
        for name, bar in found.items()
    }


def error_bar(
    differences: Sequence[float],
    estimates: Sequence[float],
    *,
    is_norm: bool = False,
    least_ratio: float = LEAST_RATIO,
) -> float:
    """Error bar of a quantity on the last mesh of a sequence; the formula stands above.

    Args:
        differences: Between each mesh and the one before, shape (n,), >= 0.
        estimates: Of the error on each mesh, the first one too, shape (n + 1,), >= 0.
        is_norm: See `Quantity.is_norm`: the difference before the last counts for nothing.
        least_ratio: Of what is left after a mesh over what was before it; none less is believed.

    Returns:
        Relative, >= SAFETY NOISE; infinite for less than three meshes, or where the sequence does
        not settle.
    """
    if len(differences) < 2 or not np.isfinite([*differences, *estimates]).all():
        return math.inf
    before, last = differences[-2:]
    if max(before, last) <= NOISE:
        return SAFETY * NOISE
    ratios = [
        least_ratio,
        last / before if before > 0.0 else math.inf,
        estimates[-1] / estimates[-2] if estimates[-2] > 0.0 else least_ratio,
    ]
    # A difference that was small by chance says nothing of the rate: the one before does.
    if len(differences) > 2 and before < last and differences[-3] > 0.0:
        ratios[1] = math.sqrt(last / differences[-3])
    ratio = max(ratios)
    if ratio > LARGEST_RATIO:
        return math.inf
    apart = last if is_norm else max(last, ratio * before)
    return max(SAFETY * apart * ratio / (1.0 - ratio), SAFETY * NOISE)


def _estimates_settle(differences: Sequence[float], estimates: Sequence[float]) -> bool:
    """Whether the estimates of three meshes or more tell a rate, where their differences do not."""
    is_told = len(differences) >= 2 and bool(np.isfinite([*differences, *estimates]).all())
    return is_told and estimates[-1] <= LARGEST_RATIO * estimates[-2]


def error_bar_of_two(difference: float, estimates: Sequence[float]) -> float:
    """Error bar of a quantity on the finer of two meshes, where a third was not to be had.

    The formula above with the estimates' ratio alone, LEAST_RATIO_OF_TWO and SAFETY_OF_TWO.

    Args:
        difference: Between the two, >= 0.
        estimates: Of the error on both, shape (2,), >= 0.

    Returns:
        Relative, >= SAFETY_OF_TWO NOISE; infinite where the estimates do not shrink.
    """
    if not np.isfinite([difference, *estimates]).all():
        return math.inf
    before, last = estimates
    ratio = max(LEAST_RATIO_OF_TWO, last / before) if before > 0.0 else LEAST_RATIO_OF_TWO
    if difference > NOISE and ratio > LARGEST_RATIO:
        return math.inf
    ratio = min(ratio, LARGEST_RATIO)
    return SAFETY_OF_TWO * max(difference * ratio / (1.0 - ratio), NOISE)
