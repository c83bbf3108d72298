"""What a polyhedron leaves out of stress, of the force of a support and of the energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from judged import state_of

from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.judging.case_references import truth_request
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.references.adaptive_truth import ENERGY as ADAPTIVE_ENERGY
from palpate.validation.references.geometry import _compare_stresses, with_geometry
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, ReferenceSet
from palpate.validation.references.runs import solve_state
from palpate.validation.references.statics import estimate_bars

OUTER, INNER, E, NU, P = 2.0, 1.0, 1000.0, 0.3, 10.0
# Lame's thick sphere: u = p a^3 / (E (b^3 - a^3)) ((1 - 2 nu) r + (1 + nu) b^3 / (2 r^2)).
_C = P * INNER**3 / (OUTER**3 - INNER**3)
GROWTH = _C / E * ((1.0 - 2.0 * NU) * INNER + (1.0 + NU) * OUTER**3 / (2.0 * INNER**2))
# Half of what the pressure does, in an eighth; the planes are pulled by p on the hole's quarter.
ENERGY = 0.5 * P * 4.0 * math.pi * INNER**2 * GROWTH / 8.0
REACTION = -P * math.pi * INNER**2 / 4.0
# Hoop stress c (1 + b^3 / (2 r^3)), its mean by volume.
HOOP = _C * (1.0 + 1.5 * OUTER**3 * math.log(OUTER / INNER) / (OUTER**3 - INNER**3))
CHECK = """
[[check]]
metric = "{}"
against = "truth"
expected = {}
limit = 0.5
reason = "Lame"
{}
"""
CASE = f"""
schema = 1
title = "A thick sphere under pressure"
strain = "linear"

[geometry]
shape = "hollow_octant"
radius = {OUTER}
inner_radius = {INNER}
edge_length = 0.9

[material]
youngs_modulus = {E}
poissons_ratio = {NU}

[[support]]
sliding = true
region = {{ half_space = {{ point = [1e-6, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] }} }}

[[support]]
sliding = true
region = {{ half_space = {{ point = [0.0, 1e-6, 0.0], normal = [0.0, -1.0, 0.0] }} }}

[[support]]
sliding = true
region = {{ half_space = {{ point = [0.0, 0.0, 1e-6], normal = [0.0, 0.0, -1.0] }} }}

[[load]]
kind = "pressure"
pressure = {P}
region = {{ ball = {{ center = [0.0, 0.0, 0.0], radius = {INNER + 1e-6} }} }}
""" + "".join(
    CHECK.format(*row)
    for row in (
        ("published_reaction", REACTION, 'support = 1\ncomponent = "x"'),
        ("published_energy", ENERGY, ""),
        (
            "published_stress",
            HOOP,
            'component = "largest_principal"\n'
            "region = { ball = { center = [0.0, 0.0, 0.0], radius = 3.0 } }",
        ),
    )
)


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Each published number of the truth by metric, as a check tells it."""
    path = tmp_path_factory.mktemp("lame") / "lame.toml"
    path.write_text(CASE)
    case = load_case(path)

    def tell(_line):
        pass

    states = {
        (label, Strain.LINEAR): solve_state(case.problem, Strain.LINEAR, degree, tell)
        for label, degree in ((SAME_MESH, 1), (QUADRATIC, 2))
    }
    found = ReferenceSet(states, estimate_bars(case.problem, states), "here")
    whole = with_geometry(case, found, tell, strains=[Strain.LINEAR], request=truth_request(case))
    checks = [CaseJudge(case, whole).check(spec, None) for spec in case.checks]
    return case, {check.metric: check for check in checks}


@pytest.mark.dolfinx
@pytest.mark.long
def test_planes_are_pulled_by_the_hole_of_the_true_sphere(judged):
    """By balance alone, on any mesh: p times the hole in the plane, of the arc or of the chords."""
    case, checks = judged
    facets = case.problem.loads[0].facets
    corners = case.problem.mesh.points[facets]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    chords = 0.5 * abs(doubled[:, 0].sum())
    found = checks["published_reaction"]
    off = 1.0 - P * chords / abs(REACTION)
    assert found.value == pytest.approx(off, rel=0.02)
    assert off > 0.02
    # In units of the number expected; with its factor of safety.
    assert found.bar_parts["geometry"] == pytest.approx(1.25 * off, rel=0.1)


@pytest.mark.dolfinx
@pytest.mark.once
def test_the_energy_of_the_true_sphere_is_within_the_bar_and_its_geometry(judged):
    _, checks = judged
    found = checks["published_energy"]
    assert 0.01 < found.value <= found.reference_error
    assert found.bar_parts["geometry"] > 0.3 * found.value


@pytest.mark.dolfinx
@pytest.mark.once
def test_stress_has_a_geometry_part_too(judged):
    """Balance leaves the mean alone, but not where in the wall it is."""
    _, checks = judged
    found = checks["published_stress"]
    assert found.value <= found.reference_error
    assert found.bar_parts["geometry"] > 0.01
    assert "its geometry adds up to" in found.message


def test_energies_of_a_body_and_its_true_shape_differ_by_their_ratio() -> None:
    """Displacements of 1.1 times the size have 1.21 times the energy under linear strain."""
    problem = load_case("block").problem
    once = state_of(problem, 1e-3 * problem.mesh.points, Strain.LINEAR)
    more = state_of(problem, 1.1e-3 * problem.mesh.points, Strain.LINEAR)
    for other, ratio in ((once, 0.0), (more, 0.21)):
        found = _compare_stresses(problem, (problem, once), (problem, other), {})
        assert found == {ADAPTIVE_ENERGY: pytest.approx(ratio, abs=1e-12)}
