"""A correct solution in single precision passes where that is granted, a wrong one nowhere."""

from __future__ import annotations

import dataclasses
import io
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from judged import GREEN, case_of, failed, judge, judged_by, sending, solved, stored
from rich.console import Console

from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import Precision as Arithmetic
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.candidates.candidate import fastsim_candidate, result_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import load_case
from palpate.validation.exchange.nodal_arrays import (
    cell_materials,
    fixed_components,
    lumped_mass,
    nodal_force,
)
from palpate.validation.judging import outputs
from palpate.validation.metrics.body import body_of, shape_gradients
from palpate.validation.metrics.stepping import steps_per_output
from palpate.validation.references.reference_set import SAME_MESH, SMOOTHED, ReferenceSet
from palpate.validation.states import Precision, Verdict

REMARK = "agrees to single precision"


def sent(name, rounded):
    """The reference's own displacement as a program in single precision would send it.

    Of smoothed tetrahedra: linear ones fail what the users of these cases need of the truth.
    """

    def make(problem, strain):
        state = stored(name, SMOOTHED, strain)
        values = state.displacement if problem.time is None else state.displacements
        return rounded(problem.mesh.points, values)

    return sending(make, element=Element.SMOOTHED)


def as_displacements(_rest, values):
    return values.astype(np.float32).astype(np.float64)


def as_positions(rest, values):
    return (rest + values).astype(np.float32).astype(np.float64) - rest


class SingleForces:
    """External less internal force of linear tetrahedra, every number in 24 bits."""

    def __init__(self, problem, strain):
        mesh, single = problem.mesh, np.float32
        E, nu = cell_materials(problem)[:, :2].astype(single).T[:, :, None, None]
        self.lmbda, self.mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        self.cells, self.strain = mesh.cells, strain
        self.gradients = shape_gradients(mesh).astype(single)
        self.volumes = signed_volumes(mesh.points, mesh.cells).astype(single)[:, None, None]
        self.dead = sum(nodal_force(mesh, load) for load in problem.loads).astype(single)

    def __call__(self, u):
        one = np.eye(3, dtype=np.float32)
        H = u.astype(np.float32)[self.cells].transpose(0, 2, 1) @ self.gradients
        F = one + H
        E = (H + H.transpose(0, 2, 1)) / np.float32(2)
        if self.strain is Strain.GREEN:
            E = (F.transpose(0, 2, 1) @ F - one) / np.float32(2)
        S = self.lmbda * np.trace(E, axis1=1, axis2=2)[:, None, None] * one + 2 * self.mu * E
        P = S if self.strain is Strain.LINEAR else F @ S
        force = self.dead.copy()
        corners = (self.volumes * P @ self.gradients.transpose(0, 2, 1)).transpose(0, 2, 1)
        np.add.at(force, self.cells, -corners)
        assert force.dtype == np.float32
        return force


def newton_in_single(problem, strain):
    """Newton whose forces and displacement are in single precision; its directions may be any."""
    forces, exact = SingleForces(problem, strain), body_of(problem, strain).internal
    free = np.flatnonzero(fixed_components(problem)[0].ravel() == 0)
    u, shape = np.zeros(problem.mesh.points.size, dtype=np.float32), problem.mesh.points.shape
    for _ in range(12):
        K, h = np.empty((len(free), len(free))), 1e-5
        for column, dof in enumerate(free):
            d = np.zeros(u.size)
            d[dof] = h
            ahead, back = (exact((u + s * d).reshape(shape)).ravel() for s in (1.0, -1.0))
            K[:, column] = (ahead - back)[free] / (2.0 * h)
        step = np.linalg.solve(K, forces(u.reshape(shape)).ravel()[free].astype(np.float64))
        u[free] += step.astype(np.float32)
    return u.reshape(shape).astype(np.float64)


def steps_in_single(problem, strain):
    """Central differences of displacements, three levels of them in single precision."""
    forces, span = SingleForces(problem, strain), problem.time
    dt, half = np.float32(span.time_step), np.float32(0.5 * span.mass_damping * span.time_step)
    mass = lumped_mass(problem).astype(np.float32)[:, None]
    is_fixed, steps = fixed_components(problem)[0] == 1, steps_per_output(problem)
    now = np.zeros(problem.mesh.points.shape, dtype=np.float32)
    before = np.where(is_fixed, now, dt * dt / 2 * forces(now) / mass)
    found = [now]
    for step in range(steps * span.num_outputs):
        ahead = (dt * dt * forces(now) / mass + 2 * now - (1 - half) * before) / (1 + half)
        now, before = np.where(is_fixed, np.float32(0), ahead), now
        if (step + 1) % steps == 0:
            found.append(now)
    return np.array(found, dtype=np.float64)


def fastsim_in_single(problem, strain):
    return simulate(problem, strain=strain, precision=Arithmetic.SINGLE).displacements


SOLUTIONS = {
    "positions sent, block": ("block", sent("block", as_positions)),
    "positions sent, cantilever": ("cantilever", sent("cantilever", as_positions)),
    "positions sent, motion": ("block-motion", sent("block-motion", as_positions)),
    "displacements sent": ("block", sent("block", as_displacements)),
    "Newton": ("confined", sending(newton_in_single)),
    "own steps": ("block-motion", sending(steps_in_single)),
    "fastsim's steps": ("block-motion", sending(fastsim_in_single)),
    "fastsim's steps, waves": ("wave", sending(fastsim_in_single)),
}


@pytest.fixture
def block_of_single(tmp_path):
    """A result file: the block's reference, rounded as positions; it says so itself."""
    rest = case_of("block").problem.mesh.points
    moved = as_positions(rest, stored("block", SAME_MESH).displacement)
    about = json.dumps({"tool": "it", "precision": "single"})
    np.savez(tmp_path / "solution.npz", displacement=moved, about=about)
    return tmp_path / "solution.npz"


@pytest.mark.parametrize("word", SOLUTIONS)
@pytest.mark.long
def test_a_correct_solution_in_single_precision_passes_where_that_is_granted(word):
    name, candidate = SOLUTIONS[word]
    strict = judge(case_of(name), candidate=candidate)
    assert strict.verdict is Verdict.FAILED
    assert all(REMARK in check.message for check in failed(strict))
    granted = judge(case_of(name), candidate=candidate, precision=Precision.SINGLE)
    assert granted.verdict is Verdict.PASSED, [c.message for c in granted.checks]


@pytest.mark.parametrize(
    ("name", "faults"),
    {
        "block": (Fault.SOFTER, Fault.SWAPPED_LAME, Fault.DROPPED_LOAD),
        "beam": (Fault.DROPPED_LOAD,),
        "cantilever": (Fault.SOFTER,),
        "kidney": (Fault.SWAPPED_LAME,),
        "press": (Fault.SOFTER,),
        "block-motion": (Fault.DROPPED_LOAD, Fault.WRONG_MASS, Fault.NO_DAMPING),
        "slide": (Fault.SOFTER,),
        "wave": (Fault.SOFTER,),
    }.items(),
)  # fmt: skip
@pytest.mark.long
def test_a_wrong_solution_fails_in_single_precision_too(name, faults):
    for fault in faults:
        wrong = with_fault(fastsim_candidate(), fault)
        result = judge(case_of(name), candidate=wrong, precision=Precision.SINGLE)
        assert result.verdict is Verdict.FAILED, fault
        assert any(check.precision is Precision.SINGLE for check in failed(result)), fault
        assert not any(REMARK in check.message for check in result.checks), fault


def test_a_wrong_solution_has_no_such_remark():
    result = judge(case_of("block"), candidate=with_fault(fastsim_candidate(), Fault.SOFTER))
    assert result.verdict is Verdict.FAILED
    assert not any(REMARK in check.message for check in result.checks)


def test_what_a_simulator_says_of_itself_loosens_nothing(block_of_single):
    result = judge(case_of("block"), candidate=result_candidate(block_of_single))
    assert result.verdict is Verdict.FAILED
    assert {check.precision for check in result.checks} == {Precision.DOUBLE}
    assert any(REMARK in check.message for check in result.checks)


def test_a_case_may_grant_it_to_all_or_some_of_its_checks(write_case, monkeypatch):
    def judged(*changes):
        case = load_case(str(write_case(*changes)))
        exact = dataclasses.replace(solved(case.problem), label=SAME_MESH)
        rounded = as_positions(case.problem.mesh.points, exact.displacement)
        references = ReferenceSet({(SAME_MESH, GREEN): exact}, {}, "made up")
        candidate = sending(lambda _problem, _strain: rounded)
        return judged_by(references, monkeypatch, case, candidate=candidate)

    whole = ("schema = 1\n", 'schema = 1\nprecision = "single"\n')
    assert judged().verdict is Verdict.FAILED
    granted = judged(whole)
    assert granted.verdict is Verdict.PASSED
    assert [c.precision for c in granted.checks] == [Precision.SINGLE, Precision.DOUBLE]
    one = judged(("limit = 1e-8\n", 'limit = 1e-8\nprecision = "single"\n'))
    assert one.verdict is Verdict.PASSED
    back = judged(whole, ("limit = 1e-8\n", 'limit = 1e-8\nprecision = "double"\n'))
    assert back.verdict is Verdict.FAILED
    with pytest.raises(InputError, match="smallest_det_f"):
        judged(("limit = 0.0\n", 'limit = 0.0\nprecision = "single"\n'))


def test_the_precision_stands_in_every_output():
    name, candidate = SOLUTIONS["positions sent, cantilever"]
    results = [judge(case_of(name), candidate=candidate, precision=Precision.SINGLE)]
    (case,) = json.loads(outputs.results_json(results, "x"))["cases"]
    assert {(c["against"], c["precision"]) for c in case["checks"]} == {
        ("same_mesh", "single"),
        ("truth", "single"),
        ("truth", "double"),  # the truth's own, against a published number
        ("candidate", "single"),  # a published number is compared too
        ("candidate", "double"),
    }
    # Limits that a user needs are far above what rounding does, and stay.
    assert [c["limit"] for c in case["checks"] if c["against"] == "truth"] == [0.02, 2e-3, 2e-3]
    kinds = {
        (prop.get("value"), "single precision" in str(test.get("name")))
        for test in ET.fromstring(outputs.junit_xml(results)).iter("testcase")
        for prop in test.iter("property")
        if prop.get("name") == "precision"
    }
    assert kinds == {("single", True), ("double", False)}
    console = Console(width=300, record=True, file=io.StringIO())
    outputs.print_results(results, console)
    table = console.export_text()
    assert "displacement_l2 (same mesh, green, smoothed, single precision)" in table
    assert "Single precision is granted by the caller" in table
    assert "strains rounded by 4 x 2^-24" in table
    assert "single precision" in outputs.summary_markdown(results)


def test_the_caller_grants_it_on_the_command_line(block_of_single, command_line):
    for words, code in (([], 1), (["--precision", "single"], 0), (["--precision", "half"], 2)):
        assert command_line("compare", "block", block_of_single, *words) == code
