"""Loads that vary over a face, in case files: what they build, what is refused, what is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.errors import InputError
from palpate.validation.case import Case, load_case
from palpate.validation.diagnosis.load_slips import load_explanations
from palpate.validation.diagnosis.static_answer import StaticAnswer
from palpate.validation.mechanics.body import Body
from palpate.validation.preview.look import look_at
from palpate.validation.preview.picture import draw_case

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


@pytest.mark.parametrize(
    ("load", "complaint"),
    [
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
    draw_case(case, tmp_path / "case.png", by=("matplotlib",))
    assert (tmp_path / "case.png").stat().st_size > 5000


def test_a_profile_taken_as_uniform_is_found(write_case: Write) -> None:
    from palpate.fastsim.statics import solve_static

    case = case_of(write_case, VALUES)
    problem, load = case.problem, load_of(case)
    mean = Traction(load.facets, (2.0, 0.0, 4.0))
    slipped = type(problem)(problem.mesh, problem.material, problem.supports, (mean,))
    answer = StaticAnswer(Body(problem, case.strain), solve_static(slipped).displacement)
    fits = [found.name for found in load_explanations(answer) if found.fits]
    assert fits == ["load 1 (traction) taken as uniform, at its mean"]
