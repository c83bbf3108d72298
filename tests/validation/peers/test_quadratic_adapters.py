"""What adapters of quadratic tetrahedra are handed: nodes, loads and holds by their own shapes."""

from __future__ import annotations

import dataclasses
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Traction
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.peers import adapters
from palpate.validation.peers.registry import interpreters, read_peers

FOLDER = Path(adapters.__file__).parent
MESH = brick_box((3, 2, 2), (0.3, 0.2, 0.2), ragged=0.15)
END = side(MESH, 0, 0.3)
PULL = Traction(END, (40.0, 10.0, -20.0))
BODY = Problem(MESH, Material(2e4, 0.3), (held(side(MESH, 0, 0.0)),), (PULL,))


@pytest.fixture
def quadratic(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The module as adapters import it, from their own folder."""
    monkeypatch.syspath_prepend(str(FOLDER))
    yield importlib.import_module("nodes")
    sys.modules.pop("nodes", None)


def job_of(*loads: Load) -> dict[str, Any]:
    problem = dataclasses.replace(BODY, loads=loads)
    return rest_arrays(problem) | {"load_kinds": [type(load).__name__ for load in loads]}


def test_the_nodes_are_the_points_and_the_middles_of_edges(quadratic: ModuleType) -> None:
    body = quadratic.Quadratic.of(job_of(PULL))
    assert np.array_equal(body.points[: MESH.num_points], MESH.points)
    for middle, (a, b) in enumerate(quadratic.EDGES, start=4):
        ends = body.points[body.cells[:, [a, b]]]
        np.testing.assert_allclose(body.points[body.cells[:, middle]], ends.mean(axis=1))
    # Eight parts of an eighth each, all the right way round.
    parts = signed_volumes(body.points, body.parts.astype(np.int32))
    whole = signed_volumes(MESH.points, MESH.cells)
    np.testing.assert_allclose(parts.reshape(-1, 8), np.repeat(whole[:, None] / 8, 8, axis=1))


def test_middles_are_held_between_held_corners_of_the_boundary_only(quadratic: ModuleType) -> None:
    body = quadratic.Quadratic.of(job_of(PULL))
    # All of the held face, and nothing else, at the places of nodes.
    on_face = np.isclose(body.points[:, 0], 0.0)
    assert np.array_equal(body.fixed.all(axis=1), on_face)
    assert np.array_equal(body.fixed.any(axis=1), on_face)


@pytest.mark.parametrize(
    "load", [PULL, BodyForce((3.0, -2.0, 1.0)), PointForce(np.array([5]), np.array([[1.0, 2, 3]]))]
)
def test_force_and_moment_of_the_nodes_are_those_of_the_points(
    quadratic: ModuleType, load: Load
) -> None:
    job = job_of(load)
    body = quadratic.Quadratic.of(job)
    given = job["external_force"]
    np.testing.assert_allclose(body.force.sum(axis=0), given.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        np.cross(body.points, body.force).sum(axis=0),
        np.cross(MESH.points, given).sum(axis=0),
        rtol=1e-9,
    )


def test_loads_are_work_on_quadratic_fields(quadratic: ModuleType) -> None:
    """Of u = x^2 e_x: t_x L^2 A on the end face, and b_x times the integral of x^2."""

    def work(load: Load) -> float:
        body = quadratic.Quadratic.of(job_of(load))
        square = np.zeros_like(body.points)
        square[:, 0] = body.points[:, 0] ** 2
        return float((body.force * square).sum())

    assert work(PULL) == pytest.approx(40.0 * 0.3**2 * 0.04, rel=1e-12)
    assert work(BodyForce((3.0, 0.0, 0.0))) == pytest.approx(3.0 * 0.3**3 / 3 * 0.04, rel=1e-12)


def test_loads_that_cannot_be_told_apart_are_refused(quadratic: ModuleType) -> None:
    with pytest.raises(ValueError, match="more than one kind"):
        quadratic.Quadratic.of(job_of(PULL, BodyForce((1.0, 0.0, 0.0))))
    other = Traction(side(MESH, 1, 0.2), (0.0, 7.0, 0.0))
    with pytest.raises(ValueError, match="not the same everywhere"):
        quadratic.Quadratic.of(job_of(PULL, other))


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", [peer.name for peer in read_peers() if peer.is_quadratic])
def test_a_quadratic_adapter_gives_the_references_quadratic_answer(name: str) -> None:
    from palpate.validation.references.runs import solve_state

    command = next(peer for peer in read_peers() if peer.name == name).command_line()
    if command is None:
        pytest.skip(f"{name}: its tool is not installed in {interpreters()}")
    truth = solve_state(BODY, Strain.GREEN, 2, lambda _line: None).displacement
    found = outside_candidate(OutsideSimulator(command, 120.0)).solve(
        BODY, Strain.GREEN, lambda _line: None
    )
    # Four points of integration, where the reference has more: as far apart as that makes them.
    apart = np.abs(found.displacement - truth).max() / np.abs(truth).max()
    assert apart < 5e-3
    # Linear ones are ten times as far.
    plain = solve_state(BODY, Strain.GREEN, 1, lambda _line: None).displacement
    assert np.abs(plain - truth).max() / np.abs(truth).max() > 10.0 * apart
