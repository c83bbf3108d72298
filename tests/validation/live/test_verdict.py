"""A pose of the page against FEniCSx: right as it is, red once it is spoiled; and the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.case import Case, load_case
from palpate.validation.live.hand import Settling
from palpate.validation.live.live_case import Touch, live_case, patch_radius
from palpate.validation.live.panes import Surface, make_panes
from palpate.validation.live.recording import take_hold, write_pose
from palpate.validation.live.verdict import (
    SAME_MESH,
    TRUTH,
    PoseOfPane,
    judge_panes,
    read_pose,
    same_mesh_references,
    true_references,
)

pytestmark = [pytest.mark.dolfinx, pytest.mark.nightly]


def pressed(
    depth: float, folder: Path, radius: float = 8.2
) -> tuple[Case, list[PoseOfPane], Settling]:
    """The block with a ball [mm] pressed in along -x [mm], held until it rests."""
    case = load_case("block")
    live = live_case(
        case, Touch({"shape": "sphere", "radius": radius}, mass_damping=100.0), (Element.LINEAR,)
    )
    panes = make_panes(live.problem, Surface(live.problem), (Element.LINEAR,))
    gap = live.start[0] - 40.0 - radius
    goal = np.round(live.start - (gap + depth) * live.outwards, 6)
    ticks, settling = 60, Settling(live.clock.tick)
    for tick in range(1, ticks + 1):
        x, y, z = live.start + (goal - live.start) * tick / ticks
        for pane in panes:
            pane.advance(np.array(case.spec.units.lengths((x, y, z))), None, live.clock.steps)
    x, y, z = goal
    while not settling.is_over:
        for pane in panes:
            pane.advance(np.array(case.spec.units.lengths((x, y, z))), None, live.clock.steps)
        if settling.note([pane.displacement for pane in panes]) and not settling.is_over:
            for pane in panes:
                pane.mean_force()
    forces = [pane.mean_force() for pane in panes]
    path, answers = write_pose(live, goal, panes, forces, None, folder, "held")
    return load_case(path), read_pose(answers), settling


# A vertex may slide off the page's own ball at 2 mm: then there is more than one equilibrium.
@pytest.mark.parametrize(("depth", "radius"), [(1.0, 8.2), (2.0, 20.0)])
def test_a_settled_pose_is_that_of_the_same_mesh_and_a_spoiled_one_is_not(
    depth: float, radius: float, tmp_path: Path
) -> None:
    case, panes, settling = pressed(depth, tmp_path, radius)
    assert settling.rests
    assert case.problem.time is None
    assert [pane.strain for pane in panes] == [Strain.LINEAR, Strain.GREEN]
    references = same_mesh_references(case, panes, lambda _: None)
    assert not references.failures
    answer = judge_panes(SAME_MESH, case, panes, references)
    assert [pane["verdict"] for pane in answer.reports] == ["passed", "passed"]
    sizes = [np.linalg.norm(pane.displacement, axis=1).max() for pane in panes]
    assert (answer.errors.max(axis=1) < 0.005 * np.array(sizes)).all()
    # The colours of the page: an error where the tool acts.
    assert (answer.errors.max(axis=1) > 0.0).all()
    for factor in (1.02, 0.98):
        spoiled = [
            PoseOfPane(p.name, p.strain, p.element, factor * p.displacement, p.force) for p in panes
        ]
        answer = judge_panes(SAME_MESH, case, spoiled, references)
        assert [pane["verdict"] for pane in answer.reports] == ["failed", "failed"]
    soft = [PoseOfPane(p.name, p.strain, p.element, p.displacement, 1.05 * p.force) for p in panes]
    answer = judge_panes(SAME_MESH, case, soft, references)
    assert [pane["verdict"] for pane in answer.reports] == ["failed", "failed"]


def dragged(folder: Path) -> tuple[Case, list[PoseOfPane]]:
    """The block, its end pulled aside by a spring, with smoothed tetrahedra."""
    case, elements = load_case("block"), (Element.LINEAR, Element.SMOOTHED)
    live = live_case(case, Touch(), elements)
    panes = make_panes(live.problem, Surface(live.problem), elements)
    mesh = case.problem.mesh
    end = int(np.argmin(np.linalg.norm(mesh.points - [0.04, 0.0125, 0.01], axis=1)))
    grip = take_hold(live, panes[-1], end, patch_radius(mesh), largest_way=0.1, digits=6)
    for pane in panes:
        pane.hold(grip.spring)
    grip.hand.send(grip.first + np.array([2.56, 1.92, 0.0]))
    x, y, z = live.start
    away, settling = np.array(case.spec.units.lengths((x, y, z))), Settling(live.clock.tick)
    while not settling.is_over:
        x, y, z = grip.hand.next_position()
        for pane in panes:
            pane.advance(away, np.array(case.spec.units.lengths((x, y, z))), live.clock.steps)
        settling.note([pane.displacement for pane in panes])
    nothing = [np.zeros(3)] * len(panes)
    path, answers = write_pose(
        live, live.start, panes, nothing, grip.static_table(), folder, "held"
    )
    return load_case(path), read_pose(answers)


def test_a_drag_reaches_the_truth_which_tells_good_from_bad(tmp_path: Path) -> None:
    case, panes = dragged(tmp_path)
    known = same_mesh_references(case, panes, lambda _: None)
    answer = judge_panes(SAME_MESH, case, panes, known)
    assert [pane["verdict"] for pane in answer.reports] == ["passed"] * 3
    # Also from a spoiled pose the reference comes to what is right.
    spoiled = [replace(pane, displacement=1.02 * pane.displacement) for pane in panes]
    led = same_mesh_references(case, spoiled, lambda _: None)
    answer = judge_panes(SAME_MESH, case, spoiled, led)
    assert [pane["verdict"] for pane in answer.reports] == ["failed"] * 3
    found = true_references(case, panes, known, lambda _: None)
    assert found.bars["displacement_l2", Strain.GREEN] <= 0.01
    # Linear tetrahedra on 90 cells are off by more than is asked, and the truth itself is not.
    answer = judge_panes(TRUTH, case, panes, found)
    assert [pane["verdict"] for pane in answer.reports[:2]] == ["failed", "failed"]
    truth = found.truth(Strain.GREEN)
    assert truth is not None
    right = replace(panes[1], displacement=truth.displacement)
    assert judge_panes(TRUTH, case, [right], found).told[0]["verdict"] == "passed"
    assert np.isfinite(answer.errors).all()


def test_a_ball_on_the_block_reaches_the_truth(tmp_path: Path) -> None:
    case, panes, _ = pressed(1.0, tmp_path, radius=20.0)
    known = same_mesh_references(case, panes, lambda _: None)
    found = true_references(case, panes, known, lambda _: None)
    truth = found.truth(Strain.GREEN)
    assert truth is not None
    told = judge_panes(TRUTH, case, panes, found).told
    assert [pane["verdict"] for pane in told] == ["failed", "failed"]
    assert found.bars["tool_force", Strain.GREEN] < 0.1
