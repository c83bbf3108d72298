"""The study of tools on the half space: its blocks, its extrapolation, its verdicts both ways."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference.availability import is_available
from palpate.validation.report.study_page import study_page
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies import half_space
from palpate.validation.studies.closed_forms import hertz_force, punch_force
from palpate.validation.studies.half_space import Outcome, blocks
from palpate.validation.studies.half_space.blocks import (
    BAR,
    CONTACT_RADIUS,
    MATERIAL,
    SIZES,
    Block,
    HalfSpace,
    closed_force,
    extrapolate,
    hertz_radius,
    pressed_block,
    pressed_depth,
    round_block,
    solve_block,
    solve_half_space,
)

if is_available():
    from palpate.reference.statics import solve_static

TOOLS = ("punch", "sphere")
SETTLEMENT = 0.7


def block(tool: str, size: float, factor: float = 1.0) -> Block:
    """The force that settles a block by k F / (E W) and by a little of x^3 beside."""
    depth, E = pressed_depth(tool), MATERIAL.youngs_modulus
    low, high = 0.0, 10.0 * closed_force(tool)
    for _ in range(200):
        force = 0.5 * (low + high)
        left = SETTLEMENT * force / (E * size * CONTACT_RADIUS) * (1.0 - 0.1 / size**2)
        alone = (
            force * depth / closed_force(tool)
            if tool == "punch"
            else depth * (force / closed_force(tool)) ** (2.0 / 3.0)
        )
        low, high = (force, high) if alone - left < depth else (low, force)
    force *= factor
    return Block(size, force, BAR, 1000, 3000, 3, hertz_radius(force))


def right(tool: str, factor: float = 1.0) -> HalfSpace:
    return extrapolate(tool, [block(tool, size, factor) for size in SIZES])


def test_a_run_that_was_cut_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    solved: list[float] = []

    def solve(tool: str, size: float, bar: float, progress: object) -> Block:
        del bar, progress
        if len(solved) == 2:
            solved.clear()
            raise KeyboardInterrupt
        solved.append(size)
        return block(tool, size)

    monkeypatch.setattr(blocks, "solve_block", solve)
    with pytest.raises(KeyboardInterrupt):
        solve_half_space("punch", in_silence)
    assert solve_half_space("punch", in_silence) == right("punch")
    assert solved == [SIZES[2]]


def test_closed_forms_are_the_published_ones() -> None:
    # E* = 5000 / 0.91 Pa; 2 E* a d, and 4/3 E* R^(1/2) d^(3/2) with d = a^2 / R.
    modulus = 5000.0 / 0.91
    assert punch_force(1e-6, MATERIAL, 1e-3) == pytest.approx(2.0 * modulus * 1e-9)
    assert hertz_force(1e-5, MATERIAL, 0.1) == pytest.approx(
        4.0 / 3.0 * modulus * math.sqrt(0.1) * 1e-5**1.5
    )
    assert hertz_radius(closed_force("sphere")) == pytest.approx(CONTACT_RADIUS)


@pytest.mark.parametrize("size", [4.0, 64.0])
def test_a_block_is_the_quarter_of_a_cylinder(size: float) -> None:
    mesh = round_block(size, 2)
    assert mesh.volume == pytest.approx(0.25 * math.pi * (size * CONTACT_RADIUS) ** 3, rel=1e-12)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0.0
    edges = np.sort(mesh.boundary_facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_punch_touches_its_circle_and_no_more() -> None:
    problem = pressed_block("punch", 4.0)
    near = problem.tools[0].contact_facets
    corners = problem.mesh.points[near]
    edges = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    assert area == pytest.approx(0.25 * math.pi * CONTACT_RADIUS**2, rel=1e-9)


@pytest.mark.parametrize("tool", TOOLS)
def test_blocks_lead_to_the_half_space(tool: str) -> None:
    found = right(tool)
    assert found.ratio == pytest.approx(1.0, abs=1e-4)
    assert abs(found.ratio - 1.0) <= 2.0 * found.remainder < 1e-4
    assert found.settlement == pytest.approx(SETTLEMENT, rel=0.02)
    # All forces 1 % off are that on the half space, and bars of 0.3 % leave 0.5 %.
    assert right(tool, 1.01).ratio == pytest.approx(1.01, abs=2e-3)
    assert found.bar == pytest.approx(BAR * 5.0 / 3.0, rel=0.3)


def good() -> Outcome:
    return Outcome(right("punch"), right("sphere"))


def verdicts(outcome: Outcome) -> list[Verdict]:
    return [finding.verdict for finding in half_space.judge(outcome)]


def test_a_right_truth_passes() -> None:
    assert set(verdicts(good())) == {Verdict.PASSED}


@pytest.mark.parametrize(
    ("place", "spoil"),
    [
        (0, lambda o: o._replace(punch=o.punch._replace(ratio=1.01))),
        (0, lambda o: o._replace(punch=o.punch._replace(bar=0.02))),
        (0, lambda o: o._replace(punch=o.punch._replace(ratio=math.nan))),
        (1, lambda o: o._replace(sphere=o.sphere._replace(ratio=0.99))),
        (1, lambda o: o._replace(sphere=o.sphere._replace(remainder=math.inf))),
        (2, lambda o: o._replace(sphere=o.sphere._replace(settlement=0.45))),
        (2, lambda o: o._replace(punch=o.punch._replace(settlement_bar=1.0))),
        (3, lambda o: o._replace(sphere=o.sphere._replace(blocks=narrow(o.sphere.blocks)))),
    ],
)
def test_each_spoiled_answer_fails_its_own_claim(
    place: int, spoil: Callable[[Outcome], Outcome]
) -> None:
    found = verdicts(spoil(good()))
    assert found[place] is Verdict.FAILED
    assert found.count(Verdict.FAILED) == 1


def narrow(blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    return tuple(block._replace(touching=0.9 * block.touching) for block in blocks)


def test_the_page_stands_alone() -> None:
    shown = half_space.present(good())
    page = study_page("Half space", ["Why."], half_space.judge(good()), shown)
    assert page.count("<svg") == 1
    assert "flat punch" in page


@pytest.mark.dolfinx
@pytest.mark.parametrize(("tool", "known"), [("punch", 1.181), ("sphere", 1.189)])
def test_the_first_mesh_is_near_the_truth(tool: str, known: float) -> None:
    """In a block of four contact radii, where the study's last mesh has `known`."""
    (felt,) = solve_static(pressed_block(tool, 4.0), strain=Strain.LINEAR, degree=2).tools
    assert 4.0 * felt.forces[-1][2] / closed_force(tool) == pytest.approx(known, rel=0.02)


@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.parametrize("tool", TOOLS)
def test_a_block_is_solved_to_its_bar(tool: str) -> None:
    found = solve_block(tool, 4.0, 0.01, lambda _line: None)
    assert found.bar <= 0.01
    assert found.meshes >= 3
