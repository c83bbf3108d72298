"""Section IV: tools that touch tissue. Is the contact right, and what does it cost?

A rigid sphere on a block has a closed form where the strain is small and linear (Hertz): the
linear simulator must come to it as the mesh is refined, and Green strain must depart from it by the
same amount on every mesh. Beyond that, the same discrete problem is given to the reference: force,
displacement and change of volume must be the same on the same mesh.
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference.availability import is_available
from palpate.validation.report.study_page import Finding, judged
from palpate.validation.states import Progress
from palpate.validation.studies.contact.bodies import collide, fold
from palpate.validation.studies.contact.present import HERTZ_LIMIT, Outcome, present
from palpate.validation.studies.contact.scenes import all_scenes, compare, last_depth
from palpate.validation.studies.contact.speed import PART, measure_speeds
from palpate.validation.studies.contact.sphere import (
    DEPTH,
    DEPTHS,
    LEVELS,
    hertz_level,
    penalty_rates,
    vary_penalty,
)
from palpate.validation.studies.study import Study

SAME_MESH_LIMIT = 1e-6
ADDED_LIMIT = 0.2


def compute(progress: Progress) -> Outcome:
    """Solve, compare, time."""
    if not is_available():
        raise InputError("study contact needs FEniCSx to compare with; see the set-up in README")
    speeds = measure_speeds(progress)
    levels = [hertz_level(n, growth, progress) for n, growth in LEVELS]
    pairs = [compare(scene, strain, progress) for scene in all_scenes() for strain in Strain]
    progress("the last depth with an equilibrium, penalties")
    last, penalties = last_depth(0.35), vary_penalty()
    progress("two cubes that collide, a folded bar")
    return Outcome(levels, pairs, last, penalties, speeds, collide(), fold())


def judge(found: Outcome) -> list[Finding]:
    """What was claimed, and whether it holds."""
    away = [abs(level.linear - 1.0) for level in found.levels]
    ratios = [level.green / level.linear for level in found.levels]
    depth, det, why = found.last_depth
    rates = penalty_rates(found.penalties)
    first, second = found.speeds
    hit, bar = found.collision, found.fold
    findings = [
        judged(
            f"linear strain is within {HERTZ_LIMIT:.0%} of Hertz at d = {DEPTH:g} R, and nearer "
            "on every finer mesh",
            ", ".join(f"{level.linear - 1.0:+.2%}" for level in found.levels),
            away[-1] <= HERTZ_LIMIT and all(np.diff(away) < 0.0),
        ),
        judged(
            "Green strain departs from linear by the same on every mesh, within 0.2 %: it is the "
            "material's departure",
            ", ".join(f"{ratio - 1.0:+.2%}" for ratio in ratios),
            max(ratios) - min(ratios) <= 0.002 and max(ratios) < 0.99,
        ),
    ]
    for pair in found.pairs:
        errors = pair.force_error, pair.displacement_error, pair.volume_error
        findings.append(
            judged(
                f"{pair.scene}, {pair.strain} strain: force, displacement and change of volume "
                f"are the reference's on the same mesh, within {SAME_MESH_LIMIT:g}",
                ", ".join(f"{error:.1e}" for error in errors) + f"; up to {pair.reached}",
                all(error <= SAME_MESH_LIMIT for error in errors),
            )
        )
    return [
        *findings,
        judged(
            f"the sphere goes to {DEPTHS[-1]:g} R, and where Saint-Venant-Kirchhoff has no "
            "equilibrium any more is stated",
            f"{depth:.3f} R (smallest det F {det:.2f}): {why}",
            depth > DEPTHS[-1],
        ),
        judged(
            "penalties lack a force in proportion to 1/k, within 0.1 in the exponent",
            "exponents " + ", ".join(f"{rate:.3f}" for rate in rates),
            all(abs(rate - 1.0) <= 0.1 for rate in rates[1:]),
        ),
        judged(
            "two cubes that collide keep momentum and its moment to 1e-12, energy to 0.5 %",
            f"{hit.momentum_error:.1e}, {hit.moment_error:.1e}, {hit.energy_error:.2%}; speeds "
            f"{hit.speeds[0]:.2f} and {hit.speeds[1]:.2f} of the first after it",
            max(hit.momentum_error, hit.moment_error) <= 1e-12 and hit.energy_error <= 0.005,
        ),
        judged(
            "a folded bar rests on itself, less deep the stiffer the penalty, at last within a "
            "tenth of an edge",
            f"{bar.free:.2f} edges deep without contact, with it "
            + ", ".join(f"{depth:.3f}" for depth in bar.depths),
            bar.free > 1.0 and all(np.diff(bar.depths) < 0.0) and bar.depths[-1] <= 0.1,
        ),
        judged(
            f"a capsule adds at most {ADDED_LIMIT:.0%} to a step of {first.cells} cells",
            ", ".join(f"{share:+.1%}" for share in first.shares[:2])
            + f" (constraint, penalty); self-collision {first.shares[2]:+.1%}",
            max(first.shares[:2]) <= ADDED_LIMIT,
        ),
        judged(
            f"with a moving capsule {PART:.0%} of the cells that would run in real time still do, "
            "on one core",
            f"{second.cells} cells at {min(second.real_time_factors[1:3]):.2f} times real time "
            f"({first.real_time_cells} without a tool)",
            min(second.real_time_factors[1:3]) >= 1.0
            and second.cells >= 0.95 * PART * first.real_time_cells,
        ),
    ]


STUDY = Study("Contact with tools (section IV)", __doc__, compute, judge, present)
