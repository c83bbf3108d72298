"""An impact as a whole: impulse against momentum, and energy, of a bar whose motion is known.

A bar between smooth walls that meets another one: it touches for 2 L / c, with a force rho c v A,
and leaves as fast as it came (d'Alembert).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from calibration_recipe.swings import impact_problem

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, InitialVelocity, Problem, Strain
from palpate.meshes.rigid_tool import ToolPath
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import on_own_mesh
from palpate.validation.case import load_case
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics import CATALOGUE, make_state
from palpate.validation.metrics.balance import energy_balance, impulse_balance, unfit
from palpate.validation.metrics.validity import Worst
from palpate.validation.states import State, Trajectory, Verdict, in_silence

SPEED, GAP, LENGTH, AREA = 0.01, 0.4, 1.0, 0.25**2
# The speed of waves and the density are one.
FORCE, CONTACT = SPEED * AREA, 2.0 * LENGTH
BAR, _, ANSWER = impact_problem(nu=0.3, speed=SPEED, gap=GAP, outputs=44)
METRICS = ("impulse_balance", "energy_balance")


def felt(times: Floats, force: float = FORCE) -> Floats:
    """Means of the force on the wall from output to output [N], (1, n + 1, 3)."""
    impulse = force * np.clip(times - GAP, 0.0, CONTACT)
    forces = np.zeros((1, len(times), 3))
    forces[0, 1:, 0] = -np.diff(impulse) / np.diff(times)
    return forces


def known(*, force: float = FORCE, part: float = 1.0) -> State:
    """The bar's motion; the force on the wall, and what it leaves with over what it came with."""
    motion = ANSWER.state.trajectory
    assert motion is not None
    displacements = motion.displacements.copy()
    leaves = GAP + CONTACT
    late = motion.times > leaves
    displacements[late, :, 0] -= (1.0 - part) * SPEED * (motion.times[late] - leaves)[:, None]
    return with_states(displacements, felt(motion.times, force))


def with_states(displacements: Floats, forces: Floats | None) -> State:
    assert BAR.time is not None
    return make_state(
        BAR.mesh, displacements[-1], label="bar", simulator="known", strain=Strain.LINEAR,
        trajectory=Trajectory(BAR.time.output_times, displacements), tool_forces=forces,
    )  # fmt: skip


def test_the_closed_form_is_in_balance() -> None:
    right = known()
    assert impulse_balance(BAR, right).value < 1e-12
    # Rounding of 1e-16 of a way of 4e-2, over the outputs' time and the speed of 1e-2.
    assert energy_balance(BAR, right).value < 1e-12
    assert energy_balance(BAR, right).doubt < 1e-12


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_a_wrong_force_or_rebound_is_off_by_what_is_wrong(part: float) -> None:
    # The momentum that a bar shows is 2 m v, or (1 + part) m v.
    weak = impulse_balance(BAR, known(force=part * FORCE))
    assert weak.value == pytest.approx(abs(part - 1.0), rel=1e-9)
    tired = known(part=part)
    assert impulse_balance(BAR, tired).value == pytest.approx(abs(1 - part) / (1 + part), rel=1e-9)
    assert energy_balance(BAR, tired).value == pytest.approx(abs(1.0 - part**2), rel=1e-9)


@pytest.mark.parametrize("element", list(Element))
def test_an_explicit_bar_has_the_impulse_and_the_contact_of_the_closed_form(
    element: Element,
) -> None:
    found = simulate(BAR, strain=Strain.LINEAR, element=element)
    forces = found.tools[0].mean_forces[:, 0]
    step = found.times[1]
    mass = AREA * LENGTH
    # One of eight cells stops at the wall: half of its mass is that of the points there.
    assert -forces.sum() * step == pytest.approx(2.0 * mass * SPEED, rel=1.0 / 16.0)
    touching = np.flatnonzero(forces)
    assert step * (touching[-1] - touching[0] + 1) == pytest.approx(CONTACT, abs=1.0 / 8.0 + step)
    state = with_states(found.displacements, found.tools[0].mean_forces[None])
    state = replace(state, element=element)
    assert impulse_balance(BAR, state).value < 1e-12
    assert 0.0 < energy_balance(BAR, state).value < 2.0 / 16.0


def test_what_damping_takes_is_counted() -> None:
    dropped = load_case("drop").problem
    assert dropped.time is not None
    # A loss tangent of 0.03 at the 50 Hz of the block's first swing.
    span = replace(dropped.time, stiffness_damping=1e-4, time_step=None)
    damped = replace(dropped, time=span)
    state = fastsim_candidate().solve(damped, Strain.GREEN, in_silence)
    with_it, without = energy_balance(damped, state), energy_balance(dropped, state)
    assert with_it.value + with_it.doubt < without.value - without.doubt
    assert with_it.value < 0.1
    assert impulse_balance(damped, state).value < 1e-12


def test_a_strain_that_changes_evenly_leaves_no_doubt_of_what_damping_takes() -> None:
    # Of 45 intervals one is left over when they are taken in twos: the first, before anything.
    assert BAR.time is not None
    span = replace(BAR.time, num_outputs=45, stiffness_damping=1e-3)
    problem, times = replace(BAR, time=span), span.output_times
    since = np.clip(times - times[1], 0.0, None)[:, None, None]
    displacements = -SPEED * since * BAR.mesh.points * [1.0, 0.0, 0.0]
    state = replace(with_states(displacements, None), trajectory=Trajectory(times, displacements))
    found = energy_balance(problem, state)
    assert found.value > 0.0
    assert found.doubt < 1e-12


def test_a_result_on_a_mesh_of_its_own_is_measured_there() -> None:
    dropped = load_case("drop").problem
    assert dropped.time is not None
    dropped = replace(dropped, time=replace(dropped.time, time_step=None))
    own = on_own_mesh(fastsim_candidate()).solve(dropped, Strain.GREEN, in_silence)
    right = fastsim_candidate().solve(dropped, Strain.GREEN, in_silence)
    assert impulse_balance(dropped, own).value < 1e-9
    # Smaller cells stop less mass at the tool.
    assert 0.0 < energy_balance(dropped, own).value < energy_balance(dropped, right).value
    softer = replace(own, tool_forces=0.9 * np.asarray(own.tool_forces))
    assert impulse_balance(dropped, softer).value == pytest.approx(0.1, rel=1e-6)


def test_forces_in_the_first_and_the_last_interval_leave_a_doubt() -> None:
    state = known()
    forces = np.array(state.tool_forces)
    forces[0, 1, 0] = -0.1 * FORCE
    assert BAR.time is not None
    step = BAR.time.output_times[1]
    found = impulse_balance(BAR, replace(state, tool_forces=forces))
    expected = 0.5 * 0.1 * step / CONTACT
    assert (found.value, found.doubt) == (pytest.approx(expected), pytest.approx(expected))


@pytest.mark.parametrize("metric", METRICS)
def test_a_motion_that_is_no_number_or_never_moves_fails(metric: str) -> None:
    right = known()
    wrong = [np.zeros_like(right.displacements)]
    for number in (math.nan, math.inf, 1e90, 1e308):
        wrong.append(right.displacements.copy())
        wrong[-1][-2, 5, 0] = number
    own = CATALOGUE[metric].own
    assert own is not None
    for displacements in wrong:
        assert not own(BAR, with_states(displacements, right.tool_forces)).value < 0.5


def test_forces_that_are_missing_fail() -> None:
    right = known()
    assert impulse_balance(BAR, replace(right, tool_forces=None)) == Worst(math.inf)
    short = np.array(right.tool_forces)[:, 1:]
    assert impulse_balance(BAR, replace(right, tool_forces=short)) == Worst(math.inf)


def test_the_doubt_is_the_error_bar_of_the_check() -> None:
    case = load_case("drop")
    (spec,) = (check for check in case.checks if check.metric == "energy_balance")
    state = fastsim_candidate().solve(case.problem, Strain.GREEN, in_silence)
    found = energy_balance(case.problem, state)
    for limit, verdict in (
        (found.value + 1.01 * found.doubt, Verdict.PASSED),
        (found.value, Verdict.INCONCLUSIVE),
        (found.value - 1.01 * found.doubt, Verdict.FAILED),
    ):
        asked = spec.model_copy(update={"limit": limit})
        check = judge_check(asked, Strain.GREEN, case.problem, state, None, 0.0, "")
        assert check.verdict is verdict
        assert check.reference_error == found.doubt


def unfit_problems() -> dict[str, Problem]:
    (wall,), span = BAR.tools, BAR.time
    assert span is not None
    moving = ToolPath([0.0, 1.0], np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]))
    slow = TabularAmplitude((0.0, 1.0), (0.0, 1.0))
    moved = replace(BAR.supports[0], displacement=(0.0, 0.1, 0.0))
    return {
        "thrown": replace(BAR, initial_velocity=None),
        "thrown, ": replace(BAR, time=replace(span, num_outputs=4)),
        "mass_damping": replace(BAR, time=replace(span, mass_damping=1.0)),
        "weight": replace(BAR, loads=(BodyForce((1.0, 0.0, 0.0), slow),)),
        "still": replace(BAR, tools=(replace(wall, path=moving),)),
        "without friction": replace(BAR, tools=(replace(wall, friction_coefficient=0.1),)),
        "at a tool": replace(BAR, tools=()),
        "free of supports": replace(BAR, initial_velocity=InitialVelocity((-SPEED, SPEED, 0.0))),
        "do not move": replace(BAR, supports=(moved, *BAR.supports[1:])),
    }


@pytest.mark.parametrize("needed", unfit_problems())
def test_other_problems_are_refused_with_what_is_needed(needed: str) -> None:
    problem = unfit_problems()[needed]
    assert not any(CATALOGUE[metric].fits(problem) for metric in METRICS)
    assert needed in unfit(problem)
    with pytest.raises(InputError, match=needed):
        impulse_balance(problem, known())
    assert unfit(BAR) == ""
