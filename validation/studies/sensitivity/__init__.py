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

Under dead loads only force over modulus counts: E and load by the same factor change no
displacement, and more modulus is less load. Both are tested: a simulator with a stiffness of its
own, an artificial spring or bulk term that does not scale, fails them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from palpate.validation.case import load_case
from palpate.validation.report.line_plot import BLUE, GREY, OCHRE, RED, paper_style
from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import Figure, Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.kidney.meshes import QUANTITIES, follow_meshes, stored_truth
from palpate.validation.studies.sensitivity.budget import (
    INPUTS,
    STEP,
    Budget,
    InputResponses,
    follow_inputs,
    make_budget,
)
from palpate.validation.studies.study import Study

ASKED = ("volume change", "area change", "largest displacement")
# Two solutions to 1e-10 of the forces; the kidney's stiffness spreads over four decades.
SCALING_TOLERANCE = 1e-7


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


def judge(found: Found) -> list[Finding]:
    """Only F / E counts; more modulus is less load; and what dominates."""
    budgets, responses = found
    # A step up in E is a step down in F by 1 / 1.1: both differences see the same curve, apart
    # from its curvature over the step.
    mirrored = max(
        abs(b.sensitivities["Young's modulus"] + b.sensitivities["load"])
        / abs(b.sensitivities["load"])
        for b in budgets
    )
    findings = [
        judged(
            "only force over modulus counts: both raised by a half move no point by more than "
            f"{SCALING_TOLERANCE:g} of the largest displacement",
            f"{responses.scaling_error:.1e}",
            responses.scaling_error <= SCALING_TOLERANCE,
        ),
        judged(
            "so the sensitivity to the modulus is that to the load with the other sign, up to the "
            f"square of the step ({STEP**2:g} and a little)",
            f"sum at most {mirrored:.4f} of one of them",
            mirrored <= 2.0 * STEP**2,
        ),
        judged(
            "central differences are a fair measure: within the step no number departs from a "
            f"straight line by more than {1.5 * STEP:g} of its change (1/E does by {STEP:g})",
            f"at most {max(b.curvature for b in budgets):.3f}",
            max(b.curvature for b in budgets) <= 1.5 * STEP,
        ),
    ]
    for b in budgets:
        u_num, u_val = b.finest_uncertainty, b.validation_uncertainty
        largest = max(b.input_parts, key=lambda name: b.input_parts[name])
        told = (
            "no error bar on the finest mesh"
            if u_num is None or u_val is None
            else f"u_input {b.input_uncertainty:.2%} (most from {largest}, "
            f"{b.input_parts[largest]:.2%}), u_num {u_num:.2%}, u_val {u_val:.2%}"
        )
        findings.append(
            judged(
                f"{b.quantity}: +-10 % of the inputs outweighs the numerical error on the finest "
                "mesh and on the case's own",
                f"{told}; error of the case's own mesh {b.mesh_error:+.2%}; linear strain "
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
        numbers={"step": STEP, "scaling_error": responses.scaling_error},
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
    from matplotlib import pyplot

    with paper_style():
        figure, axes = pyplot.subplots(
            1, len(budgets), figsize=(10.4, 3.8), sharey=True, sharex=True, squeeze=False
        )
        for panel, budget in zip(axes[0], budgets, strict=True):
            parts = [(name, abs(v), colour) for name, v, colour in _parts(budget) if v is not None]
            for place, (_, value, colour) in enumerate(parts):
                # On a logarithmic scale a length means nothing: marks, not bars.
                panel.axhline(place, color="#e4e4e4", lw=0.7, zorder=0)
                panel.plot(100.0 * value, place, "o", color=colour, ms=7)
                text = f"{100 * value:.2g} %"
                panel.text(135.0 * value, place, text, va="center", fontsize=8.5)
            panel.set_yticks(range(len(parts)), [name for name, _, _ in parts])
            panel.set_xscale("log")
            panel.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
            panel.set_title(budget.quantity, fontsize=10)
            panel.set_xlabel("% of the value")
            panel.spines[["top", "right"]].set_visible(False)
        axes[0][0].invert_yaxis()
        largest = max(abs(value or 0.0) for b in budgets for _, value, _ in _parts(b))
        axes[0][0].set_xlim(0.3, 600.0 * largest)
        figure.tight_layout()
        return Figure(
            figure_svg(figure),
            "The kidney case. Blue: standard uncertainty from inputs known to +-10 %. Ochre: "
            "numerical, as u_num on the finest mesh and as the error of the case's own mesh. "
            "Dark: u_val, both together. Red: linear instead of Green strain, for comparison; "
            "no part of u_val.",
        )


TITLE = "How much do the inputs matter, and how much the mesh?"
STUDY = Study(TITLE, __doc__, compute, judge, present)
