"""Loads that vary over a face, in case files: what they build, what is refused, what is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import side
from palpate.meshes.errors import InputError
from palpate.meshes.face_loads import Profile, hydrostatic_traction, profile_traction
from palpate.validation.case import Case, load_case
from palpate.validation.diagnosis.static_hypotheses import StaticResult, load_hypotheses
from palpate.validation.exchange.nodal_arrays import nodal_force
from palpate.validation.metrics.body import Body
from palpate.validation.report.pictures import draw_case
from palpate.validation.report.preview import look_at

Write = Callable[..., Path]
FORCE = 'kind = "force"\nforce = [60.0, 20.0, -10.0]'
MILLI = '\n[units]\nlength = "mm"\nforce = "mN"\nstress = "kPa"\n'


def case_of(write_case: Write, load: str, units: str = "") -> Case:
    return load_case(write_case((FORCE, load), ("\n[geometry]", units + "\n[geometry]")))


def load_of(case: Case) -> Traction:
    (load,) = case.problem.loads
    assert isinstance(load, Traction)
    return load


VALUES = """kind = "traction"
values = [
    { at = [2, 0, 0], traction = [0, 0, 0] },
    { at = [2, 1, 0], traction = [0, 0, 8] },
    { at = [2, 0, 1], traction = [4, 0, 0] },
]"""
PARABOLA = """kind = "traction"
traction = [0.0, 0.0, 30.0]
profile = "parabolic"
start = [2, 0, 0]
end = [2, 0, 1]"""
LIQUID = """kind = "traction"
profile = "hydrostatic"
density = 1000.0
gravity = [0.0, 0.0, -10.0]
free_surface = [7.0, 7.0, 1.5]"""
MOMENT = 'kind = "moment"\nmoment = [0.0, 5.0, 0.0]'


def test_values_at_places(write_case: Write) -> None:
    load = load_of(case_of(write_case, VALUES))
    assert load.at(np.array([2.0, 0.5, 0.5])) == pytest.approx([2.0, 0.0, 4.0])
    in_units = load_of(case_of(write_case, VALUES, MILLI))
    assert in_units.at(1e-3 * np.array([2.0, 0.5, 0.5])) == pytest.approx([2e3, 0.0, 4e3])


def test_a_profile(write_case: Write) -> None:
    load = load_of(case_of(write_case, PARABOLA))
    # 4 * 0.25 * 0.75 of 30.
    assert load.at(np.array([2.0, 0.3, 0.25])) == pytest.approx([0.0, 0.0, 22.5])


def test_a_moment_is_in_units_of_force_times_length(write_case: Write) -> None:
    # 5 mN mm on a square of 1 mm: t = M z / I = 5 (0.5) 12 kPa, z from the middle.
    load = load_of(case_of(write_case, MOMENT, MILLI))
    assert load.at(1e-3 * np.array([2.0, 0.2, 1.0])) == pytest.approx([30e3, 0.0, 0.0], abs=1e-6)


def test_a_liquid_presses_with_its_depth(write_case: Write) -> None:
    load = load_of(case_of(write_case, LIQUID))
    # rho g (1.5 - z) against +x, the outward normal of the end.
    assert load.at(np.array([2.0, 0.3, 0.25])) == pytest.approx([-12.5e3, 0.0, 0.0])
    dense = LIQUID.replace("1000.0", "1.0")
    in_units = load_of(case_of(write_case, dense, MILLI + 'density = "g/cm3"\n'))
    assert in_units.at(1e-3 * np.array([2.0, 0.3, 0.25])) == pytest.approx([-12.5, 0.0, 0.0])
    # Archimedes: what a box in the liquid feels in all is the weight of the liquid it displaces.
    mesh = case_of(write_case, LIQUID).problem.mesh
    faces = [side(mesh, axis, place) for axis in range(3) for place in (0.0, (2.0, 1.0, 1.0)[axis])]
    pressed = sum(
        nodal_force(mesh, hydrostatic_traction(mesh, face, 1e3, (1.0, 2.0, -10.0), (0.0, 0.0, 9.0)))
        for face in faces
    )
    assert np.sum(pressed, axis=0) == pytest.approx([-2e3, -4e3, 2e4], rel=1e-12)
    look = "\n".join(look_at(case_of(write_case, LIQUID)).lines)
    assert "force on a surface, varying, [-1e+04, 0, 0] N" in look


def test_a_liquid_on_what_is_no_flat_face_below_it_is_refused(write_case: Write) -> None:
    low = LIQUID.replace("[7.0, 7.0, 1.5]", "[0.0, 0.0, 0.75]")
    with pytest.raises(InputError, match=r"load 1: .* reaches 0\.25 m above the free surface"):
        assert case_of(write_case, low).problem
    corner = ("point = [1.999, 0.0, 0.0], normal = [1.0", "point = [1.5, 0.0, 0.0], normal = [1.0")
    with pytest.raises(InputError, match=r"load 1: .* needs a flat face"):
        assert load_case(write_case((FORCE, LIQUID), corner)).problem
    mesh = case_of(write_case, LIQUID).problem.mesh
    end = side(mesh, 0, 2.0)
    with pytest.raises(InputError, match="density = -1"):
        hydrostatic_traction(mesh, end, -1.0, (0, 0, -10), (0, 0, 9))
    with pytest.raises(InputError, match="needs gravity"):
        hydrostatic_traction(mesh, end, 1.0, (0, 0, 0), (0, 0, 9))
    with pytest.raises(InputError, match="see hydrostatic_traction"):
        profile_traction(end, (1, 0, 0), Profile.HYDROSTATIC, (0, 0, 0), (1, 0, 0))


@pytest.mark.parametrize(
    ("load", "complaint"),
    [
        (LIQUID.replace("density = 1000.0\n", ""), "needs density, gravity and free_surface"),
        (LIQUID + "\nstart = [0, 0, 0]", "goes without traction, values, start and end"),
        (LIQUID + "\ntraction = [0, 0, 0]", "goes without traction"),
        (LIQUID.replace("hydrostatic", "linear"), 'goes with profile = "hydrostatic"'),
        (LIQUID.replace("1000.0", "-1000.0"), "greater than 0"),
        (LIQUID.replace("-10.0", "0.0"), "presses nothing"),
        ('kind = "traction"', "needs traction, alone or with a profile, or values"),
        (VALUES + "\ntraction = [1, 0, 0]", "needs traction, alone or with a profile, or values"),
        (VALUES + "\nstart = [1, 0, 0]", "values go without start"),
        (PARABOLA.replace("end = [2, 0, 1]", ""), "profile, start and end go together"),
        (PARABOLA.replace("end = [2, 0, 1]", "end = [2, 0, 0]"), "are the same place"),
        (PARABOLA.replace("parabolic", "parabolik"), "parabolic"),
        (VALUES.replace("traction = [4", "tracton = [4"), "tracton"),
        (VALUES.replace("[4, 0, 0]", "[4, 0, nan]"), "finite"),
        (MOMENT.replace("[0.0, 5.0, 0.0]", "5.0"), "moment"),
    ],
)
def test_bad_tables_are_named(write_case: Write, load: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        case_of(write_case, load)


def test_values_of_no_affine_field_are_named_with_their_load(write_case: Write) -> None:
    bent = """kind = "traction"
values = [
    { at = [2, 0, 0], traction = [0, 0, 0] },
    { at = [2, 0, 0.5], traction = [0, 0, 1] },
    { at = [2, 0, 1], traction = [0, 0, 5] },
]"""
    with pytest.raises(InputError, match=r"load 1: .*not those of one affine field"):
        assert case_of(write_case, bent).problem


def test_what_is_too_large_to_compute_with_is_refused(write_case: Write) -> None:
    with pytest.raises(InputError, match="too large"):
        assert case_of(write_case, VALUES.replace("8]", "1e200]")).problem


def test_check_tells_the_moment_and_draws_the_spread(write_case: Write, tmp_path: Path) -> None:
    case = case_of(write_case, MOMENT)
    lines = "\n".join(look_at(case).lines)
    assert "moment, its force [0, 0, 0] N" in lines
    assert "moment [0, 5, 0] N m about its middle" in lines
    draw_case(case, tmp_path / "case.png")
    assert (tmp_path / "case.png").stat().st_size > 5000


def test_a_profile_taken_as_uniform_is_found(write_case: Write) -> None:
    from palpate.fastsim.statics import solve_static

    case = case_of(write_case, VALUES)
    problem, load = case.problem, load_of(case)
    mean = Traction(load.facets, (2.0, 0.0, 4.0))
    slipped = type(problem)(problem.mesh, problem.material, problem.supports, (mean,))
    answer = StaticResult(Body(problem, case.strain), solve_static(slipped).displacement)
    fits = [found.name for found in load_hypotheses(answer) if found.fits]
    assert fits == ["load 1 (traction) taken as uniform, at its mean"]
