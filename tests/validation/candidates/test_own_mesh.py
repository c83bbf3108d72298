"""Solutions on a mesh of the candidate's own are measured there, in statics and in motion."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.problem import Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_uniformly
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.case.schema import CheckSpec
from palpate.validation.exchange.result_files import read_result
from palpate.validation.judging.checks import judge_check
from palpate.validation.states import State, Verdict

Field = NDArray[np.float64]


def read_state(folder: Path, problem: Problem, own: Field) -> State:
    """The state of a solution, (num_points, 3) or with times first, on the mesh cut in eight."""
    finer = refine_uniformly(problem.mesh)
    arrays = {"displacement": own, "points": finer.points, "cells": finer.cells}
    if own.ndim == 3:
        arrays["times"] = np.linspace(0.0, 1.0, len(own))
    np.savez(folder / "r.npz", **arrays)
    return state_of_result(read_result(folder / "r.npz"), problem, "them", Strain.GREEN)


@pytest.mark.parametrize("is_motion", [False, True])
def test_cells_that_only_the_own_mesh_has_are_measured(
    tmp_path: Path, problem: Problem, is_motion: bool
) -> None:
    finer = refine_uniformly(problem.mesh)
    own = np.zeros((finer.num_points, 3))
    # A point of its own, at no point of the case, thrown ten lengths away.
    own[-1] = -20.0
    given = problem
    if is_motion:
        given = dataclasses.replace(problem, time=TimeSpan(1.0, num_outputs=1))
        own = np.stack([np.zeros_like(own), own])
    state = read_state(tmp_path, given, own)
    assert np.abs(state.displacement).max() < 1e-6
    assert state.smallest_det_f < 0.0
    assert state.max_displacement == pytest.approx(20.0 * np.sqrt(3.0), rel=1e-14)
    spec = CheckSpec(metric="inverted_cells", against="candidate", limit=0.0, reason="r")
    check = judge_check(spec, Strain.GREEN, given, state, None, 0.0, "")
    assert check.verdict is Verdict.FAILED
    assert check.value is not None
    assert check.value >= 1.0
