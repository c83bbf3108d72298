"""Fits to a case's measurements: what made the data is found, and what they cannot tell is said."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_bars import (
    FORCE_CURVE,
    MARKERS,
    TRUE,
    exact_motions,
    measured_bar,
    write_tracks,
)

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element
from palpate.reference import availability
from palpate.validation.case import Case, load_case
from palpate.validation.case.measurements import read_measurements
from palpate.validation.case.variants import value_of
from palpate.validation.judging.measured_model import derivatives, solve_measured
from palpate.validation.states import Verdict
from palpate.validation.studies.fit import FitError
from palpate.validation.studies.fit_case import (
    CaseFit,
    LastStep,
    fit_case,
    law_fits,
    parameters_of,
    preferred,
)
from palpate.validation.studies.fit_page import fitted_text

MODULUS, POISSON = TRUE
KEYS = [MODULUS, POISSON]


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return measured_bar(tmp_path_factory.mktemp("bar"))


def fitted(case: Case, keys: list[str] = KEYS[:1], **options: object) -> CaseFit:
    options = {"last_step": LastStep.NONE} | options
    bounds = {POISSON: (0.2, 0.48)} if POISSON in keys else {}
    return fit_case(case, parameters_of(case, keys, bounds), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["hung", "bare"])
def test_derivatives_are_those_of_whole_solutions(bar: Case, name: str) -> None:
    measured = read_measurements(bar, [name])[name]
    scales = {MODULUS: 1e5, POISSON: 0.1, "mass[0].mass": 10.0}
    there = solve_measured(measured, measured.at(TRUE), element=Element.SMOOTHED)
    found = derivatives(measured, TRUE, scales, there, element=Element.SMOOTHED)
    for k, (key, scale) in enumerate(scales.items()):
        here, step = TRUE.get(key, value_of(bar, key)), 1e-3 * scale
        low, high = (
            solve_measured(
                measured, measured.at({**TRUE, key: here + s * step}), element=Element.SMOOTHED
            ).values
            for s in (-1.0, 1.0)
        )
        expected = (high - low) / (2.0 * step)
        # A central difference is off by the square of the relative step.
        assert found[:, k] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max() + 1e-18)
    # What an experiment sets itself does not move it.
    assert np.any(found[:, 2]) == (name == "hung")


def test_both_runs_of_both_loads_find_the_modulus(bar: Case) -> None:
    found = fitted(bar, by_run=True)
    off = abs(found.values[MODULUS] - 130e3)
    assert off <= found.fit.half_widths[0] < 0.02 * 130e3
    assert found.used == ("hung", "bare")
    assert len(found.by_run) == 2
    mean = np.mean([values[0] for values in found.by_run])
    assert mean == pytest.approx(found.values[MODULUS], rel=1e-3)


def test_a_slender_bar_that_bends_shows_its_modulus_and_not_poissons_ratio(tmp_path: Path) -> None:
    found = fitted(measured_bar(tmp_path, noise=0.4), KEYS)
    assert found.fit.undetermined == (POISSON,)
    (blind,) = found.fit.blind
    assert abs(blind.direction[1]) > 0.95
    assert "press it between plates" in found.remedy(POISSON)
    assert abs(found.values[MODULUS] - 130e3) <= found.fit.half_widths[0]


def test_what_was_held_out_is_predicted_and_judged(bar: Case) -> None:
    found = fitted(bar, hold_out=["hung"])
    assert found.used == ("bare",)
    rows = found.held_out["hung"]
    assert [row.verdict for row in rows] == [Verdict.PASSED] * 9
    for row in rows:
        assert row.u_val == pytest.approx(np.hypot(row.input, row.data))  # no mesh is better
        assert abs(row.error) < 4.0 * row.u_val
    error, doubt = found.score()
    assert 0.0 < error < doubt + 0.1


def test_linear_tetrahedra_fit_a_modulus_that_is_too_soft(bar: Case) -> None:
    """By what they lock. A finer mesh takes some of it out again, the reference most."""
    alone = fitted(bar, element=Element.LINEAR).values[MODULUS]
    locked = 1.0 - alone / 130e3
    assert locked > 0.1
    finer = fitted(bar, element=Element.LINEAR, last_step=LastStep.MESH).values[MODULUS]
    assert 0.0 < 1.0 - finer / 130e3 < 0.8 * locked


@pytest.mark.skipif(not availability.is_available(), reason="needs FEniCSx")
def test_the_last_step_by_the_reference_finds_what_made_the_data(tmp_path: Path) -> None:
    """Data of a far finer mesh: coarse cells alone are off by more than the interval."""
    case = measured_bar(tmp_path, noise=0.02)
    fine = load_case(tmp_path / "bar.toml").path
    text = fine.read_text("utf-8").replace("edge_length = 10.0", "edge_length = 3.0")
    (tmp_path / "fine.toml").write_text(text, "utf-8")
    rng = np.random.default_rng(5)
    for name, motions in exact_motions(load_case(tmp_path / "fine.toml")).items():
        for run in (1, 2):
            noisy = motions + 0.02 * rng.standard_normal(motions.shape)
            write_tracks(tmp_path / f"{name}_{run}.csv", dict(zip(MARKERS, noisy, strict=True)))
    found = fitted(case, last_step=LastStep.REFERENCE)
    coarse = abs(found.coarse[0] / 130e3 - 1.0)
    better = abs(found.values[MODULUS] / 130e3 - 1.0)
    assert coarse > 0.03
    assert better < 0.4 * coarse


def test_every_law_is_fitted_and_none_wins_where_intervals_overlap(bar: Case) -> None:
    laws = [Law.NEO_HOOKEAN_STABLE, Law.NEO_HOOKEAN]
    found = law_fits(
        bar, laws, [MODULUS], None, hold_out=["hung"], last_step=LastStep.NONE
    )  # fmt: skip
    assert list(found) == [str(law) for law in laws]
    assert preferred(found) is None  # a bar that bends by small strains cannot tell these
    with pytest.raises(InputError, match="names a law twice"):
        law_fits(bar, laws[:1] * 2, [MODULUS], None)


def test_the_fitted_case_is_a_case_with_its_values_and_their_uncertainty(
    bar: Case, tmp_path: Path
) -> None:
    found = fitted(bar, KEYS, last_step=LastStep.NONE)
    for file in bar.files:
        shutil.copyfile(file, tmp_path / file.name)
    (tmp_path / "again.toml").write_text(fitted_text(found), "utf-8")
    again = load_case(tmp_path / "again.toml")
    for key, value in found.values.items():
        assert value_of(again, key) == pytest.approx(value, rel=1e-7)
    assert set(again.spec.evidence.fitted) == set(KEYS)
    (uncertain,) = again.spec.uncertainty
    assert uncertain.inputs == tuple(KEYS)
    assert uncertain.standard[0] == pytest.approx(np.sqrt(found.fit.covariance[0, 0]), rel=0.01)
    assert abs(uncertain.correlation[0][1]) == pytest.approx(
        abs(found.fit.correlation[0, 1]), abs=1e-3
    )
    assert [m.set for m in again.spec.measurement] == [m.set for m in bar.spec.measurement]
    # From there a fit moves no more.
    once_more = fitted(again, KEYS)
    for key, value in found.values.items():
        assert once_more.values[key] == pytest.approx(value, rel=1e-4)


def test_the_command_leaves_page_tables_and_case(
    bar: Case, tmp_path: Path, palpate_run: Callable
) -> None:
    ended = palpate_run(
        "fit", bar.path, "--parameter", MODULUS, "--hold-out", "hung", "--last-step", "none",
        "-o", tmp_path / "out",
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert "hung is predicted to 2 mm" in ended.stdout
    written = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))
    (fit,) = written["fits"].values()
    assert fit["fitted_to"] == ["bare"]
    assert fit["last_step"] == "none"
    with (tmp_path / "out" / "measured-hung.csv").open(encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    assert {row["verdict"] for row in rows} == {"passed"}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "hung, held out" in page
    again = load_case(tmp_path / "out" / "bar-fitted.toml")
    assert value_of(again, MODULUS) == pytest.approx(fit["values"][MODULUS], rel=1e-7)
    read_measurements(again)  # its files lie beside it


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--parameter", "material.young"], "did you mean 'material.youngs_modulus'"),
        (["--parameter", MODULUS, "--bounds", f"{POISSON}=0.2:0.4"], "it is not fitted"),
        (["--parameter", MODULUS, "--bounds", f"{MODULUS}=2e5"], "write KEY=LOW:HIGH"),
        (["--parameter", MODULUS, "--bounds", f"{MODULUS}=2e5:3e5"], "needs lower < start < upper"),
        (["--parameter", MODULUS, "--hold-out", "hang"], "has no measurement 'hang'"),
        (["--parameter", MODULUS, "--data", "hung", "--hold-out", "hung"], "name it once"),
        (["--parameter", MODULUS, "--hold-out", "hung", "--hold-out", "bare"], "is left to fit to"),
        (["--parameter", MODULUS, "--law", "neo-hookean", "--law", "neo-hookean-stable"],
         "give --hold-out"),
        (["--parameter", MODULUS, "--confidence", "1.5", "--last-step", "none"],
         "between 0 and 1"),
    ],
)  # fmt: skip
def test_what_cannot_be_fitted_is_refused_and_nothing_is_left(
    bar: Case, tmp_path: Path, palpate_run: Callable, words: list[str], says: str
) -> None:
    ended = palpate_run("fit", bar.path, *words, "-o", tmp_path / "out")
    assert ended.returncode == 2
    assert says in ended.stderr
    assert not list(tmp_path.iterdir())


def test_a_case_without_measurements_is_named(tmp_path: Path, palpate_run: Callable) -> None:
    ended = palpate_run("fit", "block", "--parameter", MODULUS, "-o", tmp_path / "out")
    assert ended.returncode == 2
    assert "block.toml has no [[measurement]]" in ended.stderr


def test_a_number_that_is_0_needs_bounds(bar: Case) -> None:
    with pytest.raises(FitError, match="state --bounds load"):
        parameters_of(bar, ["load[0].acceleration[0]"])
    (one,) = parameters_of(bar, ["load[0].acceleration[2]"])
    assert (one.lower, one.upper) == (-39.24, -2.4525)


@pytest.mark.nightly
@pytest.mark.parametrize("count", [1, 2])
def test_intervals_on_a_body_contain_what_made_the_data(tmp_path: Path, count: int) -> None:
    """100 draws of noise: 90 to 99 intervals at 95 %, each within 1.3 of Cramér and Rao's bound.

    Moduli are told apart by a bar that is also weighed while it hangs: density is the second.
    """
    keys = [MODULUS, "mass[0].mass"][:count]
    true = {MODULUS: 130e3, "mass[0].mass": 10.0}
    case = measured_bar(tmp_path)
    exact = exact_motions(case)
    inside, widths = np.zeros(count), []
    for draw in range(100):
        rng = np.random.default_rng(1000 + draw)
        for name, motions in exact.items():
            for run in (1, 2):
                noisy = motions + 0.1 * rng.standard_normal(motions.shape)
                write_tracks(tmp_path / f"{name}_{run}.csv", dict(zip(MARKERS, noisy, strict=True)))
        found = fitted(case, keys)
        off = [abs(found.values[key] - true[key]) for key in keys]
        inside += np.array(off) <= found.fit.half_widths
        widths.append(found.fit.half_widths)
    assert np.all((inside >= 90) & (inside <= 99)), inside
    measured = read_measurements(case)
    rows = []
    for one in measured.values():
        there = solve_measured(one, one.at(true), element=Element.SMOOTHED)
        slope = derivatives(one, true, true, there, element=Element.SMOOTHED)[:, :count]
        rows.append(slope / (0.1e-3 / np.sqrt(2.0)))
    information = np.vstack(rows).T @ np.vstack(rows)
    bound = 1.96 * np.sqrt(np.diag(np.linalg.inv(information)))
    assert np.all(np.median(widths, axis=0) < 1.3 * bound)


PRESS = (
    """
schema = 1
title = "A gel pressed by a ball"
[units]
length = "mm"
stress = "kPa"
[geometry]
shape = "box"
size = [40.0, 40.0, 20.0]
edge_length = 8.0
[material]
law = "neo-hookean-stable"
youngs_modulus = 10.0
poissons_ratio = 0.45
[[support]]
region = { half_space = { point = [0.0, 0.0, 0.01], normal = [0.0, 0.0, -1.0] } }
[[tool]]
shape = "sphere"
radius = 12.0
contact = "facets"
region = { half_space = { point = [0.0, 0.0, 19.99], normal = [0.0, 0.0, 1.0] } }
pose = [
  { time = 0.0, position = [20.0, 20.0, 32.01] },
  { time = 1.0, position = [20.0, 20.0, 28.01] },
]
[[check]]
metric = "displacement_l2"
limit = 1e-6
reason = "the same equations"
"""
    + FORCE_CURVE
)


def test_a_curve_of_force_over_depth_shows_the_modulus(tmp_path: Path) -> None:
    (tmp_path / "gel.toml").write_text(PRESS, "utf-8")
    (tmp_path / "press.csv").write_text("depth_mm,force_N\n1,1\n2,2\n3,3\n4,4\n", "utf-8")
    case = load_case(tmp_path / "gel.toml")
    measured = read_measurements(case)["press"]
    made = solve_measured(
        measured, measured.at({MODULUS: 14.0}), element=Element.SMOOTHED
    ).values  # fmt: skip
    assert np.all(np.diff(made) > 0.0)  # the deeper, the more
    noisy = made + 0.002 * np.random.default_rng(1).standard_normal(4)
    rows = [f"{d},{force:.9f}" for d, force in zip((1, 2, 3, 4), noisy, strict=True)]
    (tmp_path / "press.csv").write_text("\n".join(["depth_mm,force_N", *rows]), "utf-8")
    found = fitted(load_case(tmp_path / "gel.toml"))
    assert abs(found.values[MODULUS] - 14.0) <= found.fit.half_widths[0] < 0.05 * 14.0
    # A force that is all modulus is in proportion to it.
    slope = derivatives(
        measured, {MODULUS: 14.0}, {MODULUS: 14.0}, solve_measured(
            measured, measured.at({MODULUS: 14.0}), element=Element.SMOOTHED
        ), element=Element.SMOOTHED,
    )  # fmt: skip
    assert slope[:, 0] == pytest.approx(made / 14.0, rel=1e-6)
