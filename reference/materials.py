"""Material by cell: constants that jump at the cells' boundaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.meshes.problem import Inclusion, Material
from palpate.reference import fenicsx
from palpate.reference.mesh_transfer import TransferredMesh
from palpate.reference.principal_laws import PrincipalFunction, energy_of_stretches


def lame_parameters(material: Material) -> tuple[float, float]:
    """Return lmbda and mu [Pa] of an isotropic material."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def by_cell(
    transferred: TransferredMesh,
    material: Material,
    inclusions: Sequence[Inclusion],
    value: Callable[[Material], float],
) -> Any:
    """Return a number of the material in every cell, as a function that is constant in each.

    Always a function, also for one material: then every body compiles to the same forms.

    Args:
        transferred: The mesh.
        material: Of the cells in no inclusion.
        inclusions: Cells of another material (see `Problem`).
        value: What is wanted of a material.
    """
    values = np.full(transferred.source.num_cells, value(material))
    for inclusion in inclusions:
        values[np.asarray(inclusion.cells)] = value(inclusion.material)
    return fenicsx.cell_function(transferred.mesh, values[transferred.cell_of_cell])


def lame_by_cell(
    transferred: TransferredMesh, material: Material, inclusions: Sequence[Inclusion]
) -> tuple[Any, Any]:
    """Return lmbda and mu [Pa] as functions that are constant in each cell."""
    return (
        by_cell(transferred, material, inclusions, lambda m: lame_parameters(m)[0]),
        by_cell(transferred, material, inclusions, lambda m: lame_parameters(m)[1]),
    )


def energy_by_cell(
    material: Material, lmbda: Any | None, mu: Any
) -> Callable[[int], PrincipalFunction]:
    """W of principal strains at some points of each cell, by a law that is written in stretches.

    Args:
        material: Of which the law is read, and its terms.
        lmbda: Lamé's parameters [Pa], functions that are constant in each cell; None for 0.
        mu: The second.

    Returns:
        What makes the function of the number of points in each cell.
    """

    def function(num_points: int) -> PrincipalFunction:
        shear = np.repeat(fenicsx.cell_values(mu), num_points)
        first = 0.0 * shear
        if lmbda is not None:
            first = np.repeat(fenicsx.cell_values(lmbda), num_points)
        return energy_of_stretches(material.law, first, shear, material.ogden_terms)

    return function
