"""What tetrahedra are off by in bending, from the cells through the thickness: a rule of thumb.

A cell of constant strain cannot bend. What it takes for bending, shear within each cell and near
incompressibility a change of its volume, is stiffness k times that of the body itself, and so a
part k / (1 + k) of the displacement is missing. With n cells through the thickness, each a times as
long as high, and Lamé's x = lmbda / mu = 2 nu / (1 - 2 nu):

    linear      k = (2 + 1.4 a^2 + x) / n^2
    smoothed    k = 0.5 a^2.3 / n^3 + 1.4 x / (28 + x) a^1.5 / n^2

The numbers were fitted to a clamped bar, four times as long as thick, and `palpate study elements`
holds them against it: of 1 to 8 cells, one to four times as long as high, Poisson's ratios of 0.3
to 0.499. They are for bricks cut into six; meshers' cells do a little better. Bars with few cells
along lose more by long cells than others: a longer one is nearer the truth than this says.
"""

from __future__ import annotations

from palpate.meshes.problem import Element

STUDY = "palpate study elements"


def expected_error(
    num_cells: float, slenderness: float, poissons_ratio: float, element: Element
) -> float:
    """Part of the displacement in bending that is missing [-], 0 to 1.

    Args:
        num_cells: Through the thickness, > 0.
        slenderness: Length of a cell, across the thickness, over its height, > 0.
        poissons_ratio: Below 0.5; of negative ones as of 0.
        element: Whose tetrahedra.
    """
    nu, a, n = max(poissons_ratio, 0.0), slenderness, num_cells
    x = 2.0 * nu / (1.0 - 2.0 * nu)
    if element is Element.LINEAR:
        k = (2.0 + 1.4 * a**2 + x) / n**2
    else:
        k = 0.5 * a**2.3 / n**3 + 1.4 * x / (28.0 + x) * a**1.5 / n**2
    return k / (1.0 + k)
