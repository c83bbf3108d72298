"""Springs over patches of the surface as virtual work in UFL; see `palpate.meshes.spring`.

    W(u; v) = integral of kappa (d - u) . v over the patch,

kappa linear on each facet between its values at the vertices, whatever the degree of u; so the
integral is exact. It is symmetric, and holds the patch by kappa more than nothing: a Robin
condition.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats
from palpate.meshes.spring import Spring
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.follower_load import FollowerLoad
from palpate.reference.mesh_transfer import TransferredSpace, create_space


class SpringForce(FollowerLoad):
    """The forces of a spring on a body, and their derivative.

    The anchor is where the spring's path ends, until `move_to` says otherwise.

    Args:
        space: Of the displacements.
        spring: Which.
        u: Displacement, in UFL.
        v: Its test function.
        unknown: See `FollowerLoad`.
        trial: See `FollowerLoad`.
        what: "spring 2": for messages.
    """

    def __init__(
        self,
        space: TransferredSpace,
        spring: Spring,
        *,
        u: Any,
        v: Any,
        unknown: Any,
        trial: Any,
        what: str,
    ) -> None:
        mesh = space.transferred.mesh
        self._path = spring.path.components()
        self._amplitude: TabularAmplitude | None = spring.amplitude
        self._anchor = fem.Constant(mesh, spring.path.end.astype(PETSc.ScalarType))
        kappa = _density(space, spring)
        area = space.transferred.facet_measure(spring.facets, what, degree=1 + 2 * space.degree)
        super().__init__(mesh, kappa * ufl.inner(self._anchor - u, v) * area, unknown, trial)

    @property
    def is_steady(self) -> bool:
        """Whether its stiffness never changes."""
        return self._amplitude is None

    def factor(self, time: float) -> float:
        """On its stiffness [-]."""
        return 1.0 if self._amplitude is None else self._amplitude(time)

    def move_to(self, time: float) -> None:
        """Have the anchor where it is at a time [s]."""
        self._anchor.value[:] = [component(time) for component in self._path]


def _density(space: TransferredSpace, spring: Spring) -> Any:
    """Stiffness per rest area [N/m3] as a function that is linear in each cell."""
    source = space.transferred.source
    nodal: Floats = np.zeros((source.num_points, 3))
    nodal[spring.facets.ravel(), 0] = spring.densities(source.points).ravel()
    linear = create_space(space.transferred, 1)
    found = fem.Function(linear.space)
    found.x.array[: 3 * linear.num_blocks] = linear.from_points(nodal)
    found.x.scatter_forward()
    return found[0]


def spring_forces(
    space: TransferredSpace,
    springs: tuple[Spring, ...],
    *,
    u: Any,
    v: Any,
    unknown: Any,
    trial: Any,
) -> list[SpringForce]:
    """Each of a problem's springs; arguments as `SpringForce` has them."""
    return [
        SpringForce(
            space, spring, u=u, v=v, unknown=unknown, trial=trial, what=f"spring {number} (Spring)"
        )
        for number, spring in enumerate(springs, start=1)
    ]
