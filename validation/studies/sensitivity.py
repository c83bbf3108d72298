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

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from palpate.validation.case import load_case
from palpate.validation.report.study_page import Finding, StudyTable
from palpate.validation.studies.input_sensitivity import (
    INPUTS,
    STEP,
    Budget,
    InputResponses,
    follow_inputs,
    make_budget,
)
from palpate.validation.studies.kidney_convergence import (
    QUANTITIES,
    follow_meshes,
    stored_truth,
)
from palpate.validation.studies.sensitivity_figure import draw_uncertainty
from palpate.validation.studies.study_folder import judged, leave_study

ASKED = ("volume change", "area change", "largest displacement")
# Two solutions to 1e-10 of the forces; the kidney's stiffness spreads over four decades.
SCALING_TOLERANCE = 1e-7


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Move the inputs, refine the mesh; leave report.html, a figure, a table and results.json."""
    case = load_case("kidney")
    responses = follow_inputs(case.problem, progress)
    meshes = follow_meshes(case.problem, progress)
    truth = stored_truth(case)
    budgets = [make_budget(q, responses, meshes.assess(q), truth[q]) for q in ASKED]
    findings = judge(budgets, responses)
    return leave_study(
        folder,
        console,
        name="sensitivity",
        title="How much do the inputs matter, and how much the mesh?",
        about=(__doc__ or "").split("\n\n")[1:],
        findings=findings,
        figures={"uncertainty": draw_uncertainty(budgets)},
        tables={
            "sensitivities": sensitivity_table(budgets),
            "uncertainty": uncertainty_table(budgets),
            "responses": response_table(responses),
        },
        numbers={
            "step": STEP,
            "responses": asdict(responses),
            "budgets": [
                {**asdict(b), "validation_uncertainty": b.validation_uncertainty} for b in budgets
            ],
        },
    )


def judge(budgets: Sequence[Budget], responses: InputResponses) -> list[Finding]:
    """Only F / E counts; more modulus is less load; and what dominates."""
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
        found = (
            "no error bar on the finest mesh"
            if u_num is None or u_val is None
            else f"u_input {b.input_uncertainty:.2%} (most from {largest}, "
            f"{b.input_parts[largest]:.2%}), u_num {u_num:.2%}, u_val {u_val:.2%}"
        )
        findings.append(
            judged(
                f"{b.quantity}: +-10 % of the inputs outweighs the numerical error on the finest "
                "mesh and on the case's own",
                f"{found}; error of the case's own mesh {b.mesh_error:+.2%}; linear strain "
                f"instead of Green {b.model_error:+.1%}",
                u_num is not None and b.input_uncertainty > max(u_num, abs(b.mesh_error)),
            )
        )
    return findings


def sensitivity_table(budgets: Sequence[Budget]) -> StudyTable:
    """Per cent of each number for one per cent of each input."""
    rows = [
        [f"{b.quantity} [{QUANTITIES[b.quantity][1]}]", f"{b.value:.6g}",
         *(f"{b.sensitivities[name]:+.4f}" for name in INPUTS), f"{b.curvature:.4f}"]
        for b in budgets
    ]  # fmt: skip
    return StudyTable(
        "Sensitivities d ln Q / d ln X, by central differences of 10 %",
        ["quantity", "value", *INPUTS, "departure from a straight line"],
        rows,
    )


def uncertainty_table(budgets: Sequence[Budget]) -> StudyTable:
    """Parts of u_val, and the errors beside it."""
    rows = []
    for b in budgets:
        parts: list[float | None] = [
            *(b.input_parts[name] for name in INPUTS),
            b.input_uncertainty,
            b.finest_uncertainty,
            b.validation_uncertainty,
        ]
        texts = ["-" if p is None else f"{100 * p:.2f}" for p in parts]
        signed = [f"{100 * x:+.2f}" for x in (b.mesh_error, b.model_error)]
        rows.append([b.quantity, *texts, *signed])
    return StudyTable(
        "Standard uncertainties and errors, in per cent of the value",
        ["quantity", *(f"from {name}" for name in INPUTS), "u_input", "u_num, finest mesh",
         "u_val", "error of the case's mesh", "linear instead of Green"],
        rows,
    )  # fmt: skip


def response_table(responses: InputResponses) -> StudyTable:
    """Every number that was computed."""
    named: list[tuple[str, Any]] = [("as given", responses.base)]
    for name, (down, up) in responses.moved.items():
        named += [(f"{name} -10 %", down), (f"{name} +10 %", up)]
    named.append(("linear strain", responses.linear))
    rows = [
        [name, *(f"{QUANTITIES[q][2] * getattr(r, QUANTITIES[q][0]):.6g}" for q in QUANTITIES)]
        for name, r in named
    ]
    return StudyTable(
        "Responses on the case's mesh",
        ["inputs", *(f"{q} [{unit}]" for q, (_, unit, _) in QUANTITIES.items())],
        rows,
    )
