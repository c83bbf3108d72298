"""What a result records beside its checks: every metric, error fields, where it comes from."""

from __future__ import annotations

import datetime
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.quality import measure_quality
from palpate.validation.case import Case
from palpate.validation.metrics import CATALOGUE, measure
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.stored import problem_key
from palpate.validation.states import State
from palpate.validation.versions import version_of


def error_lengths(candidates: dict[Strain, State], references: ReferenceSet) -> dict[str, Points]:
    """Length of the displacement error at each point [m], (num_points,), by pair of states."""
    fields = {}
    for strain, candidate in candidates.items():
        for reference in (references.same_mesh(strain), references.truth(strain)):
            if reference is not None:
                error = candidate.displacement - reference.displacement
                name = f"{candidate.label} - {reference.label}, {strain}"
                fields[name] = np.linalg.norm(error, axis=1)
    return fields


def all_metrics(
    case: Case, candidates: dict[Strain, State], references: ReferenceSet
) -> dict[str, float | None]:
    """Every metric of every pair, whether a check asks for it or not."""
    mesh = case.problem.mesh
    metrics: dict[str, float | None] = {
        "rest.volume": mesh.volume,
        "rest.surface_area": mesh.surface_area,
    }
    for state in (*candidates.values(), *references.states.values()):
        name = f"{state.label.replace(',', '').replace(' ', '_').lower()}.{state.strain}"
        metrics[f"{name}.volume"] = state.volume
        metrics[f"{name}.surface_area"] = state.surface_area
        metrics[f"{name}.smallest_det_f"] = state.smallest_det_f
        metrics[f"{name}.max_displacement"] = state.max_displacement
    for strain, candidate in candidates.items():
        pairs = (
            ("same_mesh", references.same_mesh(strain)),
            ("truth", references.truth(strain)),
        )
        for word, reference in pairs:
            if reference is None:
                continue
            for metric in _comparable(word, case.problem):
                value = measure(metric, case.problem, candidate, reference).value
                name = error_name(word, strain, candidate.element, metric)
                metrics[name] = value if np.isfinite(value) else None
    return metrics


def error_name(against: str, strain: Strain, element: Element, metric: str) -> str:
    """What an error is called among the metrics of a result."""
    which = f"{strain}" if element is Element.LINEAR else f"{strain}.{element}"
    return f"error.{against}.{which}.{metric}"


def _comparable(against: str, problem: Problem) -> list[str]:
    """Metrics that compare with a reference of this kind; oscillations only where asked for."""
    return [
        metric.name
        for metric in CATALOGUE.values()
        if metric.compare
        and (against == "same_mesh" or not metric.needs_same_mesh)
        and not metric.is_fitted
        and (not metric.needs_time or problem.time)
        and (not problem.time or against == "same_mesh" or metric.has_moving_truth)
        and (not metric.needs_tools or problem.tools)
    ]


def provenance_of(case: Case, references: ReferenceSet) -> dict[str, Any]:
    """Where and when a case was judged, with what, and against which reference."""
    mesh = case.problem.mesh
    quality = measure_quality(mesh)
    return {
        "palpate": version_of("palpate"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": " ".join(["palpate", *sys.argv[1:]]),
        "case_key": problem_key(case.problem),
        "case_file": case_file(case),
        "mesh": {
            "origin": case.mesh.origin,
            "num_points": mesh.num_points,
            "num_cells": mesh.num_cells,
            "smallest_dihedral_deg": quality.smallest_dihedral_deg,
            "longest_edge": quality.longest_edge,
        },
        "reference": {"origin": references.origin, **references.provenance},
    }


def case_name(case: Case) -> str:
    """What a case is called on the command line: by its name, or its file."""
    return case.name if case.is_builtin else case_file(case)


def case_file(case: Case) -> str:
    """The case's file as seen from the working folder, where it lies below it."""
    path = case.path.absolute()
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path.name)
