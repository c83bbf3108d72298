"""Error bars on the last of a sequence of meshes; no FEniCSx.

Let d_k be the relative difference of a quantity between mesh k - 1 and mesh k, and e_k the
dual-weighted estimate of its error on mesh k. The remaining error is bounded by a geometric series
with the larger ratio of the two:

    ratio = max(e_n / e_(n-1), d_n / d_(n-1), LEAST_RATIO or LEAST_RATIO_OF_NUMBERS)
    bar = SAFETY max(d_n, ratio d_(n-1)) ratio / (1 - ratio)

d_(n-1) is used besides d_n because the difference of a signed number may be small by chance, and
the point of largest difference may lie where no cell was cut. For the same reason
(d_n / d_(n-2))^(1/2) replaces d_n / d_(n-1) where d_n is above d_(n-1), if there is a d_(n-2). The
norm of a difference does not cancel, but it is small too where the relevant cells were not cut, as
in slender bodies of long cells: there the estimates decrease more slowly than the norm, and
d_(n-1) is multiplied by e_n / e_(n-1). The error of the largest displacement is at most that of the
displacement at the worst point: where both bars are requested, its bar is at most the other one.

The change of the area of flat faces is determined by their edges: its derivative is a line load
along each edge, whose dual goes as log r. The contributions of edges have both signs, so that
differences cancel by chance; and where the displacement goes as r^a, at a re-entrant edge, the
error falls as h^a alone, more slowly than before. The estimates add cells without sign. So the bar
of an area is AREA_WIDER times the formula, or AREA_OF_ESTIMATE e_n where that is less, and never
less than the formula. Where its differences do not settle and its estimates do, it is
AREA_OF_ESTIMATE e_n, if that is no less than d_n.

LEAST_RATIO is that of smooth displacements, whose quadratic approximation has a four times smaller
gradient error where cells are halved; at clamped edges, where the displacement goes as the square
root of the distance and the error halves, both ratios show this: e_k uses the quantity's own dual,
or, for the energy and for forces through parts, that of the displacement in L2 (`duals`). All these
factors are checked against known solutions by `palpate study calibration`.

Numbers with a dual of their own converge, for smooth solutions, like the product of two gradient
errors: h^4. Each mesh has about 3.6 times as many cells as the one before (in the middle of the
calibration's problems that are not set apart), so that 3.6^(-4/3) = 0.18 of the error remains; no
ratio below LEAST_RATIO_OF_NUMBERS is used. Such a number may pass by chance through its values on
two meshes in a row, and both differences are too small: its bar is at least PART_OF_ESTIMATE e_n.

Where the ratio is above LARGEST_RATIO nothing can be concluded, and the bar is infinite. Where the
last two differences are at most NOISE, the bar is SAFETY NOISE.

At a clamped corner under compression strains grow without bound as cells shrink, and
Saint-Venant-Kirchhoff loses its resistance: finer meshes invert there, and there is no limit that
differences of coarser ones could tend to. Where the smallest det F of the meshes goes that way (see
`goes_towards_inversion`), what depends on single points and edges has no bar.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.reference.adaptivity.goals import Quantity

LEAST_RATIO = 0.25
LEAST_RATIO_OF_NUMBERS = 0.2
LARGEST_RATIO = 0.9
SAFETY = 1.75
# On the calibration's problems that are not set apart, errors of areas of clamped and re-entrant
# bodies are at most 0.36 of their estimate, and 1.25 times the bound by differences. Three is
# Roache's factor (below) for grids that show no rate.
AREA_OF_ESTIMATE = 0.5
AREA_WIDER = 3.0
# There one number had two small differences in a row; its error is 0.05 of its estimate.
PART_OF_ESTIMATE = 0.1
# For two meshes, whose differences show no rate: the ratio of clamped edges, and Roache's factor
# for two grids (ASME J. Fluids Eng. 116, 1994).
LEAST_RATIO_OF_TWO = 0.5
SAFETY_OF_TWO = 3.0
# Stretch below which Saint-Venant-Kirchhoff softens, 1 / 3^(1/2): det F without transverse strain.
DET_F_OF_SOFTENING = 3.0**-0.5
# A truth of twice 3.6 times the cells is what its bar should hold against.
_MESHES_AHEAD = 2
# Relative error of a number due to solving to 1e-10 of the forces.
NOISE = 1e-8


def error_bars(
    sequences: Mapping[str, tuple[Sequence[float], Sequence[float]]],
) -> dict[str, float]:
    """Error bars of the quantities on one sequence of meshes, by the formulas above.

    From differences and estimates (see `error_bar`) by name: that of a quantity, for a part of the
    body followed by "@" and a label.

    Raises:
        ValueError: A name does not begin with a quantity.
    """
    kinds = {name: Quantity(name.partition("@")[0]) for name in sequences}
    found = {
        name: bar_of(kinds[name], differences, estimates)
        for name, (differences, estimates) in sequences.items()
    }
    return {
        name: min(bar, found.get(str(kinds[name].bounded_by), math.inf))
        for name, bar in found.items()
    }


def bar_of(quantity: Quantity, differences: Sequence[float], estimates: Sequence[float]) -> float:
    """Error bar of a single quantity, by the rules above; for the sequences see `error_bar`."""
    if not quantity.has_own_dual:
        return error_bar(differences, estimates, is_norm=quantity.is_norm)
    bar = error_bar(differences, estimates, least_ratio=LEAST_RATIO_OF_NUMBERS)
    estimate = estimates[-1]
    if quantity is Quantity.SURFACE_AREA:
        edges = AREA_OF_ESTIMATE * estimate
        # Estimates on three or more meshes may show a rate, where their differences do not.
        is_known = len(differences) > 1 and np.isfinite([*differences, *estimates]).all()
        if math.isfinite(bar):
            bar = max(bar, min(AREA_WIDER * bar, edges))
        elif is_known and estimate <= LARGEST_RATIO * estimates[-2] and differences[-1] <= edges:
            bar = edges
    return max(bar, PART_OF_ESTIMATE * estimate)


def error_bar(
    differences: Sequence[float],
    estimates: Sequence[float],
    *,
    is_norm: bool = False,
    least_ratio: float = LEAST_RATIO,
) -> float:
    """Error bar of a quantity on the last mesh of a sequence, by the formula above.

    Args:
        differences: Between each mesh and the one before, shape (n,), >= 0.
        estimates: Of the error on each mesh, the first one too, shape (n + 1,), >= 0.
        is_norm: See `Quantity.is_norm`: the difference before the last counts by the estimates.
        least_ratio: Smallest ratio of the error on a mesh to that on the mesh before that is used.

    Returns:
        Relative, >= SAFETY NOISE; infinite for fewer than three meshes, or where the sequence does
        not settle.
    """
    if len(differences) < 2 or not np.isfinite([*differences, *estimates]).all():
        return math.inf
    before, last = differences[-2:]
    if max(before, last) <= NOISE:
        return SAFETY * NOISE
    of_estimates = estimates[-1] / estimates[-2] if estimates[-2] > 0.0 else 0.0
    of_differences = last / before if before > 0.0 else math.inf
    # A difference that was small by chance gives no rate: the one before it does.
    if len(differences) > 2 and before < last and differences[-3] > 0.0:
        of_differences = math.sqrt(last / differences[-3])
    ratio = max(least_ratio, of_differences, of_estimates)
    if ratio > LARGEST_RATIO:
        return math.inf
    apart = max(last, (of_estimates if is_norm else ratio) * before)
    return max(SAFETY * apart * ratio / (1.0 - ratio), SAFETY * NOISE)


def goes_towards_inversion(smallest_det_f: Sequence[float]) -> bool:
    """Whether the smallest det F of a sequence of meshes has no limit short of an inverted cell.

    It has fallen on each of the last two refinements, and where 1 - det F goes on growing as on the
    last one, det F is below DET_F_OF_SOFTENING on the second mesh from the last. One refinement
    alone shows no trend.

    Args:
        smallest_det_f: On each mesh [-], of Saint-Venant-Kirchhoff under Green strain.

    >>> goes_towards_inversion([0.79, 0.77, 0.71]), goes_towards_inversion([0.95, 0.94, 0.92])
    (True, False)
    """
    last = smallest_det_f[-3:]
    if len(last) < 3 or not all(b < a < 1.0 for a, b in itertools.pairwise(last)):
        return False
    before, now = (1.0 - value for value in last[-2:])
    return bool(now * (now / before) ** _MESHES_AHEAD >= 1.0 - DET_F_OF_SOFTENING)


def error_bar_of_few(bar: float, differences: Sequence[float], estimates: Sequence[float]) -> float:
    """Error bar of a quantity on the last of a few meshes that are near to each other.

    That of two meshes is `error_bar_of_two`. Of three that are too near to each other to show a
    rate, whose bar is infinite by the formula above, the first and the last are taken as two: they
    are apart by at most both differences, and the ratio of their estimates is believed down to the
    formula's own LEAST_RATIO. On the calibration's 71 static problems, each mesh with 1.6 times the
    cells of the last one, 60 have a bar then and 42 without; of both all hold, the errors being at
    most 0.61 of them. By the first and the last alone 56 would have one, and be at most 0.59 of it.
    """
    match differences:
        case [apart]:
            return error_bar_of_two(apart, estimates)
        case [before, last] if math.isinf(bar):
            apart, both = last + (1.0 + last) * before, (estimates[0], estimates[-1])
            return error_bar_of_two(apart, both, least_ratio=LEAST_RATIO)
    return bar


def error_bar_of_two(
    difference: float, estimates: Sequence[float], *, least_ratio: float = LEAST_RATIO_OF_TWO
) -> float:
    """Error bar of a quantity on the finer of two meshes, where a third could not be solved.

    The formula above with the estimates' ratio alone, its least value and SAFETY_OF_TWO. Relative,
    >= SAFETY_OF_TWO NOISE; infinite where the estimates on both do not decrease.
    """
    if not np.isfinite([difference, *estimates]).all():
        return math.inf
    before, last = estimates
    ratio = max(least_ratio, last / before) if before > 0.0 else least_ratio
    if difference > NOISE and ratio > LARGEST_RATIO:
        return math.inf
    ratio = min(ratio, LARGEST_RATIO)
    return SAFETY_OF_TWO * max(difference * ratio / (1.0 - ratio), NOISE)
