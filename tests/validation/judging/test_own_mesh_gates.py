"""No built-in case passes a solution that is right at its points and garbage between them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from judged import case_of, judge, large_by_night, references_of

from palpate.meshes.refinement import refine_uniformly
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.case import builtin_cases
from palpate.validation.exchange.point_location import locate_points
from palpate.validation.references.reference_set import SAME_MESH, SMOOTHED
from palpate.validation.states import Verdict, gravest


def verdict_on_own_mesh(name: str, folder: Path, *, garbage: float) -> Verdict:
    """The reference on the case's mesh cut in eight, with garbage at the new inner points.

    Args:
        name: Of a built-in case.
        folder: For the result.
        garbage: In sizes of the body.
    """
    case, references = case_of(name), references_of(name)
    # The cantilever asks for the truth, to which smoothed tetrahedra are near enough.
    label = SMOOTHED if name == "cantilever" else SAME_MESH
    right = references.states.get((label, case.strain)) or references.truth(case.strain)
    assert right is not None
    mesh = case.problem.mesh
    own = refine_uniformly(mesh)
    location = locate_points(mesh, own)
    motion = right.trajectory
    arrays = {
        "displacement": np.stack(
            [location.read(mesh.cells, state) for state in right.displacements]
        ),
        "points": own.points,
        "cells": own.cells,
    }
    if motion is not None:
        arrays["times"] = motion.times
    about: dict[str, object] = {"element": right.element.value}
    if right.tool_forces is not None:
        about["tool_forces"] = right.tool_forces.tolist()
    arrays["about"] = np.array(json.dumps(about))
    inner = np.ones(own.num_points, dtype=bool)
    inner[: mesh.num_points] = False
    inner[np.unique(own.boundary_facets)] = False
    assert inner.any()
    shape = (int(inner.sum()), 3)
    thrown = garbage * np.random.default_rng(0).uniform(-1.0, 1.0, shape)
    arrays["displacement"][:, inner] += thrown * float(np.ptp(mesh.points, axis=0).max())
    np.savez(folder / "r.npz", **arrays)
    result = judge(case, candidate=result_candidate(folder / "r.npz", right.element))
    if name not in ("press", "slide"):
        return result.verdict
    # Their cells are too coarse for the truth, with garbage or without.
    return gravest([c.verdict for c in result.checks if c.against == "same_mesh"])


@pytest.mark.parametrize("name", large_by_night(builtin_cases(), "silicone-bar", "beam", "phantom"))
@pytest.mark.long
def test_garbage_at_inner_points_of_the_own_mesh_fails(name: str, tmp_path: Path) -> None:
    assert verdict_on_own_mesh(name, tmp_path, garbage=0.3) is Verdict.FAILED


@pytest.mark.parametrize("name", ["block", "block-motion", "cantilever", "press", "slide"])
def test_without_the_garbage_it_does_not(name: str, tmp_path: Path) -> None:
    assert verdict_on_own_mesh(name, tmp_path, garbage=0.0) is not Verdict.FAILED
