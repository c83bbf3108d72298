"""What results are compared with: truths, references by a simulator's own steps, and other laws.

A truth is the stored one of a case, or is solved here under another law, and cached. For a motion
there are also references by the steps that a simulator states, so that the error of scheme and step
is distinguished from that of the solver.

Where a result follows another law than the stated one, that law is found: in statics the residual
of every law that the judge knows is computed at the result. From there Newton's method finds the
nearby equilibrium of the best one: the distance from it to the equilibrium of the stated law is the
error of the law, and the rest is the solver's. In motion every law is solved by the same steps.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain, with_law
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.cached_results import CachedResult, ResultCache, made_here, text_hash
from palpate.validation.candidates.equations import TIME_LIMIT
from palpate.validation.case import Case
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.judging.case_references import are_the_cases, find_references
from palpate.validation.metrics.audit import NotPositiveDefiniteError, solve_scaled
from palpate.validation.metrics.body import Body, imbalance
from palpate.validation.metrics.laws import LawOfCells, along, laws_instead_of_law
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.references.reference_set import BOTH, OF_ELEMENT, ReferenceSet
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.references.statics import solve_live
from palpate.validation.references.stored import (
    MissingReferenceError,
    UntrustedReferenceError,
    problem_key,
    read_reference,
    write_reference,
)
from palpate.validation.states import Progress, State

# The time after which no finer mesh of a truth is begun, and the time of all runs of a motion: a
# board has many of them [s]; and the number of unknowns of the largest mesh of statics.
_SECONDS, _SECONDS_OF_A_MOTION, _UNKNOWNS = 120.0, 240.0, 2e5
# The most cells times steps of one run by a simulator's own steps, which takes some minutes then;
# and of each run where several laws are tried.
_WORK, _WORK_OF_A_LAW = 2e7, 2e6
# Distances below this fraction of the largest displacement are not attributed to a law.
NOT_A_LAW = 1e-3
# Another law must have at most this fraction of the stated law's residual and distance.
_EXPLAINS = 0.1
_TOLERANCE = 1e-6
_MOST_STEPS = 8


@dataclass(frozen=True, eq=False)
class Truth:
    """The references of a case under a law; None where there are none, with the reason.

    Attributes:
        case: The case under the law.
        references: States and bars.
        why: Why there are none, or none except on the case's own mesh.
        seconds: Wall time of solving them, where they were solved for the board [s].
        cached: When an earlier call solved them; "" where none did.
    """

    case: Case
    references: ReferenceSet | None = None
    why: str = ""
    seconds: float = 0.0
    cached: str = ""

    @property
    def law(self) -> Law:
        """The law of the truth."""
        return self.case.problem.material.law


def case_under(case: Case, law: Law) -> Case:
    """A case of finite strain under a law; one of linear strain is Hooke's, whatever the law."""
    return case.under(law) if case.strain is Strain.GREEN else case


def _cached(
    cache: ResultCache, name: str, asked: str, progress: Progress
) -> tuple[CachedResult, ReferenceSet | None] | None:
    """A cached reference; without states where it is known that there are none."""
    cached = cache.read(name, asked, made_here(), progress)
    if cached is None or cached.file is None:
        return None if cached is None else (cached, None)
    try:
        references, made_for = read_reference(cached.file)
    except (MissingReferenceError, UntrustedReferenceError):
        return None
    return (cached, references) if made_for == asked else None


def _store(
    cache: ResultCache, name: str, asked: str, record: Mapping[str, Any], found: ReferenceSet | None
) -> None:
    write = None
    if found is not None:
        write = functools.partial(
            write_reference,
            name=name,
            key=asked,
            references=found,
            provenance=dict(found.provenance),
        )
    cache.write(name, asked, made_here(), record, write)


def find_truth(case: Case, cache: ResultCache, progress: Progress) -> Truth:
    """The stored references of a case; under another law cached ones, or new ones.

    Args:
        case: The case under the law that is wanted.
        cache: Where such truths are stored.
        progress: Called with one line for each truth solved, and with why a cached one is not used.
    """
    if case.other_law is None:
        try:
            return Truth(case, find_references(case, live=False, progress=progress))
        except InputError as error:
            return Truth(case, why=str(error))
    problem, name = case.problem, f"truth-{case.name}"
    limit = _SECONDS if problem.time is None else _SECONDS_OF_A_MOTION
    asked = text_hash(problem_key(problem), case.strain, f"{limit:g} {_UNKNOWNS:g}")
    if (known := _cached(cache, name, asked, progress)) is not None:
        cached, found = known
        why, seconds = str(cached.record["why"]), float(cached.record["seconds"])
        return Truth(case, found, why, seconds, cached.date if cached.is_from_before else "")
    begin, why = time.monotonic(), ""
    found = None
    try:
        found = _solve_truth(case, limit, progress)
    except ReferenceUnavailableError as error:
        return Truth(case, why=str(error))
    except (ReferenceFailedError, InputError) as error:
        why = str(error)
    if found is not None and found.truth(case.strain) is None:
        why = "; ".join(found.failures.values()) or "the reference found no solution"
        found = None if found.same_mesh(case.strain) is None else found
    seconds = time.monotonic() - begin
    _store(cache, name, asked, {"why": why, "seconds": seconds}, found)
    return Truth(case, found, why, seconds)


def _solve_truth(case: Case, seconds: float, progress: Progress) -> ReferenceSet:
    """Solve the references of a case under another law, for its own strain measure."""
    problem, strains = case.problem, (case.strain,)
    if problem.time is not None:
        # Without a stated step there is no reference on the same mesh to compare with.
        wanted = {"truth"} if problem.time.time_step is None else BOTH
        return solve_motion_set(problem, progress, wanted=wanted, strains=strains, seconds=seconds)
    # Only the distance of displacements is reported.
    request = TruthRequest(seconds=seconds, metrics={case.strain: ("displacement_l2",)})
    return solve_live(
        problem, progress, strains=strains, has_stress=False, request=request, unknowns=_UNKNOWNS
    )


@dataclass(frozen=True)
class OwnSteps:
    """References of a motion with the steps that a simulator states, and with other laws.

    Attributes:
        cache: Where they are stored.
        progress: Called with one line for each run.
    """

    cache: ResultCache
    progress: Progress

    def of(self, problem: Problem, result: State) -> State | None:
        """The reference on the same mesh with the steps that the simulator states.

        None where it states none, where that would take too long, or without such a reference.
        """
        if result.steps is None or are_the_cases(problem, result.steps):
            return None
        return self._solve(problem, result, result.steps, _WORK)

    def followed(self, problem: Problem, result: State, stated: State) -> tuple[str, State] | None:
        """Another law that the result follows, with its own steps or the case's, and its motion.

        Args:
            problem: The problem under the law that is stated.
            result: The simulator's result.
            stated: The reference of that law with the same steps.

        Returns:
            Its name and motion; "" and `stated` where no other law explains it better; None where
            none could be tried.
        """
        span, steps = problem.time, result.steps
        apart = distance(result.displacements, stated.displacements)
        if apart <= NOT_A_LAW:
            return "", stated
        if span is None or problem.tools:
            return None
        if steps is None:
            if span.time_step is None:
                return None
            steps = Steps(Integrator.CENTRAL_DIFFERENCES, span.time_step)
        tried: dict[str, tuple[float, State]] = {}
        for law in (each for each in Law if each is not problem.material.law):
            try:
                other = with_law(problem, law)
            except InputError:
                continue
            found = self._solve(other, result, steps, _WORK_OF_A_LAW)
            if found is not None:
                tried[law.value] = distance(result.displacements, found.displacements), found
        if not tried:
            return None
        best = min(tried, key=lambda name: tried[name][0])
        left, found = tried[best]
        return (best, found) if left <= _EXPLAINS * apart else ("", stated)

    def _solve(self, problem: Problem, result: State, steps: Steps, most: float) -> State | None:
        assert problem.time is not None
        if not problem.mesh.num_cells * problem.time.end_time / steps.time_step <= most:
            return None
        strain, element = result.strain, result.element
        name = f"steps-{problem.material.law}"
        asked = text_hash(problem_key(problem), strain, element, repr(steps))
        known = _cached(self.cache, name, asked, self.progress)
        if known and known[1] and (OF_ELEMENT[element], strain) in known[1].states:
            return known[1].states[OF_ELEMENT[element], strain]
        try:
            state = solve_by_steps(
                problem, strain, steps, self.progress, element=element, time_limit=TIME_LIMIT
            )
        except (ReferenceFailedError, InputError):
            return None
        if not np.isfinite(state.displacements).all():
            return None
        references = ReferenceSet({(OF_ELEMENT[element], strain): state}, {}, str(steps))
        _store(self.cache, name, asked, {}, references)
        return state


def followed_law(
    problem: Problem, strain: Strain, displacement: Points, stated: Points
) -> tuple[str, Points] | None:
    """The law and its equilibrium near a result with plain linear tetrahedra.

    Args:
        problem: The problem under the stated law, without tools.
        strain: The stated strain measure.
        displacement: The result [m], (num_points, 3).
        stated: The equilibrium of the stated law on the same mesh [m].

    Returns:
        Its name and displacement; None where none explains the result better than the stated law.
    """
    body = Body(problem, strain)
    external = body.external(displacement)
    own = imbalance(body.internal(displacement), external, body.free)
    left = {}
    for name, law in laws_instead_of_law(strain, body.law).items():
        found = imbalance(body.internal(displacement, law), external, body.free)
        if found <= _EXPLAINS * own:
            left[name] = found, law
    for name in sorted(left, key=lambda each: left[each][0]):
        near = _equilibrium(body, displacement, left[name][1])
        if near is not None and distance(displacement, near) <= _EXPLAINS * distance(
            displacement, stated
        ):
            return name, near
    return None


def _equilibrium(body: Body, displacement: Points, law: LawOfCells) -> Points | None:
    """The equilibrium of another law by Newton's method from nearby; None if it fails."""
    u = displacement + body.to_supports(displacement)
    for _ in range(_MOST_STEPS):
        internal, external = body.internal(u, law), body.external(u)
        if imbalance(internal, external, body.free) <= _TOLERANCE:
            return u
        H = body.gradient(u)

        def product(change: Points, H: Points = H) -> Points:
            stress = along(lambda at: law(at, body.lmbda, body.mu), H, body.gradient(change))
            return body.freed(body.force_of(stress))

        try:
            right = body.freed(external - internal)
            u = u + solve_scaled(product, right, body.stiffness_diagonal, tolerance=1e-3)
        except (NotPositiveDefiniteError, ReferenceFailedError, np.linalg.LinAlgError):
            return None
    return None
