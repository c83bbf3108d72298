"""A fit finds what made the data, within its own intervals, and says what they cannot tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.validation.states import Verdict
from palpate.validation.studies.fit import (
    Experiment,
    Fit,
    FitError,
    Parameter,
    Validation,
    fit,
    predict_held_out,
)

TIME = np.linspace(0.0, 2.0, 30)
NOISE = 0.02
# A swing that decays: amplitude and damping; both are told by its envelope.
TRUE = np.array([1.0, 0.7])
PARAMETERS = (Parameter("amplitude", 0.5, 0.1, 3.0), Parameter("damping", 1.5, 0.0, 4.0))


def decay(values: np.ndarray) -> np.ndarray:
    return np.asarray(values[0] * np.exp(-values[1] * TIME))


def slope(values: np.ndarray) -> np.ndarray:
    shape = np.exp(-values[1] * TIME)
    return np.column_stack([shape, -values[0] * TIME * shape])


def experiment(values: np.ndarray, name: str = "decay", **more: object) -> Experiment:
    labels = [f"{t:.2f} s" for t in TIME]
    return Experiment(name, labels, values, np.full(len(TIME), NOISE), decay, **more)  # type: ignore[arg-type]


def noisy(seed: int) -> np.ndarray:
    return decay(TRUE) + NOISE * np.random.default_rng(seed).standard_normal(len(TIME))


@pytest.mark.parametrize("derivatives", [slope, None])
def test_without_noise_it_finds_what_made_the_data(derivatives: object) -> None:
    found = fit(PARAMETERS, [experiment(decay(TRUE), derivatives=derivatives)])
    assert found.values == pytest.approx(TRUE, rel=1e-6)
    assert found.blind == ()


def test_intervals_cover_the_truth_as_often_as_they_say_and_are_as_narrow_as_can_be() -> None:
    fits = [fit(PARAMETERS, [experiment(noisy(seed), derivatives=slope)]) for seed in range(100)]
    inside = np.array([np.abs(f.values - TRUE) <= f.half_widths for f in fits])
    # 95 of 100 draws; a binomial count is within 90 and 99 in 97 of 100 such studies.
    assert (inside.sum(axis=0) >= 90).all()
    assert (inside.sum(axis=0) <= 99).all()
    information = slope(TRUE).T @ slope(TRUE) / NOISE**2
    bound = 1.96 * np.sqrt(np.diag(np.linalg.inv(information)))  # Cramer and Rao's, at 95 %
    widths = np.median([f.half_widths for f in fits], axis=0)
    assert (widths <= 1.3 * bound).all()
    assert (widths >= bound / 1.3).all()


def test_a_factor_that_is_in_two_parameters_is_not_identifiable() -> None:
    """Only the product of two parameters is in the data: one combination is blind."""

    def product(values: np.ndarray) -> np.ndarray:
        return np.asarray(values[0] * values[1] * np.exp(-TIME))

    data = product(np.array([1.0, 2.0])) + NOISE * np.random.default_rng(1).standard_normal(30)
    given = Experiment("product", ["x"] * 30, data, np.full(30, NOISE), product)
    found = fit([Parameter("a", 1.1, 0.5, 1.5), Parameter("b", 1.9, 1.5, 2.5)], [given])
    (blind,) = found.blind
    # d(ab) = 0 along (a, -b); over half the bounds' width, 0.5 of each.
    along = np.array([found.values[0], -found.values[1]])
    along /= np.linalg.norm(along)
    assert abs(float(blind.direction @ along)) == pytest.approx(1.0, abs=1e-3)
    assert found.undetermined == ("a", "b")
    assert found.values[0] * found.values[1] == pytest.approx(2.0, abs=0.1)


def test_the_last_step_keeps_the_error_of_a_coarse_model_out_of_the_parameters() -> None:
    """A coarse model is 5 % too stiff: alone it would fit an amplitude that is 5 % off."""

    def coarse(values: np.ndarray) -> np.ndarray:
        return 0.95 * decay(values)

    labels, spread = ["x"] * len(TIME), np.full(len(TIME), NOISE)
    alone = fit(PARAMETERS, [Experiment("x", labels, decay(TRUE), spread, coarse)])
    both = fit(PARAMETERS, [Experiment("x", labels, decay(TRUE), spread, coarse, finer=decay)])
    assert alone.values[0] == pytest.approx(TRUE[0] / 0.95, rel=1e-6)
    # A step by derivatives of the coarse model leaves 5 % of 5 %.
    assert both.values[0] == pytest.approx(TRUE[0], rel=0.05**2 * 1.2)
    assert both.step is not None
    assert both.step[0] == pytest.approx(both.values[0] - alone.values[0], rel=1e-12)


def test_a_finer_model_that_is_far_from_the_coarse_one_is_refused() -> None:
    def other(values: np.ndarray) -> np.ndarray:
        return 0.2 * decay(values)

    with pytest.raises(FitError, match="search on a finer mesh"):
        fit(PARAMETERS, [experiment(decay(TRUE), finer=other)])


def test_residuals_and_scatter_are_those_of_the_noise() -> None:
    found = fit(PARAMETERS, [experiment(noisy(3), "a"), experiment(noisy(4), "b")])
    assert found.degrees == 58
    # s is known to 1 / sqrt(2 x 58) = 9 %: three times that.
    assert found.scatter == pytest.approx(1.0, abs=0.28)
    assert found.residuals["b"] == pytest.approx(noisy(4) - decay(found.values), abs=1e-12)
    assert found.correlation[0, 0] == pytest.approx(1.0, rel=1e-12)
    assert 0.3 < found.correlation[0, 1] < 0.9  # more at the start may decay faster


@pytest.mark.parametrize(
    ("error", "verdict"),
    [(0.5, Verdict.PASSED), (-0.8, Verdict.PASSED), (0.9, Verdict.INCONCLUSIVE),
     (-1.1, Verdict.INCONCLUSIVE), (1.3, Verdict.FAILED), (-1.3, Verdict.FAILED)],
)  # fmt: skip
def test_a_verdict_needs_the_whole_interval_on_one_side(error: float, verdict: Verdict) -> None:
    found = Validation(error, 0.06, 0.06, math.sqrt(0.01 - 2 * 0.0036), 1.0)
    assert found.u_val == pytest.approx(0.1, rel=1e-12)
    assert found.verdict is verdict


def test_an_uncertainty_that_swallows_the_error_passes_nothing() -> None:
    assert Validation(0.0, 0.0, 0.0, 1.0, 1.0).verdict is Verdict.INCONCLUSIVE


def held_out(found: Fit, factor: float) -> list[Verdict]:
    value = factor * TRUE[0] * np.exp(-TRUE[1] * np.array([3.0]))
    ahead = Experiment("later", ["3 s"], value, np.array([0.002]),
                       lambda v: np.array([v[0] * np.exp(-3.0 * v[1])]))  # fmt: skip
    rows = predict_held_out(found, ahead, limit=np.array([0.1]), numerical=np.zeros(1))
    return [row.verdict for row in rows]


def test_what_was_set_apart_is_predicted_with_the_uncertainty_of_the_fit() -> None:
    found = fit(PARAMETERS, [experiment(noisy(7), derivatives=slope)])
    assert held_out(found, 1.0) == [Verdict.PASSED]
    assert held_out(found, 3.0) == [Verdict.FAILED]
    ahead = Experiment("later", ["3 s"], np.zeros(1), np.array([1e-9]),
                       lambda v: np.array([v[0] * np.exp(-3.0 * v[1])]))  # fmt: skip
    (row,) = predict_held_out(found, ahead, limit=np.array([1.0]), numerical=np.zeros(1))
    fits = [fit(PARAMETERS, [experiment(noisy(s), derivatives=slope)]).values for s in range(100)]
    spread = float(np.std([v[0] * np.exp(-3.0 * v[1]) for v in fits]))
    # A standard deviation of 100 draws is known to 7 %, s of one fit to 13 %: twice their sum.
    assert row.input == pytest.approx(spread, rel=0.4)


def test_what_makes_no_fit_is_named() -> None:
    one = experiment(decay(TRUE))
    with pytest.raises(FitError, match="lower < start < upper"):
        Parameter("x", 2.0, 0.0, 1.0)
    with pytest.raises(FitError, match="named once"):
        fit([PARAMETERS[0], PARAMETERS[0]], [one])
    with pytest.raises(FitError, match="measure more"):
        fit(PARAMETERS, [Experiment("x", ["a"], np.ones(1), np.ones(1), lambda v: v[:1])])
    with pytest.raises(FitError, match="uncertainty of b is 0"):
        Experiment("x", ["a", "b"], np.ones(2), np.array([1.0, 0.0]), lambda v: v)
    with pytest.raises(FitError, match="experiment x: the prediction"):
        fit(PARAMETERS, [Experiment("x", ["a"] * 3, np.ones(3), np.ones(3), lambda v: v * np.nan)])
