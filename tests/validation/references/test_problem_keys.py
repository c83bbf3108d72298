"""Keys of problems as version 0.1 made them: a stored reference or answer belongs by these."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.problem import Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import ContactRule, SphereShape, ToolPath
from palpate.validation.case import load_case
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.references.stored import problem_key

# Of version 0.1: of the stored reference, and of the folder for other simulators (Green strain).
KEYS_OF_0_1 = {
    # A pressure, a weight and a pull.
    "block": (
        "5ddd43083f32cc535a938c7879f2e936838b976ca3e8f9c4d3f7a9ce19e38b77",
        "e9d43dbf1cb5b1aae7b9151dd104f9593e064f96ee738d844d2bbf04a43edb7c",
    ),
    # A tool; a tool that moves.
    "press": (
        "9b123c551dff7d268a8c9e817700c0bca68fc42779fc0dc8ee42a27d54e46964",
        "06bd6cdb4fde5751a49b785994fe3892327cd80db21a5e69bc15f370aa4ffa40",
    ),
    "slide": (
        "be7bb46179201e5b5881bf523b45ffaf4466cf78ee2cdf3dbb70c8f17adb86e1",
        "745cd4a82fba73f7a35d030363b8173506b7866171335defab2003339c1f7048",
    ),
    # A motion without a step; supports by component with a displacement.
    "csm3": (
        "f61fb8e7e23d0968c36f02ef85c33b186176798c8adb83dd73d47af77390bb16",
        "68e12a538a184f7480504913439eb6a6270f461c5572326078c85e8c64317241",
    ),
    "stretch": (
        "e75b340f54a1937230d6cad569597acbe652d7400704e0452a7978bb129d0a81",
        "1ca8a093b412dfdbb203b00dc484ad11b2cda385362a377d404215937aa444c5",
    ),
}


def problem_of_0_1(name: str) -> Problem:
    """As it was then: a ball of 12 mm in press, at vertices, whose tool slide moved."""
    if name not in ("press", "slide"):
        return load_case(name).problem
    still = load_case("press").problem
    places = 1e-3 * np.array([[24.0, 17.0, 32.0], [26.0, 18.0, 28.0]])
    down = ToolPath(np.arange(2.0), places)
    ball = dataclasses.replace(
        still.tools[0], shape=SphereShape(0.012), path=down, contact=ContactRule.VERTICES
    )
    still = dataclasses.replace(still, tools=(ball,))
    if name == "press":
        return still
    positions = [[0.022, 0.016, 0.0325], [0.023, 0.017, 0.029], [0.037, 0.022, 0.029]]
    path = ToolPath(np.array([0.0, 0.15, 0.4]), np.array(positions))
    return dataclasses.replace(
        still,
        time=TimeSpan(0.4, 5e-4, 5.0, 40),
        tools=(dataclasses.replace(still.tools[0], path=path),),
    )


@pytest.mark.parametrize("name", KEYS_OF_0_1)
def test_a_problem_with_optional_fields_at_their_defaults_has_its_key_of_0_1(name):
    problem = problem_of_0_1(name)
    assert (problem_key(problem), case_key(problem, Strain.GREEN)) == KEYS_OF_0_1[name]
