"""Markers on a bar that bends: their pins, derivatives, and what a fit to them can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.meshes.problem import Element, Problem
from palpate.meshes.transforms import rotation
from palpate.validation.case import load_case
from palpate.validation.studies.fit import FitError, Parameter, fit
from palpate.validation.studies.fit_bodies import MarkedBody, pin_on

TEXT = """
schema = 1
title = "A bar that bends by its weight"
units = { length = "mm" }
[material]
law = "neo-hookean-stable"
youngs_modulus = 100e3
poissons_ratio = 0.4
density = 1e3
[geometry]
shape = "box"
size = [100.0, 20.0, 20.0]
edge_length = 10.0
[[support]]
region = { half_space = { point = [0.1, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]
"""
PLACES = {
    "above": np.array([0.1, 0.01, 0.026]),
    "left": np.array([0.1, -0.006, 0.015]),
    "middle": np.array([0.05, 0.01, 0.026]),
}
TRUE = np.array([130e3, 0.35])
PARAMETERS = (
    Parameter("material.youngs_modulus", 100e3, 50e3, 300e3),
    Parameter("material.poissons_ratio", 0.4, 0.2, 0.48),
)
NOISE = 1e-4  # [m], a hundredth of the drop


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    path = tmp_path_factory.mktemp("bar") / "bar.toml"
    path.write_text(TEXT, "utf-8")
    return load_case(path).problem


def marked(bar: Problem, count: int = 2, element: Element = Element.SMOOTHED) -> MarkedBody:
    def make(values: np.ndarray) -> Problem:
        moduli = dict(zip(("youngs_modulus", "poissons_ratio"), map(float, values), strict=False))
        return replace(bar, material=replace(bar.material, **moduli))

    pins = {name: pin_on(bar.mesh, place, radius=6e-3) for name, place in PLACES.items()}
    return MarkedBody(make, pins, np.array([100e3, 0.1])[:count], element=element)


def by_marker(moved: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(PLACES, moved.reshape(-1, 3), strict=True))


def test_a_pin_turns_with_the_face_it_sticks_to(bar: Problem) -> None:
    turn, shift = rotation((0.3, 1.0, 0.2), 40.0), np.array([0.01, 0.02, -0.03])
    rest = bar.mesh.points
    for place in PLACES.values():
        pin = pin_on(bar.mesh, place, radius=6e-3)
        found = pin.moved(rest, rest @ turn.T + shift - rest)
        assert found == pytest.approx(turn @ place + shift - place, abs=1e-14)


def test_derivatives_are_those_of_whole_solutions(bar: Problem) -> None:
    body = marked(bar)
    found = body.derivatives(TRUE)
    for k, step in enumerate((1e-3 * TRUE[0], 1e-3)):
        change = np.zeros(2)
        change[k] = step
        expected = (body.predict(TRUE + change) - body.predict(TRUE - change)) / (2.0 * step)
        # A central difference is off by the square of the relative step.
        assert found[:, k] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def test_a_slender_bar_that_bends_tells_its_modulus_and_not_poissons_ratio(bar: Problem) -> None:
    body = marked(bar)
    noise = NOISE * np.random.default_rng(36).standard_normal(9)
    measured = body.predict(TRUE) + noise
    found = fit(PARAMETERS, [body.experiment("weight", by_marker(measured), NOISE)])
    assert found.undetermined == ("material.poissons_ratio",)
    (blind,) = found.blind
    assert abs(blind.direction[1]) > 0.95
    assert abs(found.values[0] - TRUE[0]) <= found.half_widths[0]


def test_linear_tetrahedra_would_fit_a_modulus_that_is_too_soft(bar: Problem) -> None:
    """By what they lock; the last step by the model that made the data takes it out again."""
    smoothed, linear = marked(bar, 1), marked(bar, 1, Element.LINEAR)
    measured = by_marker(smoothed.predict(TRUE[:1]))
    (modulus,) = PARAMETERS[:1]
    alone = fit([modulus], [linear.experiment("weight", measured, NOISE)])
    locked = alone.values[0] / TRUE[0]
    assert locked < 0.9
    both = fit([modulus], [linear.experiment("weight", measured, NOISE, smoothed)])
    # One step of Gauss and Newton leaves the square of what it corrects.
    assert abs(both.values[0] / TRUE[0] - 1.0) < 2.0 * (1.0 - locked) ** 2
    assert abs(both.values[0] / TRUE[0] - 1.0) < 0.5 * (1.0 - locked)


def test_a_marker_that_was_not_measured_is_named(bar: Problem) -> None:
    with pytest.raises(FitError, match="left was not measured"):
        marked(bar, 1).experiment("x", {"above": np.zeros(3), "middle": np.zeros(3)}, NOISE)
