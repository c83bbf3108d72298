"""Error against run time of every installed simulator, at several mesh sizes, in one plot.

A soft bar, clamped at one end, is bent by a downward traction on the other until its tip has
sunk by a quarter of its length. The error is the relative L2 distance from quadratic elements on
the finest mesh; the time is processor time of the solve alone, on one thread, without start-up and
reading. For a simulator with another law the distance of that law remains however fine the mesh:
it is drawn separately.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.fastsim.condensed import condense, solve_condensed
from palpate.fastsim.forces import external_force
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.exchange.placement import match_points
from palpate.validation.peers.registry import read_peers
from palpate.validation.references.field_truth import STVK, FieldTruth, time_fastsim
from palpate.validation.references.runs import solve_state
from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import CandidateFailedError, Progress, Verdict
from palpate.validation.versions import version_of

TITLE = "Error against run time"
SIZE = (0.08, 0.02, 0.02)
DIVISIONS = (1, 2, 3, 4, 6)
TRACTION = 150.0  # Pa, downward on the free end
TIME_LIMIT = 120.0
LINEAR = "linear strain"
# Number of responses of the condensed model that are timed together.
_STEPS = 100
# Largest distance from fastsim on the same mesh, over the largest displacement: a text file has
# seven digits, and relaxation stops at a residual of 1e-7.
SAME_MESH = 1e-4


class Row(NamedTuple):
    """One simulator on one mesh.

    `seconds` is the processor's time of the solve; `error` the relative L2 distance from the
    quadratic reference; `same_mesh` the largest distance from fastsim on the same mesh, over the
    largest displacement, None of quadratic tetrahedra, whose equations are others.
    """

    tool: str
    version: str
    law: str
    method: str
    num_cells: int
    seconds: float
    error: float
    same_mesh: float | None


class Runs(NamedTuple):
    """All runs, what was left out and why, and the reference's change on a halved mesh."""

    rows: Sequence[Row]
    left_out: Sequence[str]
    reference_change: float


def make_problem(divisions: int) -> Problem:
    """The bar with `divisions` bricks across and four times as many along."""
    mesh = brick_box((4 * divisions, divisions, divisions), SIZE)
    load = Traction(side(mesh, 0, SIZE[0]), (0.0, 0.0, -TRACTION))
    return Problem(mesh, Material(2e4, 0.3, 1000.0), (support_of(side(mesh, 0, 0.0)),), (load,))


def compute(progress: Progress) -> Runs:
    """Run all simulators that are installed."""
    problems = {n: make_problem(n) for n in DIVISIONS}
    finest, half = problems[DIVISIONS[-1]], problems[3]
    truth, coarser = (
        FieldTruth(problem, solve_state(problem, Strain.GREEN, 2, progress).displacement)
        for problem in (finest, half)
    )
    rows: list[Row] = []
    condensed: list[Row] = []
    left_out: list[str] = []

    def leave_out(line: str) -> None:
        left_out.append(line)
        progress(line)

    solutions: dict[int, Points] = {}
    us = ("fastsim", version_of("palpate"), STVK, "Newton, conjugate gradients")
    for n, problem in problems.items():
        seconds, solutions[n] = time_fastsim(problem)
        error = truth.error_of(problem.mesh, solutions[n])
        rows.append(Row(*us, problem.mesh.num_cells, seconds, error, 0.0))
        condensed += time_condensed(problem, solutions[n], truth)
    others = run_installed(problems, solutions, truth, progress, leave_out)
    return Runs([*rows, *condensed, *others], left_out, truth.change_of(coarser))


def run_installed(
    problems: Mapping[int, Problem],
    solutions: Mapping[int, Points],
    truth: FieldTruth,
    progress: Progress,
    leave_out: Progress,
    quadratic: Mapping[int, Problem] | None = None,
) -> list[Row]:
    """Run every other installed simulator on the meshes that it can take.

    Args:
        problems: Problems by number of divisions.
        solutions: fastsim's solutions with plain linear tetrahedra by divisions [m].
        truth: The reference that errors are measured against.
        progress: Called before each run.
        leave_out: Called with each run that is not finished, and the reason.
        quadratic: Problems for quadratic tetrahedra by divisions; the same ones where None.
    """
    rows = []
    for peer in read_peers():
        if not peer.frontier:
            continue
        command = peer.command_line()
        if command is None:
            leave_out(f"{peer.name}: {peer.why_missing()}")
            continue
        simulator = OutsideSimulator(command, TIME_LIMIT)
        given = problems if quadratic is None or not peer.is_quadratic else quadratic
        for n, problem in given.items():
            if n > peer.frontier:
                break
            ours = None if peer.is_quadratic else solutions[n]
            try:
                rows.append(_run_peer(simulator, peer.law, problem, ours, truth, progress))
            except CandidateFailedError as failure:
                leave_out(f"{peer.name}, {problem.mesh.num_cells} cells: {failure}")
                break
    return rows


def _run_peer(
    simulator: OutsideSimulator,
    law: Law,
    problem: Problem,
    ours: Points | None,
    truth: FieldTruth,
    progress: Progress,
) -> Row:
    """Run a simulator of a law; `ours` is fastsim's solution, None for other equations."""
    result, seconds = simulator.run(problem, Strain.GREEN, progress)
    about: Mapping[str, object] = result.about
    matched = match_points(result, problem)
    found, mesh, own = matched.displacement[0], problem.mesh, matched.displacement
    if matched.own_mesh is not None and matched.own_displacement is not None:
        mesh, own = matched.own_mesh, matched.own_displacement
    return Row(
        str(about["tool"]),
        str(about["version"]),
        STVK if law.is_linear_in_strain else law.value,
        str(about.get("method", "Newton, dense matrices")),
        problem.mesh.num_cells,
        float(str(about.get("seconds", seconds))),
        truth.error_of(mesh, own[0]),
        None if ours is None else float(np.abs(found - ours).max() / np.abs(ours).max()),
    )


def time_condensed(problem: Problem, green: Points, truth: FieldTruth) -> list[Row]:
    """Time the condensed linear model with its making, and a force on the finished model.

    Args:
        problem: The problem, whose loads act through the compliance.
        green: fastsim's solution with Green strain [m].
        truth: The reference that errors are measured against.
    """
    begin = time.process_time()
    found = solve_condensed(problem).displacement
    seconds = {"condensed": time.process_time() - begin}
    load = external_force(problem)
    touched = np.flatnonzero(load.any(axis=1))
    model = condense(dataclasses.replace(problem, loads=()), touched=touched)
    forces = load[model.touched]
    begin = time.process_time()
    for _ in range(_STEPS):
        model.displacement(forces)
    seconds["condensed, ready"] = (time.process_time() - begin) / _STEPS
    apart = float(np.abs(found - green).max() / np.abs(green).max())
    error = truth.error_of(problem.mesh, found)
    about = (version_of("palpate"), LINEAR, "compliance of the loaded points")
    return [
        Row(tool, *about, problem.mesh.num_cells, spent, error, apart)
        for tool, spent in seconds.items()
    ]


def judge(runs: Runs) -> list[Finding]:
    """Judge the claims that the figure rests on; another law is reported, but not judged."""
    same_law = [row for row in runs.rows if row.law == STVK]
    apart, worst = max((row.same_mesh, row) for row in same_law if row.same_mesh is not None)
    findings = [
        judged(
            f"simulators of the same law and element agree on the same mesh to {SAME_MESH:g}",
            f"largest distance {apart:.2g} ({worst.tool}, {worst.num_cells} cells)",
            apart <= SAME_MESH,
        )
    ]
    for tool in dict.fromkeys(row.tool for row in same_law):
        errors = [row.error for row in same_law if row.tool == tool]
        claim = f"{tool}: a finer mesh is nearer to the reference"
        if len(errors) < 2:
            found = f"{errors[0]:.3f} on the one mesh that it solved, which shows no convergence"
            findings.append(Finding(claim, found, Verdict.INCONCLUSIVE))
            continue
        words = " > ".join(f"{error:.3f}" for error in errors)
        findings.append(judged(claim, words, all(b < a for a, b in pairwise(errors))))
    return findings + [
        judged(
            f"{row.tool} ({row.law}), {row.num_cells} cells: another law, judged apart",
            f"model term {100 * (row.same_mesh or 0.0):.1f} % of the largest displacement, on "
            "this mesh",
            True,
        )
        for row in runs.rows
        if row.law != STVK
    ]


def present(runs: Runs) -> Page:
    """The page: error over processor time, and all runs."""
    columns = {"tool": "", "version": "", "law": "", "method": "", "cells": "d"}
    columns |= {"seconds": ".3g", "error": ".4f", "same mesh": ".2g"}
    return Page(
        figures={"frontier": draw(runs)},
        tables={"frontier": Table("Every run", columns, runs.rows)},
        remarks=[f"Left out: {line}" for line in runs.left_out],
        numbers={"reference_change": runs.reference_change, "left_out": list(runs.left_out)},
    )


def draw(runs: Runs) -> Figure:
    """Draw a line for each tool; lines of another law are dashed."""
    lines, notes = [], []
    for tool in dict.fromkeys(row.tool for row in runs.rows):
        of = [row for row in runs.rows if row.tool == tool]
        is_same = of[0].law == STVK
        lines.append(
            Line(
                [row.seconds for row in of],
                [row.error for row in of],
                style="-o" if is_same else "--s",
                width=2.2 if tool == "fastsim" else 1.2,
                label=f"{tool} {of[0].version}" + ("" if is_same else f", {of[0].law}"),
            )
        )
        notes += [(row.seconds, row.error, f"{row.num_cells}") for row in (of[0], of[-1])]
    panel = Panel(
        lines,
        notes=notes,
        levels=(runs.reference_change,),
        log="xy",
        title="Error against run time; numbers are cells",
        x="processor time of the solve [s], one thread",
        y="relative L2 error against quadratic elements",
    )
    return line_figure(
        [[panel]],
        "Lower left is better. The dotted line is the reference's own change when its mesh "
        "is halved: errors near it say nothing. Dashed: another material law.",
        shares_legend=False,
    )
