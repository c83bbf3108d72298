"""The inputs of a case moved one at a time, and what each number owes to them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics.grid_convergence import GridConvergence
from palpate.validation.states import Progress
from palpate.validation.studies.bodies import Solve, changed
from palpate.validation.studies.kidney.meshes import Response, StoredTruth, measure_response

INPUTS = ("Young's modulus", "Poisson's ratio", "load")
STEP = 0.1
# V&V 20-2009, section 2: from an expanded to a standard uncertainty, where the error has one sign.
COVERAGE = 1.15


class InputResponses(NamedTuple):
    """Responses to each input, (down, up) by STEP, alone.

    `base` and `linear` (strain) are with the inputs as given. `scaling_error` is the largest change
    of displacement over the largest displacement when modulus and load are both raised by a half.
    """

    base: Response
    moved: Mapping[str, tuple[Response, Response]]
    linear: Response
    scaling_error: float


@dataclass(frozen=True)
class Budget:
    """What is known of one number, all relative to its value on the case's mesh [-].

    Attributes:
        quantity: Which number.
        value: On the case's mesh, in its unit.
        sensitivities: d ln Q / d ln X by input.
        curvature: Largest departure of two steps from a straight line, over the largest change.
        input_parts: |dQ/dX| u_X by input.
        finest_uncertainty: u_num on the finest mesh, over its value; None without an error bar.
        mesh_error: Signed error on the case's own mesh, against the stored reference.
        model_error: Signed change by linear strain, on the case's mesh.
    """

    quantity: str
    value: float
    sensitivities: Mapping[str, float]
    curvature: float
    input_parts: Mapping[str, float]
    finest_uncertainty: float | None
    mesh_error: float
    model_error: float

    @property
    def input_uncertainty(self) -> float:
        """u_input."""
        return math.hypot(*self.input_parts.values())

    @property
    def validation_uncertainty(self) -> float | None:
        """u_val = sqrt(u_num^2 + u_input^2) on the finest mesh; None without u_num."""
        if self.finest_uncertainty is None:
            return None
        return math.hypot(self.finest_uncertainty, self.input_uncertainty)


def follow_inputs(
    problem: Problem, progress: Progress, *, solve: Solve = solve_static
) -> InputResponses:
    """Solve with each input down and up, with linear strain, and with modulus and load raised.

    Args:
        problem: The case.
        progress: Called with one line for each input.
        solve: fastsim's statics, or what is put to the test in its place.
    """

    def respond(given: Problem, strain: Strain = Strain.GREEN) -> Response:
        return measure_response(given, solve(given, strain=strain).displacement)

    moved = {}
    for name in INPUTS:
        progress(f"{name} down and up by {100 * STEP:g} %")
        down, up = (respond(changed(problem, name, 1.0 + s * STEP)) for s in (-1.0, 1.0))
        moved[name] = (down, up)
    progress("modulus and load together; linear strain")
    rest = solve(problem).displacement
    both = changed(changed(problem, "load", 1.5), "Young's modulus", 1.5)
    gap = np.linalg.norm(solve(both).displacement - rest, axis=1).max()
    return InputResponses(
        base=measure_response(problem, rest),
        moved=moved,
        linear=respond(problem, Strain.LINEAR),
        scaling_error=float(gap / np.linalg.norm(rest, axis=1).max()),
    )


def make_budget(
    quantity: str, responses: InputResponses, grids: GridConvergence, truth: StoredTruth
) -> Budget:
    """Put the parts of one number beside each other."""
    value = responses.base[quantity]
    moved = {name: (low[quantity], high[quantity]) for name, (low, high) in responses.moved.items()}
    sensitivities = {name: (up - down) / (2.0 * STEP * value) for name, (down, up) in moved.items()}
    departure = max(abs(up + down - 2.0 * value) for down, up in moved.values())
    bar = grids.error_bar
    return Budget(
        quantity=quantity,
        value=value,
        sensitivities=sensitivities,
        curvature=departure / max(abs(up - down) for down, up in moved.values()),
        input_parts={name: abs(s) * STEP / math.sqrt(3.0) for name, s in sensitivities.items()},
        finest_uncertainty=None if bar is None else bar / COVERAGE / abs(grids.value),
        mesh_error=(value - truth.value) / abs(value),
        model_error=responses.linear[quantity] / value - 1.0,
    )
