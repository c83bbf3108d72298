"""A measured number comes with its uncertainty, which enters the verdict like an error bar."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics.difference import make_state
from palpate.validation.states import Verdict

MESH = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
FACES = tuple(
    held(side(MESH, axis, 0.0), components=tuple(axis == k for k in range(3))) for axis in range(3)
)
PROBLEM = Problem(
    MESH, Material(1e3, 0.0), FACES, (Traction(side(MESH, 0, 2.0), (10.0, 0.0, 0.0)),)
)


def check(expected: float, **more) -> CheckSpec:
    given = {
        "metric": "published_displacement",
        "against": "candidate",
        "limit": 0.02,
        "reason": "measured",
        "at": (2.0, 0.0, 0.0),
        "component": "x",
        "expected": expected,
    }
    return CheckSpec.model_validate(given | more)


def verdict(spec: CheckSpec, bar: float = 0.0):
    u = solve_static(PROBLEM, strain=Strain.LINEAR).displacement
    # t L / E = 10 * 2 / 1000.
    assert u[:, 0].max() == pytest.approx(0.02, rel=1e-9)
    state = make_state(MESH, u, label="p1", simulator="test", strain=Strain.LINEAR)
    candidate, reference = (None, state) if spec.against == "truth" else (state, None)
    return judge_check(spec, Strain.LINEAR, PROBLEM, candidate, reference, bar, "")


@pytest.mark.parametrize("against", ["candidate", "truth"])
@pytest.mark.parametrize(
    ("off", "uncertainty", "wanted"),
    [
        (0.01, None, Verdict.PASSED),
        (0.01, 0.005, Verdict.PASSED),
        (0.01, 0.015, Verdict.INCONCLUSIVE),
        (0.03, None, Verdict.FAILED),
        (0.03, 0.005, Verdict.FAILED),
        (0.03, 0.015, Verdict.INCONCLUSIVE),
    ],
)
def test_what_a_measurement_does_not_tell_is_inconclusive(against, off, uncertainty, wanted):
    expected = 0.02 / (1.0 - off)
    more = {} if uncertainty is None else {"uncertainty": uncertainty * expected}
    found = verdict(check(expected, against=against, **more))
    assert found.verdict is wanted
    assert found.value == pytest.approx(off, rel=1e-6)
    assert found.reference_error == pytest.approx(uncertainty or 0.0, abs=1e-12)
    assert ("+-" in found.message) == bool(uncertainty)


def test_the_truths_own_bar_comes_on_top():
    expected = 0.02 / 0.99
    spec = check(expected, against="truth", uncertainty=0.005 * expected)
    assert verdict(spec).verdict is Verdict.PASSED
    # Of the largest displacement, nearly the number itself.
    assert verdict(spec, bar=0.008).verdict is Verdict.INCONCLUSIVE


def test_bad_uncertainties_are_refused():
    with pytest.raises(ValidationError, match="uncertainty"):
        check(0.02, uncertainty=-0.1)
    with pytest.raises(ValidationError, match="uncertainty goes with published_displacement, pub"):
        CheckSpec.model_validate(
            {"metric": "displacement_l2", "limit": 0.1, "reason": "none", "uncertainty": 0.1}
        )
    assert np.isfinite(check(0.02, uncertainty=0.0).uncertainty)
