"""A law or a modulus in the place of what was asked for, where that is not the usual law."""

from __future__ import annotations

import dataclasses

import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.diagnosis import diagnose
from palpate.validation.metrics import make_state

ASKED = Law.NEO_HOOKEAN
SLIPS = {
    "saint-venant-kirchhoff law": {"law": Law.SAINT_VENANT_KIRCHHOFF},
    "neo-hookean-stable law": {"law": Law.NEO_HOOKEAN_STABLE},
    "neo-hookean-stable-log law": {"law": Law.NEO_HOOKEAN_STABLE_LOG},
    "neo-hookean-isochoric law": {"law": Law.NEO_HOOKEAN_ISOCHORIC},
    "Poisson's ratio 0.35 in the place of 0.3": {"poissons_ratio": 0.35},
}


def asked() -> Problem:
    problem = load_case("stretch").problem
    material = dataclasses.replace(problem.material, law=ASKED)
    return dataclasses.replace(problem, material=material, loads=(BodyForce((0.0, 9e3, -2e4)),))


@pytest.mark.parametrize("words", list(SLIPS))
def test_it_is_named_in_statics(words):
    problem = asked()
    other = dataclasses.replace(problem.material, **SLIPS[words])
    u = solve_static(dataclasses.replace(problem, material=other)).displacement
    state = make_state(problem.mesh, u, label="c", simulator="c", strain=Strain.GREEN)
    found = diagnose(problem, state, None).first
    assert found is not None
    assert found.name == words


def test_what_was_asked_for_keeps_its_equations():
    problem = asked()
    u = solve_static(problem).displacement
    state = make_state(problem.mesh, u, label="c", simulator="c", strain=Strain.GREEN)
    found = diagnose(problem, state, None).first
    assert found is not None
    assert found.name == "the stated equations are kept on this mesh"
