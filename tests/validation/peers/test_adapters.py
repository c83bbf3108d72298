"""Adapters whose tool is installed give fastsim's answer; rest by kinetic damping is right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.peers.adapters import harness
from palpate.validation.peers.registry import interpreters, read_peers

# Largest distance from fastsim on the same mesh, over the largest displacement: seven digits in
# a text file, a residual of 1e-7 or, in single precision and with another law, the law.
ALLOWED = {
    "numpy-dense": 1e-9,
    "calculix-c3d4": 1e-5,
    "felupe-tetra4": 1e-8,
    "mujoco-flex": 1e-5,
    "newton-semi-implicit": 0.02,
}


@pytest.mark.parametrize("name", ALLOWED)
def test_an_adapter_gives_fastsims_answer(problem: Problem, name: str) -> None:
    if name == "newton-semi-implicit":
        # Laws part as strains grow: at a tenth of the load they are nearly one.
        x, y, z = problem.loads[0].traction  # type: ignore[union-attr]
        lighter = Traction(problem.loads[0].facets, (x / 10, y / 10, z / 10))  # type: ignore[union-attr]
        problem = dataclasses.replace(problem, loads=(lighter,))
    answer = solve_static(problem).displacement
    command = next(peer for peer in read_peers() if peer.name == name).command_line()
    if command is None:
        pytest.skip(f"{name}: its tool is not installed in {interpreters()}")
    found = outside_candidate(OutsideSimulator(command, 120.0)).solve(
        problem, Strain.GREEN, lambda _line: None
    )
    apart = np.abs(found.displacement - answer).max() / np.abs(answer).max()
    assert apart <= ALLOWED[name]
    assert {"tool", "version", "law", "method", "seconds"} <= set(found.says)


def test_kinetic_damping_brings_a_spring_to_rest_and_gives_up_politely() -> None:
    # k = m = 1, pulled by 1: rest at x = 1; steps of 0.1 s.
    place, velocity, force = np.zeros(1), np.zeros(1), 1.0

    def step() -> None:
        velocity[:] += 0.1 * (force - place)
        place[:] += 0.1 * velocity

    count, residual = harness.relax(step, lambda: velocity, 10.0, force, 1e-6, 10_000)
    assert residual <= 1e-6
    assert place[0] == pytest.approx(1.0, abs=1e-5)
    assert count < 2000

    def speed_up() -> None:
        velocity[:] += 1.0

    velocity[:] = 0.0
    # 1 m/s more in each step of 0.1 s: 10 N out of balance of 1 N.
    assert harness.relax(speed_up, lambda: velocity, 10.0, force, 1e-6, 7) == (
        7, pytest.approx(10.0),
    )  # fmt: skip
    # Who creeps at one speed is not at rest where forces say otherwise.
    velocity[:] = 1.0

    def half_out() -> object:
        return np.array([0.5])

    assert harness.relax(lambda: None, lambda: velocity, 10.0, force, 1e-6, 7) == (1, 0.0)
    assert harness.relax(lambda: None, lambda: velocity, 10.0, force, 1e-6, 7, half_out) == (
        7,
        0.5,
    )
    with pytest.raises(SystemExit, match="blew up after 1 steps"):
        harness.relax(lambda: None, lambda: np.array([np.nan]), 10.0, force, 1e-6, 7)
    # No answer then, and the reason is the last line.
    harness.require_rest(1e-6, 1e-6)
    for left in (1.01e-6, np.inf, np.nan):
        with pytest.raises(SystemExit, match="not at rest at its last step"):
            harness.require_rest(left, 1e-6)


def test_the_stable_step_is_below_the_limit_of_the_matrix(problem: Problem) -> None:
    from palpate.fastsim.body import Body
    from palpate.validation.exchange.nodal_arrays import cell_materials, lumped_mass

    materials = cell_materials(problem)
    rest = {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "youngs_modulus": materials[:, 0],
        "poissons_ratio": materials[:, 1],
    }
    step = harness.stable_step(rest, lumped_mass(problem))
    limit = Body(problem.mesh, problem.material).critical_time_step()
    assert 0.1 * limit < step < limit
