"""Bodies under a tool: the right way, with the force of statics, and repeated bit for bit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.contact.explicit_tools import depth_at_start
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.live.bench_touch import Client, connected
from palpate.validation.live.live_case import Touch, live_case, problem_of
from palpate.validation.live.panes import ExplicitPane, Surface
from palpate.validation.live.pointer import Pointer
from palpate.validation.live.simulation import Simulation
from palpate.validation.solving import solve
from palpate.validation.states import Verdict

CAPSULE = {"shape": "capsule", "radius": 9.0, "half_length": 8.0}
PLATE = {"shape": "box", "half_widths": [9.0, 30.0, 30.0]}


def pressed(client: Client, depth: float, seconds: float = 1.0) -> dict[str, object]:
    """The head of a frame after the tool was pressed in along -x [mm] and has rested."""
    x, y, z = client.scene["tool"]["start"]
    client.say("tool", number=1, to=[x - depth, y, z])
    return client.until_time(client.frames[-1]["time"] + seconds if client.frames else seconds)


def test_the_force_on_the_tool_is_that_of_statics(serving) -> None:
    touch = Touch(PLATE, mass_damping=100.0)
    with serving("block", touch) as server, connected(server.address) as client:
        gap = client.scene["tool"]["start"][0] - 40.0 - 9.0
        pressed(client, gap + 2.0, 0.8)
        heads = [head for head in (client.hear() for _ in range(20)) if "panes" in head]
        live = server.simulation.live
        goal = live.start - np.array([gap + 2.0, 0.0, 0.0])
        still = live.with_path([live.start, goal])
        statics = dataclasses.replace(problem_of(live.case, still), time=None)
        for number, strain in enumerate((Strain.LINEAR, Strain.GREEN)):
            state = solve(statics, strain=strain)
            assert state.tool_forces is not None
            expected = state.tool_forces[0]
            force = np.mean([head["panes"][number]["force"] for head in heads], axis=0)
            # The tool is pushed back, out of the body.
            assert expected[0] > 0.05
            assert np.linalg.norm(force - expected) < 0.02 * np.linalg.norm(expected)
        positions = client.positions(len(server.simulation.surface.used))
        moved = positions[1] - live.problem.mesh.points[server.simulation.surface.used] * 1e3
        assert moved[:, 0].min() == pytest.approx(-2.0, abs=0.05)
        assert heads[-1]["panes"][1]["volume"] < 0.0


def test_the_tool_of_a_case_begins_where_explicit_steps_can() -> None:
    """The ball of press begins at the slab; averages over facets are in it already."""
    case = load_case("press")
    assert depth_at_start(case.problem) > 0.0
    live = live_case(case, Touch(), (Element.LINEAR,))
    assert -2e-4 < depth_at_start(live.problem) <= 0.0
    # Back along its own way, by less than what the ball (30 mm) lies off a facet's edge (7.5 mm).
    ways = [np.array(pose.position) for pose in case.spec.tool[0].pose]
    back = live.start - ways[0]
    np.testing.assert_allclose(np.cross(back, ways[0] - ways[1]), 0.0, atol=1e-6)
    assert 0.0 < np.linalg.norm(back) < 7.5**2 / (2.0 * 30.0)
    ExplicitPane(live.problem, Surface(live.problem), Strain.GREEN, Element.LINEAR)


def test_the_pull_of_a_grip_is_that_of_statics(serving) -> None:
    with (
        serving("block", Touch(mass_damping=100.0)) as server,
        connected(server.address) as client,
    ):
        client.until_time(0.05)
        simulation = server.simulation
        rest = simulation.live.problem.mesh.points[simulation.surface.used]
        point = int(np.argmin(np.linalg.norm(rest - [0.04, 0.0125, 0.02], axis=1)))
        client.say("grab", point=point, radius=14.0)
        client.say("pull", number=1, by=[2.0, 0.5, 3.0])
        client.until_time(1.2)
        heads = [head for head in (client.hear() for _ in range(10)) if "panes" in head]
        grip = simulation._grip
        assert grip is not None
        assert heads[-1]["grip"] == pytest.approx([2.0, 0.5, 3.0])
        live = simulation.live
        still = {**live.data, "spring": [grip.static_table()]}
        still.pop("tool")
        statics = dataclasses.replace(problem_of(live.case, still), time=None)
        for number, strain in enumerate((Strain.LINEAR, Strain.GREEN)):
            state = solve(statics, strain=strain)
            (spring,) = statics.springs
            patch = PatchSprings(statics.mesh.points, (spring,))
            anchors, ones = spring.path.end[None], np.ones(1)
            expected = -patch.resultants(state.displacement, anchors, ones)[0]
            force = np.mean([head["panes"][number]["force"] for head in heads], axis=0)
            # The body pulls back.
            assert expected[2] < -0.005
            assert np.linalg.norm(force - expected) < 0.02 * np.linalg.norm(expected)
        client.say("let_go")
        assert client.until(lambda heard: heard.get("grip", 0) is None)["panes"][0]["force"] == [
            0.0,
            0.0,
            0.0,
        ]


@pytest.mark.parametrize("radius", [8.9, 13.0], ids=["slips", "crushes"])
def test_a_tool_that_is_driven_through_the_body_is_held_back(radius: float) -> None:
    """A ball towards the clamp: a small one parts the vertices, a large one inverts cells."""
    ball = {"shape": "sphere", "radius": radius}
    live = live_case(load_case("block"), Touch(ball, mass_damping=100.0), (Element.LINEAR,))
    pane = ExplicitPane(live.problem, Surface(live.problem), Strain.GREEN, Element.LINEAR)
    pointer = Pointer(live.start, live.outwards, 40.0 * live.clock.tick, digits=6)
    pointer.send(live.start - 30.0 * live.outwards)
    retreats = 0
    for _ in range(150):
        position = pointer.next_position(pane.room)
        retreats += pointer.is_held_back
        pane.advance(position * 1e-3, None, live.clock.steps)
        assert not pane.trouble
    assert retreats
    assert pane.smallest_det_f > 0.2
    assert pointer.position[0] > 40.0
    assert pane.mean_force()[0] > 0.0


def test_pause_stops_the_bodies_and_reset_brings_them_back(serving) -> None:
    with serving("block") as server, connected(server.address) as client:
        pressed(client, 12.0, 0.2)
        client.say("pause", on=True)
        at = client.until(lambda heard: heard.get("paused") is True)["time"]
        client.say("colour", by="stress")
        assert client.until(lambda heard: heard.get("colour") == "stress")["time"] == at
        client.say("reset")
        client.say("pause", on=False)
        after = client.until(lambda heard: heard.get("paused") is False)
        assert after["time"] < 0.05
        assert after["tool"] == pytest.approx(client.scene["tool"]["start"])


def test_three_panes_where_both_elements_are_there(serving) -> None:
    both = tuple(Element)
    with serving("block", elements=both) as server, connected(server.address) as client:
        pressed(client, 8.0, 0.6)
        assert client.scene["panes"] == [
            "linear strain",
            "Green strain",
            "Green strain (smoothed)",
        ]
        forces = [pane["force"][0] for pane in client.frames[-1]["panes"]]
        assert all(force > 0.0 for force in forces)
        # Smoothed tetrahedra are softer.
        assert forces[2] < forces[1]


def test_with_the_cases_loads_the_bodies_move_by_themselves(serving) -> None:
    with serving("block", Touch(mass_damping=50.0)) as server, connected(server.address) as client:
        assert client.until_time(0.1)["panes"][1]["energy"] == 0.0
        client.say("loads", on=True)
        scene = client.until(lambda heard: heard.get("kind") == "scene")
        assert scene["has_loads"] is True
        assert client.until_time(0.6)["panes"][1]["energy"] > 1e-6


@pytest.fixture
def recorded(serving) -> tuple[Simulation, Path]:
    """A motion by tool and by grip, under the case's own loads."""
    with serving("block", Touch(CAPSULE, has_loads=True)) as server:
        with connected(server.address) as client:
            client.until_time(0.1)
            client.say("record", on=True)
            client.until(lambda heard: heard.get("recording") is True)
            x, y, z = client.scene["tool"]["start"]
            for number, goal in enumerate([[x - 6, y + 1, z], [x - 3.7, y - 2, z + 1.7]]):
                client.say("tool", number=number + 1, to=goal)
                client.until_time(0.2 * (number + 1))
            client.say("grab", point=3, radius=14.0)
            client.say("pull", number=3, by=[1.0, -2.0, 1.5])
            client.until_time(0.5)
            client.say("let_go")
            client.until_time(0.55)
            client.say("record", on=False)
            path = Path(client.until(lambda heard: "recorded" in heard)["recorded"])
        return server.simulation, path


def test_what_was_recorded_repeats_the_motion_bit_for_bit(
    recorded: tuple[Simulation, Path], tmp_path: Path
) -> None:
    simulation, path = recorded
    case = load_case(path)
    assert path.parent == tmp_path
    again = live_case(load_case("block"), Touch(CAPSULE, has_loads=True), (Element.LINEAR,))
    assert case.problem.time is not None
    assert case.problem.time.time_step == again.clock.time_step
    replay_is_the_motion(simulation, path)


@pytest.mark.dolfinx
@pytest.mark.long
def test_what_was_recorded_passes_its_gate_and_a_fault_does_not(
    recorded: tuple[Simulation, Path],
) -> None:
    case = load_case(recorded[1])
    assert len(case.spec.tool) == len(case.spec.spring) == 1
    right = fastsim_candidate()
    both = (right, with_fault(right, Fault.SOFTER))
    result = judge_case(case, live=True, candidate=both, diagnoses=False)
    for metric in ("trajectory_l2", "tool_force"):
        verdicts = [check.verdict for check in result.checks if check.metric == metric]
        assert verdicts == [Verdict.PASSED, Verdict.FAILED]


def replay_is_the_motion(simulation: Simulation, path: Path) -> None:
    """The case's run against the pane's own body, sent from position to position as it was."""
    case = load_case(path)
    span = case.problem.time
    assert span is not None
    tool, (grip,) = case.spec.tool[0], simulation.recorded_grips
    live, each = simulation.live, simulation.live.clock.steps
    for pane in simulation.panes:
        whole = simulate(case.problem, strain=pane.strain, element=pane.element)
        pane.reset()
        assert whole.num_steps == each * (len(tool.pose) - 1)
        forces = []
        for number, pose in enumerate(tool.pose[1:]):
            step, anchor = number * each, None
            if step == grip.begin:
                pane.attach(grip.spring)
            if grip.end is not None and step == grip.end:
                pane.release()
            if grip.begin <= step < (grip.end or 10**9):
                anchor = live.metres(grip.positions[(step - grip.begin) // each])
            pane.advance(live.metres(np.array(pose.position)), anchor, each)
            if (number + 1) * each % (whole.num_steps // span.num_outputs) == 0:
                forces.append(pane.mean_force())
        assert not pane.trouble
        np.testing.assert_array_equal(pane.displacement, whole.displacements[-1])
        assert np.abs(whole.displacements[-1]).max() > 1e-3
        assert np.abs(whole.tools[0].mean_forces[1:] - forces).max() < 1e-9 * np.abs(forces).max()
