"""A mechanical problem as plain data in SI units, the input of every simulator."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points, checked_indices
from palpate.meshes.boundary_conditions import (
    Load,
    Support,
    require_agreement,
    require_boundary_facets,
)
from palpate.meshes.errors import InputError, TooManyStepsError
from palpate.meshes.material_law import LARGEST_CONSTANT, Law

# A problem is made of these: importers may take them from here.
from palpate.meshes.material_law import Inclusion as Inclusion
from palpate.meshes.material_law import Material as Material
from palpate.meshes.point_mass import PointMass
from palpate.meshes.rigid_tool import RigidTool
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Strain(StrEnum):
    """Engineering strain (eq. 3-4), or finite strain: for the paper's law Green strain (eq. 6-7).

    GREEN means finite strain under every law, whether the law is written in Green strain or not.
    LINEAR is its limit for small strains and rotations, Hooke's law with the same E and nu.

    >>> import palpate
    >>> palpate.Strain("green") is palpate.Strain.GREEN
    True
    """

    LINEAR = "linear"
    GREEN = "green"


class Element(StrEnum):
    """Linear tetrahedra: plain (the paper's), or with strains smoothed over edges and nodes.

    Both have the same points and the same unknowns. The element is chosen when a case is solved,
    not in the case. Smoothing averages cells of the same elastic constants only (Young's modulus
    and Poisson's ratio): where others meet at an edge or a node, each has an average of its own.

    >>> import palpate
    >>> palpate.Element("smoothed")
    <Element.SMOOTHED: 'smoothed'>
    """

    LINEAR = "linear"
    SMOOTHED = "smoothed"


# Memory of the states that are stored of a motion.
MOST_STORED_BYTES = 16_000_000_000


@dataclass(frozen=True)
class TimeSpan:
    """The time axis of a dynamic problem.

    Args:
        end_time: [s], > 0.
        time_step: [s], > 0; None lets the simulator choose a stable one.
        mass_damping: lambda in D = lambda M (eq. 11) [1/s], >= 0.
        num_outputs: Number of stored states after the initial one, evenly spaced, >= 1.
        stiffness_damping: beta of a viscous stress S_v = beta C : dE/dt besides the law's [s], >= 0
            (Kelvin and Voigt's solid), C Hooke's at rest, E the strain measure. For small strains
            D = beta K, Rayleigh's: a mode omega has the damping ratio beta omega / 2. Rotations are
            not damped, however large, and the material's law does not matter.

    >>> import palpate
    >>> palpate.TimeSpan(end_time=0.5, mass_damping=4.0).num_outputs
    50
    """

    end_time: float
    time_step: float | None = None
    mass_damping: float = 0.0
    num_outputs: int = 50
    stiffness_damping: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.end_time <= LARGEST_CONSTANT:
            raise InputError(
                f"end_time = {self.end_time:g} s: needs a value above 0, at most "
                f"{LARGEST_CONSTANT:g}"
            )
        if self.time_step is not None and not (
            math.isfinite(self.time_step) and self.time_step > 0.0
        ):
            raise InputError(f"time_step = {self.time_step:g} s: needs a finite value above 0")
        for name, unit in (("mass_damping", "1/s"), ("stiffness_damping", "s")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} = {value:g} {unit}: needs a value >= 0")
        if self.num_outputs < 1:
            raise InputError(f"num_outputs = {self.num_outputs}: needs at least 1")
        if self.time_step is not None:
            self.require_few_steps(self.time_step)

    @property
    def output_times(self) -> Floats:
        """Times of the stored states, 0 among them [s], shape (num_outputs + 1,)."""
        return np.linspace(0.0, self.end_time, self.num_outputs + 1)

    def require_few_steps(self, time_step: float) -> None:
        """Refuse a time step with which the motion would take more than 1e9 of them.

        Raises:
            TooManyStepsError: It is so, or the step is 0 or NaN, as overflowing numbers make it.
        """
        if not time_step * TooManyStepsError.MOST >= self.end_time:
            raise TooManyStepsError(self.end_time, time_step)


@dataclass(frozen=True)
class InitialVelocity:
    """Velocity at the start of a motion, that of a rigid body: v + omega x (X - c).

    Fixed components start with the motion of their supports instead.

    Args:
        velocity: v, at the center [m/s], shape (3,).
        angular_velocity: omega [rad/s], shape (3,).
        center: c [m], shape (3,).

    Raises:
        InputError: A number that is not finite.

    >>> import palpate
    >>> spin = palpate.InitialVelocity(angular_velocity=(0.0, 0.0, 2.0))
    >>> spin.at(np.array([[1.0, 0.0, 0.0]])).tolist()
    [[0.0, 2.0, 0.0]]
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.velocity, *self.angular_velocity, *self.center]).all():
            raise InputError(f"an initial velocity needs finite numbers, got {self}")

    def at(self, points: Points) -> Points:
        """Velocity [m/s] at rest positions [m], both of shape (n, 3)."""
        turning = np.cross(self.angular_velocity, points - np.array(self.center))
        velocity: Points = turning + np.array(self.velocity)
        return velocity


@dataclass(frozen=True, eq=False)
class Problem:
    """Mesh, material, supports, loads and tools, all in SI units and plain arrays.

    Args:
        mesh: At rest, points [m].
        material: Material of the whole body except its inclusions.
        supports: Where and how the body is fixed or moved.
        loads: Forces on the body.
        time: Time axis of a motion; None asks for static equilibrium.
        tools: Rigid bodies that press on the body.
        inclusions: Cells of other materials.
        initial_velocity: Velocity at the start of a motion; None starts from rest.
        springs: Springs from patches of the surface to moved anchors.
        masses: Masses that hang on the surface; inert in motion. Their weight is among the loads
            if it acts: see `PointMass.weight`.

    Raises:
        IndexRangeError: A point or facet that the mesh does not have; `.rows` says which.
        FacetNotOnBoundaryError: A facet of a support, load, tool, spring or mass inside the
            body, or twice there.
        DisagreeingSupportsError: Two supports that prescribe different displacements of a point.
        InputError: Indices that are not whole numbers, a cell in two inclusions, inclusions of
            another law, a tool beside a support along a slanted normal, an initial velocity without
            a time span, a spring without a point of the mesh within its radius, or a mass without
            facets.

    >>> import numpy as np
    >>> import palpate
    >>> from palpate.meshes.shapes import shape_box
    >>> mesh = palpate.mesh(shape_box((0.06, 0.02, 0.02), edge_length=0.01))
    >>> x = mesh.points[mesh.boundary_facets][:, :, 0]
    >>> held = mesh.boundary_facets[(x < 1e-9).all(axis=1)]
    >>> pulled = mesh.boundary_facets[(x > 0.06 - 1e-9).all(axis=1)]
    >>> problem = palpate.Problem(
    ...     mesh,
    ...     palpate.Material(10e3, 0.4),
    ...     supports=(palpate.Support(np.unique(held), held),),
    ...     loads=(palpate.Traction(pulled, (500.0, 0.0, 0.0)),),
    ... )
    >>> round(palpate.solve(problem).max_displacement * 1e3)  # mm
    3
    """

    mesh: TetMesh
    material: Material
    supports: tuple[Support, ...]
    loads: tuple[Load, ...]
    time: TimeSpan | None = None
    tools: tuple[RigidTool, ...] = ()
    inclusions: tuple[Inclusion, ...] = ()
    initial_velocity: InitialVelocity | None = None
    springs: tuple[Spring, ...] = ()
    masses: tuple[PointMass, ...] = ()

    def __post_init__(self) -> None:
        for kind in ("supports", "loads", "tools", "springs", "masses"):
            one = "mass" if kind == "masses" else kind[:-1]
            items = enumerate(getattr(self, kind), start=1)
            checked = [_on_mesh(item, self.mesh, f"{one} {k}") for k, item in items]
            object.__setattr__(self, kind, tuple(checked))
        require_agreement(
            self.mesh, self.supports, None if self.time is None else self.time.end_time
        )
        for spring in self.springs:
            spring.densities(self.mesh.points)  # says if it weighs no point
        for mass in self.masses:
            mass.density(self.mesh.points)  # says if it has no facets
        if self.time is not None:
            stored = (self.time.num_outputs + 1) * self.mesh.points.nbytes
            if stored > MOST_STORED_BYTES:
                raise InputError(
                    f"num_outputs = {self.time.num_outputs}: states of {self.mesh.num_points} "
                    f"points take {stored / 1e9:.3g} GB; at most {MOST_STORED_BYTES / 1e9:g} GB"
                )
        if self.initial_velocity is not None and self.time is None:
            raise InputError("an initial velocity is of a motion; give a time span")
        if self.tools and any(support.normal is not None for support in self.supports):
            raise InputError(
                "a tool and a support along a slanted normal do not go together; turn the body so "
                "that the plane's normal is x, y or z, and hold that component"
            )
        taken = np.zeros(self.mesh.num_cells, dtype=bool)
        for number, inclusion in enumerate(self.inclusions, start=1):
            what = f"cells of inclusion {number}"
            cells = checked_indices(inclusion.cells, 1, self.mesh.num_cells, what)
            if taken[cells].any() or len(np.unique(cells)) != len(cells):
                raise InputError(f"{what}: a cell is named twice; each has one material")
            taken[cells] = True
        laws = dict.fromkeys((self.material.law, *(i.material.law for i in self.inclusions)))
        if len(laws) > 1:
            raise InputError(
                f"inclusions follow the law of their body; here are {', '.join(laws)}: give them "
                "all the same"
            )
        if (
            len({m.ogden_terms for m in (self.material, *(i.material for i in self.inclusions))})
            > 1
        ):
            raise InputError(
                "inclusions of Ogden's law have their body's exponents, and its parts of the shear "
                "modulus; their moduli at rest may differ"
            )


Item = TypeVar("Item", bound="DataclassInstance")
Carry = Callable[[Indices], Indices]


def _on_mesh(item: Item, mesh: TetMesh, what: str) -> Item:
    """The item with checked points and facets: arrays of points that the mesh has."""
    changes = {}
    for name, width in (("points", 1), ("facets", 3), ("contact_facets", 3)):
        rows = getattr(item, name, None)
        if rows is not None:
            checked = checked_indices(rows, width, mesh.num_points, f"{name} of {what}")
            if not (isinstance(rows, np.ndarray) and rows.dtype == checked.dtype):
                changes[name] = checked
            if width == 3:
                require_boundary_facets(mesh, checked, f"{name} of {what}")
    return dataclasses.replace(item, **changes) if changes else item


def on_other_mesh(
    problem: Problem, mesh: TetMesh, *, facets: Carry, cells: Carry, points: Carry | None = None
) -> Problem:
    """The same problem on another mesh of its body.

    `facets`, `cells` and `points` carry those of the mesh before to those of the same area, volume
    or position on the other; points stay where that is None.
    """
    parts: dict[str, Any] = {
        kind: tuple(
            with_rows(item, facets=facets, points=points, cells=cells)
            for item in getattr(problem, kind)
        )
        for kind in ("supports", "loads", "tools", "inclusions", "springs", "masses")
    }
    return dataclasses.replace(problem, mesh=mesh, **parts)


def with_rows(
    item: Item, *, facets: Carry, points: Carry | None = None, cells: Carry | None = None
) -> Item:
    """A support, load, tool, spring, mass or inclusion on other facets, points or cells."""
    changes = {}
    for name, carry in (
        ("facets", facets),
        ("contact_facets", facets),
        ("points", points),
        ("cells", cells),
    ):
        rows = getattr(item, name, None)
        if carry is not None and rows is not None and len(rows):
            changes[name] = carry(rows)
    return dataclasses.replace(item, **changes) if changes else item


def with_law(problem: Problem, law: Law) -> Problem:
    """The same problem of a body that follows another law, with the same moduli at rest.

    Raises:
        InputError: Mooney and Rivlin's law, which has one constant more than the moduli at rest.
    """
    if law.has_c01:
        raise InputError(f"{law} has three constants, of which moduli at rest tell two")

    def of(material: Material) -> Material:
        return dataclasses.replace(material, law=law, c01=0.0)

    inclusions = (dataclasses.replace(i, material=of(i.material)) for i in problem.inclusions)
    return dataclasses.replace(problem, material=of(problem.material), inclusions=tuple(inclusions))


def require_no_tools(problem: Problem, what: str) -> None:
    """Raise InputError where a problem has tools and `what` does not support them."""
    if problem.tools:
        raise InputError(f"{what} knows no tools; take the tool out of the case, or solve statics")


def require_no_springs(problem: Problem, what: str) -> None:
    """Raise InputError where a problem has springs and `what` does not support them."""
    if problem.springs:
        raise InputError(f"{what} knows no springs; take the spring out of the case")


def require_linear_in_strain(material: Material, strain: Strain, what: str) -> None:
    """Raise InputError for another law than Saint-Venant-Kirchhoff, the only one of `what`.

    Under linear strain every law is Hooke's, and nothing is refused.
    """
    if strain is Strain.GREEN and not material.law.is_linear_in_strain:
        raise InputError(
            f"{what}: no law is known there but {Law.SAINT_VENANT_KIRCHHOFF}, and this body "
            f"follows {material.law}"
        )
