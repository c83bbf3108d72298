"""What a solution says to a measurement, and how that depends on the numbers of its case.

Computed of a marker is its motion from the body at rest to equilibrium; of a frequency that of the
small swing about equilibrium in which the marker moves most along the component when the body is
let go from its shape at rest: without damping, which lowers a frequency by less than a thousandth
where one swing loses a quarter.

Derivatives of equilibria are one solve of the tangent for each number (`fastsim.sensitivities`);
that of a frequency is the change of Rayleigh's quotient of its mode, the first order of
perturbation (K.-J. Bathe, Finite Element Procedures, 2nd ed. 2014, section 10.2); forces on tools
are solved again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.sensitivities import Change, find_sensitivities, has_exact_tangent
from palpate.fastsim.statics import solve_static
from palpate.fastsim.vibration import find_swings, rayleigh_quotient
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element
from palpate.validation.case import Case
from palpate.validation.case.measurements import Measured, pins_of, travel
from palpate.validation.case.variants import value_of

# Modes among which the one that a marker swings in is looked for.
_MODES = 3
# A number's step in a difference, over its scale: in what costs no solve, and in what is solved.
_STEP, _STEP_OF_SOLVES = 1e-4, 1e-2


@dataclass(frozen=True)
class Prediction:
    """What an equilibrium says to a measurement.

    Attributes:
        values: Shape (n,), SI units.
        displacement: Of the equilibrium [m], shape (num_points, 3).
        mode: The swing that a frequency is of, shape (num_points, 3); None of other kinds.
    """

    values: Floats
    displacement: Points
    mode: Points | None = None


def solve_measured(
    measured: Measured, case: Case, *, element: Element, start: Points | None = None
) -> Prediction:
    """Solve the experiment of a measurement by fastsim, and read off what was measured.

    Args:
        measured: The measurement.
        case: Its case, or that with other numbers; of its strain measure.
        element: Tetrahedra.
        start: Where to start from [m], shape (num_points, 3).

    Returns:
        Values, in the order of the measurement's, and the equilibrium.

    Raises:
        FastsimError: There is no equilibrium.
    """
    problem, strain = case.problem, case.strain
    if measured.spec.kind == "tool_force":
        tool = (measured.spec.tool or 1) - 1
        times, way = travel(problem, tool)
        wanted = np.interp(measured.depths, way, times)
        found = solve_contact(
            problem, strain=strain, element=element, times=np.concatenate([times[:1], wanted])
        )
        axis = "xyz".index(measured.spec.component or "z")
        return Prediction(found.forces[1:, tool, axis], found.displacements[-1])
    if problem.tools:
        pressed = solve_contact(problem, strain=strain, element=element)
        return of_equilibrium(measured, case, pressed.displacements[-1], element=element)
    solved = solve_static(problem, strain=strain, element=element, start=start)
    return of_equilibrium(measured, case, solved.displacement, element=element)


def of_equilibrium(
    measured: Measured, case: Case, displacement: Points, *, element: Element
) -> Prediction:
    """What an equilibrium says to a measurement of markers, whoever found it.

    Args:
        measured: The measurement, of markers.
        case: Its case, or that with other numbers.
        displacement: The equilibrium [m], shape (num_points, 3).
        element: Tetrahedra by which a frequency is computed.

    Returns:
        Values, in the order of the measurement's.
    """
    problem, pins = case.problem, pins_of(case, measured.spec.markers)
    rest = problem.mesh.points
    if measured.spec.kind == "rest":
        moved = [pin.moved(rest, displacement) for pin in pins.values()]
        return Prediction(np.concatenate(moved), displacement)
    swings = find_swings(problem, displacement, _MODES, strain=case.strain, element=element)
    (pin,) = pins.values()
    axis = "xyz".index(measured.spec.component or "z")
    # Let go from where the body is at rest without loads.
    swings_of_body = swings.swings_from(-displacement)
    there = pin.moved(rest, displacement)[axis]
    movements = [abs(pin.moved(rest, displacement + x)[axis] - there) for x in swings_of_body]
    strongest = int(np.argmax(movements))
    return Prediction(
        swings.frequencies[strongest : strongest + 1], displacement, swings.modes[strongest]
    )


def derivatives(
    measured: Measured,
    values: Mapping[str, float],
    scales: Mapping[str, float],
    prediction: Prediction,
    *,
    element: Element,
    like: Case | None = None,
) -> Floats:
    """Derivatives of what is predicted of a measurement by numbers of its case.

    Args:
        measured: The measurement.
        values: Numbers of the case at which it was predicted, by key, in the case's units.
        scales: Size of each number by which to derive, by key; a difference takes a small part.
        prediction: What was predicted there, by fastsim.
        element: Its tetrahedra.
        like: The case of the prediction, whose mesh is used again.

    Returns:
        Shape (n, len(scales)), SI units over the case's; 0 for a number that the experiment sets.
    """
    case = measured.at(values, like=like)
    # Of contact and of pressure that follows the body there is no symmetric tangent.
    is_solved = not has_exact_tangent(case.problem, case.strain)
    found = np.zeros((len(measured.values), len(scales)))
    keys = [key for key in scales if key not in measured.spec.set]
    pairs, widths = [], []
    for key in keys:
        here = values.get(key, value_of(measured.case, key))
        step = (_STEP_OF_SOLVES if is_solved else _STEP) * scales[key]
        pair = [measured.at({**values, key: here + s * step}, like=case) for s in (-1.0, 1.0)]
        pairs.append(pair)
        widths.append(2.0 * step)
    numbers = [list(scales).index(key) for key in keys]
    if is_solved:
        for k, pair, width in zip(numbers, pairs, widths, strict=True):
            low, high = (solve_measured(measured, one, element=element).values for one in pair)
            found[:, k] = (high - low) / width
        return found
    changes = [
        Change(pair[0].problem, pair[1].problem, width)
        for pair, width in zip(pairs, widths, strict=True)
    ]
    u = prediction.displacement
    responses = find_sensitivities(case.problem, u, changes, strain=case.strain, element=element)
    for k, pair, width, response in zip(numbers, pairs, widths, responses, strict=True):
        low, high = (
            _along(measured, one, u + sign * 0.5 * width * response, prediction, element)
            for one, sign in zip(pair, (-1.0, 1.0), strict=True)
        )
        found[:, k] = (high - low) / width
    return found


def _along(
    measured: Measured, case: Case, displacement: Points, prediction: Prediction, element: Element
) -> Floats:
    """What a displacement near the predicted one says, with the predicted mode."""
    if prediction.mode is None:
        return of_equilibrium(measured, case, displacement, element=element).values
    quotient = rayleigh_quotient(
        case.problem, displacement, prediction.mode, strain=case.strain, element=element
    )
    return np.array([math.sqrt(quotient) / (2.0 * math.pi)])
