"""Work against precision: error over processor time of every installed simulator, on three bodies.

A soft bar, clamped at one end, is bent by a downward traction on the other until its tip has
sunk by a quarter of its length, as the measured bar of the case `silicone-bar` is. The error is the
relative L2 distance from quadratic elements on the finest mesh. The scatter of the measured bar,
over the displacement of its tip, is a floor: of a body that is known no better, more accuracy of
the simulator says nothing more.

The ball of the case `press` and the swinging strip of `strip` are compared with the cases' stored
truths, whose error bars are the floor there; the strip's error is the worst in time over the
largest displacement. Meshes, steps (so many to each that the simulator would take) and iterations
are varied, one at a time.

The time is processor time, user and system, of the solve in the simulator's process and those that
it starts, on one thread, without start-up and reading; the table has that of the whole program too.
For a simulator with another law the distance of that law remains however fine the mesh: it is
drawn dashed.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from palpate.fastsim.condensed import condense, solve_condensed
from palpate.fastsim.forces import external_force
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.peers.frontier_cases import (
    BAR,
    BODIES,
    MEASURED,
    OURS,
    PRESS,
    SMOOTHED,
    STRIP,
    TRUTHS_BAR,
    Row,
    measured_scatter,
    run_case,
    run_peer,
)
from palpate.validation.peers.registry import read_peers
from palpate.validation.references.field_truth import STVK, FieldTruth, time_fastsim
from palpate.validation.references.runs import solve_state
from palpate.validation.report.plots import COLOURS, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import CandidateFailedError, Progress, Verdict
from palpate.validation.versions import version_of

TITLE = "Work against precision"
SIZE = (0.08, 0.02, 0.02)
DIVISIONS = (1, 2, 3, 4, 6)
TRACTION = 150.0  # Pa, downward on the free end
TIME_LIMIT = 120.0
LINEAR, READY = "linear strain", "condensed, ready"
# Number of responses of the condensed model that are timed together.
_STEPS = 100
# Largest distance from fastsim on the same mesh, over the largest displacement: a text file has
# seven digits, and relaxation stops at a residual of 1e-7.
SAME_MESH = 1e-4


class Runs(NamedTuple):
    """All runs, what was left out and why, and the floors, by body and with words for the figure.

    `reference_change` is the bar's: of the reference on a halved mesh.
    """

    rows: Sequence[Row]
    left_out: Sequence[str]
    reference_change: float
    floors: Mapping[str, Mapping[float, str]] = MappingProxyType({})


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
    us = (OURS, version_of("palpate"), STVK, "Newton, conjugate gradients")
    smoothed: list[Row] = []
    for n, problem in problems.items():
        seconds, solutions[n] = time_fastsim(problem)
        error = truth.error_of(problem.mesh, solutions[n])
        rows.append(Row(*us, problem.mesh.num_cells, seconds, error, 0.0))
        seconds, found = time_fastsim(problem, Element.SMOOTHED)
        error = truth.error_of(problem.mesh, found)
        smoothed.append(Row(SMOOTHED, *us[1:], problem.mesh.num_cells, seconds, error, None))
        condensed += time_condensed(problem, solutions[n], truth)
    # Quadratic elements on the finest mesh are the reference themselves.
    coarse = {n: problems[n] for n in DIVISIONS[:-1]}
    others = run_installed(problems, solutions, truth, progress, leave_out, coarse)
    change = truth.change_of(coarser)
    floors = {BAR: {change: TRUTHS_BAR, measured_scatter(): MEASURED}}
    for body in (PRESS, STRIP):
        of_case, bar = run_case(body, progress, leave_out)
        others += of_case
        floors[body] = {bar: TRUTHS_BAR}
    return Runs([*rows, *smoothed, *condensed, *others], left_out, change, floors)


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
                rows.append(run_peer(simulator, peer.law, problem, ours, truth, progress))
            except CandidateFailedError as failure:
                leave_out(f"{peer.name}, {problem.mesh.num_cells} cells: {failure}")
                break
    return rows


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
    seconds[READY] = (time.process_time() - begin) / _STEPS
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
    on_same_mesh = [(row.same_mesh, row) for row in same_law if row.same_mesh is not None]
    apart, worst = max((apart, row) for apart, row in on_same_mesh if row.body == BAR)
    findings = [
        judged(
            f"simulators of the same law and element agree on the same mesh to {SAME_MESH:g}",
            f"largest distance {apart:.2g} ({worst.tool}, {worst.num_cells} cells)",
            apart <= SAME_MESH,
        )
    ]
    plain = [row for row in same_law if not row.setting]
    for body, tool in dict.fromkeys((row.body, row.tool) for row in plain):
        errors = [row.error for row in plain if (row.body, row.tool) == (body, tool)]
        claim = f"{body}, {tool}: a finer mesh is nearer to the reference"
        if len(errors) < 2:
            found = f"{errors[0]:.3f} on the one mesh that it solved, which shows no convergence"
            findings.append(Finding(claim, found, Verdict.INCONCLUSIVE))
            continue
        words = " > ".join(f"{error:.3g}" for error in errors)
        findings.append(judged(claim, words, all(b < a for a, b in pairwise(errors))))
    return findings + [
        judged(
            f"{row.tool} ({row.law}), {row.num_cells} cells: another law, judged apart",
            f"model term {100 * (row.same_mesh or 0.0):.1f} % of the largest displacement, on "
            "this mesh",
            True,
        )
        for row in runs.rows
        if row.law != STVK and row.body == BAR
    ]


def times_ours(row: Row, rows: Sequence[Row]) -> float | None:
    """Processor time over that of fastsim's linear tetrahedra on the same mesh of the same body."""
    key = (row.body, row.num_cells, "")
    ours = [r.seconds for r in rows if (r.body, r.num_cells, r.setting) == key and r.tool == OURS]
    return row.seconds / ours[0] if ours else None


def present(runs: Runs) -> Page:
    """The page: error over processor time, and all runs."""
    columns = {"body": "", "tool": "", "version": "", "law": "", "method": "", "setting": ""}
    columns |= {"cells": "d", "seconds": ".3g", "times fastsim": ".3g", "whole program [s]": ".3g"}
    columns |= {"error": ".4f", "same mesh": ".2g"}
    rows = [
        (
            *(row.body, row.tool, row.version, row.law, row.method, row.setting, row.num_cells),
            *(row.seconds, times_ours(row, runs.rows), row.whole, row.error, row.same_mesh),
        )
        for row in runs.rows
    ]
    return Page(
        figures={"frontier": draw(runs)},
        tables={"frontier": Table("Every run", columns, rows)},
        remarks=[f"Left out: {line}" for line in runs.left_out],
        numbers={"reference_change": runs.reference_change, "left_out": list(runs.left_out)},
    )


_MARKERS = "osD^vP*Xphd<>"
# More than one figure else has.
_COLOURS = (*COLOURS, "#1aa6a6", "#7d8f00", "#e0703a", "#111111", "#9fb8c8")
_TITLES = {
    BAR: "a bar, bent by a quarter of its length",
    PRESS: "a ball pressed into a slab",
    STRIP: "a strip that swings",
}


def draw(runs: Runs, file: Path | None = None) -> Figure:
    """One panel for each body; each tool has one colour and marker, and another law is dashed.

    Args:
        runs: What was run.
        file: Where it is written as PDF or PNG too.
    """
    tools = list(dict.fromkeys(row.tool for row in runs.rows))
    panels: list[Panel] = []
    for body in BODIES:
        # What a finished model takes for one more force is no solve: it is in the table alone.
        of_body = [row for row in runs.rows if row.body == body and row.tool != READY]
        if not of_body:
            continue
        lines: list[Line] = []
        for tool, setting in dict.fromkeys((row.tool, _varied(row)) for row in of_body):
            of = [row for row in of_body if (row.tool, _varied(row)) == (tool, setting)]
            k, is_same = tools.index(tool), of[0].law == STVK
            dashes = ":" if setting else "-" if is_same else "--"
            label = f"{tool} {of[0].version.partition(' (')[0]}"
            label += "" if is_same else f", {of[0].law}"
            lines.append(
                Line(
                    [row.seconds for row in of],
                    [row.error for row in of],
                    style=dashes + _MARKERS[k % len(_MARKERS)],
                    colour=_COLOURS[k % len(_COLOURS)],
                    width=2.4 if k < 1 else 1.2,
                    # Its legend shows a line of meshes where there is one.
                    label="" if any(line.label == label for line in lines) else label,
                )
            )
        panels.append(
            Panel(
                lines,
                levels=runs.floors.get(body, {runs.reference_change: ""}),
                log="xy",
                title=_TITLES[body],
                x="processor time of the solve [s]",
                y="relative L2 error [-]" if not panels else "",
            )
        )
    return line_figure(
        [panels],
        "Lower left is better: a point of a line is a mesh, finer to the right; dotted ones are "
        "other steps or iterations on one mesh. Errors near the truth's bar (of the bent bar: what "
        "halving its reference's mesh changes) say nothing; below the scatter of the measured bar "
        "more accuracy buys nothing. Dashed: another material law, whose distance stays.",
        shares_legend=True,
        pdf=file,
    )


def _varied(row: Row) -> str:
    """The name of what is varied beside the mesh."""
    return row.setting.partition(" ")[0]
