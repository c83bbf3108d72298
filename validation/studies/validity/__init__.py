"""Where may linear strain stand in for Green strain, and where does Green strain itself end?

Linear strain (eq. 3-4) is cheap and wrong under rotation; Saint-Venant-Kirchhoff with Green strain
(eq. 6-7) is right under rotation and gives way in compression. The map says how far each reaches:
a bar bent at its tip, over load, Poisson's ratio and slenderness; and a block stretched, crushed,
sheared and twisted. Displacement errors are L2 norms over that of Green strain. Volume errors are
parts of the rest volume, since a bent bar hardly changes its own.

Loads are measured by what linear strain itself predicts, so that whoever has a linear solver can
look up whether to believe it: the deflection of the tip over the length, the nominal strain, the
angle of twist. For a slender bar the deflection is P L^2 / (3 E I).

"No equilibrium" is what fastsim finds on its mesh. In free compression it is the closed form.
At a clamp, and where a free side wrinkles, a finer mesh gives way earlier: these limits are from
above, and have no error bar. A dash in a table: not reached, up to 2 (in compression 1/4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from palpate.reference.availability import is_available
from palpate.validation.report.study_page import Finding, judged
from palpate.validation.states import Progress
from palpate.validation.studies.closed_forms import COMPRESSION_LIMIT, elastica_error
from palpate.validation.studies.study import Study
from palpate.validation.studies.validity.block import (
    HOMOGENEOUS,
    MOST,
    Mode,
    ModePoint,
    find_mode_limit,
    follow_mode,
)
from palpate.validation.studies.validity.present import Found, ModeLimits, bars_of, present
from palpate.validation.studies.validity.rising import (
    CELLS_ACROSS,
    DEFLECTIONS,
    LIMITS,
    POISSONS_RATIOS,
    SLENDERNESSES,
    BendingLimit,
    BendingPoint,
    DegreeCheck,
    border,
    check_by_quadratic,
    find_limit,
    follow_bar,
)

MODE_RATIOS = (0.0, 0.3, 0.45)
# Points solved again with quadratic tetrahedra, (L/h, nu, nearest deflection), and bricks across.
CHECKED = ((1.0, 0.45, 0.16), (4.0, 0.3, 0.16), (4.0, 0.45, 0.08), (8.0, 0.3, 0.08))
QUADRATIC_ACROSS = 4
# fastsim's tolerance is 1e-10 of the forces; homogeneous states multiply it by a few.
HOMOGENEOUS_TOLERANCE = 1e-8
BORDER_TOLERANCE = 0.05
# A bar as short as it is high is mostly corner of the clamp, which linear tetrahedra blur.
STUBBY = 2.0
STUBBY_TOLERANCE = 0.15


def compute(progress: Progress) -> Found:
    """Compute the map."""
    points: list[BendingPoint] = []
    limits: list[BendingLimit] = []
    for place in product(SLENDERNESSES, POISSONS_RATIOS):
        progress("bending: L/h = {:g}, Poisson's ratio {:g}".format(*place))
        points += follow_bar(*place, CELLS_ACROSS, DEFLECTIONS)
        limits.append(find_limit(*place, CELLS_ACROSS))
    checks = []
    for slenderness, nu, deflection in CHECKED if is_available() else ():
        bar = bars_of(points)[slenderness, nu]
        point = min(bar, key=lambda p: abs(p.nominal - deflection))
        checks.append(check_by_quadratic(point, QUADRATIC_ACROSS, progress))
    return Found(
        points,
        limits,
        finer=find_limit(4.0, 0.3, CELLS_ACROSS + 2),
        modes=[p for m in Mode for nu in MODE_RATIOS for p in follow_mode(m, nu)],
        ends={(m, nu): find_mode_limit(m, nu) for m in Mode for nu in MODE_RATIOS},
        checks=checks,
    )


def judge(found: Found) -> list[Finding]:
    """The block, the bars, and the bars again with quadratic tetrahedra."""
    return [
        *judge_modes(found.modes, found.ends),
        *judge_bending(found.points, found.limits),
        *judge_checks(found.checks),
    ]


def judge_modes(points: Sequence[ModePoint], ends: ModeLimits) -> list[Finding]:
    """Homogeneous states against closed forms; the end of free compression."""
    homogeneous = [p for p in points if p.mode in HOMOGENEOUS]
    worst = max(p.distance for p in homogeneous)
    free = [end for (mode, _), end in ends.items() if mode is Mode.COMPRESSION]
    loads = [end[0] if end else math.inf for end in free]
    distance = max(abs(load - COMPRESSION_LIMIT) for load in loads)
    return [
        judged(
            "homogeneous states: errors and volumes of fastsim equal the closed forms to "
            f"{HOMOGENEOUS_TOLERANCE:g}",
            f"{len(homogeneous)} states, at most {worst:.1e} off",
            worst <= HOMOGENEOUS_TOLERANCE,
        ),
        judged(
            "free compression: equilibrium ends at P/E = 1/(3 sqrt 3) = "
            f"{COMPRESSION_LIMIT:.5f} for every Poisson's ratio, within one load step",
            "lost beyond "
            + ", ".join(f"{x:.5f}" for x in loads)
            + "; stretch "
            + ", ".join(f"{end[1]:.4f}" if end else "-" for end in free)
            + " (1/sqrt 3 = 0.5774)",
            # The load is raised in steps down to 1/8192 of the most.
            distance <= 1.5 * MOST[Mode.COMPRESSION] / 8192.0,
        ),
    ]


def judge_bending(points: Sequence[BendingPoint], limits: Sequence[BendingLimit]) -> list[Finding]:
    """What breaks linear strain in bending, and where Green strain ends."""
    bars = bars_of(points)
    longest = max(length for length, _ in bars)
    slender = [p for p in points if p.slenderness == longest]
    # Beyond, the shooting for the elastica has more than one root.
    thin = [p for p in slender if p.nominal <= 1.0]
    exact = {d: elastica_error(3.0 * d) for d in {p.nominal for p in thin}}
    ratios = [p.displacement_error / exact[p.nominal] for p in thin]
    # The mean of theta^2 along the bar: 2 alpha^2 / 15 with alpha = 3 delta.
    volumes = [p.linear_volume_change / (1.2 * p.nominal**2) for p in slender if p.nominal >= 0.05]
    rotations, strains, beyond = [], [], []
    ends = {(m.slenderness, m.poissons_ratio): m.deflection or math.inf for m in limits}
    for place, bar in bars.items():
        errors = [p.displacement_error for p in bar]
        tenth = border(errors, [p.nominal for p in bar], LIMITS[-1])
        beyond.append(ends[place] / (math.inf if tenth is None else tenth))
        if place[0] >= 4.0:
            rotation = border(errors, [p.tip_rotation for p in bar], 0.05)
            strain = border(errors, [p.bending_strain for p in bar], 0.05)
            rotations.append(math.inf if rotation is None else rotation)
            strains.append(math.inf if strain is None else strain)
    spread, strain_spread = max(rotations) / min(rotations), max(strains) / min(strains)
    return [
        judged(
            f"slender bars (L/h = {longest:g}): the displacement error is the elastica's, within "
            f"{BORDER_TOLERANCE:.0%}",
            f"{min(ratios):.3f} to {max(ratios):.3f} of it over {len(ratios)} points",
            max(abs(r - 1.0) for r in ratios) <= BORDER_TOLERANCE,
        ),
        judged(
            "slender bars: linear strain invents the volume of its rotations, 2/15 (P L^2/(E I))^2"
            f" of the body, within {BORDER_TOLERANCE:.0%}",
            f"{min(volumes):.3f} to {max(volumes):.3f} of it",
            max(abs(v - 1.0) for v in volumes) <= BORDER_TOLERANCE,
        ),
        judged(
            "rotation is what breaks linear strain: from L/h = 4 on the 5 % border is at one "
            "rotation of the tip for all slendernesses and Poisson's ratios, within 10 %",
            f"{math.degrees(min(rotations)):.2f} to {math.degrees(max(rotations)):.2f} degrees "
            f"(ratio {spread:.3f}), while the bending strain there varies by {strain_spread:.1f}",
            spread <= 1.10 < strain_spread,
        ),
        judged(
            "Green strain ends beyond the 10 % border of linear strain in every bar: where "
            "equilibrium is lost, linear strain has long been wrong",
            f"at {min(beyond):.1f} to {max(beyond):.0f} times its load",
            min(beyond) > 1.0,
        ),
    ]


def judge_checks(checks: Sequence[DegreeCheck]) -> list[Finding]:
    """Linear against quadratic tetrahedra."""
    if not checks:
        return []
    displacement = max(abs(c.displacement_ratio - 1.0) for c in checks)
    volumes: dict[bool, float] = {True: 0.0, False: 0.0}
    for c in checks:
        is_stubby = c.by_linear.slenderness < STUBBY
        volumes[is_stubby] = max(volumes[is_stubby], abs(c.volume_ratio - 1.0))
    stiffness = max(c.load_ratio for c in checks)
    return [
        judged(
            "the map is no artefact of linear tetrahedra: quadratic ones find the same errors at "
            f"the same deflection, within {BORDER_TOLERANCE:.0%} (volume of stubby bars, L/h below "
            f"{STUBBY:g}: {STUBBY_TOLERANCE:.0%})",
            f"{len(checks)} points: displacement within {displacement:.1%}, volume within "
            f"{volumes[False]:.1%}, of stubby bars {volumes[True]:.1%}, though the linear ones "
            f"need up to {stiffness:.2f} times the load",
            max(displacement, volumes[False]) <= BORDER_TOLERANCE
            and volumes[True] <= STUBBY_TOLERANCE,
        )
    ]


TITLE = "Linear or Green strain: where each may be believed"
STUDY = Study(TITLE, __doc__, compute, judge, present)
