"""A pose of the live page held against the reference: a program of its own, in the background.

python -m palpate.validation.live.verdict CASE.toml POSE.npz ANSWER.npz: the case is static, POSE
holds each pane's displacement [m] and the force on the hand [N]; ANSWER gets its error at each
point [m], and what is to be said of it as JSON. Progress goes to standard output, a line each.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case import load_case
from palpate.validation.exchange.result_files import ResultFile
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.sets import QUADRATIC, TRUTH
from palpate.validation.simulators.candidate import Candidate
from palpate.validation.simulators.result_states import state_of_result
from palpate.validation.states import CandidateFailedError, Progress, State


def judge_pose(case: Path, pose: Path, progress: Progress) -> tuple[list[dict[str, Any]], Floats]:
    """What is to be said of each pane, and its error at each point [m], (num_panes, num_points).

    All panes are held against the truth under Green strain, also those that are stepped with linear
    strain: the question is whether what is seen is what tissue does.

    Raises:
        ReferenceFailedError: There is no truth of this pose.
        InputError: The case cannot be used.
    """
    given = np.load(pose, allow_pickle=False)
    names = [str(name) for name in given["names"]]
    candidates = [
        pose_candidate(name, given["displacement"][k], given["force"][k], str(given["element"][k]))
        for k, name in enumerate(names)
    ]
    result = judge_case(
        load_case(case), live=True, candidate=candidates, diagnoses=False, progress=progress
    )
    truth, each = truth_of(result), len(result.checks) // len(names)
    told, errors = [], []
    for number, judged in enumerate(result.candidates):
        own = next(state for state in result.states if state.label == judged.name)
        errors.append(np.linalg.norm(own.displacement - truth.displacement, axis=1))
        checks = result.checks[number * each : (number + 1) * each]
        told.append(
            {
                "name": judged.name,
                "verdict": judged.verdict.value,
                "checks": [
                    f"{check.metric} {check.verdict.value}: {check.message}" for check in checks
                ],
            }
        )
    return told, np.array(errors)


def pose_candidate(name: str, displacement: Points, force: Floats, element: str) -> Candidate:
    """What stands in a pane, as an answer; of the force on the hand too, where there is a tool."""

    def solve(problem: Problem, strain: Strain, _progress: Progress) -> State:
        about: dict[str, Any] = {"element": element}
        if problem.tools:
            about["tool_forces"] = [force.tolist()]
        values = displacement[None]
        result = ResultFile(Path(name), values, are_positions=False, times=None, about=about)
        return state_of_result(result, problem, name, strain)

    return Candidate(name, solve, can_be_asked=False, element=Element(element))


def truth_of(result: CaseResult) -> State:
    """The best reference under Green strain.

    Raises:
        ReferenceFailedError: There is none.
    """
    for label in (TRUTH, QUADRATIC):
        for state in result.states:
            if state.is_reference and state.label == label and state.strain is Strain.GREEN:
                return state
    raise ReferenceFailedError("; ".join(result.notes) or "the reference found no equilibrium")


def main(words: list[str]) -> int:
    """See the module."""
    case, pose, answer = map(Path, words)
    try:
        told, errors = judge_pose(case, pose, lambda line: print(line, flush=True))
    except (InputError, ReferenceFailedError, ReferenceUnavailableError, CandidateFailedError) as e:
        print(e, file=sys.stderr, flush=True)
        return 3
    with atomic_path(answer) as temporary, temporary.open("wb") as file:
        np.savez(file, errors=errors, told=np.array(json.dumps(told)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
