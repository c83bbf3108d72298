"""Goals of the adaptive reference, and differences of two meshes in them; no FEniCSx.

A goal may be for a part of the body: stress in some cells, force through a support or a cut.
However fine the solved mesh is, stress is given by the means of Cauchy's stress over the cells of
the case's mesh, and a force through a cut by those of the first Piola-Kirchhoff stress P, whose
nodal forces are V P grad N with the linear shape functions N of the case's points.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norm, size_of_change
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.result import ReferenceResult

# Below this fraction of the sum of all nodal forces' sizes the force of a support counts as zero.
_NO_SUPPORT_FORCE = 1e-4
# Of a support of single points, over the largest force.
_NO_FORCE = 1e-6


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the case's mesh on which a goal is defined.

    Attributes:
        cells: Cells whose stress counts, (n,); none for a force.
        weights: Weight of each component of a nodal force in a cut [-], (num_points, 3).
        support: Number of the support whose force counts; None for a cut.
    """

    cells: Indices
    weights: Points
    support: int | None = None

    def is_inside(self, mesh: TetMesh) -> Floats:
        """1 in the cells whose stress counts, 0 in the others, (num_cells,)."""
        inside = np.zeros(mesh.num_cells)
        inside[self.cells] = 1.0
        return inside


class Quantity(StrEnum):
    """A quantity of a state with an error bar, relative to its own size or change.

    TOOL_FORCE is the forces on all tools at the end of their paths, over the largest. The last two
    are for a part of the body: the L2 norm of Cauchy's stress in it, and the force through it, over
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
        """Whether its estimates use its own dual: it is a number, or a value at single points."""
        return self in (
            Quantity.DISPLACEMENT_MAX,
            Quantity.MAX_DISPLACEMENT,
            Quantity.VOLUME,
            Quantity.SURFACE_AREA,
        )

    @property
    def is_of_points(self) -> bool:
        """Whether it depends on single points, edges or cells: one corner decides about it."""
        return self in (
            Quantity.DISPLACEMENT_MAX,
            Quantity.MAX_DISPLACEMENT,
            Quantity.SURFACE_AREA,
            Quantity.STRESS_L2,
        )

    @property
    def bounded_by(self) -> Quantity | None:
        """The quantity whose error is an upper bound of this one's, if there is one."""
        return Quantity.DISPLACEMENT_MAX if self is Quantity.MAX_DISPLACEMENT else None


OF_PART = frozenset({Quantity.STRESS_L2, Quantity.TRACTION_RESULTANT})


@dataclass(frozen=True)
class Goal:
    """A quantity and the error bar that is requested for it.

    Args:
        quantity: The quantity.
        tolerance: Largest bar that is small enough [-], > 0; infinite to accept any bar.
        part: Part of the case's mesh, for quantities of a part; else None.
        name: Its name in the result: the quantity, followed by "@" and a label for a part; the
            quantity's own name where empty.

    Raises:
        InputError: The tolerance is not above 0, a part is missing or not allowed, or the name does
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


@dataclass(frozen=True, eq=False)
class JudgedSolution:
    """Another solution, which is to be within some distance of the reference.

    Attributes:
        displacement: At the points of the case's mesh [m], (num_points, 3).
        tool_forces: Forces on the tools at the end of their paths [N], (num_tools, 3).
        limits: Largest relative distance that is allowed, by quantity [-]: of
            Quantity.DISPLACEMENT_L2 and Quantity.TOOL_FORCE.
    """

    displacement: Points
    tool_forces: Points
    limits: Mapping[Quantity, float]

    def is_decided(
        self, mesh: TetMesh, state: ReferenceResult, bars: Mapping[Quantity, float]
    ) -> bool:
        """Whether a state with error bars decides on which side of the limits it is.

        It is outside where one distance is, whatever the others are, and inside where all are.
        Without limits there is nothing to be decided.
        """
        tools = tuple(
            dataclasses.replace(tool, forces=(*tool.forces[:-1], tuple(force.tolist())))
            for tool, force in zip(state.tools, self.tool_forces, strict=False)
        )
        own = dataclasses.replace(state, displacement=self.displacement, tools=tools)
        off = {q: difference(Goal(q, math.inf), mesh, state, own) for q in self.limits}
        if any(off[q] - bars.get(q, math.inf) > limit for q, limit in self.limits.items()):
            return True
        return bool(off) and all(
            off[q] + bars.get(q, math.inf) <= x for q, x in self.limits.items()
        )


@dataclass(frozen=True)
class Budget:
    """Limits of an adaptive solve: no mesh is begun that would exceed one of them.

    Args:
        seconds: Total time [s], > 0.
        memory: Memory [GB], > 0.
        unknowns: Number of unknowns, > 0; independent of the machine.

    Raises:
        InputError: A value is not above 0.
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
    """Whether a quantity has a limit as the mesh is refined.

    Under a force on a point, of a load or a support, the displacement grows as 1 / r (Kelvin), and
    its gradient's square cannot be integrated: with Green strain no solution is known; in the
    linear solution the displacement of that point is infinite, and so are the changes of volume and
    area with it.
    """
    return not has_point_forces or (
        strain is Strain.LINEAR and quantity in (Quantity.DISPLACEMENT_L2, Quantity.TOOL_FORCE)
    )


def softens(problem: Problem, strain: Strain) -> bool:
    """Whether compression takes the body's resistance: Saint-Venant-Kirchhoff at finite strain."""
    return strain is Strain.GREEN and problem.material.law.is_linear_in_strain


def has_point_forces(problem: Problem, state: ReferenceResult) -> bool:
    """Whether forces act on single points: loads, or supports without facets that carry any."""
    if any(isinstance(load, PointForce) for load in problem.loads):
        return True
    sizes = np.linalg.norm(state.support_forces, axis=1)
    single = np.array([len(support.facets) == 0 for support in problem.supports], dtype=bool)
    # Supports of a body whose loads balance each other have forces from rounding only.
    scale = max(
        float(sizes.max(initial=0.0)), state.strain_energy / problem.mesh.volume ** (1.0 / 3.0)
    )
    return bool((sizes[single] > _NO_FORCE * scale).any())


def _nodal_forces(mesh: TetMesh, state: ReferenceResult) -> Points:
    volumes = signed_volumes(mesh.points, mesh.cells)
    P = state.first_piola_kirchhoff_stress
    # Gradients of the corners' linear shape functions [1/m], (num_cells, 4, 3).
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    by_corner = volumes[:, None, None] * gradients @ P.transpose(0, 2, 1)
    forces = np.zeros_like(mesh.points)
    np.add.at(forces, mesh.cells, by_corner)
    return forces


def _value(quantity: Quantity, mesh: TetMesh, part: Part | None, state: ReferenceResult) -> Any:
    """Value of a quantity for a state, of which differences are taken."""
    match quantity:
        case Quantity.DISPLACEMENT_L2 | Quantity.DISPLACEMENT_MAX:
            return state.displacement
        case Quantity.MAX_DISPLACEMENT:
            return _largest(state.displacement)
        case Quantity.VOLUME | Quantity.SURFACE_AREA | Quantity.STRAIN_ENERGY:
            return getattr(state, quantity)
        case Quantity.TOOL_FORCE:
            return np.array([tool.forces[-1] for tool in state.tools])
    assert part is not None
    if quantity is Quantity.STRESS_L2:
        return state.cauchy_stress[part.cells]
    if part.support is not None:
        return state.support_forces[part.support]
    return (part.weights * _nodal_forces(mesh, state)).sum(axis=0)


def _size(quantity: Quantity, mesh: TetMesh, part: Part | None, value: Any) -> float:
    """Size of a quantity's value, or of a difference of two values, >= 0."""
    match quantity:
        case Quantity.DISPLACEMENT_L2:
            return l2_norm(mesh, value)
        case Quantity.STRESS_L2:
            # Components along fixed axes, so that different rotations of a cell count too.
            assert part is not None
            volumes = signed_volumes(mesh.points, mesh.cells)[part.cells]
            return math.sqrt(float(volumes @ np.einsum("cij,cij->c", value, value)))
        case Quantity.DISPLACEMENT_MAX | Quantity.TOOL_FORCE:
            return _largest(value)
    return float(np.linalg.norm(value))


def scale_of(quantity: Quantity, mesh: TetMesh, part: Part | None, state: ReferenceResult) -> float:
    """The scale by which a difference of a quantity is divided, from the more accurate state.

    The size of its value, or of its change, or of the largest force of a support: 1 N where every
    support is balanced in itself. For `part` see `Goal`.
    """
    match quantity:
        case Quantity.VOLUME:
            return size_of_change(state.volume, state.rest_volume)
        case Quantity.SURFACE_AREA:
            return size_of_change(state.surface_area, state.rest_surface_area)
        case Quantity.TRACTION_RESULTANT:
            largest = _largest(state.support_forces)
            of_all = float(np.linalg.norm(_nodal_forces(mesh, state), axis=1).sum())
            return largest if largest > _NO_SUPPORT_FORCE * of_all else 1.0
    return _size(quantity, mesh, part, _value(quantity, mesh, part, state))


def _largest(rows: Points) -> float:
    return float(np.linalg.norm(rows, axis=1).max(initial=0.0))


def difference(goal: Goal, mesh: TetMesh, fine: ReferenceResult, coarse: ReferenceResult) -> float:
    """Relative difference of two states at the points of one mesh, over the finer one's scale [-].

    At least 0; 0 where both are zero, infinite where only the more accurate one is.
    """
    quantity, part = goal.quantity, goal.part
    own, other = (_value(quantity, mesh, part, state) for state in (fine, coarse))
    apart = _size(quantity, mesh, part, own - other)
    scale = scale_of(quantity, mesh, part, fine)
    if scale == 0.0:
        return 0.0 if apart == 0.0 else math.inf
    return apart / scale
