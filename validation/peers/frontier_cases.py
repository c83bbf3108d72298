"""The press and the swinging strip in the study of work against precision, by their stored truths.

Whoever cannot take a case is left out with its reason; both elements of fastsim can.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.untrusted import parse_toml
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import Case, load_case
from palpate.validation.case.measurements import read_measurement
from palpate.validation.case.schema import CaseSpec
from palpate.validation.exchange.placement import match_points
from palpate.validation.judging.case_references import find_references
from palpate.validation.peers.registry import read_peers
from palpate.validation.references.field_truth import STVK, FieldTruth
from palpate.validation.states import CandidateFailedError, Progress, in_silence
from palpate.validation.versions import version_of

OURS, SMOOTHED = "fastsim", "fastsim, smoothed"
BAR, PRESS, STRIP = BODIES = ("bar", "press", "strip")
# Size of the bodies' boxes [mm], and edges of their meshes.
_BOXES = {PRESS: (60.0, 40.0, 20.0), STRIP: (100.0, 10.0, 10.0)}
_EDGES = {PRESS: (10.0, 7.0, 5.0, 3.5, 2.5), STRIP: (10.0, 5.0, 3.5, 2.5)}
_METRICS = {PRESS: "displacement_l2", STRIP: "trajectory_l2"}
# Steps in the place of one, on the second mesh; of those that iterate, which take longer,
# iterations and steps [s] on the first.
_SUBSTEPS = (2, 4)
_ITERATIONS = (3, 10, 30)
_STEPS = (5e-3, 2.5e-3, 1.25e-3)
TIME_LIMIT = 120.0
# Words of the floors in the figure.
MEASURED, TRUTHS_BAR = "measured\nscatter", "truth's\nbar"


class Row(NamedTuple):
    """One simulator on one mesh.

    `seconds` is the processor's time of the solve; `error` the relative L2 distance from the
    quadratic reference; `same_mesh` the largest distance from fastsim on the same mesh, over the
    largest displacement, None of quadratic tetrahedra, whose equations are others. `whole` is the
    processor's time of the whole program, None of fastsim, which runs here; `setting` is what is
    varied beside the mesh.
    """

    tool: str
    version: str
    law: str
    method: str
    num_cells: int
    seconds: float
    error: float
    same_mesh: float | None
    whole: float | None = None
    body: str = BAR
    setting: str = ""


def run_case(body: str, progress: Progress, leave_out: Progress) -> tuple[list[Row], float]:
    """Every simulator on meshes of a case, with other steps and iterations; and the truth's bar.

    Args:
        body: Name of the case.
        progress: Called before each run.
        leave_out: Called with each run that is not finished, and the reason.
    """
    case = load_case(body)
    references = find_references(case, live=False, progress=in_silence)
    best = references.truth(case.strain)
    assert best is not None  # stored with palpate
    truth = FieldTruth(case.problem, best.displacements)
    meshed = [_on_mesh(case, _BOXES[body], edge) for edge in _EDGES[body]]
    _ours(body, meshed[0], Element.LINEAR, truth, in_silence)  # what is loaded once is not timed
    rows = [
        _ours(body, problem, element, truth, progress) for element in Element for problem in meshed
    ]
    for setting, problem, command, law in _asked(body, meshed, leave_out):
        simulator = OutsideSimulator(command, TIME_LIMIT)
        try:
            row = run_peer(simulator, law, problem, None, truth, progress)
        except CandidateFailedError as failure:
            leave_out(f"{body}, {simulator.name}, {problem.mesh.num_cells} cells: {failure}")
            continue
        rows.append(row._replace(body=body, setting=setting))
    return rows, references.bars[_METRICS[body], case.strain]


def _on_mesh(case: Case, size: tuple[float, float, float], edge: float) -> Problem:
    """A case's problem on a mesh of its box with edges of this length [mm]."""
    data = parse_toml(case.text)
    data["geometry"] = {"shape": "box", "size": list(size), "edge_length": edge}
    data.pop("mesh", None)
    return dataclasses.replace(case, spec=CaseSpec.model_validate(data)).problem


def _ours(
    body: str, problem: Problem, element: Element, truth: FieldTruth, progress: Progress
) -> Row:
    tool = OURS if element is Element.LINEAR else SMOOTHED
    progress(f"{tool}, {body}, {problem.mesh.num_cells} cells")
    before = time.process_time()
    state = fastsim_candidate(element=element).solve(problem, Strain.GREEN, in_silence)
    seconds = time.process_time() - before
    error = truth.error_of(problem.mesh, state.displacements)
    method = "Newton, conjugate gradients" if problem.time is None else "central differences"
    about = (tool, version_of("palpate"), STVK, method, problem.mesh.num_cells)
    return Row(*about, seconds, error, None, None, body)


def _asked(
    body: str, meshed: list[Problem], leave_out: Progress
) -> Iterator[tuple[str, Problem, str, Law]]:
    """What others are asked: the setting, the problem, the command line and its law."""
    for peer in read_peers():
        if not (peer.varies if body == STRIP else peer.takes_tools):
            continue
        command = peer.command_line()
        if command is None:
            leave_out(f"{body}, {peer.name}: {peer.why_missing()}")
            continue
        if body != STRIP or peer.varies == "substeps":
            for problem in meshed:
                yield "", problem, command, peer.law
        if body != STRIP:
            continue
        if peer.varies == "substeps":
            for number in _SUBSTEPS:
                yield f"substeps {number}", meshed[1], f"{command} substeps={number}", peer.law
            continue
        for number in _ITERATIONS:
            words = f"iterations {number}, steps of {_STEPS[1]:g} s"
            yield words, _stepped(meshed[0], _STEPS[1]), f"{command} iterations={number}", peer.law
        for step in _STEPS:
            yield f"steps of {step:g} s", _stepped(meshed[0], step), command, peer.law


def _stepped(problem: Problem, step: float) -> Problem:
    """The motion with a time step [s] for those that have none of their own."""
    assert problem.time is not None
    return dataclasses.replace(problem, time=dataclasses.replace(problem.time, time_step=step))


def measured_scatter() -> float:
    """Standard uncertainty of the measured bar's markers, over the largest displacement of one [-].

    By the runs' scatter, of the case `silicone-bar` under its weight.
    """
    case = load_case("silicone-bar")
    spec = next(one for one in case.spec.measurement if one.name == "load101")
    measured = read_measurement(case, spec)
    largest = np.linalg.norm(measured.values.reshape(-1, 3), axis=1).max()
    return float(measured.uncertainty.max() / largest)


def run_peer(
    simulator: OutsideSimulator,
    law: Law,
    problem: Problem,
    ours: Points | None,
    truth: FieldTruth,
    progress: Progress,
) -> Row:
    """Run a simulator of a law; `ours` is fastsim's solution, None for other equations."""
    before = time_of_children()
    result, seconds = simulator.run(problem, Strain.GREEN, progress)
    whole = time_of_children() - before
    about: Mapping[str, object] = result.about
    matched = match_points(result, problem)
    found, mesh, own = matched.displacement, problem.mesh, matched.displacement
    if matched.own_mesh is not None and matched.own_displacement is not None:
        mesh, own = matched.own_mesh, matched.own_displacement
    return Row(
        str(about["tool"]),
        str(about["version"]),
        STVK if law.is_linear_in_strain else law.value,
        str(about.get("method", "Newton, dense matrices")),
        problem.mesh.num_cells,
        float(str(about.get("seconds", seconds))),
        truth.error_of(mesh, own),
        None if ours is None else float(np.abs(found[0] - ours).max() / np.abs(ours).max()),
        whole,
    )


def time_of_children() -> float:
    """Processor time, user and system, of ended processes that were started here [s]."""
    spent = os.times()
    return spent.children_user + spent.children_system
