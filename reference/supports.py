"""Supports as held degrees of freedom with their prescribed values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.reference import fenicsx
from palpate.reference.mesh_transfer import TransferredSpace


@dataclass(frozen=True, eq=False)
class HeldDofs:
    """Which degrees of freedom are held, and where.

    Attributes:
        dofs: Sorted degrees of freedom (three per node), shape (n,).
        values: Displacement of each under the full load [m], shape (n,).
    """

    dofs: Indices
    values: Floats


def hold(space: TransferredSpace, supports: Sequence[Support]) -> HeldDofs:
    """Turn supports into held degrees of freedom.

    A facet holds everything on its closure: of a quadratic space its edges too.

    Raises:
        InputError: A prescribed displacement that is not finite, a facet inside the body, or two
            supports that want different displacements of one point.
    """
    held: dict[int, float] = {}
    for number, support in enumerate(supports, start=1):
        what = f"support {number}"
        displacement = np.asarray(support.displacement, dtype=np.float64)
        if displacement.shape != (3,) or not np.isfinite(displacement).all():
            raise InputError(f"{what}: displacement {support.displacement} needs 3 finite values")
        blocks = _blocks(space, support, what)
        for axis in range(3):
            if not support.components[axis]:
                continue
            value = float(displacement[axis])
            for dof in (3 * blocks + axis).tolist():
                if held.setdefault(dof, value) != value:
                    raise InputError(
                        f"{what} prescribes {value:g} m along {'xyz'[axis]} where another support "
                        f"prescribes {held[dof]:g} m; give each point one displacement"
                    )
    dofs = np.array(sorted(held), dtype=np.int32)
    return HeldDofs(dofs, np.array([held[int(d)] for d in dofs], dtype=np.float64))


def _blocks(space: TransferredSpace, support: Support, what: str) -> Indices:
    entities = space.transferred.facet_entities(support.facets, what)
    on_facets = fenicsx.fem.locate_dofs_topological(space.space, 2, entities)
    owned = np.asarray(on_facets, dtype=np.int32)
    return np.union1d(space.owned_dofs(support.points), owned[owned < space.num_blocks])
