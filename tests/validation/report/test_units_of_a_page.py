"""A report has one system of units: the case's, in its text, plots and pictures."""

from __future__ import annotations

import dataclasses
import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Strain
from palpate.validation.candidates.candidate import function_candidate
from palpate.validation.case import load_case
from palpate.validation.case.units import Units
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.html import write_report
from palpate.validation.report.pictures import first_view, result_views
from palpate.validation.report.viewer import viewer_json
from palpate.validation.states import Verdict

LENGTHS = {"m", "cm", "mm"}
# A number, or three in parentheses, or a heading's bracket before a unit; exponents go with it.
_UNIT = re.compile(
    r"(?:[0-9)]\s|\[)(mm|cm|m|Pa|kPa|MPa|kg|g|kg/m[3³]|g/cm[3³])[23²³]?(?![\w/³²·^*])"
)


def text_of(page: str) -> str:
    """All that is read on a page, plots too, but neither data, scripts nor the case file."""
    page = re.sub(
        r"<(script|style)\b.*?</\1>|<details class=.case.*?</details>", "", page, flags=re.S
    )
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", page)).split())


def units_in(text: str) -> set[str]:
    return set(_UNIT.findall(text))


@pytest.fixture(scope="module")
def softer() -> CaseResult:
    """A block in mm, kPa whose candidate has another modulus: failures and a diagnosis."""
    from palpate.fastsim.statics import solve_static

    def softer(problem):  # type: ignore[no-untyped-def]
        material = dataclasses.replace(problem.material, youngs_modulus=7e3, poissons_ratio=0.3)
        return solve_static(dataclasses.replace(problem, material=material)).displacement

    return judge_case(load_case("block"), candidate=function_candidate(softer))


@pytest.mark.parametrize(
    ("units", "own"),
    [
        (Units(length="mm", stress="kPa", mass="g"), {"mm", "kPa", "kg/m³", "g"}),
        (Units(length="cm", stress="MPa", density="g/cm3"), {"cm", "MPa", "g/cm³", "kg"}),
        (Units(), {"m", "Pa", "kg/m³", "kg"}),
    ],
    ids=lambda given: "" if isinstance(given, set) else given.length,
)
@pytest.mark.usefixtures("no_pictures")
def test_a_page_has_the_units_of_its_case(
    softer: CaseResult, units: Units, own: set[str], tmp_path: Path
) -> None:
    weight = PointMass(softer.problem.mesh.boundary_facets[:1], 0.003)
    problem = dataclasses.replace(softer.problem, masses=(weight,))
    assert softer.verdict is Verdict.FAILED
    shown = dataclasses.replace(
        softer,
        units=units,
        problem=problem,
        evidence={},
        provenance={**softer.provenance, "note": "0.004 m apart"},
    )
    text = text_of(write_report([shown], tmp_path).read_text("utf-8"))
    assert units_in(text) == own
    assert f"{0.004 / units.of('length')[0]:g} {units.length} apart" in text
    # The record's one length too, which is in metres in results.json.
    edge = softer.provenance["mesh"]["longest_edge"] / units.of("length")[0]
    assert f"longest edge {edge:.4g} {units.length}" in text
    # A number that is known by hand, under its heading.
    volume = 40.0 * 25.0 * 20.0 * (1e-3 / units.of("length")[0]) ** 3
    assert f"volume [{units.length}³]" in text
    assert f"{volume:.7g}"[:4].strip("0") in text


def test_pictures_and_the_scene_have_the_units_of_the_case(block: CaseResult) -> None:
    for unit, size in (("mm", 40.0), ("m", 0.04)):
        shown = dataclasses.replace(block, units=Units(length=unit))
        views = [view for views in result_views(shown).values() for view in views]
        values = [s.values_name for view in views for s in view.surfaces if s.values is not None]
        names = {name.partition("\n")[0] for name in values}
        assert names == {f"displacement [{unit}]", f"error [{unit}]"}
        original = views[0].surfaces[0].points
        assert np.ptp(original[:, 0]) == pytest.approx(size)
        scene = json.loads(viewer_json(shown))
        assert scene["unit"] == unit
        found = first_view(shown)
        assert found is not None
    green = [s for s in block.states if s.strain is Strain.GREEN]
    assert scene["solutions"][0]["largest"] < 0.1 * 1e3 * max(s.max_displacement for s in green)


def test_the_scan_sees_metres_and_leaves_words() -> None:
    assert units_in("a point 0.003 m off; area [mm²]; (1, 2, 3) m; 4 kPa") == {"m", "mm", "kPa"}
    assert units_in("9.81 m/s2 and 3 meshes of 2 minutes") == set()
