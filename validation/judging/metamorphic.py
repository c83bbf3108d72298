"""Relations that every right simulator satisfies, without any reference.

1. turned, mirrored, renumbered, other units: the same result;
2. a body whose fixed points are turned by a finite angle turns as a whole, without strain; linear
   strain cannot do that, and who says to use it must be seen to break this one;
3. an affine motion of the boundary is an affine motion of the inside, on a ragged mesh, whichever
   way the bricks are cut into tetrahedra.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.meshes import transforms
from palpate.meshes.arrays import Points
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.diagnosis import Diagnosis
from palpate.validation.diagnosis.result_hypotheses import turned_otherwise
from palpate.validation.judging.checks import decide
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.states import CandidateFailedError, Progress, Verdict, gravest, in_silence

# Both results are solved to 1e-10; a body that bends easily shows a hundred times that.
LIMIT = 1e-8
ANGLE_DEG = 70.0
# The rigid turn. Linear strain sees a finite turn as a shrinking by 1 - cos of its angle, 23 %
# here, and strains the body by it: a tenth of that is far above what any solver leaves.
TURN_DEG = 40.0
LEAST_BROKEN = 0.02
_AXIS = (1.0, 2.0, -0.5)
_TURNED, _RENUMBERED = "turned", "renumbered"
_PATCHES = ("patch", "patch, diagonals swapped")
# What every law satisfies, isotropic or not.
_OF_ANY_LAW = (_RENUMBERED, *_PATCHES)
_REASON = "the same problem in another form: only solver error may differ"


@dataclass(frozen=True)
class _Relation:
    name: str
    reason: str
    error: Callable[[], float]
    # Linear strain cannot satisfy it: a simulator that does, does not use linear strain.
    must_be_broken: bool = False


def judge_relations(case: Case, candidate: Candidate, progress: Progress) -> CaseResult:
    """Judge a candidate by the relations, on a case's problem and on a ragged box.

    Raises:
        InputError: The case has time.
    """
    problem = case.problem
    if problem.time is not None:
        raise InputError(f"{case.name}: relations are for static cases")
    progress("the problem as it stands")
    checks = []
    for relation in _relations(problem, case.strain, candidate):
        progress(f"{case.name}: {relation.name}")
        checks.append(_judge(relation, case.strain, candidate.element))
    diagnoses = _isotropy(checks)
    verdict = gravest([check.verdict for check in checks])
    return CaseResult(
        name=case.name,
        title=f"{case.title}: relations that need no reference",
        verdict=verdict,
        checks=tuple(checks),
        problem=problem,
        notes=(*candidate.notes, *(f"Diagnosis: {each}." for each in diagnoses)),
        candidates=(Judged(candidate.name, verdict, candidate.element),),
        diagnoses=diagnoses,
    )


def _isotropy(checks: list[CheckResult]) -> tuple[Diagnosis, ...]:
    """A law that is not isotropic breaks the turn, and none of `_OF_ANY_LAW`."""
    values = {check.metric: check.value for check in checks}
    broken, others = values[_TURNED], [values[name] for name in _OF_ANY_LAW]
    if broken is None or None in others:
        return ()
    found = turned_otherwise(max(value for value in others if value is not None), broken)
    if not found.fits:
        return ()
    about = checks[0]
    return (Diagnosis(about.strain, (found,), 1, broken, found.of, element=about.element),)


def _judge(relation: _Relation, strain: Strain, element: Element) -> CheckResult:
    value, limit = None, LEAST_BROKEN if relation.must_be_broken else LIMIT
    try:
        error = relation.error()
    except CandidateFailedError as failure:
        verdict, message = Verdict.FAILED, str(failure)
    else:
        value = error if np.isfinite(error) else None
        verdict = decide(error, 0.0, limit)
        message = f"{error:.2g} {'<=' if verdict is Verdict.PASSED else '>'} {limit:g}"
        if relation.must_be_broken:
            is_broken = value is not None and value >= limit
            verdict = Verdict.PASSED if is_broken else Verdict.FAILED
            message = (
                f"{error:.2g} >= {limit:g}: broken, as linear strain must"
                if is_broken
                else f"{error:.2g} < {limit:g}: satisfied, so this is not linear strain"
            )
    return CheckResult(
        metric=relation.name,
        against="relation",
        strain=strain,
        verdict=verdict,
        reason=relation.reason,
        message=message,
        value=value,
        limit=limit,
        scale="largest displacement",
        element=element,
    )


def _relations(problem: Problem, strain: Strain, candidate: Candidate) -> Iterator[_Relation]:
    def moved(given: Problem) -> Points:
        return candidate.solve(given, strain, in_silence).displacement

    def from_expected(given: Problem, expected: Points) -> float:
        return float(np.abs(moved(given) - expected).max() / np.abs(expected).max())

    own = moved(problem)
    # A body that does not move at all has no scale: then nothing may move in another form.
    scale = float(np.abs(own).max()) or 1.0

    def from_own(changed: Problem, back: transforms.Back) -> float:
        return float(np.abs(back(moved(changed)) - own).max() / scale)

    # At other angles single components become slanted normals, which few simulators know.
    is_general = all(all(support.components) for support in problem.supports)
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    matrix = transforms.rotation(_AXIS, ANGLE_DEG) if is_general else axes
    for name, changed in (
        (_TURNED, transforms.turn(problem, matrix)),
        ("mirrored", transforms.turn(problem, np.diag([1.0, -1.0, 1.0]))),
        (_RENUMBERED, transforms.renumber(problem)),
        ("other units", transforms.change_units(problem)),
    ):
        yield _Relation(name, _REASON, partial(from_own, *changed))

    is_linear = strain is Strain.LINEAR
    what = f"fixed points turned by {TURN_DEG:g} degrees turn the body without strain"
    what += ", which linear strain cannot: it must break this" if is_linear else ""
    turned = partial(from_expected, *_rigid_turn(problem, is_linear=is_linear))
    yield _Relation("rigid turn", what, turned, must_be_broken=is_linear)

    what = "an affine motion of the boundary is one of the inside, on any mesh"
    for name, mesh in zip(_PATCHES, (_box(), _box(is_swapped=True)), strict=True):
        affine = mesh.points @ np.array([[0.1, 0.05, 0.0], [-0.04, -0.08, 0.1], [0.0, 0.06, 0.05]])
        outer = np.unique(mesh.boundary_facets)
        given = transforms.prescribe(mesh, problem.material, outer, affine)
        yield _Relation(name, what, partial(from_expected, given, affine))


def _rigid_turn(problem: Problem, *, is_linear: bool) -> tuple[Problem, Points]:
    """A body whose fixed points are turned by a finite angle, and its displacement if rigid."""
    if is_linear:
        # One face of a box: of a body that is fixed all round, linear strain turns the inside too.
        mesh = _box()
        fixed = np.flatnonzero(mesh.points[:, 0] < 1e-9)
    else:
        # Not what is fixed in part, which in plane strain is every point there is.
        mesh = problem.mesh
        clamps = [s for s in problem.supports if all(s.components)] or problem.supports[:1]
        fixed = np.unique(np.concatenate([s.points for s in clamps]))
    turned = mesh.points @ (transforms.rotation(_AXIS, TURN_DEG) - np.eye(3)).T
    return transforms.prescribe(mesh, problem.material, fixed.astype(np.int32), turned), turned


def _box(*, is_swapped: bool = False) -> TetMesh:
    """A ragged box of bricks; mirrored in x, they are cut along the other diagonals."""
    mesh = brick_box((3, 3, 3), (0.03, 0.03, 0.03), ragged=0.2)
    if not is_swapped:
        return mesh
    return TetMesh(mesh.points * [-1.0, 1.0, 1.0], mesh.cells[:, [0, 2, 1, 3]])
