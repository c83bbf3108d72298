"""fastsim as a candidate, and fastsim with a seeded fault to show that gates go red.

A candidate that diverges, crashes or answers NaN has failed; that is a verdict, not an error.
"""

from __future__ import annotations

import dataclasses
import time
from enum import StrEnum

import numpy as np

from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress


class Fault(StrEnum):
    """Faults that can be seeded into the candidate."""

    NONE = "none"
    SOFTER = "softer"
    MIRRORED = "mirrored"
    DROPPED_LOAD = "dropped-load"
    LINEAR_INSTEAD_OF_GREEN = "linear-instead-of-green"
    NAN = "nan"


def run_fastsim(
    problem: Problem, strain: Strain, progress: Progress, fault: Fault = Fault.NONE
) -> Answer:
    """Solve by fastsim, with a seeded fault if asked.

    Raises:
        CandidateFailedError: It diverged, or answered NaN.
    """
    from palpate.fastsim.errors import FastsimError
    from palpate.fastsim.statics import solve_static

    given, used = _spoil_problem(problem, fault), strain
    if fault is Fault.LINEAR_INSTEAD_OF_GREEN:
        used = Strain.LINEAR
    progress(f"fastsim, {used} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        result = solve_static(given, strain=used, progress=progress)
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    seconds = time.perf_counter() - start
    displacement = result.displacement
    if fault is Fault.MIRRORED:
        displacement = displacement * np.array([1.0, -1.0, 1.0])
    if fault is Fault.NAN:
        displacement = displacement.copy()
        displacement[len(displacement) // 2, 0] = np.nan
    bad = np.flatnonzero(~np.isfinite(displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    return Answer(
        displacement,
        seconds,
        {
            "newton_iterations": result.iterations,
            "linear_iterations": result.linear_iterations,
            "relative_residual": result.residual_history[-1],
        },
    )


def _spoil_problem(problem: Problem, fault: Fault) -> Problem:
    if fault is Fault.SOFTER:
        material = problem.material
        softer = Material(0.98 * material.youngs_modulus, material.poissons_ratio, material.density)
        return dataclasses.replace(problem, material=softer)
    if fault is Fault.DROPPED_LOAD:
        return dataclasses.replace(problem, loads=problem.loads[:-1])
    return problem
