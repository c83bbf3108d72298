"""What is a number worth when its inputs are not known better than that?

The kidney case, Green strain, by fastsim: Young's modulus, Poisson's ratio and load each up and
down by 10 %, alone, and central differences. A sensitivity is d ln Q / d ln X: by how many per cent
a number Q changes for one per cent of an input X. Tissue is seldom known to 10 %.

Beside it stands the numerical error of the same numbers, from three meshes (grid convergence index)
and against the stored quadratic reference, and the model's: linear instead of Green strain.

After ASME V&V 20-2009, sections 1 to 3: u_val = sqrt(u_num^2 + u_input^2), standard uncertainties
all. u_input^2 is the sum of (dQ/dX u_X)^2, on the case's mesh, with u_X = 10 % / sqrt 3, the
standard deviation of a value that lies anywhere within +-10 %, each on its own. u_num is the error
bar of the grid convergence index on the finest mesh over 1.15, the factor for an error whose side
is known. What u_val means: if an experiment of negligible error gave D and the simulation S, then
the error of the model lies within S - D +- u_val (one standard uncertainty). A difference below
u_val says nothing against the model, and nothing for it beyond u_val. There is no experiment here,
so no u_D, and no claim of validation.

Under dead loads only force over modulus counts, so that the sensitivity to the modulus is that to
the load with the other sign, up to the square of the step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.transforms import scale_loads
from palpate.validation.case import load_case
from palpate.validation.metrics.grid_convergence import GridConvergence
from palpate.validation.report.plots import BLUE, GREY, OCHRE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.convergence import (
    QUANTITIES,
    Response,
    StoredTruth,
    follow_meshes,
    measure_response,
    stored_truth,
)

TITLE = "How much do the inputs matter, and how much the mesh?"

INPUTS = ("Young's modulus", "Poisson's ratio", "load")
STEP = 0.1
# V&V 20-2009, section 2: from an expanded to a standard uncertainty, where the error has one sign.
COVERAGE = 1.15
ASKED = ("volume change", "area change", "largest displacement")


class InputResponses(NamedTuple):
    """Responses to each input, (down, up) by STEP, alone; and with the inputs as given.

    `linear` is by linear strain.
    """

    base: Response
    moved: Mapping[str, tuple[Response, Response]]
    linear: Response


@dataclass(frozen=True)
class Budget:
    """What is known of one number Q, all but itself relative to its value on the case's mesh [-].

    `sensitivities` are d ln Q / d ln X by input, `input_parts` |dQ/dX| u_X; `curvature` is the
    largest departure of two steps from a straight line, over the largest change.
    `finest_uncertainty` is u_num on the finest mesh, None without an error bar. The errors are
    signed: of the case's own mesh against the stored reference, and of linear strain.
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


class Found(NamedTuple):
    """A budget of each number that is asked for, and what all of them were made from."""

    budgets: Sequence[Budget]
    responses: InputResponses


def compute(progress: Progress) -> Found:
    """Move the inputs, refine the mesh."""
    case = load_case("kidney")
    responses = follow_inputs(case.problem, progress)
    meshes, truth = follow_meshes(case.problem, progress), stored_truth(case)
    return Found([make_budget(q, responses, meshes.assess(q), truth[q]) for q in ASKED], responses)


def follow_inputs(problem: Problem, progress: Progress) -> InputResponses:
    """Solve with each input down and up, as given, and with linear strain."""

    def respond(given: Problem, strain: Strain = Strain.GREEN) -> Response:
        return measure_response(given, solve_static(given, strain=strain).displacement)

    moved = {}
    for name in INPUTS:
        progress(f"{name} down and up by {100 * STEP:g} %")
        down, up = (respond(changed(problem, name, 1.0 + s * STEP)) for s in (-1.0, 1.0))
        moved[name] = (down, up)
    progress("inputs as given; linear strain")
    return InputResponses(respond(problem), moved, respond(problem, Strain.LINEAR))


def changed(problem: Problem, name: str, factor: float) -> Problem:
    """The problem with one of `INPUTS` multiplied."""
    if name == "load":
        return scale_loads(problem, factor)
    field = {"Young's modulus": "youngs_modulus", "Poisson's ratio": "poissons_ratio"}[name]
    value = factor * getattr(problem.material, field)
    return replace(problem, material=replace(problem.material, **{field: value}))


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


def judge(found: Found) -> list[Finding]:
    """Whether central differences are fair, and what dominates."""
    budgets = found.budgets
    curvature = max(b.curvature for b in budgets)
    findings = [
        judged(
            "central differences are a fair measure: within the step no number departs from a "
            f"straight line by more than {1.5 * STEP:g} of its change (1/E does by {STEP:g})",
            f"at most {curvature:.3f}",
            curvature <= 1.5 * STEP,
        ),
    ]
    for b in budgets:
        u_num, u_val = b.finest_uncertainty, b.validation_uncertainty
        largest = max(b.input_parts, key=lambda name: b.input_parts[name])
        words = (
            "no error bar on the finest mesh"
            if u_num is None or u_val is None
            else f"u_input {b.input_uncertainty:.2%} (most from {largest}, "
            f"{b.input_parts[largest]:.2%}), u_num {u_num:.2%}, u_val {u_val:.2%}"
        )
        findings.append(
            judged(
                f"{b.quantity}: +-10 % of the inputs outweighs the numerical error on the finest "
                "mesh and on the case's own",
                f"{words}; error of the case's own mesh {b.mesh_error:+.2%}; linear strain "
                f"instead of Green {b.model_error:+.1%}",
                u_num is not None and b.input_uncertainty > max(u_num, abs(b.mesh_error)),
            )
        )
    return findings


def present(found: Found) -> Page:
    """Sensitivities, the parts of u_val and the errors beside it, and every response."""
    budgets, responses = found
    sensitivities = Table(
        "Sensitivities d ln Q / d ln X, by central differences of 10 %",
        {"quantity": "", "value": ".6g", **dict.fromkeys(INPUTS, "+.4f"),
         "departure from a straight line": ".4f"},
        [
            (_named(b.quantity), b.value, *(b.sensitivities[name] for name in INPUTS), b.curvature)
            for b in budgets
        ],
    )  # fmt: skip
    parts = [(b.quantity, [value for _, value, _ in _parts(b)]) for b in budgets]
    uncertainty = Table(
        "Standard uncertainties and errors, in per cent of the value",
        {"quantity": "", **{f"from {name}": ".2f" for name in INPUTS}, "u_input": ".2f",
         "u_num, finest mesh": ".2f", "u_val": ".2f", "error of the case's mesh": "+.2f",
         "linear instead of Green": "+.2f"},
        [(name, *(None if v is None else 100.0 * v for v in values)) for name, values in parts],
    )  # fmt: skip
    named = {"as given": responses.base}
    for name, (down, up) in responses.moved.items():
        named |= {f"{name} -10 %": down, f"{name} +10 %": up}
    named["linear strain"] = responses.linear
    every = Table(
        "Responses on the case's mesh",
        {"inputs": "", **{_named(quantity): ".6g" for quantity in QUANTITIES}},
        [(name, *response.values()) for name, response in named.items()],
    )
    return Page(
        figures={"uncertainty": draw(budgets)},
        tables={"sensitivities": sensitivities, "uncertainty": uncertainty, "responses": every},
        numbers={"step": STEP},
    )


def _named(quantity: str) -> str:
    return f"{quantity} [{QUANTITIES[quantity][0]}]"


def _parts(budget: Budget) -> list[tuple[str, float | None, str]]:
    """Name, value [-] and colour of everything that a number owes."""
    return [
        *((f"{name}, +-10 %", value, BLUE) for name, value in budget.input_parts.items()),
        ("u_input", budget.input_uncertainty, BLUE),
        ("u_num, finest mesh", budget.finest_uncertainty, OCHRE),
        ("u_val", budget.validation_uncertainty, GREY),
        ("error, case's mesh", budget.mesh_error, OCHRE),
        ("linear strain", budget.model_error, RED),
    ]


def draw(budgets: Sequence[Budget]) -> Figure:
    """Every part as a mark, a panel for each number, on one logarithmic scale."""
    largest = max(abs(value or 0.0) for b in budgets for _, value, _ in _parts(b))
    panels = []
    for budget in budgets:
        parts = [(name, abs(v), colour) for name, v, colour in _parts(budget) if v is not None]
        rows = range(len(parts), 0, -1)
        panels.append(
            Panel(
                # On a logarithmic scale a length means nothing: marks, not bars.
                [
                    Line((100.0 * value,), (row,), style="o", colour=colour)
                    for row, (_, value, colour) in zip(rows, parts, strict=True)
                ],
                notes=[
                    (100.0 * value, row, f"{100 * value:.2g} %")
                    for row, (_, value, _) in zip(rows, parts, strict=True)
                ],
                y_ticks={row: name for row, (name, _, _) in zip(rows, parts, strict=True)},
                title=budget.quantity,
                x="% of the value",
                log="x",
                x_range=(0.3, 600.0 * largest),
            )
        )
    return line_figure(
        [panels],
        "The kidney case. Blue: standard uncertainty from inputs known to +-10 %. Ochre: "
        "numerical, as u_num on the finest mesh and as the error of the case's own mesh. "
        "Dark: u_val, both together. Red: linear instead of Green strain, for comparison; "
        "no part of u_val.",
        shares_legend=False,
    )
