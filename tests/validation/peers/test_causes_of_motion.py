"""A seeded error of step, iterations or law in a motion of our own simulators is told as that."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain, with_law
from palpate.validation.candidates.candidate import candidates_for, fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.peers import adapters
from palpate.validation.peers.board_judge import LAW, MESH, SOLVER, STEP, Score, judge_run
from palpate.validation.peers.board_references import OwnSteps, Truth
from palpate.validation.peers.board_runs import Cache, Run, Status
from palpate.validation.peers.registry import Peer
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.states import State, in_silence

pytestmark = [pytest.mark.dolfinx, pytest.mark.slow]

DESCENT = Path(adapters.__file__).parent / "vertex_block_descent.py"
COMMAND = f"{sys.executable} {DESCENT} {{case}} {{result}} {{iterations}}"
COPY = Peer(name="copy", title="copy", command="copy {case} {result}")
STEP_SIZE = 4e-3


def by_descent(problem: Problem, iterations: int) -> State:
    """Backward Euler with steps of eight of the case's, solved more or less."""
    (candidate,) = candidates_for(COMMAND, 300.0, time_step=STEP_SIZE, iterations=iterations)
    return candidate.solve(problem, Strain.GREEN, in_silence)


def test_errors_of_step_iterations_and_law_land_in_their_own_columns(let_go: Path) -> None:
    case = load_case(let_go)
    problem = case.problem
    truth = Truth(case, solve_motion_set(problem, in_silence, strains=(Strain.GREEN,)))
    assert truth.references is not None
    best = truth.references.truth(Strain.GREEN)
    same = truth.references.same_mesh(Strain.GREEN)
    assert best is not None
    assert same is not None
    lengths = np.linalg.norm(best.displacements, axis=2)
    place = np.unravel_index(int(lengths.argmax()), lengths.shape)
    direction = best.displacements[place] / lengths[place] ** 2

    def apart(one: State, other: State) -> float:
        return float((one.displacements - other.displacements)[place] @ direction)

    asked: list[str] = []
    own_steps = OwnSteps(Cache(let_go.parent / "kept"), asked.append)

    def score(state: State) -> Score:
        return judge_run(
            Run("copy", case.name, Status.ANSWERED, state=state), COPY, truth, truth, own_steps
        )

    solved, few = by_descent(problem, 300), by_descent(problem, 12)
    law = fastsim_candidate().solve(with_law(problem, Law.NEO_HOOKEAN), Strain.GREEN, in_silence)
    seeded = {
        STEP: (solved, apart(solved, same)),
        SOLVER: (few, apart(few, solved)),
        LAW: (law, apart(law, same)),
    }
    for cause, (state, added) in seeded.items():
        found = score(state)
        assert abs(added) > 0.005, cause
        assert found.causes[cause] == pytest.approx(added, rel=0.1), cause
        # A step has been seeded into what is solved too little as well.
        others = {LAW, STEP, SOLVER} - {cause, *([STEP] if cause == SOLVER else [])}
        for other in others:
            assert abs(found.causes.get(other, 0.0)) < 0.1 * abs(added), (cause, other)
        total = apart(state, same) + found.causes[MESH]
        assert sum(found.causes.values()) == pytest.approx(total, abs=1e-12)
        assert found.follows == (Law.NEO_HOOKEAN if cause == LAW else "")
    # A second look solves nothing again.
    before = len(asked)
    score(few)
    assert len(asked) == before
