"""Faults seeded into the smoothed element turn the check on the same mesh red.

A candidate of NumPy alone solves the linear case densely by the averages it is given: the right
ones, or with one slip in them. Held against the reference's stored smoothed tetrahedra.
"""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.judging import judge as judging
from palpate.validation.judging.judge import judge_case
from palpate.validation.metrics import make_state
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.smoothing import Smoothing
from palpate.validation.references.reference_set import SMOOTHED, ReferenceSet
from palpate.validation.references.stored import load_stored
from palpate.validation.states import Verdict

INCLUSION = """
[[inclusion]]
region = { box = { min = [20.0, -1.0, -1.0], max = [41.0, 26.0, 21.0] } }
material = { youngs_modulus = 40.0, poissons_ratio = 0.3, density = 1000.0 }
"""


def right(_smoothing):
    pass


def one_edge_counts_twice(smoothing):
    # Of one cell: its share of the strain of one of its edges.
    plain = smoothing._means

    def means(patches, values):
        found = plain(patches, values)
        if patches.shape[1] == 6:
            flat = patches.ravel()
            weights = np.repeat(smoothing._volumes, 6)
            weights[7] *= 2.0
            rows = np.repeat(values, 6, axis=0)
            sums = np.stack([np.bincount(flat, weights * r) for r in rows.T], axis=1)
            found = (sums / np.bincount(flat, weights)[:, None])[patches].mean(axis=1)
        return found

    smoothing._means = means


def a_node_without_one_cell(smoothing):
    # Its volume lacks a cell whose strain is counted.
    plain = smoothing._means

    def means(patches, values):
        found = plain(patches, values)
        if patches.shape[1] == 4:
            flat = patches.ravel()
            weights = np.repeat(smoothing._volumes, 4)
            volumes = np.bincount(flat, weights)
            short = volumes.copy()
            short[flat[0]] -= weights[0]
            sums = np.bincount(flat, weights * np.repeat(values[:, 0], 4))
            found = (sums / short)[patches].mean(axis=1)[:, None]
        return found

    smoothing._means = means


def across_materials(smoothing):
    whole = Smoothing(smoothing.mesh, np.ones(len(smoothing._volumes)), smoothing._mu * 0.0 + 1.0)
    smoothing._edges, smoothing._nodes = whole._edges, whole._nodes


def solve(problem, slip):
    """The linear equilibrium [m] by a dense matrix of the smoothed element with a slip in it."""
    body = Body(problem, Strain.LINEAR, Element.SMOOTHED)
    body._smoothing.mesh = problem.mesh
    slip(body._smoothing)
    shape, free = problem.mesh.points.shape, np.flatnonzero(~body.fixed.ravel())
    unit = np.eye(problem.mesh.points.size)
    K = np.stack([body.internal(unit[k].reshape(shape)).ravel()[free] for k in free], axis=1)
    u = np.zeros(problem.mesh.points.size)
    u[free] = np.linalg.solve(K, body.external(np.zeros(shape)).ravel()[free])
    return u.reshape(shape)


def state(problem, displacement, label, simulator):
    return make_state(
        problem.mesh, displacement, label=label, simulator=simulator, strain=Strain.LINEAR,
        element=Element.SMOOTHED,
    )  # fmt: skip


def verdict(case, slip, green):
    def answer(problem, strain, _progress):
        return green if strain is Strain.GREEN else state(
            problem, solve(problem, slip), "mine", "mine"
        )  # fmt: skip

    mine = Candidate("mine", answer, has_both_strains=True, element=Element.SMOOTHED)
    result = judge_case(case, candidate=mine, diagnoses=False)
    (check,) = [c for c in result.checks if c.strain is Strain.LINEAR]
    assert (check.against, check.element) == ("same_mesh", Element.SMOOTHED)
    return check.verdict


@pytest.mark.parametrize(
    ("slip", "expected"),
    [
        (right, Verdict.PASSED),
        (one_edge_counts_twice, Verdict.FAILED),
        (a_node_without_one_cell, Verdict.FAILED),
        # One material: there is nothing to smooth across.
        (across_materials, Verdict.PASSED),
    ],
)
def test_a_wrong_average_fails_on_the_same_mesh(slip, expected):
    case = load_case("block")
    green = load_stored("block", case.problem).states[SMOOTHED, Strain.GREEN]
    assert verdict(case, slip, green) is expected


@pytest.mark.parametrize(
    ("slip", "expected"), [(right, Verdict.PASSED), (across_materials, Verdict.FAILED)]
)
def test_smoothing_across_a_material_fails_on_the_same_mesh(slip, expected, tmp_path, monkeypatch):
    shutil.copy(builtin_folder() / "block.vtu", tmp_path)
    text = load_case("block").text.replace("[[check]]", INCLUSION + "\n[[check]]", 1)
    (tmp_path / "two.toml").write_text(text, encoding="utf-8")
    case = load_case(str(tmp_path / "two.toml"))
    assert len(case.problem.inclusions) == 1
    # Split by material: by the judge's own equations, which the reference's keep to 1e-12.
    kept = state(case.problem, solve(case.problem, right), SMOOTHED, "reference")
    references = ReferenceSet({(SMOOTHED, Strain.LINEAR): kept}, {}, "made here")
    monkeypatch.setattr(judging, "find_references", lambda *_given, **_options: references)
    assert verdict(case, slip, kept) is expected
