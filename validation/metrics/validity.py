"""What a state says of itself, without a reference: its cells, its rotation, its way in time.

Rotation is what breaks linear strain. Bent bars from four times as long as thick on are off by one
curve over the rotation of their tip, whatever their length and Poisson's ratio: in displacement by
1 % at 1.5 degrees, 5 % at 7.4 and 10 % at 14.4 (`palpate study validity`). Of another body's
largest rotation that is a guide, no bound: only the audit by Green strain measures its error.

Whether a body can have got from state to state shows garbage between the outputs. Between two
states a body leaves the straight line by no more than its
acceleration lets it: |u(t) - line| <= a h1 h2 / 2, h1 and h2 the times to the two. From rest under
loads F that stay, sqrt(a.M a) <= sqrt(F.M^-1 F) at all times: differentiate the equation of motion,
and its energy (a.M a + v.K v) / 2 only falls, from the value of the start. Loads that change add
their total variation; supports that move are loads that change, by what they pull with. This holds
for linear elasticity, whatever the damping by mass; Green strain stays near it.

For tools there is no such bound, and for moving supports a wide one. There the second differences
of the result's states at the outputs, which are compared, say how it accelerates, where they are
close enough to resolve the motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Load, Pressure, Support
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import fixed_components, lumped_mass
from palpate.validation.metrics.body import (
    body_of,
    load_force,
    shape_gradients,
    spring_stiffness_times,
)
from palpate.validation.metrics.difference import are_measurable, measurable_rows, smallest
from palpate.validation.metrics.laws import rotation_of
from palpate.validation.metrics.motion import content_frequency
from palpate.validation.states import State, Trajectory

# Error of displacement [-], and the rotation at which a bent bar has it [degrees].
BORDERS = {0.01: 1.5, 0.05: 7.4, 0.10: 14.4}
# Cells turned more than all the others: so much of the volume is let go, for corners and edges.
_LEFT_OUT = 0.01
# A pressure follows: it may turn round and its area may grow.
_FOLLOWING = 2.0
# Outputs see means of the acceleration over two of their steps.
_DRIVEN = 4.0
# Outputs at least, and outputs in a period, whose second differences resolve a motion.
_FEWEST_OUTPUTS = 8
_OUTPUTS_PER_PERIOD = 4
# Fraction of the largest state, and of the body: what single precision leaves of a displacement,
# and of one that was taken from positions.
_ROUNDING = 1e-5
_ROUNDING_OF_PLACES = 1e-6


def det_f(mesh: TetMesh, displacement: Points) -> Points:
    """Volume ratio of each cell [-], (num_cells,); NaN where a corner cannot be measured."""
    rest = signed_volumes(mesh.points, mesh.cells)
    with np.errstate(over="ignore", invalid="ignore"):
        moved: Points = signed_volumes(mesh.points + displacement, mesh.cells) / rest
    moved[~measurable_rows(displacement)[mesh.cells].all(axis=1)] = math.nan
    return moved


@dataclass(frozen=True)
class Worst:
    """A count or a ratio of the worst of all states that were given, and its time [s].

    `doubt` is what reading it may be off by, and counts as its error bar.
    """

    value: float
    time: float | None = None
    doubt: float = 0.0

    @property
    def when(self) -> str:
        """The time, as words for people; "" in statics."""
        return "" if self.time is None else f" at {self.time:.4g} s"


def shapes(mesh: TetMesh, state: State) -> Iterator[tuple[float | None, TetMesh, Points]]:
    """Every state that was given, not the compared ones alone: its time, mesh and displacement.

    On the mesh it was given on: the candidate's own, or else the case's.
    """
    motion = state.given
    own = state.own
    where = mesh if own is None else own.mesh
    if motion is None:
        yield None, where, state.displacement if own is None else own.displacements[-1]
        return
    displacements = motion.displacements if own is None else own.displacements
    for time, displacement in zip(motion.times, displacements, strict=True):
        yield float(time), where, displacement


def inverted_cells(mesh: TetMesh, displacement: Points) -> int:
    """Cells whose det F is not above 0, or no number."""
    return int((~(det_f(mesh, displacement) > 0.0)).sum())


def most_inverted(mesh: TetMesh, state: State) -> Worst:
    """Most cells turned inside out in any state that was given."""
    most = max(
        (Worst(inverted_cells(where, u), time) for time, where, u in shapes(mesh, state)),
        key=lambda worst: worst.value,
    )
    return most if most.value else Worst(0)


def smallest_det_f(mesh: TetMesh, state: State) -> Worst:
    """Smallest volume ratio of a cell in any state; minus infinity where one is no number."""
    return min(
        (Worst(smallest(det_f(where, u)), time) for time, where, u in shapes(mesh, state)),
        key=lambda worst: worst.value,
    )


def cell_rotations(mesh: TetMesh, displacement: Points) -> Floats:
    """Angle [rad], 0 to pi, of the rotation nearest to each F (Higham 1989), (num_cells,)."""
    corners = displacement[mesh.cells].transpose(0, 2, 1)
    rotations = rotation_of(np.eye(3) + corners @ shape_gradients(mesh))
    cosines = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0)
    angles: Floats = np.arccos(np.clip(cosines, -1.0, 1.0))
    return angles


def largest_rotation(mesh: TetMesh, displacement: Points) -> float:
    """Angle that all but 1 % of the volume are turned by at most [rad]."""
    angles = cell_rotations(mesh, displacement)
    order = np.argsort(angles)
    volume = np.cumsum(mesh.cell_volumes[order])
    k = int(np.searchsorted(volume, (1.0 - _LEFT_OUT) * volume[-1]))
    return float(angles[order][k])


def describe_rotation(mesh: TetMesh, displacement: Points) -> str:
    """One line: how far the body is turned, and which border of the validity map it leaves."""
    degrees = math.degrees(largest_rotation(mesh, displacement))
    left = [error for error, border in BORDERS.items() if degrees > border]
    turned = f"{1.0 - _LEFT_OUT:.0%} of the volume turned by at most {degrees:.2f} degrees"
    if not left:
        return f"{turned}: within the {min(BORDERS):.0%} border of bent bars"
    border = f"{max(left):.0%} border of bent bars ({BORDERS[max(left)]:g} degrees)"
    return f"{turned}: beyond the {border}; see palpate study validity"


def unmeasurable_state(state: State) -> str:
    """Which state that was given holds numbers that cannot be measured; "" where none does."""
    motion = state.given
    own = [] if state.own is None else [state.own.displacements]
    if motion is None:
        is_good = are_measurable(state.displacement, *own)
        return "" if is_good else "the result holds numbers that are none, or too large to measure"
    for k, displacement in enumerate(motion.displacements):
        if not are_measurable(displacement, *(there[k] for there in own)):
            return (
                f"its state at {motion.times[k]:.4g} s holds numbers that are none, or too large "
                "to measure"
            )
    return ""


def state_out_of_reach(problem: Problem, state: State) -> str:
    """Why a state that was given cannot be one of this body's motion; "" where all can.

    Every state is compared with those before and after it, next to it and half an output away.
    A result that was interpolated between steps as long as an output is within reach too.
    """
    motion, outputs = state.given, state.trajectory
    if problem.time is None or motion is None or outputs is None:
        return ""
    mass = lumped_mass(problem)
    interval = problem.time.end_time / problem.time.num_outputs
    most = largest_acceleration(problem, state.strain, outputs, state.element)
    is_looked_at = ~_moving_components(problem)
    size = float(np.ptp(problem.mesh.points, axis=0).max()) * math.sqrt(mass.sum())
    largest = math.sqrt(max(_squared(mass, u) for u in motion.displacements))
    rounding = _ROUNDING * largest + _ROUNDING_OF_PLACES * size
    worst, message = 1.0, ""
    for before, k, after in _neighbours(motion.times, 0.5 * interval):
        h1, h2 = (float(motion.times[b] - motion.times[a]) for a, b in ((before, k), (k, after)))
        u0, u, u1 = (motion.displacements[i] for i in (before, k, after))
        bend = np.where(is_looked_at, u - (u0 * h2 + u1 * h1) / (h1 + h2), 0.0)
        off = math.sqrt(_squared(mass, bend))
        reach = most * max(interval, h1 + h2) * h1 * h2 / (h1 + h2) + rounding
        if off > worst * reach:
            worst, metres = off / reach, math.sqrt(mass.sum())
            message = (
                f"its state at {motion.times[k]:.4g} s is out of the body's reach: "
                f"{off / metres:.3g} m (root mean square) off the line from its state at "
                f"{motion.times[before]:.4g} s to that at {motion.times[after]:.4g} s; what moves "
                f"it here takes it {reach / metres:.3g} m off at most"
            )
    return message


def _moving_components(problem: Problem) -> NDArray[np.bool_]:
    """Which components supports lead along, (num_points, 3): they may turn at once."""
    assert problem.time is not None
    are_led = np.zeros(problem.mesh.points.shape, dtype=bool)
    for support in problem.supports:
        if _variation(support, problem.time.end_time)[1] > 0.0:
            are_led |= _moved_by(problem, support) != 0.0
    return are_led


def _neighbours(times: Points, apart: float) -> Iterator[tuple[int, int, int]]:
    """Each inner state with those next to it, and with those at least so far away [s]."""
    slack = 1e-9 * float(times[-1])
    for k in range(1, len(times) - 1):
        yield k - 1, k, k + 1
        before = int(np.searchsorted(times, times[k] - apart + slack, side="right")) - 1
        after = int(np.searchsorted(times, times[k] + apart - slack))
        if 0 <= before < k < after < len(times) and (before, after) != (k - 1, k + 1):
            yield before, k, after


def _squared(mass: Points, field: Points) -> float:
    """field.M field, with masses [kg] at the points."""
    return float(mass @ np.einsum("ij,ij->i", field, field))


def largest_acceleration(
    problem: Problem, strain: Strain, outputs: Trajectory, element: Element = Element.LINEAR
) -> float:
    """Bound of sqrt(a.M a) over the whole motion [m/s2 sqrt(kg)].

    The supports pull by the law of the strain measure at the element's tetrahedra; the motion at
    the outputs is looked at where supports move or tools press.
    """
    assert problem.time is not None
    end, mass = problem.time.end_time, lumped_mass(problem)
    is_free = fixed_components(problem)[0] == 0
    start, by_loads, by_supports = np.zeros_like(problem.mesh.points), 0.0, 0.0
    for item in (*problem.loads, *problem.supports):
        first, varied = _variation(item, end)
        if isinstance(item, Support):
            force = -body_of(problem, strain, element).internal(_moved_by(problem, item))
            by_supports += varied * _over_mass(force, mass, is_free)
        else:
            force = load_force(problem.mesh, item, np.zeros_like(problem.mesh.points), strain)
            if isinstance(item, Pressure) and strain is Strain.GREEN:
                force *= _FOLLOWING
            by_loads += varied * _over_mass(force, mass, is_free)
        start += first * force
    for spring in problem.springs:
        if spring.amplitude is not None:
            return math.inf
        # As stiff as it is it belongs to the body; its anchor's way is a load's.
        for axis, component in enumerate(spring.path.components()):
            way = np.zeros_like(problem.mesh.points)
            way[:, axis] = 1.0
            force = spring_stiffness_times(problem.mesh, [spring], way)
            first, varied = _varied(component, end)
            by_loads += varied * _over_mass(force, mass, is_free)
            start += first * force
    by_loads += _over_mass(start, mass, is_free)
    if problem.initial_velocity is not None:
        by_loads += _by_start(problem, problem.initial_velocity.at(problem.mesh.points))
    if problem.tools:
        return by_loads + _seen(problem, strain, outputs, mass, element)
    if by_supports > 0.0:
        by_supports = min(by_supports, _seen(problem, strain, outputs, mass, element))
    return by_loads + by_supports


def _by_start(problem: Problem, velocity: Points) -> float:
    """Bound of a motion that starts with a velocity: a' = -M^-1 K v preserves (a.M a) + (v.K v).

    Besides, the damping's lambda v, and stiffness damping's beta M^-1 K v.
    """
    assert problem.time is not None
    speed = np.where(fixed_components(problem)[0] > 0, 0.0, velocity)
    rate = body_of(problem, Strain.LINEAR).internal(speed)
    rate = rate + spring_stiffness_times(problem.mesh, problem.springs, speed)
    stretched = float(np.sum(speed * rate))
    kinetic = float(np.sum(lumped_mass(problem)[:, None] * speed**2))
    # A turn strains a body whose points go straight: its accelerations are omega^2 r at most.
    turning = problem.initial_velocity
    spin = 0.0 if turning is None else float(np.linalg.norm(turning.angular_velocity))
    damping = problem.time.mass_damping
    by_start = math.sqrt(max(stretched, 0.0)) + (damping + spin) * math.sqrt(kinetic)
    if problem.time.stiffness_damping:
        force = body_of(problem, Strain.LINEAR).internal(speed)
        viscous = problem.time.stiffness_damping * force / np.sqrt(lumped_mass(problem))[:, None]
        is_fixed = fixed_components(problem)[0] > 0
        by_start += float(np.linalg.norm(np.where(is_fixed, 0.0, viscous)))
    return by_start


def _seen(
    problem: Problem, strain: Strain, outputs: Trajectory, mass: Points, element: Element
) -> float:
    """Estimate by second differences of the outputs; infinite where they are too coarse for it."""
    interval = float(outputs.times[1] - outputs.times[0])
    bends = np.diff(outputs.displacements, 2, axis=0)
    if len(bends) + 1 < _FEWEST_OUTPUTS:
        return math.inf
    content = content_frequency(problem, strain, outputs, element)
    if not _OUTPUTS_PER_PERIOD * interval * content <= 1.0:
        return math.inf
    return _DRIVEN * math.sqrt(max(_squared(mass, bend) for bend in bends)) / interval**2


def _moved_by(problem: Problem, support: Support) -> Points:
    """Displacement of the fixed points for a change of the factor by 1 [m], (num_points, 3)."""
    moved = np.zeros_like(problem.mesh.points)
    rate = np.tile(np.array(support.displacement), (len(support.points), 1))
    if support.rotation is not None:
        turned = support.rotation
        arms = problem.mesh.points[support.points] - np.array(turned.center)
        rate += turned.angle * np.cross(np.array(turned.axis), arms)
    directions = support.directions
    moved[support.points] = rate @ directions.T @ directions
    return moved


def _variation(item: Load | Support, end: float) -> tuple[float, float]:
    """The factor at the start [-], and by how much it changes in all until the end."""
    return (1.0, 0.0) if item.amplitude is None else _varied(item.amplitude, end)


def _varied(amplitude: TabularAmplitude, end: float) -> tuple[float, float]:
    knots = [0.0, *(t for t in amplitude.times if 0.0 < t < end), end]
    factors = np.array([amplitude(t) for t in knots])
    return float(factors[0]), float(np.abs(np.diff(factors)).sum())


def _over_mass(force: Points, mass: Points, is_free: NDArray[np.bool_]) -> float:
    """sqrt(F.M^-1 F) over what is free."""
    return math.sqrt(float((np.where(is_free, force, 0.0) ** 2 / mass[:, None]).sum()))
